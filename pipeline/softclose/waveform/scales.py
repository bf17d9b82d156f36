"""Owns what the drive of a switch is multiplied by: volts and times of the common waveform."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Scales:
    """a u(t / b) of each switch; (n,) float64 each."""

    volts: NDArray[np.float64]
    """a: the drive's volts are multiplied by it."""
    times: NDArray[np.float64]
    """b: its instants and durations are."""
