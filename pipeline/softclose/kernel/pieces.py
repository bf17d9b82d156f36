"""Owns the flat form of a drive that the kernels read: pieces on which u(t) is a constant plus a few terms.

One set of arrays, and three kinds of terms, told apart by how many numbers a row of `ramps` has (`form`):

* `COSINES`: amplitude, angular frequency, origin of amplitude cos(omega (t - origin)): pulses, and lines, which are the
  middle of a long one;
* `DECAYING`: the same and a decay, amplitude exp(-decay (t - begin)) cos(omega (t - origin)): what a low-pass delivers;
* `POLYNOMIAL`: one coefficient, row k that of (t - middle of the piece)^(k + 1): samples, of which
  many are one polynomial.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numba import njit

from softclose.arrays import FloatArray, IntArray
from softclose.waveform import AnyDrive, Fitted, Trace, Waveform
from softclose.waveform.fitted import MANY
from softclose.waveform.flat import SNAP_US, flatten_pulses, line_term
from softclose.waveform.lowpass import deliver_flat

COSINES, DECAYING, POLYNOMIAL = 3, 4, 1

_PAYS = 6
"""Lines that a polynomial has to take the place of: what follows noise takes several steps."""


def flatten(drive: AnyDrive, horizon_us: float) -> tuple[FloatArray, IntArray, FloatArray]:
    """The flat form of a drive: pieces (n_piece, 3) start, end [µs], constant [V]; number of terms; terms."""
    if isinstance(drive, Trace):
        lines = flatten_lines(drive, horizon_us)
        if len(lines[0]) <= MANY:
            return lines
        fitted = _fitted(drive.times_us.tobytes(), drive.volts.tobytes()).flat(horizon_us)
        return fitted if _PAYS * len(fitted[0]) <= len(lines[0]) else lines
    if isinstance(drive, Waveform):
        return flatten_pulses(drive, horizon_us)
    return drive.flat(horizon_us)


@lru_cache(maxsize=64)
def _fitted(times_us: bytes, volts: bytes) -> Fitted:
    """Of a trace: the same one comes to a kernel again and again."""
    return Fitted.of(Trace(np.frombuffer(times_us), np.frombuffer(volts)))


def flatten_lines(trace: Trace, horizon_us: float) -> tuple[FloatArray, IntArray, FloatArray]:
    """Straight lines, each as the middle of a long cosine: the kernels know no other form.

    Returns what `flatten_pulses` returns.
    """
    inside = trace.times_us[trace.times_us < horizon_us]
    knots = np.append(inside, horizon_us)
    u = trace.voltage(knots)
    long_enough = np.append(np.diff(knots) > SNAP_US, True)
    knots, u = knots[long_enough], u[long_enough]
    knots[0] = 0.0
    begin, end = knots[:-1], knots[1:]
    pieces = np.stack([begin, end, 0.5 * (u[:-1] + u[1:])], axis=1)
    sloping = u[1:] != u[:-1]
    ramps = np.stack(line_term(begin, end, u[:-1], u[1:]), axis=1)
    return pieces, sloping.astype(np.int64), np.ascontiguousarray(ramps[:, None, :])


_deliver_flat = njit(error_model="numpy")(deliver_flat)


@njit(error_model="numpy", forceinline=True)
def deliver(i, pieces, n_ramps, ramps, path, scales, out_pieces, out_n, out_ramps):  # type: ignore[no-untyped-def]
    """What is delivered to switch i, in the out_ arrays; its number of pieces. One row of scales is for all."""
    row = i if scales.shape[0] > 1 else 0
    rate, delay, offset = scales[row, 0], scales[row, 1], scales[row, 2]
    return _deliver_flat(pieces, n_ramps, ramps, path, rate, delay, offset, out_pieces, out_n, out_ramps)


@njit(error_model="numpy", forceinline=True)
def voltage(pieces, n_ramps, ramps, i, t):  # type: ignore[no-untyped-def]
    """u(t) [V] on piece i."""
    u = pieces[i, 2]
    if ramps.shape[2] == POLYNOMIAL:
        s = t - 0.5 * (pieces[i, 0] + pieces[i, 1])
        rest = 0.0
        for k in range(n_ramps[i] - 1, -1, -1):
            rest = (rest + ramps[i, k, 0]) * s
        return u + rest
    for j in range(n_ramps[i]):
        amplitude = ramps[i, j, 0]
        if ramps.shape[2] == DECAYING and ramps[i, j, 3] > 0.0:
            amplitude *= math.exp(-ramps[i, j, 3] * (t - pieces[i, 0]))
        u += amplitude * math.cos(ramps[i, j, 1] * (t - ramps[i, j, 2]))
    return u


@njit(error_model="numpy", forceinline=True)
def tangent(pieces, n_ramps, ramps, i, t):  # type: ignore[no-untyped-def]
    """u [V], u' and a bound of |u''| from t to the end of piece i."""
    u, slope, bend = pieces[i, 2], 0.0, 0.0
    if ramps.shape[2] == POLYNOMIAL:
        s = t - 0.5 * (pieces[i, 0] + pieces[i, 1])
        half = 0.5 * (pieces[i, 1] - pieces[i, 0])
        rest = 0.0
        for k in range(n_ramps[i] - 1, -1, -1):
            slope = slope * s + (k + 1) * ramps[i, k, 0]
            rest = (rest + ramps[i, k, 0]) * s
            if k > 0:
                bend = bend * half + (k + 1) * k * abs(ramps[i, k, 0])
        return u + rest, slope, bend
    for j in range(n_ramps[i]):
        amplitude, omega, decay = ramps[i, j, 0], ramps[i, j, 1], 0.0
        if ramps.shape[2] == DECAYING and ramps[i, j, 3] > 0.0:
            decay = ramps[i, j, 3]
            amplitude *= math.exp(-decay * (t - pieces[i, 0]))
        angle = omega * (t - ramps[i, j, 2])
        u += amplitude * math.cos(angle)
        slope -= amplitude * omega * math.sin(angle)
        bend += abs(amplitude) * omega**2
        if decay > 0.0:
            slope -= amplitude * decay * math.cos(angle)
            bend += abs(amplitude) * decay * (decay + 2.0 * omega)
    return u, slope, bend
