"""Owns the replay of sequential methods: a library's routine runs against the records until it asks for what is not
there.

Nothing of a routine is kept between proposals; running it again over the recorded answers costs little (DESIGN §2).
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import cma
import numpy as np
from numpy.typing import NDArray

from softclose.propose.protocol import Observation
from softclose.spaces import Space
from softclose.waveform import Waveform

FloatArray = NDArray[np.float64]

WORST_CM_S = 1e4
"""What a failed candidate counts as: worse than any objective."""


class _Wanted(Exception):
    def __init__(self, point: FloatArray) -> None:
        super().__init__()
        self.point = point


class Answers:
    """The recorded objective at points of a space, looked up by the waveform that they stand for."""

    def __init__(self, space: Space, records: Sequence[Observation]) -> None:
        self._space = space
        self._known = {_key(o.waveform): o.g_cm_s if o.usable else WORST_CM_S for o in records}

    def __call__(self, point: FloatArray) -> float:
        """The recorded g at a unit point; raises to the caller of `next_point` where there is none."""
        g = self.get(point)
        if g is None:
            raise _Wanted(np.clip(point, 0.0, 1.0))
        return g

    def get(self, point: FloatArray) -> float | None:
        """The recorded g, None where there is none."""
        return self._known.get(_key(self._space.waveform(point)))


def _key(waveform: Waveform) -> bytes:
    # Stored float64 values come back bit for bit; the same point gives the same waveform.
    return waveform.rows().tobytes()


def next_point(routine: Callable[[Callable[[FloatArray], float]], object], answers: Answers) -> FloatArray | None:
    """The first unit point that the routine wants and the records lack; None where it ends without one."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            routine(answers)
    except _Wanted as wanted:
        return wanted.point
    return None


@dataclass(frozen=True, slots=True, kw_only=True)
class CmaStart:
    """Where a CMA-ES run begins."""

    point: FloatArray
    """Mean of the first generation, (d,) in the unit cube."""
    sigma: float
    """Its standard deviation."""
    population: int
    """Points in a generation; 0: the library's choice."""


def cma_points(
    start: CmaStart, answers: Answers, pending: Sequence[Waveform], space: Space, rng: np.random.Generator
) -> tuple[FloatArray | None, FloatArray]:
    """Replay CMA-ES: the next point of the unfinished generation that is neither recorded nor in flight, and the mean.

    The point is None where the run has converged, or where all of the generation is in flight.
    """
    options: dict[str, Any] = {
        "bounds": [0.0, 1.0],
        "verbose": -9,
        "seed": math.nan,  # no seeding of numpy's global generator: ours draws
        "randn": lambda n, d: rng.standard_normal((n, d)),
    }
    if start.population:
        options["popsize"] = start.population
    flying = {_key(w) for w in pending}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        strategy = cma.CMAEvolutionStrategy(np.clip(start.point, 0.01, 0.99), start.sigma, options)
        while not strategy.stop():
            generation = [np.asarray(x, dtype=np.float64) for x in strategy.ask()]
            values = [answers.get(x) for x in generation]
            for x, g in zip(generation, values, strict=True):
                if g is None and _key(space.waveform(x)) not in flying:
                    return x, np.asarray(strategy.mean)
            if any(g is None for g in values):
                break
            strategy.tell(generation, values)
        return None, np.clip(np.asarray(strategy.mean), 0.0, 1.0)
