"""Owns what a generator makes of pulses: steps in time and in volts, each held, as exact pieces of constant voltage.

Steps so fine that nothing can feel them are not told one by one: a clock below `FINEST_US` is its delay of half a step,
and where steps of voltage follow one another so fast that each has less than `FELT_VOLT_US` off the ramp, that is left.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from softclose.arrays import FloatArray, IntArray
from softclose.waveform.flat import SNAP_US, flatten_pulses
from softclose.waveform.pulses import Pulse, Waveform

FINEST_US = 5e-3
"""Samples closer than this are not told apart [µs]: between them and their mean lie 1e-4 V µs at 40 V/µs."""
FELT_VOLT_US = 2.5e-4
"""Largest area between a step and its ramp that is left out [V µs] (see `softclose.waveform.fitted`):
a quarter of what a fit leaves out."""
_LOOKS = 257
"""Points of a ramp between which it is taken to turn once at most."""


def stepped(
    waveform: Waveform, resolution_us: float, resolution_volts: float, horizon_us: float
) -> tuple[FloatArray, IntArray, FloatArray]:
    """What the generator gives on [0, horizon], as `flatten_pulses` returns it.

    resolution_us: time between two voltages [µs], 0 for none; resolution_volts: step of the voltages [V], 0 for none.
    """
    if 0.0 < resolution_us < FINEST_US:
        late = [Pulse(p.start_us + 0.5 * resolution_us, p.rise_us, p.peak_us, p.volts) for p in waveform.pulses]
        waveform, resolution_us = Waveform(late), 0.0
    pieces, n_ramps, ramps = flatten_pulses(waveform, horizon_us)
    if not (resolution_us or resolution_volts):
        return pieces, n_ramps, ramps
    begins: list[FloatArray] = []
    levels: list[FloatArray] = []
    curves: list[int] = []  # of each step the piece whose curve is left, or -1
    for i, (begin, end, level) in enumerate(pieces):
        rows = ramps[i, : n_ramps[i]]
        if resolution_us:
            first, last = (math.ceil(t / resolution_us - 1e-9) for t in (begin, end))
            at = resolution_us * np.arange(first, min(last, first + 1) if len(rows) == 0 else last)
            volts = _rounded(_curve(rows, level, at), resolution_volts)
        elif len(rows) == 0:
            at, volts = np.array([begin]), _rounded(np.array([level]), resolution_volts)
        else:
            at, volts = _crossings(rows, level, begin, end, resolution_volts)
        begins.append(at)
        levels.append(volts)
        curves.extend(np.where(np.isnan(volts), i, -1).tolist())
    t, u, curve = np.concatenate(begins), np.concatenate(levels), np.array(curves)
    t = np.minimum(t, horizon_us)
    kept = np.append(True, (np.diff(u) != 0.0) | (curve[1:] >= 0) | (curve[:-1] >= 0))
    t, u, curve = t[kept], u[kept], curve[kept]
    ends = np.append(t[1:], horizon_us)
    long_enough = ends - t > SNAP_US
    t, u, curve = t[long_enough], u[long_enough], curve[long_enough]
    t[0] = 0.0
    ends = np.append(t[1:], horizon_us)
    whole = curve >= 0
    u[whole] = pieces[curve[whole], 2]
    n = np.where(whole, n_ramps[curve], 0)
    terms = np.where(whole[:, None, None], ramps[curve], 0.0)
    return np.stack([t, ends, u], axis=1), n, np.ascontiguousarray(terms)


def _rounded(u: FloatArray, step: float) -> FloatArray:
    return np.asarray(step * np.round(u / step)) if step else u


def _curve(rows: FloatArray, level: float, t: FloatArray) -> FloatArray:
    amplitude, omega, origin = rows.T[:, :, None]
    return np.asarray(level + (amplitude * np.cos(omega * (t - origin))).sum(axis=0))


def _slope(rows: FloatArray, t: FloatArray) -> FloatArray:
    amplitude, omega, origin = rows.T[:, :, None]
    return np.asarray(-(amplitude * omega * np.sin(omega * (t - origin))).sum(axis=0))


def _crossings(rows: FloatArray, level: float, begin: float, end: float, step: float) -> tuple[FloatArray, FloatArray]:
    """Instants at which a ramp is rounded to another voltage, and those voltages; NaN from where its curve is left."""
    looks = np.linspace(begin, end, _LOOKS)
    slope = _slope(rows, looks)
    turning = np.flatnonzero(slope[1:] * slope[:-1] < 0.0)
    if len(turning):
        first = slope[turning]
        low, high = _halved(lambda t: _slope(rows, t) * first > 0.0, looks[turning], looks[turning + 1])
        looks = np.sort(np.append(looks, 0.5 * (low + high)))
    whole = np.round(_curve(rows, level, looks) / step)
    jumps = np.abs(np.diff(whole)).astype(int)
    fine = _longest(np.abs(_slope(rows, looks)), np.diff(looks), jumps, step) * step <= 8.0 * FELT_VOLT_US
    told = np.where(fine, 0, jumps)
    which = np.repeat(np.arange(len(jumps)), told)
    nth = np.arange(len(which)) - np.repeat(np.cumsum(told) - told, told)
    way = np.sign(np.diff(whole))[which]
    edge = (whole[which] + way * (nth + 0.5)) * step
    high = _halved(lambda t: way * (_curve(rows, level, t) - edge) < 0.0, looks[which], looks[which + 1])[1]
    # Where the curve is left, and where after it steps are told again, another piece begins.
    other = np.flatnonzero(np.diff(np.append(False, fine)))
    at = np.concatenate([[begin], looks[other], high])
    volts = np.concatenate([[whole[0]], np.where(fine[other], math.nan, whole[other]), whole[which] + way * (nth + 1)])
    order = np.argsort(at, kind="stable")
    return at[order], step * volts[order]


def _halved(
    is_before: Callable[[FloatArray], NDArray[np.bool_]], low: FloatArray, high: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Instants so close to one another that what lies between them is told to 1e-12 of where they were."""
    for _ in range(40):
        middle = 0.5 * (low + high)
        before = is_before(middle)
        low, high = np.where(before, middle, low), np.where(before, high, middle)
    return low, high


def _longest(slope: FloatArray, width: FloatArray, jumps: IntArray, step: float) -> FloatArray:
    """How long a step between looks lasts at most [µs]: as at the end that is less steep, or, from rest, as the first
    of so many steps of a parabola.

    slope: magnitudes at the looks [V/µs]; width: between them [µs]; jumps: how many steps there are between them.
    """
    by_slope = step / np.maximum(np.minimum(slope[1:], slope[:-1]), 1e-12)
    return np.where(jumps > 0, np.minimum(by_slope, width / np.sqrt(np.maximum(jumps, 1))), by_slope)
