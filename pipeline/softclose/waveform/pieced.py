"""Owns a drive that is told by its pieces: constants, cosines and lines, as a limiter leaves them of pulses."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from softclose.arrays import FloatArray, IntArray
from softclose.waveform.flat import SNAP_US, volts
from softclose.waveform.pulses import MAX_VOLTS, WaveformError, is_above


@dataclass(frozen=True, slots=True, eq=False)
class Pieced:
    """Pieces that follow one another from 0 on; the last one's formula holds ever after."""

    pieces: FloatArray
    """(n, 3) start, end [µs] and the constant part of u [V]."""
    n_ramps: IntArray
    """(n,) terms of each."""
    ramps: FloatArray
    """(n, m, 3) amplitude [V], angular frequency [1/µs] and origin [µs] of each term, a cosine."""

    def later(self, delay_us: float, offset_volts: float, horizon_us: float) -> Pieced:
        """The same, so much later and on a constant voltage, on [0, horizon]."""
        pieces, ramps = self.pieces.copy(), self.ramps.copy()
        pieces[:, :2] += delay_us
        pieces[:, 2] += offset_volts
        ramps[..., 2] += delay_us
        n = self.n_ramps
        if delay_us > SNAP_US:
            pieces = np.concatenate([[[0.0, delay_us, offset_volts]], pieces])
            ramps, n = np.concatenate([np.zeros((1, *ramps.shape[1:])), ramps]), np.append(0, n)
        pieces[0, 0] = 0.0
        return Pieced(*Pieced(pieces, n, ramps).flat(horizon_us))

    def flat(self, horizon_us: float) -> tuple[FloatArray, IntArray, FloatArray]:
        """The pieces on [0, horizon], as the kernels read them."""
        n = int(np.searchsorted(self.pieces[1:, 0], horizon_us - SNAP_US)) + 1
        pieces = self.pieces[:n].copy()
        pieces[-1, 1] = horizon_us
        return pieces, self.n_ramps[:n].copy(), self.ramps[:n].copy()

    def voltage(self, t_us: ArrayLike) -> FloatArray:
        """u(t) [V] at instants t_us [µs]; any shape."""
        t = np.asarray(t_us, dtype=np.float64)
        which = np.clip(np.searchsorted(self.pieces[:, 0], t, side="right") - 1, 0, None)
        return volts(self.pieces, self.n_ramps, self.ramps, which, t)

    def breakpoints(self, horizon_us: float = math.inf) -> FloatArray:
        """Instants in [0, horizon] at which another piece begins [µs]."""
        begins: FloatArray = self.pieces[:, 0]
        return begins[begins <= horizon_us]

    def max_voltage(self, horizon_us: float = 250.0) -> float:
        """Largest magnitude of the voltage over [0, horizon] [V], to a thousandth of what a piece bends."""
        pieces = self.flat(horizon_us)[0]
        inside = np.linspace(pieces[:, 0], pieces[:, 1], 33, axis=1)
        inside[:, -1] = np.nextafter(inside[:, -1], 0.0)  # a jump at its end is the next one's
        return float(np.abs(self.voltage(inside)).max())

    def check(self, max_volts: float = MAX_VOLTS, horizon_us: float = 250.0) -> None:
        """Raise WaveformError where |u| exceeds max_volts on [0, horizon]."""
        peak = self.max_voltage(horizon_us)
        if is_above(peak, max_volts):
            raise WaveformError(f"the drive reaches {peak:.6g} V; {max_volts:g} V are allowed (waveform.max_volts)")
