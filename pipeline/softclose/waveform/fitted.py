"""Owns a sampled drive as polynomials, each as long as a tolerance allows."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial
from numpy.typing import ArrayLike

from softclose.arrays import FloatArray, IntArray
from softclose.waveform.pulses import MAX_VOLTS, WaveformError, is_above
from softclose.waveform.trace import Trace

DEGREE = 7
"""Degree of the polynomials."""


@dataclass(frozen=True, slots=True, eq=False)
class Fitted:
    """Polynomials that join, for their samples are joined; the last voltage ever after."""

    knots: FloatArray
    """(n + 1,) ends of the pieces [µs], from 0."""
    coefficients: FloatArray
    """(n, DEGREE + 1) of powers of the instant, from the middle of the piece [V, V/µs, ...]."""

    @classmethod
    def of(cls, trace: Trace, tolerance_volts: float) -> Self:
        """The longest pieces, found one after another, that meet every sample of a trace to the tolerance [V].

        Between two samples they stay as close to the line, but for what the samples around it bend.

        Raises WaveformError where that is not above 0.
        """
        if not tolerance_volts > 0.0:
            raise WaveformError(f"tolerance_volts is {tolerance_volts:g}; it must be above 0")
        t, u = trace.times_us, trace.volts
        # A jump bends two samples, a curve four and more.
        bends = np.pad(np.abs(np.diff(np.diff(u) / np.diff(t))) * np.diff(t)[1:], 2)
        around = np.lib.stride_tricks.sliding_window_view(bends, 4).min(axis=1)
        knots, rows, first = [0], [], 0
        while first < len(t) - 1:
            reach, step, found = first + 1, 1, _line(t, u, first, first + 1)
            while step > 0:  # by doubling, and halving where it fails
                last = min(reach + step, len(t) - 1)
                longer = _fit(t, u, around, first, last, tolerance_volts) if last > reach else None
                if longer is None:
                    step //= 2
                else:
                    reach, found, step = last, longer, 2 * step
            knots.append(reach)
            rows.append(found)
            first = reach
        return cls(t[knots], np.array(rows))

    def flat(self, horizon_us: float) -> tuple[FloatArray, IntArray, FloatArray]:
        """The pieces on [0, horizon] as the kernels read them; rows of one number, the powers from 1 on."""
        inside = int(np.searchsorted(self.knots[1:], horizon_us)) + 1
        c = self.coefficients[:inside]
        begin, end = self.knots[: len(c)], self.knots[1 : len(c) + 1]
        pieces = np.stack([begin, end, c[:, 0]], axis=1)
        rest = c[:, 1:, None].copy()
        if pieces[-1, 1] < horizon_us:
            last = float(self.voltage(self.knots[-1]))
            pieces = np.concatenate([pieces, [[self.knots[-1], horizon_us, last]]])
            rest = np.concatenate([rest, np.zeros((1, DEGREE, 1))])
        elif pieces[-1, 1] > horizon_us:
            moved = _about(c[-1], 0.5 * (horizon_us - pieces[-1, 1]))
            pieces[-1, 1:], rest[-1, :, 0] = (horizon_us, moved[0]), moved[1:]
        return pieces, np.where(rest.any(axis=(1, 2)), DEGREE, 0).astype(np.int64), rest

    def voltage(self, t_us: ArrayLike) -> FloatArray:
        """u(t) [V] at instants t_us [µs]; any shape."""
        t = np.minimum(np.asarray(t_us, dtype=np.float64), self.knots[-1])
        which = np.clip(np.searchsorted(self.knots, t, side="right") - 1, 0, len(self.coefficients) - 1)
        s = t - 0.5 * (self.knots[which] + self.knots[which + 1])
        u = np.zeros(t.shape)
        for k in range(DEGREE, -1, -1):
            u = u * s + self.coefficients[which, k]
        return u

    def breakpoints(self, horizon_us: float = math.inf) -> FloatArray:
        """Ends of the pieces in [0, horizon] [µs]."""
        return self.knots[self.knots <= horizon_us]

    def max_voltage(self, horizon_us: float = 250.0) -> float:
        """Largest |u| over [0, horizon] [V], to a thousandth of what a piece bends."""
        ends = np.minimum(self.knots, horizon_us)
        return float(np.abs(self.voltage(np.linspace(ends[:-1], ends[1:], 33, axis=1))).max())

    def check(self, max_volts: float = MAX_VOLTS, horizon_us: float = 250.0) -> None:
        """Raise WaveformError where |u| exceeds max_volts on [0, horizon]."""
        peak = self.max_voltage(horizon_us)
        if is_above(peak, max_volts):
            raise WaveformError(f"the drive reaches {peak:.6g} V; {max_volts:g} V are allowed (waveform.max_volts)")


def _line(t: FloatArray, u: FloatArray, first: int, last: int) -> FloatArray:
    row = np.zeros(DEGREE + 1)
    row[0], row[1] = 0.5 * (u[first] + u[last]), (u[last] - u[first]) / (t[last] - t[first])
    return row


def _fit(
    t: FloatArray, u: FloatArray, around: FloatArray, first: int, last: int, tolerance: float
) -> FloatArray | None:
    """Least squares through the samples first..last, its ends on the trace; None where it misses one.

    Between two samples it may leave their line by the tolerance and a quarter of what the samples around bend [V].
    """
    line = _line(t, u, first, last)
    half, s = 0.5 * (t[last] - t[first]), t[first : last + 1] - 0.5 * (t[first] + t[last])
    z = s / half
    off = u[first : last + 1] - line[0] - line[1] * s
    degree = min(DEGREE, last - first)
    if degree < 2 or np.abs(off).max() <= tolerance:
        return line if np.abs(off).max() <= tolerance else None
    # (1 - z²) times a polynomial vanishes at both ends.
    ends = 1.0 - z * z
    basis = np.polynomial.chebyshev.chebvander(z[1:-1], degree - 2) * ends[1:-1, None]
    weights, *_ = np.linalg.lstsq(basis, off[1:-1], rcond=None)
    if np.abs(basis @ weights - off[1:-1]).max() > tolerance:
        return None
    middles = 0.5 * (z[1:] + z[:-1])
    found = np.polynomial.chebyshev.chebval(middles, weights) * (1.0 - middles**2)
    if (np.abs(found - 0.5 * (off[1:] + off[:-1])) > tolerance + 0.25 * around[first:last]).any():
        return None
    inner = Chebyshev(weights).convert(kind=Polynomial) * Polynomial([1.0, 0.0, -1.0])
    powers = np.zeros(DEGREE + 1)
    powers[: len(inner.coef)] = inner.coef / half ** np.arange(len(inner.coef))
    return line + powers


def _about(coefficients: FloatArray, shift: float) -> FloatArray:
    """Coefficients of the same polynomial about a point so much later."""
    found = np.zeros(DEGREE + 1)
    moved = Polynomial(coefficients)(Polynomial([shift, 1.0])).coef
    found[: len(moved)] = moved
    return found
