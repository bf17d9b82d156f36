"""Owns the flat form of a waveform that the kernels read: pieces on which u(t) is a constant plus a few cosines."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from softclose.waveform import Trace, Waveform

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_SNAP_US = 1e-9
"""Knots closer than this are one: rounding in start + rise + peak must not make a piece of 1e-14 µs."""


_LINE = 1e-5
"""Half a line's length in the angle of the cosine that stands for it: (1e-5)²/6 of its rise is left, as is rounding."""


def flatten(drive: Waveform | Trace, horizon_us: float) -> tuple[FloatArray, IntArray, FloatArray]:
    """The flat form of a drive: `flatten_pulses`, or `flatten_lines`."""
    return flatten_lines(drive, horizon_us) if isinstance(drive, Trace) else flatten_pulses(drive, horizon_us)


def flatten_lines(trace: Trace, horizon_us: float) -> tuple[FloatArray, IntArray, FloatArray]:
    """Straight lines, each as the middle of a long cosine: the kernels know no other form.

    Returns what `flatten_pulses` returns.
    """
    inside = trace.times_us[trace.times_us < horizon_us]
    knots = np.append(inside, horizon_us)
    u = trace.voltage(knots)
    long_enough = np.append(np.diff(knots) > _SNAP_US, True)
    knots, u = knots[long_enough], u[long_enough]
    knots[0] = 0.0
    begin, end = knots[:-1], knots[1:]
    middle, rise = 0.5 * (begin + end), np.diff(u)
    pieces = np.stack([begin, end, 0.5 * (u[:-1] + u[1:])], axis=1)
    sloping = rise != 0.0
    omega = 2.0 * _LINE / (end - begin)
    # -amplitude cos(omega (t - middle) + pi/2) = amplitude sin(omega (t - middle)), amplitude = slope / omega
    ramps = np.stack([-rise / (2.0 * _LINE), omega, middle - 0.5 * math.pi / omega], axis=1)
    return pieces, sloping.astype(np.int64), np.ascontiguousarray(ramps[:, None, :])


def flatten_pulses(waveform: Waveform, horizon_us: float) -> tuple[FloatArray, IntArray, FloatArray]:
    """Cut Eqs. 12-13 at every knot in [0, horizon].

    Returns (pieces, n_ramps, ramps): `pieces` (n_piece, 3) float64 with start, end [µs] and the constant part of u
    [V]; `n_ramps` (n_piece,) int64; `ramps` (n_piece, max, 3) float64 with amplitude [V], angular frequency [1/µs] and
    origin [µs] of `amplitude·cos(omega·(t − origin))`. The pieces cover [0, horizon] without gaps.
    """
    knots = [0.0]
    for knot in waveform.breakpoints(horizon_us):
        if knot - knots[-1] > _SNAP_US and horizon_us - knot > _SNAP_US:
            knots.append(float(knot))
    knots.append(horizon_us)
    pieces = np.zeros((len(knots) - 1, 3))
    n_ramps = np.zeros(len(pieces), dtype=np.int64)
    ramps = np.zeros((len(pieces), max(1, len(waveform.pulses)), 3))
    for i, piece in enumerate(pieces):
        piece[:2] = knots[i], knots[i + 1]
        middle = 0.5 * (knots[i] + knots[i + 1])
        for pulse in waveform.pulses:
            top = pulse.start_us + pulse.rise_us
            fall = top + pulse.peak_us
            if top <= middle < fall:
                piece[2] += pulse.volts
                continue
            if pulse.start_us <= middle < top:
                amplitude, origin = -0.5 * pulse.volts, pulse.start_us
            elif fall <= middle < pulse.end_us:
                amplitude, origin = 0.5 * pulse.volts, fall
            else:
                continue
            piece[2] += 0.5 * pulse.volts
            ramps[i, n_ramps[i]] = amplitude, math.pi / pulse.rise_us, origin
            n_ramps[i] += 1
    return pieces, n_ramps, ramps


@njit(error_model="numpy", forceinline=True)
def voltage(pieces, n_ramps, ramps, i, t):  # type: ignore[no-untyped-def]
    """u(t) [V] on piece i."""
    u = pieces[i, 2]
    for j in range(n_ramps[i]):
        u += ramps[i, j, 0] * math.cos(ramps[i, j, 1] * (t - ramps[i, j, 2]))
    return u
