"""Owns bounces under constant voltage: half a flight without losses, with losses the map from rebound to return.

The motion is autonomous there, so that how long a bounce lasts and how fast it returns are smooth functions of the
speed w of the rebound. Their values and slopes at w = 0 are those of a constant force F and drag d, the duration
T = 2 w / F (1 - d w / 3 F) and the return R = w (1 - 2 d w / 3 F); what a switch's own first bounces took adds a term
each (Newton's divided differences), until they tell the next bounce beforehand. From there on none is integrated.
"""

from __future__ import annotations

import math

from numba import njit

from softclose.kernel.series import evaluate, flight_constant
from softclose.kernel.step import step_size

MAX_RETURNS = 8
"""Bounces that are learnt from."""
_APART = 0.7
"""A bounce adds a term where its rebound is slower than this part of the last one's that did."""
_SURE = 30.0
"""Error, in rtol, to which a bounce has to be told beforehand: those after it are told better, being slower."""


@njit(error_model="numpy", forceinline=True)
def symmetric_flight(w, longest, travel, gap, c, k, u, tolerance, near, max_steps):  # type: ignore[no-untyped-def]
    """Flight time [µs] after a rebound at speed w under constant u, inf if above `longest`; and the steps taken.

    The way back mirrors the way out, so only the turning point is integrated for.
    """
    t, x, v = 0.0, travel, -w
    duration = math.inf
    n_steps = 0
    while n_steps < max_steps and 2.0 * t <= longest:
        n_steps += 1
        series = flight_constant(x, v, u, gap, c, k)
        h = min(step_size(series, tolerance), longest)
        x1, v1 = evaluate(series, h)
        if v1 < 0.0:
            t, x, v = t + h, x1, v1
            continue
        tau = h * v / (v - v1)
        for _ in range(8):
            xt, vt = evaluate(series, tau)
            shift = vt / (c * (u / (gap - xt)) ** 2 - k * xt)
            tau -= shift
            if abs(shift) < near:  # convergence is quadratic: what is left is of the order of near²
                break
        if 2.0 * (t + tau) <= longest:
            duration = 2.0 * (t + tau)
        break
    return duration, n_steps


@njit(error_model="numpy", forceinline=True)
def predict(memo, n, w, force, drag):  # type: ignore[no-untyped-def]
    """Duration [µs] and return speed after a rebound at speed w, by what n bounces have told.

    memo: (3, MAX_RETURNS) float64: their w, and the divided differences of duration and speed.
    """
    bend = -drag * w / (3.0 * force)
    t = r = 0.0
    for j in range(n - 1, -1, -1):
        t = t * (w - memo[0, j]) + memo[1, j]
        r = r * (w - memo[0, j]) + memo[2, j]
    return 2.0 * w / force * (1.0 + bend + w * w * t), w * (1.0 + 2.0 * bend + w * w * r)


@njit(error_model="numpy", forceinline=True)
def learn(memo, n, w, duration, back, force, drag, rtol):  # type: ignore[no-untyped-def]
    """Take in a bounce of that rebound, duration and return: (bounces told of, whether the next need not be flown)."""
    if n > 0 and w > _APART * memo[0, n - 1]:
        return n, False
    told_t, told_r = predict(memo, n, w, force, drag)
    limit = _SURE * rtol
    sure = n > 0 and abs(told_t - duration) <= limit * duration and abs(told_r - back) <= limit * back
    if n == MAX_RETURNS:  # rebounds beyond what a power series reaches: begin again with slower ones
        n = 0
    bend = -drag * w / (3.0 * force)
    t = (0.5 * duration * force / w - 1.0 - bend) / (w * w)
    r = (back / w - 1.0 - 2.0 * bend) / (w * w)
    for j in range(n):
        t = (t - memo[1, j]) / (w - memo[0, j])
        r = (r - memo[2, j]) / (w - memo[0, j])
    memo[0, n], memo[1, n], memo[2, n] = w, t, r
    return n + 1, sure
