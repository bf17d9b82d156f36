"""The plain numba prototype: what an engineer writes in an afternoon, against which the kernel is measured.

Dormand and Prince's pair 5(4) with an error per step, one switch after the other, compiled by numba; the voltage as the
pulses' own sum, steps that end where a pulse bends, contact found by bisection of the step's cubic, x and v between
steps from the same cubic. Nothing is arranged for speed but the compiler. What its figures mean depends on `rtol`:
`benchmarks/kernel.py` prints the error of V beside the rate.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from softclose import Waveform

FloatArray = NDArray[np.float64]
ETA, V_STICK = 0.5, 1e-5
ATOL = 1e-9
"""Per step, of x [µm] and v [µm/µs]."""


def plain(
    table: FloatArray, waveform: Waveform, horizon_us: float, times_us: FloatArray, rtol: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """V of every switch [µm/µs], NaN where it touches nothing; x [µm] and v [µm/µs] at the times, float32.

    `table` (n, 4) is travel D, gap G [µm], force c and stiffness k per mass (`softclose.kernel.dispatch.devices`).
    """
    rows = waveform.rows()
    start, rise = rows[:, 0], rows[:, 1]
    bends = np.concatenate([start, start + rise, (start + rise) + rows[:, 2], (start + rise) + rows[:, 2] + rise])
    bends = np.unique(np.append(bends[(bends > 0.0) & (bends < horizon_us)], horizon_us))
    n = len(table)
    speeds = np.full(n, np.nan)
    x, v = (np.zeros((n, len(times_us)), dtype=np.float32) for _ in range(2))
    _all(table, rows, bends, times_us, rtol, speeds, x, v)
    return speeds, x, v


@njit(cache=False)
def _volts(rows, t):  # type: ignore[no-untyped-def]
    u = 0.0
    for i in range(rows.shape[0]):
        s = t - rows[i, 0]
        rise, peak = rows[i, 1], rows[i, 2]
        if s <= 0.0 or s >= peak + 2.0 * rise:
            continue
        share = 1.0
        if s < rise:
            share = 0.5 * (1.0 - math.cos(math.pi * s / rise))
        elif s > rise + peak:
            share = 0.5 * (1.0 + math.cos(math.pi * (s - rise - peak) / rise))
        u += rows[i, 3] * share
    return u


@njit(cache=False)
def _force(rows, gap, c, k, t, x):  # type: ignore[no-untyped-def]
    pull = _volts(rows, t) / (gap - x)
    return c * pull * pull - k * x


@njit(cache=False)
def _cubic(s, h, x0, v0, x1, v1):  # type: ignore[no-untyped-def]
    """Hermite's cubic through both ends of a step: x at share s of it."""
    r = 1.0 - s
    return r * r * ((1.0 + 2.0 * s) * x0 + s * h * v0) + s * s * ((3.0 - 2.0 * s) * x1 - r * h * v1)


@njit(cache=False)
def _slope(s, h, x0, v0, x1, v1):  # type: ignore[no-untyped-def]
    """Its derivative."""
    r = 1.0 - s
    return 6.0 * s * r * (x1 - x0) / h + r * (1.0 - 3.0 * s) * v0 + s * (3.0 * s - 2.0) * v1


@njit(cache=False)
def _step(rows, gap, c, k, t, h, x, v, a1):  # type: ignore[no-untyped-def]
    """x, v and the acceleration after a step from x, v and a1; the pair's difference of x and v."""
    x2, v2 = x + h * v / 5.0, v + h * a1 / 5.0
    a2 = _force(rows, gap, c, k, t + h / 5.0, x2)
    x3, v3 = x + h * (3.0 * v + 9.0 * v2) / 40.0, v + h * (3.0 * a1 + 9.0 * a2) / 40.0
    a3 = _force(rows, gap, c, k, t + 0.3 * h, x3)
    x4 = x + h * (44.0 / 45.0 * v - 56.0 / 15.0 * v2 + 32.0 / 9.0 * v3)
    v4 = v + h * (44.0 / 45.0 * a1 - 56.0 / 15.0 * a2 + 32.0 / 9.0 * a3)
    a4 = _force(rows, gap, c, k, t + 0.8 * h, x4)
    b1, b2, b3, b4 = 19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0
    x5, v5 = x + h * (b1 * v + b2 * v2 + b3 * v3 + b4 * v4), v + h * (b1 * a1 + b2 * a2 + b3 * a3 + b4 * a4)
    a5 = _force(rows, gap, c, k, t + 8.0 / 9.0 * h, x5)
    c1, c2, c3, c4, c5 = 9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0
    x6 = x + h * (c1 * v + c2 * v2 + c3 * v3 + c4 * v4 + c5 * v5)
    v6 = v + h * (c1 * a1 + c2 * a2 + c3 * a3 + c4 * a4 + c5 * a5)
    a6 = _force(rows, gap, c, k, t + h, x6)
    d1, d3, d4, d5, d6 = 35.0 / 384.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0
    x7 = x + h * (d1 * v + d3 * v3 + d4 * v4 + d5 * v5 + d6 * v6)
    v7 = v + h * (d1 * a1 + d3 * a3 + d4 * a4 + d5 * a5 + d6 * a6)
    a7 = _force(rows, gap, c, k, t + h, x7)
    e1, e3, e4 = 71.0 / 57600.0, -71.0 / 16695.0, 71.0 / 1920.0
    e5, e6, e7 = -17253.0 / 339200.0, 22.0 / 525.0, -1.0 / 40.0
    error_x = h * (e1 * v + e3 * v3 + e4 * v4 + e5 * v5 + e6 * v6 + e7 * v7)
    error_v = h * (e1 * a1 + e3 * a3 + e4 * a4 + e5 * a5 + e6 * a6 + e7 * a7)
    return x7, v7, a7, error_x, error_v


@njit(cache=False, error_model="numpy")
def _all(table, rows, bends, times, rtol, speeds, xs, vs):  # type: ignore[no-untyped-def]
    for i in range(table.shape[0]):
        travel, gap, c, k = table[i]
        t = x = v = 0.0
        h, j, bend = 0.1, 0, 0
        a = _force(rows, gap, c, k, 1e-9, x)
        held = False
        while bend < bends.size:
            end = bends[bend]
            if held:
                hold = c * (_volts(rows, t + 1e-9) / (gap - travel)) ** 2 - k * travel
                if hold >= 0.0 and c * (_volts(rows, end - 1e-9) / (gap - travel)) ** 2 >= k * travel:
                    while j < times.size and times[j] <= end:
                        xs[i, j], vs[i, j] = travel, 0.0
                        j += 1
                    t = end
                    bend += 1
                    continue
                held = False
                a = _force(rows, gap, c, k, t + 1e-9, x)
            last = t + h >= end
            step = end - t if last else h
            x1, v1, a1, error_x, error_v = _step(rows, gap, c, k, t, step, x, v, a)
            size_x = ATOL + rtol * max(abs(x), abs(x1))
            size_v = ATOL + rtol * max(abs(v), abs(v1))
            wrong = math.sqrt(0.5 * ((error_x / size_x) ** 2 + (error_v / size_v) ** 2))
            grow = 5.0 if wrong == 0.0 else min(5.0, max(0.2, 0.9 * wrong**-0.2))
            if not wrong <= 1.0 or x1 >= gap:
                h = step * min(grow, 0.5)
                continue
            touched = x1 >= travel
            after = step
            if touched:  # the first share of the step at which the cubic is through
                low, high = 0.0, 1.0
                for _ in range(60):
                    middle = 0.5 * (low + high)
                    if _cubic(middle, step, x, v, x1, v1) >= travel:
                        high = middle
                    else:
                        low = middle
                after = high * step
                _, v2, _, _, _ = _step(rows, gap, c, k, t, after, x, v, a)
            while j < times.size and times[j] <= t + after:
                s = (times[j] - t) / step
                xs[i, j], vs[i, j] = _cubic(s, step, x, v, x1, v1), _slope(s, step, x, v, x1, v1)
                j += 1
            if touched:
                t += after
                speeds[i] = v2 if math.isnan(speeds[i]) else max(speeds[i], v2)
                x, v = travel, -ETA * v2
                a = _force(rows, gap, c, k, t, travel)
                held = -v < V_STICK and a >= 0.0
                # The next step must see the whole bounce, or its end is missed.
                h = min(0.1, max(-v / max(abs(a), 1e-9), 1e-9))
            else:
                x, v, a = x1, v1, a1
                if last:  # the voltage may jump here
                    t = end
                    bend += 1
                    a = _force(rows, gap, c, k, t + 1e-9, x)
                else:
                    t += step
                h = max(h, step * grow) if last else step * grow
