"""What a response is worth: the objective, intervals, paired comparisons, Pareto fronts."""
