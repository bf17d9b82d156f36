"""Owns the CMA-ES engine: the library `cma`, replayed against the records; restarts from fresh points when it
converges."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from threadpoolctl import threadpool_limits

from softclose.propose.protocol import Observation, Problem, Proposal, search_history
from softclose.propose.replay import Answers, CmaStart, cma_points
from softclose.propose.sobol import initial_point
from softclose.waveform import Waveform

SIGMA = 0.25
"""Standard deviation of the first generation, in units of the cube."""


class CmaesEngine:
    """Covariance matrix adaptation, from the middle of the cube, then from points of the Sobol sequence."""

    def propose(
        self, problem: Problem, index: int, history: Sequence[Observation], pending: Sequence[Waveform]
    ) -> Proposal:
        """The next point of the current generation."""
        space = problem.space
        answers = Answers(space, search_history(problem, history))
        origin, point = "cmaes", None
        with threadpool_limits(limits=1):
            for run in range(index + 1):
                begin = np.full(space.dim, 0.5) if run == 0 else initial_point(problem, run - 1, "cmaes")
                start = CmaStart(point=tuple(begin.tolist()), sigma=SIGMA, population=0)
                generator = partial(problem.generator, "cmaes", run)
                identity = ("cmaes", problem.config.campaign.seed, run)
                point, mean = cma_points(start, answers, pending, space, generator, identity)
                if point is not None:
                    break
                if len(pending):  # the generation is in flight: what waits for it may as well look near its mean
                    spread = problem.generator("cmaespad", index).standard_normal(space.dim)
                    origin, point = "cmaes-extra", np.clip(mean + 0.5 * SIGMA * spread, 0.0, 1.0)
                    break
        if point is None:
            origin, point = "sobol", initial_point(problem, index)
        return Proposal(waveform=space.waveform(point), origin=origin, n_switches=problem.config.population.n_switches)
