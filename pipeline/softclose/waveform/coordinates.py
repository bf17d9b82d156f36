"""Owns one axis of a search space: unit interval <-> physical value, a core where designs land and tails to the rest.

The core takes nearly all of the axis; a tail takes `FAR` of it and reaches linearly to the last admissible value. So
nothing admissible is out of reach, and hardly a point of a space-filling design is spent on what never lands a plate.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from softclose.arrays import FloatArray

FAR = 0.02
"""Width of a tail, in units of the axis."""


WORDS: dict[str, tuple[str, str]] = {
    "impulse": ("impulse", "× coasting"),
    "delay": ("delay", "periods"),
    "rise": ("rise time", "µs"),
    "volts": ("voltage", "V"),
    "peak": ("flat top", "µs"),
}
"""Kind of coordinate -> what a person calls it, its unit. A delay runs from the pulse before, centre to centre."""


def label_of(name: str, *, unit: bool = True) -> str | None:
    """`volts2` -> `pulse 2 voltage (V)`; None for what is no coordinate."""
    kind, pulse = name.rstrip("0123456789"), name.lstrip("abcdefghijklmnopqrstuvwxyz")
    if kind not in WORDS or not pulse.isdigit():
        return None
    words, of = WORDS[kind]
    return f"pulse {pulse} {words} ({of})" if unit else f"pulse {pulse} {words}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Axis:
    """One axis of the unit cube."""

    name: str
    """impulse, delay, rise, volts or peak, with the number of its pulse from 1."""
    least: float
    """Value at 0, in the unit of the name: impulse [scale], delay [periods], rise [µs], volts [V], peak [µs]."""
    low: float
    """Lower end of the core."""
    high: float
    """Upper end of the core."""
    most: float
    """Value at 1."""
    log: bool = False
    """True where the core is logarithmic."""
    dense: Literal["evenly", "low", "high"] = "evenly"
    """End at which the core is stretched (quadratically): half of it covers the quarter of the range at that end."""

    @property
    def core(self) -> tuple[float, float]:
        """Where the core begins and ends on the unit interval."""
        return FAR if self.least < self.low else 0.0, 1.0 - FAR if self.most > self.high else 1.0

    def value(self, u: ArrayLike) -> FloatArray:
        """Unit -> physical, any shape."""
        u = np.asarray(u, dtype=np.float64)
        begin, end = self.core
        s = np.clip((u - begin) / (end - begin), 0.0, 1.0)
        t = s**2 if self.dense == "low" else 1.0 - (1.0 - s) ** 2 if self.dense == "high" else s
        ratio = math.log(self.high / self.low) if self.log else 0.0
        inside = self.low * np.exp(t * ratio) if self.log else self.low + t * (self.high - self.low)
        below = self.least + (self.low - self.least) * u / FAR
        above = self.most - (self.most - self.high) * (1.0 - u) / FAR
        return np.asarray(np.where(u < begin, below, np.where(u > end, above, inside)))

    def unit(self, value: ArrayLike) -> FloatArray:
        """Physical -> unit, any shape; outside [0, 1], linearly, where the value is outside [least, most]."""
        v = np.asarray(value, dtype=np.float64)
        begin, end = self.core
        kept = np.clip(v, self.low, self.high)
        if self.log:
            t = np.log(kept / self.low) / math.log(self.high / self.low)
        else:
            t = (kept - self.low) / (self.high - self.low)
        s = np.sqrt(t) if self.dense == "low" else 1.0 - np.sqrt(1.0 - t) if self.dense == "high" else t
        # A side without a tail goes on with the mean slope of the core.
        down = FAR / (self.low - self.least) if begin else 1.0 / (self.high - self.low)
        up = FAR / (self.most - self.high) if end < 1.0 else 1.0 / (self.high - self.low)
        inside = begin + (end - begin) * s
        return np.asarray(inside + np.minimum(v - self.low, 0.0) * down + np.maximum(v - self.high, 0.0) * up)
