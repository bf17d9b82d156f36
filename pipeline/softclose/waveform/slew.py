"""Owns a slew limit in closed form: what follows cosines as fast as it may is cosines and straight lines.

The output y follows the input u where |u'| is within the limit; where it is not, or where u has jumped, y is a line of
that slope until it meets u again. Both instants are roots of a function whose second derivative is bounded on the
piece: stepping to the root of the parabola that lies below it cannot jump over one (as in `kernel.release`).
"""

from __future__ import annotations

import math

import numpy as np

from softclose.arrays import FloatArray, IntArray
from softclose.waveform.flat import SNAP_US, line_term

_NUDGE_US = 1e-9
_PART_US = 1e-4
"""Where both part, they are not looked for together before [µs]: what lies between them grows from nothing."""
_MET_VOLTS = 1e-9
"""Closer than this, the output is on its input [V]."""

Terms = list[tuple[float, float, float]]


def limited(
    pieces: FloatArray, n_ramps: IntArray, ramps: FloatArray, slew: float
) -> tuple[FloatArray, IntArray, FloatArray]:
    """What a limiter that rests at 0 V makes of a drive, both as `flatten_pulses` returns them.

    slew: steepest slope of the output [V/µs], above 0.
    """
    found: list[tuple[float, float, float, Terms]] = []
    y = 0.0
    for (begin, end, level), n, rows in zip(pieces.tolist(), n_ramps.tolist(), ramps.tolist(), strict=True):
        terms: Terms = [tuple(row) for row in rows[:n]]
        t = begin
        while end - t > SNAP_US:
            u, slope, *_ = _at(terms, level, t)
            if abs(y - u) <= _MET_VOLTS and abs(slope) <= slew * (1.0 + 1e-12):
                until = min(_leaves(terms, level, t, end, slew), end)
                if end - until <= SNAP_US:
                    until = end
                if until - t > SNAP_US:
                    found.append((t, until, level, terms))
                t = until
                y = _at(terms, level, t)[0]
                if t == end:
                    break
                slope = _at(terms, level, t)[1]
                way = math.copysign(1.0, slope)
            elif abs(y - u) <= _MET_VOLTS:
                way = math.copysign(1.0, slope)
            else:
                way = math.copysign(1.0, u - y)
            until = min(_meets(terms, level, t, end, y, way * slew), end)
            if end - until <= SNAP_US:
                until = end
            if until - t > SNAP_US:
                reached = y + way * slew * (until - t)
                found.append((t, until, 0.5 * (y + reached), [line_term(t, until, y, reached)]))
                y = reached
            t = until
            if t < end:
                y = _at(terms, level, t)[0]
    out = np.array([piece[:3] for piece in found])
    out[1:, 0] = out[:-1, 1]
    out[-1, 1] = pieces[-1, 1]
    widest = max(1, *(len(terms) for *_, terms in found))
    rows_out = np.zeros((len(found), widest, 3))
    for i, (*_, terms) in enumerate(found):
        rows_out[i, : len(terms)] = np.array(terms).reshape(-1, 3)
    return out, np.array([len(terms) for *_, terms in found], dtype=np.int64), rows_out


def _at(terms: Terms, level: float, t: float) -> tuple[float, float, float]:
    """u, u' and u'' at t."""
    u, slope, bend = level, 0.0, 0.0
    for amplitude, omega, origin in terms:
        cosine = amplitude * math.cos(omega * (t - origin))
        u += cosine
        slope -= amplitude * omega * math.sin(omega * (t - origin))
        bend -= cosine * omega * omega
    return u, slope, bend


def _leaves(terms: Terms, level: float, t: float, end: float, slew: float) -> float:
    """First instant from t on at which |u'| exceeds the limit; inf where none is before the end."""
    twist = sum(abs(a) * omega**3 for a, omega, _ in terms)
    if twist == 0.0 or sum(abs(a) * omega for a, omega, _ in terms) <= slew:
        return math.inf
    while t < end:
        _, slope, bend = _at(terms, level, t)
        if abs(slope) > slew:
            return t
        t += max(min(_step(slew - slope, -bend, twist), _step(slew + slope, bend, twist)), _NUDGE_US)
    return math.inf


def _meets(terms: Terms, level: float, t: float, end: float, y: float, slope: float) -> float:
    """First instant after t at which a line from y meets u; inf where none is before the end."""
    if not terms:
        return t + (level - y) / slope
    begin, way = t, math.copysign(1.0, slope)
    curve = sum(abs(a) * omega**2 for a, omega, _ in terms)
    while t < end:
        u, rate, _ = _at(terms, level, t)
        ahead = way * (u - y - slope * (t - begin))
        if t > begin and ahead <= 0.0:
            return t
        least = _PART_US if t == begin and ahead <= _MET_VOLTS else _NUDGE_US
        t += max(_step(max(ahead, 0.0), way * (rate - slope), curve), least)
    return math.inf


def _step(value: float, rate: float, bend: float) -> float:
    """The s > 0 at which value + rate s - bend s²/2, value >= 0, is 0; without cancellation for either sign."""
    root = math.sqrt(rate * rate + 2.0 * bend * value)
    if root == 0.0:
        return 0.0
    return (rate + root) / bend if rate >= 0.0 else 2.0 * value / (root - rate)
