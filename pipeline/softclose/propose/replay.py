"""Owns the replay of sequential methods: a library's routine runs against the records until it asks for what is not
there.

Nothing of a routine is kept between proposals; running it again over the recorded answers costs little (DESIGN §2).
"""

from __future__ import annotations

import math
import warnings
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cma
import numpy as np
from numpy.typing import NDArray

from softclose.propose.protocol import Observation
from softclose.waveform import Waveform
from softclose.waveform.spaces import Space

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
        return self.known(_key_at(self._space, np.asarray(point, dtype=np.float64).tobytes()))

    def known(self, key: bytes) -> float | None:
        """The recorded g of a waveform, by its key."""
        return self._known.get(key)


def _key(waveform: Waveform) -> bytes:
    # Stored float64 values come back bit for bit; the same point gives the same waveform.
    return waveform.rows().tobytes()


@lru_cache(maxsize=32_768)
def _key_at(space: Space, point: bytes) -> bytes:
    """Key of the waveform at a unit point (its float64 bytes). A replay asks for the same points at every proposal."""
    return _key(space.waveform(np.frombuffer(point)))


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

    point: tuple[float, ...]
    """Mean of the first generation, d numbers in the unit cube."""
    sigma: float
    """Its standard deviation."""
    population: int
    """Points in a generation; 0: the library's choice."""

    @property
    def array(self) -> FloatArray:
        """`point` as an array."""
        return np.array(self.point)


class _Descent:
    """One CMA-ES run, as far as the records carry it. What it was told is kept, to be held against the records."""

    def __init__(self, start: CmaStart, rng: np.random.Generator) -> None:
        options: dict[str, Any] = {
            "bounds": [0.0, 1.0],
            "verbose": -9,
            "seed": math.nan,  # no seeding of numpy's global generator: ours draws
            "randn": lambda n, d: rng.standard_normal((n, d)),
        }
        if start.population:
            options["popsize"] = start.population
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            self.strategy = cma.CMAEvolutionStrategy(np.clip(start.array, 0.01, 0.99), start.sigma, options)
        self.told: dict[bytes, float] = {}
        self.generation: list[FloatArray] = []
        self.keys: list[bytes] = []

    def agrees(self, answers: Answers) -> bool:
        """True where the records say what this run was told."""
        return all(answers.known(key) == g for key, g in self.told.items())

    def advance(self, answers: Answers, space: Space) -> bool:
        """Go on to the first generation that is not wholly recorded; False where the run has converged."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            while True:
                if not self.generation:
                    if self.strategy.stop():
                        return False
                    self.generation = [np.asarray(x, dtype=np.float64) for x in self.strategy.ask()]
                    self.keys = [_key(space.waveform(x)) for x in self.generation]
                values = [answers.known(key) for key in self.keys]
                complete = [g for g in values if g is not None]
                if len(complete) < len(values):
                    return True
                self.strategy.tell(self.generation, complete)
                self.told |= dict(zip(self.keys, complete, strict=True))
                self.generation = []


_descents: OrderedDict[tuple[Any, ...], _Descent] = OrderedDict()
"""The latest runs, to spare replaying them from their start at every proposal. A cache only: see `cma_points`."""

_MOST_DESCENTS = 16


def cma_points(
    start: CmaStart,
    answers: Answers,
    pending: Sequence[Waveform],
    space: Space,
    generator: Callable[[], np.random.Generator],
    identity: tuple[Any, ...] = (),
) -> tuple[FloatArray | None, FloatArray]:
    """Replay CMA-ES: the next point of the unfinished generation that is neither recorded nor in flight, and the mean.

    The point is None where the run has converged, or where all of the generation is in flight. generator: makes the
    run's random numbers, always the same; identity: names them. A run continued from the cache was told exactly what
    the records say, so it gives the same bits as one replayed from its start.
    """
    key = (start, space, identity)
    descent = _descents.pop(key, None)
    if descent is None or not descent.agrees(answers):
        descent = _Descent(start, generator())
    running = descent.advance(answers, space)
    if identity:
        _descents[key] = descent
        while len(_descents) > _MOST_DESCENTS:
            _descents.popitem(last=False)
    mean = np.clip(np.asarray(descent.strategy.mean), 0.0, 1.0)
    if running:
        flying = {_key(w) for w in pending}
        for x, waveform_key in zip(descent.generation, descent.keys, strict=True):
            if answers.known(waveform_key) is None and waveform_key not in flying:
                return x, mean
    return None, mean
