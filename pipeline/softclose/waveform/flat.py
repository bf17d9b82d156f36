"""Owns the flat form of pulses: pieces on which u(t) is a constant plus a few cosines, or a line as a long one."""

from __future__ import annotations

import math
from typing import TypeVar

import numpy as np

from softclose.arrays import FloatArray, IntArray
from softclose.waveform.pulses import Waveform

SNAP_US = 1e-9
"""Knots closer than this are one: rounding in start + rise + peak must not make a piece of 1e-14 µs."""


_LINE = 1e-5
"""Half a line's length in the angle of the cosine that stands for it: (1e-5)²/6 of its rise is left, as is rounding."""


Numeric = TypeVar("Numeric", float, FloatArray)


def line_term(begin: Numeric, end: Numeric, first: Numeric, last: Numeric) -> tuple[Numeric, Numeric, Numeric]:
    """Of a straight line about its mean the middle of a long cosine: amplitude [V], frequency [1/µs], origin [µs]."""
    omega = 2.0 * _LINE / (end - begin)
    # -amplitude cos(omega (t - middle) + pi/2) = amplitude sin(omega (t - middle)), amplitude = slope / omega
    return (first - last) / (2.0 * _LINE), omega, 0.5 * (begin + end) - 0.5 * math.pi / omega


def flatten_pulses(waveform: Waveform, horizon_us: float) -> tuple[FloatArray, IntArray, FloatArray]:
    """Cut Eqs. 12-13 at every knot in [0, horizon].

    Returns (pieces, n_ramps, ramps): `pieces` (n_piece, 3) float64 with start, end [µs] and the constant part of u
    [V]; `n_ramps` (n_piece,) int64; `ramps` (n_piece, max, 3) float64 with amplitude [V], angular frequency [1/µs] and
    origin [µs] of `amplitude·cos(omega·(t − origin))`. The pieces cover [0, horizon] without gaps.
    """
    knots = [0.0]
    for knot in waveform.breakpoints(horizon_us):
        if knot - knots[-1] > SNAP_US and horizon_us - knot > SNAP_US:
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


def volts(pieces: FloatArray, n_ramps: IntArray, ramps: FloatArray, which: IntArray, t: FloatArray) -> FloatArray:
    """u(t) [V] on pieces `which` at instants t [µs], both of any one shape; rows of ramps as of `flatten_pulses`, or
    with a decay from the start of the piece on [1/µs] as a fourth number.
    """
    which, u = np.asarray(which), np.array(pieces[which, 2])
    for j in range(ramps.shape[1]):
        has = n_ramps[which] > j
        here, at = which[has], t[has]
        term = ramps[here, j]
        wave = term[:, 0] * np.cos(term[:, 1] * (at - term[:, 2]))
        if ramps.shape[2] > 3:
            wave *= np.exp(-term[:, 3] * np.maximum(at - pieces[here, 0], 0.0))
        u[has] += wave
    return u
