"""Owns a slew limit in closed form: what follows cosines as fast as it may is cosines and straight lines.

The output y follows the input u where |u'| is within the limit; where it is not, or where u has jumped, y is a line of
that slope until it meets u again. Both instants are roots of a function whose second derivative is bounded on the
piece: stepping to the root of the parabola that lies below it cannot jump over one (as in `kernel.release`).
"""

from __future__ import annotations

import math

import numpy as np

from softclose.arrays import FloatArray, IntArray
from softclose.compiled import cached_njit
from softclose.waveform.flat import SNAP_US, line_term

_NUDGE_US = 1e-9
_PART_US = 1e-4
"""Where both part, they are not looked for together before [µs]: what lies between them grows from nothing."""
_MET_VOLTS = 1e-9
"""Closer than this, the output is on its input [V]."""

_njit = cached_njit(error_model="numpy")


def limited(
    pieces: FloatArray, n_ramps: IntArray, ramps: FloatArray, slew: float
) -> tuple[FloatArray, IntArray, FloatArray]:
    """What a limiter that rests at 0 V makes of a drive, both as `flatten_pulses` returns them.

    slew: steepest slope of the output [V/µs], above 0.
    """
    room = 4 * len(pieces) + 16
    while True:
        out = np.zeros((room, 3)), np.zeros(room, dtype=np.int64), np.zeros((room, ramps.shape[1], 3))
        n = _limit(pieces, n_ramps, ramps, slew, *out)
        if n >= 0:
            break
        room *= 2
    found, terms, rows = out[0][:n], out[1][:n], out[2][:n]
    found[1:, 0] = found[:-1, 1]
    found[-1, 1] = pieces[-1, 1]
    return found, terms, np.ascontiguousarray(rows[:, : max(1, int(terms.max()))])


@_njit
def _limit(pieces, n_ramps, ramps, slew, out, out_n, out_rows):  # type: ignore[no-untyped-def]
    """Write its pieces; returns how many, or -1 where there is no room for them."""
    y = 0.0
    m = 0
    for i in range(len(pieces)):
        t, end, level = pieces[i, 0], pieces[i, 1], pieces[i, 2]
        n, rows = n_ramps[i], ramps[i]
        while end - t > SNAP_US:
            if m + 2 > len(out):
                return -1
            u, slope, _ = _at(rows, n, level, t)
            met = abs(y - u) <= _MET_VOLTS
            if met and abs(slope) <= slew * (1.0 + 1e-12):
                until = min(_leaves(rows, n, level, t, end, slew), end)
                if end - until <= SNAP_US:
                    until = end
                if until - t > SNAP_US:
                    out[m, 0], out[m, 1], out[m, 2], out_n[m] = t, until, level, n
                    out_rows[m, :n] = rows[:n]
                    m += 1
                t = until
                y, slope, _ = _at(rows, n, level, t)
                if t == end:
                    break
            way = math.copysign(1.0, slope if met else u - y)
            until = min(_meets(rows, n, level, t, end, y, way * slew), end)
            if end - until <= SNAP_US:
                until = end
            if until - t > SNAP_US:
                reached = y + way * slew * (until - t)
                out[m, 0], out[m, 1], out[m, 2], out_n[m] = t, until, 0.5 * (y + reached), 1
                out_rows[m, 0, 0], out_rows[m, 0, 1], out_rows[m, 0, 2] = _line(t, until, y, reached)
                m += 1
                y = reached
            t = until
            if t < end:
                y = _at(rows, n, level, t)[0]
    return m


_line = _njit(line_term)


@_njit
def _at(rows, n, level, t):  # type: ignore[no-untyped-def]
    """u, u' and u'' at t."""
    u, slope, bend = level, 0.0, 0.0
    for j in range(n):
        amplitude, omega, origin = rows[j, 0], rows[j, 1], rows[j, 2]
        cosine = amplitude * math.cos(omega * (t - origin))
        u += cosine
        slope -= amplitude * omega * math.sin(omega * (t - origin))
        bend -= cosine * omega * omega
    return u, slope, bend


@_njit
def _leaves(rows, n, level, t, end, slew):  # type: ignore[no-untyped-def]
    """First instant from t on at which |u'| exceeds the limit; inf where none is before the end."""
    most = twist = 0.0
    for j in range(n):
        most += abs(rows[j, 0]) * rows[j, 1]
        twist += abs(rows[j, 0]) * rows[j, 1] ** 3
    if most <= slew:
        return math.inf
    while t < end:
        _, slope, bend = _at(rows, n, level, t)
        if abs(slope) > slew:
            return t
        t += max(min(_step(slew - slope, -bend, twist), _step(slew + slope, bend, twist)), _NUDGE_US)
    return math.inf


@_njit
def _meets(rows, n, level, t, end, y, slope):  # type: ignore[no-untyped-def]
    """First instant after t at which a line from y meets u; inf where none is before the end."""
    if n == 0:
        return t + (level - y) / slope
    begin, way = t, math.copysign(1.0, slope)
    curve = 0.0
    for j in range(n):
        curve += abs(rows[j, 0]) * rows[j, 1] ** 2
    while t < end:
        u, rate, _ = _at(rows, n, level, t)
        ahead = way * (u - y - slope * (t - begin))
        if t > begin and ahead <= 0.0:
            return t
        least = _PART_US if t == begin and ahead <= _MET_VOLTS else _NUDGE_US
        t += max(_step(max(ahead, 0.0), way * (rate - slope), curve), least)
    return math.inf


@_njit
def _step(value, rate, bend):  # type: ignore[no-untyped-def]
    """The s > 0 at which value + rate s - bend s²/2, value >= 0, is 0; without cancellation for either sign."""
    root = math.sqrt(rate * rate + 2.0 * bend * value)
    if root == 0.0:
        return 0.0
    return (rate + root) / bend if rate >= 0.0 else 2.0 * value / (root - rate)
