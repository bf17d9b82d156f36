"""Owns the CMA-ES engine: one run a turn from the middle of the cube or a Sobol point, a generation a wave."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from softclose.propose.descents import Beginning, continued
from softclose.propose.explore import stage_g
from softclose.propose.origins import CMAES
from softclose.propose.protocol import Observation, Problem, Proposal, Wave, even_waves
from softclose.propose.sobol import initial_point
from softclose.waveform import Waveform

SIGMA = 0.25
"""Standard deviation of the first generation, in units of the cube."""


class CmaesEngine:
    """Covariance matrix adaptation without prior knowledge; with `campaign.lag` waves in flight, as many runs."""

    def wave_sizes(self, problem: Problem, budget: int) -> list[int]:
        """The user's own waveforms beside the first generation, then a generation each."""
        each, given = _generation(problem), problem.n_initial_waveforms
        first = min(given + each, budget)
        return [first, *even_waves(budget, each, first)]

    def propose_wave(
        self, problem: Problem, wave: Wave, history: Sequence[Observation], pending: Sequence[Waveform]
    ) -> list[Proposal]:
        """The next generation of the run whose turn it is."""
        each, given, lag = _generation(problem), problem.n_initial_waveforms, problem.config.campaign.lag
        number = (wave.start - given) // each
        begins = [given + k * each for k in range(number % lag, number, lag)]
        told = [stage_g(problem, history, begin, begin + each) for begin in begins]
        points = continued(problem, _beginning(problem, number % lag), told).points()
        waveforms = problem.space.waveforms(points[: wave.size])
        return [Proposal(waveform=w, origin=CMAES, n_switches=wave.n_switches) for w in waveforms]


def _generation(problem: Problem) -> int:
    """The usual choice, 4 + 3 ln d."""
    return 4 + int(3.0 * math.log(problem.space.dim))


def _beginning(problem: Problem, run: int) -> Beginning:
    dim = problem.space.dim
    start = np.full(dim, 0.5) if run == 0 else initial_point(problem, run - 1, "cmaes")
    return Beginning(stream="cmaes", who=run, start=start, sigma=SIGMA, generation=_generation(problem))
