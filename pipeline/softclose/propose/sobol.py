"""Owns the Sobol engine: a scrambled low-discrepancy design over the search space, the start of every other engine."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from softclose.population.nets import MOST_DIMENSIONS, scrambled_sobol
from softclose.propose.origins import SOBOL
from softclose.propose.protocol import Observation, Problem, Proposal, Wave
from softclose.waveform import Waveform

WAVE = 20
"""Candidates of a wave."""


def sobol_points(dim: int, n: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """(n, dim) scrambled Sobol points in [0, 1). The first rows do not depend on n."""
    if dim <= MOST_DIMENSIONS:
        return scrambled_sobol(dim, n, rng)
    from scipy.stats import qmc  # here: it takes a second to import

    design = qmc.Sobol(dim, scramble=True, rng=rng).random_base2(max(0, math.ceil(math.log2(max(n, 1)))))
    return np.asarray(design[:n], dtype=np.float64)


def initial_points(problem: Problem, place: int, n: int, stream: str = "initial") -> NDArray[np.float64]:
    """(n, d) the points from `place` on of the campaign's initial design, repaired to admissible ones."""
    design = sobol_points(problem.space.dim, place + n, problem.generator(stream, 0))
    return problem.space.canonical(design[place:])


def initial_point(problem: Problem, place: int, stream: str = "initial") -> NDArray[np.float64]:
    """(d,) one of them."""
    return np.asarray(initial_points(problem, place, 1, stream)[0])


class SobolEngine:
    """Space-filling search without a model. Waves of any size would do."""

    is_blind = True

    def wave_sizes(self, problem: Problem, budget: int) -> list[int]:
        """Waves of `WAVE` candidates."""
        return [min(WAVE, budget - begin) for begin in range(0, budget, WAVE)]

    def propose_wave(
        self, problem: Problem, wave: Wave, history: Sequence[Observation], pending: Sequence[Waveform]
    ) -> list[Proposal]:
        """The next points of the campaign's Sobol sequence."""
        points = initial_points(problem, wave.start - problem.n_initial_waveforms, wave.size)
        waveforms = problem.space.waveforms(points)
        return [Proposal(waveform=w, origin=SOBOL, n_switches=wave.n_switches) for w in waveforms]
