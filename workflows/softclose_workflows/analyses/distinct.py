"""Owns which waveforms of a list are different ones: near copies of one that is chosen already are passed over."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from softclose.arrays import FloatArray
from softclose.waveform import Waveform

APART_V = 5.0
"""Waveforms that differ by less than this until their last change are one place of the search, told apart by nothing
that an engineer would name (root mean square, V)."""

_INSTANTS = 1001


def distinct(
    order: Iterable[int], waveform_of: Callable[[int], Waveform], *, until_us: float, apart_V: float, most: int
) -> list[int]:
    """The first `most` of `order` that differ from each other by `apart_V` or more, as they come.

    until_us: they are compared on [0, until_us] [µs]. apart_V: root mean square of the difference [V].
    """
    t = np.linspace(0.0, until_us, _INSTANTS)
    chosen: list[int] = []
    shapes: list[FloatArray] = []
    for i in order:
        if len(chosen) == most:
            break
        shape = waveform_of(i).voltage(t)
        if all(np.sqrt(np.mean((shape - other) ** 2)) >= apart_V for other in shapes):
            chosen.append(i)
            shapes.append(shape)
    return chosen


def last_change_us(waveform: Waveform, horizon_us: float) -> float:
    """Where the last pulse is up or over, a little later, within the horizon [µs]: what follows is the same voltage."""
    return min(horizon_us, float(waveform.breakpoints(horizon_us)[-1]) + 20.0)
