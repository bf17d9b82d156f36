"""Owns the replay of sequential methods: a library's routine runs against the records until it asks for what is not
there.

Nothing of a routine is kept between proposals; running it again over the recorded answers costs little.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np

from softclose.arrays import FloatArray
from softclose.propose.descents import WORST_CM_S
from softclose.propose.protocol import Observation
from softclose.waveform import Waveform
from softclose.waveform.spaces import Space


class _Wanted(Exception):
    def __init__(self, point: FloatArray) -> None:
        super().__init__()
        self.point = point


class Answers:
    """The recorded objective at points of a space, looked up by the waveform that they stand for."""

    def __init__(self, space: Space, records: Sequence[Observation]) -> None:
        self._space = space
        self._known = {_key(o.waveform): o.rank_cm_s if o.usable else WORST_CM_S for o in records}

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
