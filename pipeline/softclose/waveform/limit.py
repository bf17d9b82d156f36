"""Owns the limit on the sum of the pulses, compiled: the largest sum of a waveform, and delays that keep it admissible.

A search maps thousands of points to admissible waveforms: 1.5 ms each in plain Python, 0.02 ms here. Each entry point
is one piece of machine code, its parts put in before compilation: compiled and cached code give the same bits.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from softclose.compiled import cached_njit

_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
_SAMPLES = 16


@njit(inline="always")
def _at(rows, n, t):  # type: ignore[no-untyped-def]
    """Sum of the first n pulses (start, rise, peak, volts) at one instant, Eqs. 12-13."""
    u = 0.0
    for j in range(n):
        since = t - rows[j, 0]
        rise = rows[j, 1]
        fall = since - rise - rows[j, 2]
        if since < 0.0 or fall >= rise:
            continue
        if since < rise:
            u += rows[j, 3] * (0.5 - 0.5 * math.cos(math.pi * since / rise))
        elif fall < 0.0:
            u += rows[j, 3]
        else:
            u += rows[j, 3] * (0.5 + 0.5 * math.cos(math.pi * fall / rise))
    return u


@njit(inline="always")
def _largest(rows, n, begin, end, floor):  # type: ignore[no-untyped-def]
    """The larger of floor and the largest sum of the first n pulses in [begin, end], to about 1e-10 relative.

    Between knots every pulse is monotone, so the sum of their larger ends bounds the sum; where that bound is above
    what was found, the interval is sampled, and its best sample polished by golden sections unless the curvature says
    that nothing higher can hide between two samples.
    """
    knots = np.empty(4 * n + 2)
    knots[0] = begin
    m = 1
    for j in range(n):
        t = rows[j, 0]
        for k in range(4):
            if begin < t < end:
                place = m
                while place > 1 and knots[place - 1] > t:
                    knots[place] = knots[place - 1]
                    place -= 1
                knots[place] = t
                m += 1
            t += rows[j, 2] if k == 1 else rows[j, 1]
    knots[m] = end
    best = floor
    for i in range(m + 1):
        best = max(best, _at(rows, n, knots[i]))
    for i in range(m):
        a, b = knots[i], knots[i + 1]
        if not b > a:
            continue
        bound, curvature, middle = 0.0, 0.0, 0.5 * (a + b)
        for j in range(n):
            bound += max(_at(rows[j : j + 1], 1, a), _at(rows[j : j + 1], 1, b))
            since = middle - rows[j, 0]
            fall = since - rows[j, 1] - rows[j, 2]
            if 0.0 <= since < rows[j, 1] or 0.0 <= fall < rows[j, 1]:
                curvature += 0.5 * rows[j, 3] * (math.pi / rows[j, 1]) ** 2
        if bound <= best * (1.0 + 1e-12):
            continue
        step = (b - a) / _SAMPLES
        top, where = -1.0, 0
        for k in range(_SAMPLES + 1):
            u = _at(rows, n, a + k * step)
            if u > top:
                top, where = u, k
        best = max(best, top)
        if top + 0.125 * step * step * curvature <= best:
            continue
        low, high = max(a, a + (where - 1) * step), min(b, a + (where + 1) * step)
        while high - low > 1e-5 * step:  # the maximum is flat: an error of 1e-5 in t is one of 1e-10 in u
            left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
            if _at(rows, n, left) < _at(rows, n, right):
                low = left
            else:
                high = right
        best = max(best, _at(rows, n, 0.5 * (low + high)))
    return best


@cached_njit(nogil=True, error_model="numpy")
def largest_sum(rows, horizon):  # type: ignore[no-untyped-def]
    """Largest sum in [0, horizon] [V] of the pulses (n_pulse, 4) start, rise, peak [µs], volts."""
    return _largest(rows, rows.shape[0], 0.0, horizon, 0.0)


@cached_njit(nogil=True, error_model="numpy")
def separate(rows, limit, target):  # type: ignore[no-untyped-def]
    """Delay pulses, in place, until the sum respects the limit [V].

    rows: (n, n_pulse, 4) start, rise, peak [µs], volts, in order of their starts. A pulse keeps its gap to the end of
    the flat top before it; where the sum is then above `limit`, it is delayed by bisection until the sum is at most
    `target`, a little below: what was separated once is left alone.
    """
    for i in range(rows.shape[0]):
        top_ends = 0.0  # of the pulse before, where it was asked for
        for j in range(rows.shape[1]):
            asked = rows[i, j, 0]
            if j > 0:
                before_ends = rows[i, j - 1, 0] + rows[i, j - 1, 1] + rows[i, j - 1, 2]
                earliest = max(rows[i, j - 1, 0], before_ends + (asked - top_ends))
                rows[i, j, 0] = earliest
                clear = 0.0  # from here on the pulse is alone
                for k in range(j):
                    clear = max(clear, rows[i, k, 0] + 2.0 * rows[i, k, 1] + rows[i, k, 2])
                low, high, threshold = earliest, clear, limit
                # The first round tries the earliest instant itself; the others halve what is left.
                middle = earliest
                while high - low > 1e-6:
                    rows[i, j, 0] = middle
                    if _largest(rows[i], j + 1, middle, clear, threshold) > threshold:
                        low = middle
                    else:
                        high = middle
                    threshold = target
                    middle = 0.5 * (low + high)
                if earliest < clear:
                    rows[i, j, 0] = high
            top_ends = asked + rows[i, j, 1] + rows[i, j, 2]
