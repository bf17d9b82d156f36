"""Owns the fast kernel: Taylor series of order 16, contacts marched on the polynomial, bounces in closed form.

`_rk.py` is its readable twin. The stepping never depends on which outputs are wanted, so that V and the rest are the
same bits with and without them: samples and impacts are read off what is computed anyway.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from softclose._contact import NONE, UNDECIDED, first_contact
from softclose._hold import release_time
from softclose._pieces import voltage
from softclose._series import (
    ORDER, TERMS, bend, bounce_duration, constant, drive, evaluate, flight_constant, flight_driven, flight_time, sample,
)  # fmt: skip

_SPEED_SCALE = 1.0
"""Speeds are accurate to rtol relative to this [µm/µs]."""
_RELEASE_STEP_US = 0.5
_TINY = 1e-300
_NO_BOUNCE = (0.0,) * TERMS
_ONE_BITS = int(np.float64(1.0).view(np.int64))


@njit(error_model="numpy")
def _bits(a):  # type: ignore[no-untyped-def]
    """The bits of a >= 0 as an integer: log2(a) in fixed point, to 0.09."""
    return np.float64(a).view(np.int64)


@njit(error_model="numpy")
def _step_size(x, tolerance_bits):  # type: ignore[no-untyped-def]
    """Step at which the last two terms of v are at most the tolerance, to a few per cent [µs].

    Two terms, since one may vanish by symmetry. The roots are taken in the floating-point bits: a step need not be exact,
    and logarithms and exponentials cost as much as half the series.
    """
    a = (tolerance_bits - _bits(ORDER * abs(x[ORDER]))) // (ORDER - 1)
    b = (tolerance_bits - _bits((ORDER - 1) * abs(x[ORDER - 1]))) // (ORDER - 2)
    return 0.94 * np.int64(min(a, b) + _ONE_BITS).view(np.float64)


@njit(error_model="numpy")
def _largest_bounce(f, rtol):  # type: ignore[no-untyped-def]
    """Rebound speed up to which the series of the flight time is accurate [µm/µs]."""
    a = (rtol * f[0] / (abs(f[TERMS - 1]) + _TINY)) ** (0.5 / (TERMS - 1))
    b = (rtol * f[0] / (abs(f[TERMS - 2]) + _TINY)) ** (0.5 / (TERMS - 2))
    return min(a, b)


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
def run_switch(  # type: ignore[no-untyped-def]
    travel, gap, c, k, pieces, n_ramps, ramps, restitution, v_stick, rtol, max_steps,
    times, row, x_out, v_out, event_row, impact_time, impact_speed,
):  # fmt: skip
    """One trajectory. Returns (V, first contact, settling, impacts, x, v, held, status); fills the given rows."""
    tolerance_bits = _bits(_SPEED_SCALE * rtol)
    t, x, v = 0.0, 0.0, 0.0
    v_max, first, settled = math.nan, math.inf, math.inf
    held, launched = False, False
    n_impacts, n_steps = 0, 0
    hold_voltage = (gap - travel) * math.sqrt(k * travel / c)
    n_times, i_time = times.shape[0], 0
    n_events = impact_time.shape[1]
    for i in range(pieces.shape[0]):
        t, end = pieces[i, 0], pieces[i, 1]
        bounce_limit = -1.0
        bounce = _NO_BOUNCE
        while t < end:
            if held:
                t = min(release_time(pieces, n_ramps, ramps, i, t, hold_voltage), end)
                while i_time < n_times and times[i_time] <= t:
                    x_out[row, i_time] = travel
                    v_out[row, i_time] = 0.0
                    i_time += 1
                if t < end:
                    held = False
                    launched = True
                    settled = math.inf
                continue
            n_steps += 1
            if n_steps > max_steps:
                return v_max, first, math.inf, n_impacts, math.nan, math.nan, False, 1
            coefficients = _expand(pieces, n_ramps, ramps, i, t, x, v, gap, c, k)
            h = _step_size(coefficients, tolerance_bits)
            if launched and v == 0.0:
                h = min(h, _RELEASE_STEP_US)
            last = h >= end - t
            if last:
                h = end - t
            x1, v1 = evaluate(coefficients, h)
            tau, speed = NONE, 0.0
            # Below the contact x'' >= -k travel, so between its ends x exceeds the higher by at most k travel h²/8.
            if launched or max(x, x1) + 0.125 * k * travel * h * h >= travel:
                bound = bend(coefficients, h)
                tau, speed = first_contact(coefficients, h, travel - x, launched, v1, bound)
                if tau == UNDECIDED:
                    h, last, tau = speed, False, NONE
                    x1, v1 = evaluate(coefficients, h)
            launched = False
            t_next = end if last else t + h
            if tau != NONE:
                t_next = min(t + tau, end)
            if i_time < n_times and times[i_time] <= t_next:
                stop = i_time + 1
                while stop < n_times and times[stop] <= t_next:
                    stop += 1
                sample(coefficients, t, times, i_time, stop, row, x_out, v_out)
                i_time = stop
            t = t_next
            if tau == NONE:
                x, v = x1, v1
                continue
            if n_impacts == 0:
                first = t
                v_max = speed
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
            # Constant voltage that presses: energy is conserved, so later impacts have exactly the speed of the
            # rebound before them, and their intervals are a power series in it.
            if bounce_limit < 0.0:
                bounce_limit = 0.0
                if pieces[i, 2] > hold_voltage:
                    bounce = flight_time(travel, gap, c * pieces[i, 2] ** 2, k)
                    bounce_limit = _largest_bounce(bounce, rtol)
            while True:
                if -v < v_stick:
                    held, launched, v, settled = True, False, 0.0, t
                    break
                if -v > bounce_limit:
                    break
                n_steps += 1
                t_next = t + bounce_duration(bounce, -v)
                if t_next > end or n_steps > max_steps:
                    break
                while i_time < n_times and times[i_time] <= t_next:
                    # For the samples only; one bounce may take several steps.
                    ts, xs, vs = t, x, v
                    while True:
                        coefficients = _expand(pieces, n_ramps, ramps, i, ts, xs, vs, gap, c, k)
                        h = min(_step_size(coefficients, tolerance_bits), t_next - ts)
                        near = t_next if h >= t_next - ts else ts + h
                        stop = i_time
                        while stop < n_times and times[stop] <= near:
                            stop += 1
                        sample(coefficients, ts, times, i_time, stop, row, x_out, v_out)
                        i_time = stop
                        if near >= t_next:
                            break
                        xs, vs = evaluate(coefficients, h)
                        ts = near
                t = t_next
                if n_impacts < n_events:
                    impact_time[event_row, n_impacts] = t
                    impact_speed[event_row, n_impacts] = -v
                n_impacts += 1
                v *= restitution
    while i_time < n_times:
        x_out[row, i_time] = x
        v_out[row, i_time] = v
        i_time += 1
    return v_max, first, settled, n_impacts, x, v, held, 0


@njit(cache=True, nogil=True, error_model="numpy")
def run_block(  # type: ignore[no-untyped-def]
    lo, hi, devices, pieces, n_ramps, ramps, restitution, v_stick, rtol, max_steps,
    times, metrics, n_impacts, closed, status, impact_time, impact_speed, x_out, v_out,
):  # fmt: skip
    """Switches lo..hi-1 of `devices` (n, 4: travel, gap, c, k), each on its own; outputs are rows of whole arrays."""
    for i in range(lo, hi):
        row = i if impact_time.shape[1] > 0 else 0
        out = i if times.shape[0] > 0 else 0
        v_max, first, settled, n, x, v, held, code = run_switch(
            devices[i, 0], devices[i, 1], devices[i, 2], devices[i, 3], pieces, n_ramps, ramps,
            restitution, v_stick, rtol, max_steps, times, out, x_out, v_out,
            row, impact_time, impact_speed,
        )  # fmt: skip
        metrics[0, i] = v_max
        metrics[1, i] = first
        metrics[2, i] = settled
        metrics[3, i] = x
        metrics[4, i] = v
        n_impacts[i] = n
        closed[i] = held
        status[i] = code
