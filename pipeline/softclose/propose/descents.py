"""Owns descents: runs of CMA-ES that are told a generation at a time, the library `cma` behind them.

A run is a function of its start, of its random numbers and of what it was told. The latest state of each is kept as a
cache only: what it was told is held against the records first, and where they differ it runs again from its start.
"""

from __future__ import annotations

import functools
import math
import sys
import warnings
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from softclose.arrays import FloatArray
from softclose.metrics.ranking import BEYOND_CM_S
from softclose.propose.protocol import Problem
from softclose.waveform.spaces import Space

WORST_CM_S = 10.0 * BEYOND_CM_S
"""What a failed candidate counts as: worse than any rank."""

AGAIN = 0.4
"""A run that has converged begins again around its mean, this much as wide as it began."""


_UNUSED = ("matplotlib", "scipy.stats")
"""What the library would load and can do without: most of the time that it takes to import."""


@functools.cache
def library() -> Any:
    """The library, imported where it is used and without what it would load for plots and surrogates of its own."""
    kept_out = [name for name in _UNUSED if name not in sys.modules]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        sys.modules.update(dict.fromkeys(kept_out))  # type: ignore[arg-type]
        try:
            import cma
        finally:
            for name in kept_out:
                del sys.modules[name]
    return cma


def strategy(start: FloatArray, widths: FloatArray, sigma: float, generation: int, draw: np.random.Generator) -> Any:
    """CMA-ES of the library in the unit cube, every random number of it from `draw`.

    widths: (d,) scale of each coordinate about the start: one that begins in the tail of its axis is searched there.
    """
    options: dict[str, Any] = {
        "bounds": [0.0, 1.0],
        "verbose": -9,
        "seed": math.nan,  # no seeding of numpy's global generator: ours draws
        "randn": lambda n, d: draw.standard_normal((n, d)),
        "popsize": generation,
        "CMA_stds": widths,
    }
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return library().CMAEvolutionStrategy(np.clip(start, 0.01 * widths, 1.0 - 0.01 * widths), sigma, options)


NARROWEST = 1e-3
"""Least variance of a step along any axis of a shape, as a share of the mean: what few generations take for flat."""


def unit_factor(covariance: FloatArray) -> FloatArray:
    """(d, d) lower Cholesky factor of a covariance, widened where it is too narrow, scaled to determinant 1."""
    dim = len(covariance)
    scaled = covariance / math.exp(np.linalg.slogdet(covariance)[1] / dim)
    factor = np.linalg.cholesky(scaled + NARROWEST * float(np.trace(scaled)) / dim * np.eye(dim))
    return np.asarray(factor / math.exp(float(np.log(np.diag(factor)).mean())))


class Descent:
    """One run of CMA-ES in the unit cube."""

    def __init__(
        self, space: Space, start: FloatArray, sigma: float, generation: int, draw: np.random.Generator
    ) -> None:
        self.told: list[FloatArray] = []
        self._space = space
        self._sigma, self._draw = sigma, draw
        self._generation = generation
        self._strategy = self._begin(start, sigma)
        self._asked: FloatArray | None = None

    def _begin(self, start: FloatArray, sigma: float) -> Any:
        return strategy(start, self._space.widths(start), sigma, self._generation, self._draw)

    def points(self) -> FloatArray:
        """(generation, d) what it wants to know next; the same until it is told."""
        if self._asked is None:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                if self._strategy.stop():
                    self._strategy = self._begin(self.mean, AGAIN * self._sigma)
                self._asked = np.array(self._strategy.ask(), dtype=np.float64)
        return self._asked

    def tell(self, g: FloatArray) -> None:
        """(generation,) the objective at `points` [cm/s]."""
        asked = self.points()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            self._strategy.tell(list(asked), np.minimum(g, WORST_CM_S).tolist())
        self.told.append(g)
        self._asked = None

    @property
    def mean(self) -> FloatArray:
        """(d,) the middle of its steps."""
        return np.clip(np.asarray(self._strategy.mean, dtype=np.float64), 0.0, 1.0)

    @property
    def shape(self) -> FloatArray:
        """(d, d) lower factor of the covariance of its steps, scaled to determinant 1: which way its basin runs."""
        scale = np.broadcast_to(self._strategy.sigma_vec.scaling, (self._space.dim,))
        return unit_factor(np.asarray(self._strategy.sm.covariance_matrix) * np.outer(scale, scale))

    def go_on(self, least_sigma: float) -> None:
        """Begin a new chapter, with the shape that it has learnt: on another ensemble, and at least so wide."""
        self._strategy.sigma = max(float(self._strategy.sigma), least_sigma)
        self._sigma = least_sigma
        self.told, self._asked = [], None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Beginning:
    """All that decides a descent but what it is told."""

    stream: str
    """What its random numbers are for."""
    who: int
    """Which descent of those."""
    start: FloatArray
    """(d,) where it begins, in the unit cube."""
    sigma: float
    """How wide."""
    generation: int
    """Points that it asks for at once."""
    before: tuple[FloatArray, ...] = ()
    """(generation,) each: what it was told of in an earlier chapter, on another ensemble [cm/s]."""
    goes_on_at: float | None = None
    """Least width of the chapter after that; None: it has one chapter only."""

    @property
    def key(self) -> tuple[Hashable, ...]:
        """The same for the same descent."""
        told = (values.tobytes() for values in self.before)
        return self.stream, self.who, self.start.tobytes(), self.sigma, self.generation, self.goes_on_at, *told

    def run(self, problem: Problem) -> Descent:
        """The descent, before it is told anything of its latest chapter."""
        run = Descent(problem.space, self.start, self.sigma, self.generation, problem.generator(self.stream, self.who))
        for values in self.before:
            run.tell(values)
        if self.goes_on_at is not None:
            run.go_on(self.goes_on_at)
        return run


def continued(problem: Problem, beginning: Beginning, told: Sequence[FloatArray]) -> Descent:
    """A descent after the generations `told`, from the cache where that was told the same."""
    run: Descent | None = problem.descents.get(beginning.key)
    if run is None or len(run.told) > len(told) or any(map(_differ, run.told, told)):
        run = problem.descents[beginning.key] = beginning.run(problem)
    for g in told[len(run.told) :]:
        run.tell(g)
    return run


def _differ(a: FloatArray, b: FloatArray) -> bool:
    return a.tobytes() != b.tobytes()
