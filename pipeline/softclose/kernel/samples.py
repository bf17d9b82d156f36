"""Owns how samples of a motion are read off its polynomials: into arrays of float64 or of float32."""

from __future__ import annotations

from numba import njit

from softclose.kernel.series import sample


@njit(error_model="numpy", inline="always")
def write(row, first, stop, x, v, x64, v64, x32, v32):  # type: ignore[no-untyped-def]
    """One position and velocity at samples first..stop-1."""
    for j in range(first, stop):
        if x64.shape[1] > 0:
            x64[row, j] = x
            v64[row, j] = v
        else:
            x32[row, j] = x
            v32[row, j] = v


@njit(error_model="numpy", inline="always")
def sample_until(series, t, until, times, first, row, x64, v64, x32, v32):  # type: ignore[no-untyped-def]
    """Sample the polynomial that starts at t up to `until`; the number of samples written so far."""
    stop = first
    while stop < times.shape[0] and times[stop] <= until:
        stop += 1
    if stop > first:
        if x64.shape[1] > 0:
            sample(series, t, times, first, stop, row, x64, v64)
        else:
            sample(series, t, times, first, stop, row, x32, v32)
    return stop
