"""Owns the limit on the sum of the pulses, compiled: the largest sum of a waveform, and delays that keep it admissible.

A search maps thousands of points to admissible waveforms: 1.5 ms each in plain Python, 0.02 ms here. Each entry point
is one piece of machine code, its parts put in before compilation: compiled and cached code give bit-identical results.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from softclose.compiled import cached_njit

_EXACT = 1e-10
"""To which the largest sum is found, relative."""
_STACK = 64
"""Cells that wait: one a halving, and 1e-10 is reached after some twenty."""


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
    """The larger of floor and the largest sum of the first n pulses in [begin, end], to 1e-10 relative.

    Between knots every pulse is monotone, so the sum of their larger ends bounds the sum; where that bound is above
    what was found, the interval is halved until no cell can hide anything higher. What a cell can hide follows from
    its ends and the largest curvature C that the pulses can add up to: u stays below the parabola of curvature -C
    through both ends (branch and bound; no local maximum is missed).
    """
    knots, cells = np.empty(4 * n + 2), np.empty((_STACK, 4))
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
        cells[0] = a, b, _at(rows, n, a), _at(rows, n, b)
        waiting = 1
        while waiting > 0:
            waiting -= 1
            left, right, u_left, u_right = cells[waiting]
            width = right - left
            lift, climb = 0.125 * curvature * width * width, abs(u_right - u_left)
            top = max(u_left, u_right)
            if climb < 4.0 * lift:
                top = 0.5 * (u_left + u_right) + lift + climb * climb / (16.0 * lift)
            if top <= best * (1.0 + _EXACT) or waiting + 2 > _STACK:
                continue
            half = 0.5 * (left + right)
            u = _at(rows, n, half)
            best = max(best, u)
            # The higher half last: it is looked at first, and what it finds closes the other.
            higher = u_right > u_left
            cells[waiting] = (left, half, u_left, u) if higher else (half, right, u, u_right)
            cells[waiting + 1] = (half, right, u, u_right) if higher else (left, half, u_left, u)
            waiting += 2
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
