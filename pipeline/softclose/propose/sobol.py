"""Owns the Sobol engine: a scrambled low-discrepancy design over the search space, the start of every other engine."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from softclose.propose.protocol import Observation, Problem, Proposal
from softclose.waveform import Waveform


def sobol_points(dim: int, n: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """(n, dim) scrambled Sobol points in [0, 1). The first rows do not depend on n."""
    design = qmc.Sobol(dim, scramble=True, rng=rng).random_base2(max(0, math.ceil(math.log2(max(n, 1)))))
    return np.asarray(design[:n], dtype=np.float64)


def initial_point(problem: Problem, place: int, stream: str = "initial") -> NDArray[np.float64]:
    """(d,) the point at `place` of the campaign's initial design, repaired to an admissible one."""
    design = sobol_points(problem.space.dim, place + 1, problem.generator(stream, 0))
    return problem.space.canonical(design[place])


class SobolEngine:
    """Space-filling search without a model."""

    def propose(
        self, problem: Problem, index: int, history: Sequence[Observation], pending: Sequence[Waveform]
    ) -> Proposal:
        """The next point of the campaign's Sobol sequence."""
        point = initial_point(problem, index - problem.n_initial_waveforms)
        return Proposal(
            waveform=problem.space.waveform(point),
            origin="sobol",
            n_switches=problem.config.population.n_switches,
        )
