"""Owns the readable twin of the kernel: adaptive Dormand-Prince 5(4) with dense output and located impacts.

The method of the paper. `taylor.py` computes the same numbers several times faster and is tested against this.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import cast

import numpy as np
from numba import njit

from softclose.compiled import cached_njit
from softclose.kernel.pieces import voltage
from softclose.kernel.release import release_time
from softclose.kernel.results import store
from softclose.kernel.source import fingerprint

_MIN_STEP_US = 1e-13


@njit(error_model="numpy")
def _acceleration(pieces, n_ramps, ramps, i, t, x, gap, c, k):  # type: ignore[no-untyped-def]
    """Eq. 1 on piece i [µm/µs²]."""
    pull = voltage(pieces, n_ramps, ramps, i, t) / (gap - x)
    return c * pull * pull - k * x


@njit(error_model="numpy")
def _step(pieces, n_ramps, ramps, i, t, x, v, a, h, gap, c, k, stages):  # type: ignore[no-untyped-def]
    """One Dormand-Prince step: new x, v, a and the error estimates of x and v. `stages` (7, 2) keeps the slopes."""
    s = stages
    s[0, 0] = v
    s[0, 1] = a
    vs = v + h * (a / 5)
    s[1, 0] = vs
    s[1, 1] = _acceleration(pieces, n_ramps, ramps, i, t + h / 5, x + h * (v / 5), gap, c, k)
    xs = x + h * (3 / 40 * s[0, 0] + 9 / 40 * s[1, 0])
    vs = v + h * (3 / 40 * s[0, 1] + 9 / 40 * s[1, 1])
    s[2, 0] = vs
    s[2, 1] = _acceleration(pieces, n_ramps, ramps, i, t + 3 * h / 10, xs, gap, c, k)
    xs = x + h * (44 / 45 * s[0, 0] - 56 / 15 * s[1, 0] + 32 / 9 * s[2, 0])
    vs = v + h * (44 / 45 * s[0, 1] - 56 / 15 * s[1, 1] + 32 / 9 * s[2, 1])
    s[3, 0] = vs
    s[3, 1] = _acceleration(pieces, n_ramps, ramps, i, t + 4 * h / 5, xs, gap, c, k)
    b1, b2, b3, b4 = 19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729
    xs = x + h * (b1 * s[0, 0] + b2 * s[1, 0] + b3 * s[2, 0] + b4 * s[3, 0])
    vs = v + h * (b1 * s[0, 1] + b2 * s[1, 1] + b3 * s[2, 1] + b4 * s[3, 1])
    s[4, 0] = vs
    s[4, 1] = _acceleration(pieces, n_ramps, ramps, i, t + 8 * h / 9, xs, gap, c, k)
    c1, c2, c3, c4, c5 = 9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656
    xs = x + h * (c1 * s[0, 0] + c2 * s[1, 0] + c3 * s[2, 0] + c4 * s[3, 0] + c5 * s[4, 0])
    vs = v + h * (c1 * s[0, 1] + c2 * s[1, 1] + c3 * s[2, 1] + c4 * s[3, 1] + c5 * s[4, 1])
    s[5, 0] = vs
    s[5, 1] = _acceleration(pieces, n_ramps, ramps, i, t + h, xs, gap, c, k)
    d1, d3, d4, d5, d6 = 35 / 384, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84
    x_new = x + h * (d1 * s[0, 0] + d3 * s[2, 0] + d4 * s[3, 0] + d5 * s[4, 0] + d6 * s[5, 0])
    v_new = v + h * (d1 * s[0, 1] + d3 * s[2, 1] + d4 * s[3, 1] + d5 * s[4, 1] + d6 * s[5, 1])
    s[6, 0] = v_new
    s[6, 1] = _acceleration(pieces, n_ramps, ramps, i, t + h, x_new, gap, c, k)
    e1, e3, e4, e5, e6, e7 = 71 / 57600, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40
    x_err = h * (e1 * s[0, 0] + e3 * s[2, 0] + e4 * s[3, 0] + e5 * s[4, 0] + e6 * s[5, 0] + e7 * s[6, 0])
    v_err = h * (e1 * s[0, 1] + e3 * s[2, 1] + e4 * s[3, 1] + e5 * s[4, 1] + e6 * s[5, 1] + e7 * s[6, 1])
    return x_new, v_new, s[6, 1], x_err, v_err


@njit(error_model="numpy")
def _dense(stages, component, y0, y1, h, theta):  # type: ignore[no-untyped-def]
    """Hairer's fourth-order interpolant of component 0 (x) or 1 (v) at t + theta·h."""
    k1, k3, k4 = stages[0, component], stages[2, component], stages[3, component]
    k5, k6, k7 = stages[4, component], stages[5, component], stages[6, component]
    diff = y1 - y0
    r3 = h * k1 - diff
    r4 = diff - h * k7 - r3
    r5 = h * (
        -12715105075 / 11282082432 * k1
        + 87487479700 / 32700410799 * k3
        - 10690763975 / 1880347072 * k4
        + 701980252875 / 199316789632 * k5
        - 1453857185 / 822651844 * k6
        + 69997945 / 29380423 * k7
    )
    other = 1.0 - theta
    return y0 + theta * (diff + other * (r3 + theta * (r4 + other * r5)))


@njit(error_model="numpy")
def _contact(stages, x0, x1, v0, v1, h, travel):  # type: ignore[no-untyped-def]
    """First theta in (0, 1] with x = travel coming from below, on the dense output; -1 if the step has none.

    v changes sign at most once in a step this short, so x is monotone on either side of that instant.
    """
    lo, hi = 0.0, 1.0
    if v0 * v1 < 0.0 or (v0 == 0.0 and v1 > 0.0):  # x turns within the step: find where
        a, b = 0.0, 1.0
        for _ in range(50):
            m = 0.5 * (a + b)
            if (_dense(stages, 1, v0, v1, h, m) > 0.0) == (v1 > 0.0):
                b = m
            else:
                a = m
        if v1 > 0.0:
            lo = b  # a minimum: contact can only follow it
        else:
            hi = a  # a maximum: a double crossing has its first root before it
    elif v1 <= 0.0:
        return -1.0
    if (x1 if hi == 1.0 else _dense(stages, 0, x0, x1, h, hi)) < travel:
        return -1.0
    for _ in range(50):
        m = 0.5 * (lo + hi)
        if _dense(stages, 0, x0, x1, h, m) < travel:
            lo = m
        else:
            hi = m
    return hi


@njit(error_model="numpy")
def _run_switch(  # type: ignore[no-untyped-def]
    travel,
    gap,
    c,
    k,
    pieces,
    n_ramps,
    ramps,
    restitution,
    v_stick,
    rtol,
    max_steps,
    times,
    x_out,
    v_out,
    impact_time,
    impact_speed,
    stages,
):
    """One trajectory. Returns (V, first contact, settling, impacts, x, v, held, status); fills the given rows."""
    t, x, v = 0.0, 0.0, 0.0
    v_max, first, settled = math.nan, math.inf, math.inf
    held = False
    n_impacts = 0
    n_steps = 0
    h = 0.1
    hold_voltage = (gap - travel) * math.sqrt(k * travel / c)
    n_times = times.shape[0]
    i_time = 0
    for i in range(pieces.shape[0]):
        end = pieces[i, 1]
        t = pieces[i, 0]
        while t < end:
            if held:
                t = min(release_time(pieces, n_ramps, ramps, i, t, hold_voltage), end)
                while i_time < n_times and times[i_time] <= t:
                    x_out[i_time] = travel
                    v_out[i_time] = 0.0
                    i_time += 1
                if t < end:
                    held = False
                    settled = math.inf
                    h = 0.1
                continue
            n_steps += 1
            if n_steps > max_steps:
                x_out[i_time:] = math.nan
                v_out[i_time:] = math.nan
                return v_max, first, math.inf, n_impacts, math.nan, math.nan, False, 1
            a = _acceleration(pieces, n_ramps, ramps, i, t, x, gap, c, k)
            last = h >= end - t
            hs = min(h, end - t)
            if x == travel and v < 0.0 and a > 0.0 and hs > -4.0 * v / a:
                # A rebound: the step must resolve the flight, however low, or its dense output is all error.
                hs = -4.0 * v / a
                last = False
            x1, v1, _a, x_err, v_err = _step(pieces, n_ramps, ramps, i, t, x, v, a, hs, gap, c, k, stages)
            error = max(abs(x_err) / (1.0 + abs(x)), abs(v_err) / (0.1 + abs(v))) / rtol
            if not (error <= 1.0 and x1 < gap) and hs > _MIN_STEP_US:
                h = hs * (max(0.2, 0.9 * error**-0.2) if error > 1.0 and x1 < gap else 0.2)
                continue
            theta = _contact(stages, x, x1, v, v1, hs, travel)
            t_next = end if last else t + hs
            if theta >= 0.0:
                t_next = t + theta * hs
            while i_time < n_times and times[i_time] <= t_next:
                fraction = (times[i_time] - t) / hs
                x_out[i_time] = _dense(stages, 0, x, x1, hs, fraction)
                v_out[i_time] = _dense(stages, 1, v, v1, hs, fraction)
                i_time += 1
            if theta < 0.0:
                t, x, v = t_next, x1, v1
                h = hs * min(5.0, 0.9 * max(error, 1e-6) ** -0.2)
                continue
            # The interpolant is one order below the step: polish the instant with whole steps of exactly that length.
            tau = theta * hs
            speed = _dense(stages, 1, v, v1, hs, theta)
            for _ in range(3):
                x_hit, v_hit, _a, _e, _f = _step(pieces, n_ramps, ramps, i, t, x, v, a, tau, gap, c, k, stages)
                shift = (x_hit - travel) / v_hit if v_hit > 0.0 else 0.0
                if abs(shift) < 0.1 * tau:
                    tau -= shift
                    speed = v_hit
            speed = max(speed, 0.0)
            t = min(t + tau, end)
            x = travel
            v = -restitution * speed
            h = min(h, hs)
            if n_impacts == 0:
                first = t
                v_max = speed
            v_max = max(v_max, speed)
            if n_impacts < impact_time.shape[0]:
                impact_time[n_impacts] = t
                impact_speed[n_impacts] = speed
            n_impacts += 1
            if -v < v_stick and abs(voltage(pieces, n_ramps, ramps, i, t)) >= hold_voltage:
                held = True
                v = 0.0
                settled = t
    while i_time < n_times:
        x_out[i_time] = x
        v_out[i_time] = v
        i_time += 1
    return v_max, first, settled, n_impacts, x, v, held, 0


def _build(source: int) -> Callable[..., None]:
    @cached_njit(nogil=True, error_model="numpy")
    def run_block(  # type: ignore[no-untyped-def]
        lo,
        hi,
        devices,
        pieces,
        n_ramps,
        ramps,
        v_stick,
        rtol,
        max_steps,
        times,
        metrics,
        n_impacts,
        closed,
        status,
        impact_time,
        impact_speed,
        x_out,
        v_out,
    ):
        """Switches lo..hi-1 of `devices` (n, 8: travel, gap, c, k, restitution, losses); outputs are rows of arrays."""
        if source < 0:  # never: closes over the fingerprint, see source.py
            return
        stages = np.zeros((7, 2))
        for i in range(lo, hi):
            row = i if impact_time.shape[1] > 0 else 0
            out = i if times.shape[0] > 0 else 0
            found = _run_switch(
                devices[i, 0],
                devices[i, 1],
                devices[i, 2],
                devices[i, 3],
                pieces,
                n_ramps,
                ramps,
                devices[i, 4],
                v_stick,
                rtol,
                max_steps,
                times,
                x_out[out],
                v_out[out],
                impact_time[row],
                impact_speed[row],
                stages,
            )
            store(i, found, metrics, n_impacts, closed, status)

    return cast("Callable[..., None]", run_block)


run_block = _build(fingerprint())
