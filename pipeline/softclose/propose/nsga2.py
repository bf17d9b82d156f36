"""Owns the NSGA-II engine: a front of several objectives in one campaign, instead of the minimum of g alone.

pymoo's operators: survival by rank and crowding, binary tournaments, simulated binary crossover and polynomial mutation
(Deb et al. 2002). Parents are the survivors of all candidates so far, so that a generation is a function of the records
alone and a killed campaign goes on bit-identically.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np

from softclose.metrics.ranking import BEYOND_CM_S, is_beyond
from softclose.plugins import EngineError
from softclose.propose.objectives import front_values, worst_values
from softclose.propose.origins import NSGA2, SOBOL
from softclose.propose.protocol import Observation, Problem, Proposal, Wave, even_waves, search_history
from softclose.propose.sobol import initial_points
from softclose.waveform import Waveform

GENERATION = 64
"""Candidates of a generation, and parents of the next."""


class Nsga2Engine:
    """Non-dominated sorting with crowding, a generation a wave."""

    def __init__(self) -> None:
        try:
            import pymoo  # noqa: F401 - asked for here, so that a campaign does not fail at its second wave
        except ImportError as e:
            raise EngineError(f"engine nsga2 needs pymoo ({e}): pip install pymoo") from e

    def wave_sizes(self, problem: Problem, budget: int) -> list[int]:
        """The user's own waveforms beside the first generation, then a generation each."""
        first = min(problem.n_initial_waveforms + GENERATION, budget)
        return [first, *even_waves(budget, GENERATION, first)]

    def propose_wave(
        self, problem: Problem, wave: Wave, history: Sequence[Observation], pending: Sequence[Waveform]
    ) -> list[Proposal]:
        """Space-filling points at first, then the offspring of the best front so far."""
        seen = [o for o in search_history(problem, history) if not o.failed]
        if len(seen) < GENERATION // 2:
            points, origin = initial_points(problem, wave.start - problem.n_initial_waveforms, wave.size), SOBOL
        else:
            points, origin = _offspring(problem, seen, wave), NSGA2
        waveforms = problem.space.waveforms(points)
        return [Proposal(waveform=w, origin=origin, n_switches=wave.n_switches) for w in waveforms]


def _offspring(problem: Problem, seen: Sequence[Observation], wave: Wave) -> Any:
    """(wave.size, d) points in the unit cube."""
    from pymoo.algorithms.moo.nsga2 import RankAndCrowding, binary_tournament
    from pymoo.core.individual import Individual
    from pymoo.core.mating import Mating
    from pymoo.core.population import Population
    from pymoo.core.problem import Problem as Cube
    from pymoo.operators.crossover.sbx import SBX
    from pymoo.operators.mutation.pm import PM
    from pymoo.operators.selection.tournament import TournamentSelection

    space, draw = problem.space, problem.generator("nsga2", wave.index)
    objectives = problem.config.optimiser.objectives
    cube = Cube(n_var=space.dim, n_obj=len(objectives), xl=0.0, xu=1.0)
    coordinates, kept = space.coordinates_of_all([o.waveform for o in seen])
    values = front_values(problem.config, [seen[i] for i in kept], objectives)
    # An undefined v_u counts as in g.
    values = np.where(np.isfinite(values), values, worst_values(problem.config, objectives, values))
    # Who leaves too many open is worse than anybody in every objective, and the more so the more it leaves open.
    ranks = np.array([seen[i].rank_cm_s for i in kept])
    beyond = is_beyond(ranks)
    values[beyond] = values.max(axis=0, initial=0.0) + (ranks[beyond] - BEYOND_CM_S)[:, None]
    none = np.zeros(0)  # no constraints: the space repairs what is not admissible
    people = Population.create(
        *(Individual(X=x, F=f, G=none, H=none) for x, f in zip(coordinates, values, strict=True))
    )
    parents = RankAndCrowding().do(cube, people, n_survive=min(GENERATION, len(people)), random_state=draw)
    mating = Mating(
        TournamentSelection(func_comp=binary_tournament),
        SBX(eta=15, prob=0.9),
        PM(eta=20),
        eliminate_duplicates=None,
        n_max_iterations=10,
    )
    algorithm = SimpleNamespace(tournament_type="comp_by_dom_and_crowding", random_state=draw)
    children = mating.do(cube, parents, wave.size, random_state=draw, algorithm=algorithm)
    return np.clip(np.asarray(children.get("X"), dtype=np.float64), 0.0, 1.0)
