"""Owns how samples of a motion are read off its polynomials: into arrays of float64 or of float32."""

from __future__ import annotations

import numpy as np
from numba import njit

from softclose.kernel.modes_series import blend
from softclose.kernel.series import evaluate, sample, sample_single


@njit(error_model="numpy", forceinline=True)
def stop_at(times, first, until):  # type: ignore[no-untyped-def]
    """One past the last sample from `first` on that is not after `until`."""
    stop = first
    while stop + 8 <= times.shape[0] and times[stop + 7] <= until:
        stop += 8
    while stop < times.shape[0] and times[stop] <= until:
        stop += 1
    return stop


@njit(error_model="numpy", forceinline=True)
def _fill(values, row, first, stop, value):  # type: ignore[no-untyped-def]
    for m in range(stop - first):
        values[row, np.uintp(first + m)] = value


@njit(error_model="numpy", inline="always")
def write(row, first, stop, x, v, x64, v64, x32, v32):  # type: ignore[no-untyped-def]
    """One position and velocity at samples first..stop-1."""
    if x64.shape[1] > 0:
        _fill(x64, row, first, stop, x)
        _fill(v64, row, first, stop, v)
    else:
        _fill(x32, row, first, stop, np.float32(x))
        _fill(v32, row, first, stop, np.float32(v))


@njit(error_model="numpy", inline="always")
def sample_until(series, t, until, times, first, row, x64, v64, x32, v32):  # type: ignore[no-untyped-def]
    """Sample the polynomial that starts at t up to `until`; the number of samples written so far."""
    stop = stop_at(times, first, until)
    if stop > first:
        if x64.shape[1] > 0:
            sample(series, t, times, first, stop, row, x64, v64)
        else:
            sample_single(series, t, times, first, stop, row, x32, v32)
    return stop


@njit(error_model="numpy", forceinline=True)
def peak_of(a0, v0, a1, v1, series, h, peak):  # type: ignore[no-untyped-def]
    """Largest |a| within a step, to second order in where it turns."""
    peak = max(peak, abs(a1))
    if v0 * v1 < 0.0:
        peak = max(peak, abs(evaluate(series, h * v0 / (v0 - v1))[0]))
    return peak


@njit(error_model="numpy")
def sample_further(series, at, by, t, until, times, first, row, x64, v64, x32, v32):  # type: ignore[no-untyped-def]
    """Sample at + by times the polynomial. Not inlined: whoever wants no further mode pays nothing for it."""
    scaled = blend(series, series, by, 0.0)
    sample_until((at + scaled[0], *scaled[1:]), t, until, times, first, row, x64, v64, x32, v32)
