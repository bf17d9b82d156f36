"""Owns the DIRECT engine: `scipy.optimize.direct` over the unit cube, replayed against the records."""

from __future__ import annotations

from collections.abc import Sequence

from scipy.optimize import direct

from softclose.propose.origins import DIRECT, SOBOL
from softclose.propose.protocol import Observation, Problem, Proposal, search_history
from softclose.propose.replay import Answers, next_point
from softclose.propose.sobol import initial_point
from softclose.waveform import Waveform


class DirectEngine:
    """Dividing rectangles (Jones et al. 1993), the algorithm that the paper used for three pulses."""

    def propose(
        self, problem: Problem, index: int, history: Sequence[Observation], pending: Sequence[Waveform]
    ) -> Proposal:
        """The next centre that DIRECT asks for; a Sobol point where it waits for one in flight or has ended."""
        space = problem.space
        answers = Answers(space, search_history(problem, history))
        bounds = [(0.0, 1.0)] * space.dim
        point = next_point(
            lambda g: direct(g, bounds, maxfun=100_000, maxiter=10_000, vol_tol=0.0, len_tol=0.0), answers
        )
        origin = DIRECT
        if point is None or any(space.waveform(point) == w for w in pending):
            origin, point = SOBOL, initial_point(problem, index)
        return Proposal(waveform=space.waveform(point), origin=origin, n_switches=problem.config.population.n_switches)
