"""A campaign at work: waves proposed, simulated on an executor, committed."""
