"""Owns the fast kernel: a Taylor series, contacts marched on the polynomial, bounces in closed form.

`rk.py` is its readable twin. The stepping never depends on which outputs are wanted, so that V and the rest are the
same bits with and without them: samples and impacts are read off what is computed anyway.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import cast

import numpy as np
from numba import njit

from softclose.kernel.contact import NONE, UNDECIDED, first_contact
from softclose.kernel.pieces import voltage
from softclose.kernel.release import release_time
from softclose.kernel.results import store
from softclose.kernel.series import (
    ORDER,
    TERMS,
    bend,
    bounce_duration,
    constant,
    drive,
    evaluate,
    flight_constant,
    flight_driven,
    flight_time,
    sample,
)
from softclose.kernel.source import UNCOUNTED, fingerprint

WORK_LIMIT = 1
_SAFETY = 4.0
"""The last terms kept may be this much above the tolerance [1 µm/µs]: the first ones dropped are a quarter of them."""
_RELEASE_STEP_US = 0.5
_NO_BOUNCE = (0.0,) * TERMS
_ONE_BITS = int(np.float64(1.0).view(np.int64))


@njit(error_model="numpy", forceinline=True)
def _bits(a):  # type: ignore[no-untyped-def]
    """The bits of a >= 0 as an integer: log2(a) in fixed point, to 0.09."""
    return np.float64(a).view(np.int64)


@njit(error_model="numpy", forceinline=True)
def _radius(tolerance, a, n, b, m):  # type: ignore[no-untyped-def]
    """The h at which a h^n and b h^m are at most the tolerance, to a few per cent.

    Two terms of a series, since one may vanish by symmetry. The roots are taken in the floating-point bits: a step need
    not be exact, and logarithms and exponentials would cost as much as half the series.
    """
    budget = _bits(tolerance)
    exponent = min((budget - _bits(abs(a))) // n, (budget - _bits(abs(b))) // m)
    return 0.94 * np.int64(exponent + _ONE_BITS).view(np.float64)


@njit(error_model="numpy", forceinline=True)
def _step_size(x, tolerance):  # type: ignore[no-untyped-def]
    """Step at which the last two terms of v are at most the tolerance [µs].

    Where a pair of complex singularities leads, coefficients swing like cos(n phi): both may be small at once. A third,
    four before them, then bounds the step as the radius of convergence that it suggests.
    """
    budget = _bits(tolerance) - _ONE_BITS
    early = (budget // (ORDER - 1)) - (_bits(abs((ORDER - 4) * x[ORDER - 4])) - _ONE_BITS) // (ORDER - 5)
    h = 0.94 * np.int64(early + _ONE_BITS).view(np.float64)
    return min(h, _radius(tolerance, ORDER * x[ORDER], ORDER - 1, (ORDER - 1) * x[ORDER - 1], ORDER - 2))


@njit(error_model="numpy", inline="always")
def _expand(pieces, n_ramps, ramps, i, t, x, v, gap, c, k):  # type: ignore[no-untyped-def]
    """Taylor coefficients of x about t on piece i."""
    u0 = pieces[i, 2]
    if n_ramps[i] == 0:
        series = flight_constant(x, v, u0, gap, c, k)
    else:
        u = constant(u0)
        for j in range(n_ramps[i]):
            omega = ramps[i, j, 1]
            angle = omega * (t - ramps[i, j, 2])
            u = drive(u, ramps[i, j, 0] * math.cos(angle), ramps[i, j, 0] * math.sin(angle), omega)
        series = flight_driven(x, v, u, gap, c, k)
    return series


@njit(error_model="numpy", inline="always")
def _write(row, first, stop, x, v, x64, v64, x32, v32):  # type: ignore[no-untyped-def]
    """One position and velocity at samples first..stop-1."""
    for j in range(first, stop):
        if x64.shape[1] > 0:
            x64[row, j] = x
            v64[row, j] = v
        else:
            x32[row, j] = x
            v32[row, j] = v


@njit(error_model="numpy", inline="always")
def _sample_until(series, t, until, times, first, row, x64, v64, x32, v32):  # type: ignore[no-untyped-def]
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


@njit(error_model="numpy", forceinline=True)
def _symmetric_flight(w, longest, travel, gap, c, k, u, tolerance, near, max_steps):  # type: ignore[no-untyped-def]
    """Flight time [µs] after a rebound at speed w under constant u, inf if above `longest`; and the steps taken.

    The way back mirrors the way out, so only the turning point is integrated for.
    """
    t, x, v = 0.0, travel, -w
    duration = math.inf
    n_steps = 0
    while n_steps < max_steps and 2.0 * t <= longest:
        n_steps += 1
        series = flight_constant(x, v, u, gap, c, k)
        h = min(_step_size(series, tolerance), longest)
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


@njit(error_model="numpy", inline="always")
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
    row,
    x64,
    v64,
    x32,
    v32,
    event_row,
    impact_time,
    impact_speed,
):
    """One trajectory. Returns (V, first contact, settling, impacts, x, v, held, status); fills the given rows."""
    tolerance = _SAFETY * rtol
    near = 0.3 * math.sqrt(rtol)
    t, x, v = 0.0, 0.0, 0.0
    v_max, first, settled = math.nan, math.inf, math.inf
    held, launched = False, False
    n_impacts, n_steps, status = 0, 0, 0
    hold_voltage = (gap - travel) * math.sqrt(k * travel / c)
    n_times, i_time = times.shape[0], 0
    n_events = impact_time.shape[1]
    for i in range(pieces.shape[0]):
        t, end = pieces[i, 0], pieces[i, 1]
        bounce_limit = -1.0
        bounce = _NO_BOUNCE
        while t < end and status == 0:
            if held:
                if n_ramps[i] > 0:
                    t = min(release_time(pieces, n_ramps, ramps, i, t, hold_voltage), end)
                elif pieces[i, 2] >= hold_voltage:
                    t = end
                if i_time < n_times:
                    stop = i_time
                    while stop < n_times and times[stop] <= t:
                        stop += 1
                    _write(row, i_time, stop, travel, 0.0, x64, v64, x32, v32)
                    i_time = stop
                if t < end:
                    held, launched, settled = False, True, math.inf
                continue
            n_steps += 1
            if n_steps > max_steps:
                status = WORK_LIMIT
                break
            series = _expand(pieces, n_ramps, ramps, i, t, x, v, gap, c, k)
            h = _step_size(series, tolerance)
            if launched and v == 0.0:
                h = min(h, _RELEASE_STEP_US)
            last = h >= end - t
            if last:
                h = end - t
            x1, v1 = evaluate(series, h)
            tau, speed = NONE, 0.0
            # Below the contact x'' >= -k travel, so between its ends x exceeds the higher by at most k travel h²/8.
            if launched or max(x, x1) + 0.125 * k * travel * h * h >= travel:
                tau, speed = first_contact(series, h, travel - x, launched, v1, bend(series, h), near)
                if tau == UNDECIDED:
                    h, last, tau = speed, False, NONE
                    x1, v1 = evaluate(series, h)
            launched = False
            t_next = end if last else t + h
            if tau != NONE:
                t_next = min(t + tau, end)
            if i_time < n_times:
                i_time = _sample_until(series, t, t_next, times, i_time, row, x64, v64, x32, v32)
            t = t_next
            if tau == NONE:
                x, v = x1, v1
                continue
            if n_impacts == 0:
                first, v_max = t, speed
            v_max = max(v_max, speed)
            if n_impacts < n_events:
                impact_time[event_row, n_impacts] = t
                impact_speed[event_row, n_impacts] = speed
            n_impacts += 1
            x, v, launched = travel, -restitution * speed, True
            if n_ramps[i] > 0:
                if -v < v_stick and voltage(pieces, n_ramps, ramps, i, t) >= hold_voltage:
                    held, launched, v, settled = True, False, 0.0, t
                continue
            if pieces[i, 2] < hold_voltage:
                continue
            # Constant voltage that presses: energy is conserved, so each later impact has exactly the speed of the
            # rebound before it, and small bounces last a power series in that speed.
            if bounce_limit < 0.0:
                bounce_limit = 0.0
                if pieces[i, 2] > hold_voltage:
                    bounce = flight_time(travel, gap, c * pieces[i, 2] ** 2, k)
                    bounce_limit = _radius(
                        rtol * bounce[0], bounce[TERMS - 1], 2 * (TERMS - 1), bounce[TERMS - 2], 2 * (TERMS - 2)
                    )
            while True:
                if -v < v_stick:
                    held, launched, v, settled = True, False, 0.0, t
                    break
                n_steps += 1
                if -v <= bounce_limit:
                    duration = bounce_duration(bounce, -v)
                else:
                    duration, n = _symmetric_flight(
                        -v, end - t, travel, gap, c, k, pieces[i, 2], tolerance, near, max_steps
                    )
                    n_steps += n
                t_next = t + duration
                if t_next > end or n_steps > max_steps:
                    break
                # For the samples only: what is reported does not depend on it. A bounce may take several steps.
                ts, xs, vs = t, x, v
                while i_time < n_times and times[i_time] <= t_next:
                    series = _expand(pieces, n_ramps, ramps, i, ts, xs, vs, gap, c, k)
                    h = _step_size(series, tolerance)
                    until = t_next if h >= t_next - ts else ts + h
                    i_time = _sample_until(series, ts, until, times, i_time, row, x64, v64, x32, v32)
                    xs, vs = evaluate(series, h)
                    ts = until
                t = t_next
                if n_impacts < n_events:
                    impact_time[event_row, n_impacts] = t
                    impact_speed[event_row, n_impacts] = -v
                n_impacts += 1
                v *= restitution
    if status != 0:
        x, v, held, settled = math.nan, math.nan, False, math.inf
    if i_time < n_times:
        _write(row, i_time, n_times, x, v, x64, v64, x32, v32)
    return v_max, first, settled, n_impacts, x, v, held, status


def _build(source: int) -> Callable[..., None]:
    @njit(cache=True, nogil=True, error_model="numpy", **UNCOUNTED)
    def run_block(  # type: ignore[no-untyped-def]
        lo,
        hi,
        devices,
        pieces,
        n_ramps,
        ramps,
        restitution,
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
        x64,
        v64,
        x32,
        v32,
    ):
        """Switches lo..hi-1 of `devices` (n, 4: travel, gap, c, k), each on its own; outputs are rows of whole arrays.

        Samples go to x64 and v64, or to x32 and v32 where those have no columns: one compiled variant for both, so the
        metrics are the same bits whichever is asked for.
        """
        if source < 0:  # never: closes over the fingerprint, see source.py
            return
        for i in range(lo, hi):
            row = i if times.shape[0] > 0 else 0
            event_row = i if impact_time.shape[1] > 0 else 0
            found = _run_switch(
                devices[i, 0],
                devices[i, 1],
                devices[i, 2],
                devices[i, 3],
                pieces,
                n_ramps,
                ramps,
                restitution,
                v_stick,
                rtol,
                max_steps,
                times,
                row,
                x64,
                v64,
                x32,
                v32,
                event_row,
                impact_time,
                impact_speed,
            )
            store(i, found, metrics, n_impacts, closed, status)

    return cast("Callable[..., None]", run_block)


run_block = _build(fingerprint())
