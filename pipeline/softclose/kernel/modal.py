"""Owns the kernel of several modes: an adaptive Runge-Kutta method of order 8 with rigid or compliant contact.

Each mode i: m_i q_i'' + m_i (omega_i / Q_i) q_i' + k_i (q_i + c_i q_i³) = psi_i (F_e - F_s) + phi_i F_c, where the
electrode is at x_e = sum psi_i q_i and the contact at x_c = sum phi_i q_i. F_e is the electrostatic force, F_s that of
the film of gas and F_c that of the contact. Dormand and Prince's 8(5,3) pair with Hairer's dense output of order 7; its
coefficients are scipy's.

A rigid contact is the constraint x_c <= D. An impact is an impulse along phi that turns x_c' into -e x_c'; a switch is
held where the rebound is slower than v_stick and the constraint's force presses, and let go when that force pulls more
than the adhesion. The electrode is free behind the contact: it may go on to its counter-electrode (COLLAPSED).

Units: µm, µs, µg, hence forces in mN. One switch at a time, as in the other kernels: a row depends on nothing else.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any, cast

import numpy as np
from numba import njit
from scipy.integrate import DOP853

from softclose.compiled import cached_njit
from softclose.kernel.pieces import voltage
from softclose.kernel.results import store
from softclose.kernel.source import UNCOUNTED, fingerprint
from softclose.switch.losses import SLIP, SLIP_EXPONENT

FREE, HELD, TOUCHING = 0, 1, 2
"""Away from the contact; held in a rigid one; within a compliant one."""

WORK_LIMIT, COLLAPSED, LEFT_TABLE = 1, 2, 3
"""`softclose.device.simulate.Status`: why a trajectory ended before the horizon."""

A = np.zeros((16, 16))
A[:12, :12] = DOP853.A
A[12, :12] = DOP853.B
A[13:] = DOP853.A_EXTRA
NODES = np.concatenate([DOP853.C, [1.0], DOP853.C_EXTRA])
E3, E5, DENSE = DOP853.E3.copy(), DOP853.E5.copy(), DOP853.D.copy()
LAST, STAGES = 12, 16
# The terms of each stage that are not zero: half of them.
FIRST = np.concatenate([[0], np.cumsum((A != 0.0).sum(axis=1))])
WHICH, WEIGHT = np.ascontiguousarray(np.nonzero(A)[1]), A[A != 0.0]

_MIN_STEP_US = 1e-9
_RELEASE_STEP_US = 0.5
_JUMP = 1e-6
"""Voltage [V] above which two pieces of a drive do not join: a step that is asked for, no rounding."""
_REST = 1e-12
"""Speed [µm/µs] that rounding leaves of a switch at rest on its contact: no impact once it has touched."""
_COLLAPSED_AT = 1e-3
"""Part of the gap that mode 1 leaves at contact; where no more is left, nothing stops the electrode."""
_LOOKS = 8
"""Points within a step at which contacts are looked for: a step is a quarter of the fastest mode's period or less."""


@njit(error_model="numpy", forceinline=True)
def _electrostatic(u, x, gap, coat, half_area, knots, slopes, shrink):  # type: ignore[no-untyped-def]
    """Force [mN] at electrode displacement x: of parallel plates, or u²/2 dC/dx of a capacitance.

    coat: thickness over permittivity of a dielectric on the counter-electrode, a gap that never closes [µm].
    """
    if knots.shape[0] == 0:
        pull = u / (gap + coat - x)
        return half_area * pull * pull
    s = min(x * shrink, knots[-1])  # a trial step may ask beyond either end; an accepted one ends there
    lo, hi = 0, knots.shape[0] - 1
    while hi - lo > 1:
        middle = (lo + hi) // 2
        if knots[middle] <= s:
            lo = middle
        else:
            hi = middle
    origin = knots[lo] if slopes.shape[1] > 1 else 0.0
    slope = slopes[0, lo]
    for j in range(1, slopes.shape[0]):
        slope = slope * (s - origin) + slopes[j, lo]
    return 0.5e-6 * u * u * slope * shrink * shrink


@njit(error_model="numpy", forceinline=True)
def _slopes(out, y, u, state, n, switch):  # type: ignore[no-untyped-def]
    """Time derivative of y = (q, q') into out; returns the force [mN] with which the switch presses on a rigid
    contact, less than nothing where it pulls."""
    travel, gap, half_area, film, adhesion, modes, contact, knots, slopes, shrink, coat, free_path = switch
    xe = ve = xc = vc = 0.0
    for i in range(n):
        q, p = y[i], y[n + i]
        xe += modes[i, 4] * q
        ve += modes[i, 4] * p
        xc += modes[i, 3] * q
        vc += modes[i, 3] * p
    pull = _electrostatic(u, xe, gap, coat, half_area, knots, slopes, shrink)
    if film > 0.0:
        squeezed = film * ve / (gap - xe) ** 3
        if free_path > 0.0:
            squeezed /= 1.0 + SLIP * (free_path / (gap - xe)) ** SLIP_EXPONENT
        pull -= squeezed
    push = 0.0
    if state == TOUCHING:
        depth = max(xc - travel, 0.0)
        push = adhesion - max(contact[0] * depth ** contact[1] * (1.0 + contact[2] * vc) + contact[3] * vc, 0.0)
    asked, mobility = 0.0, 0.0
    for i in range(n):
        a = (modes[i, 4] * pull + modes[i, 3] * push) / modes[i, 0] - modes[i, 1] * y[i] - modes[i, 2] * y[n + i]
        a -= modes[i, 1] * modes[i, 5] * y[i] * y[i] * y[i]
        out[i] = y[n + i]
        out[n + i] = a
        asked += modes[i, 3] * a
        mobility += modes[i, 3] * modes[i, 3] / modes[i, 0]
    if state == HELD:
        for i in range(n):
            out[n + i] -= modes[i, 3] / modes[i, 0] * asked / mobility
    return asked / mobility


@njit(error_model="numpy", forceinline=True)
def _stage(K, s, y, h, at, u, state, n, switch):  # type: ignore[no-untyped-def]
    """Slopes K[s] of stage s of a step of length h from y, at the state that is left in `at`; returns the press."""
    for j in range(2 * n):
        dy = 0.0
        for m in range(FIRST[s], FIRST[s + 1]):
            dy += WEIGHT[m] * K[WHICH[m], j]
        at[j] = y[j] + h * dy
    return _slopes(K[s], at, u, state, n, switch)


@njit(error_model="numpy", forceinline=True)
def _dense(f, start, theta):  # type: ignore[no-untyped-def]
    """Hairer's interpolant of order 7 at the fraction theta of a step."""
    y, other = 0.0, 1.0 - theta
    for j in range(6, -1, -1):
        y = (y + f[j]) * (theta if (6 - j) % 2 == 0 else other)
    return y + start


@njit(error_model="numpy")
def _sample_mode(i, n, K, y, work, t, h, f, times, first, stop, part, mode_x, mode_v):  # type: ignore[no-untyped-def]
    """The part of mode i in x and v at times[first:stop] of a step of length h from t, by its dense output."""
    for k in range(2):
        start, end = y[k * n + i], work[k * n + i]
        slope, slope_end = K[0, k * n + i], K[LAST, k * n + i]
        f[k, 0] = end - start
        f[k, 1] = h * slope - (end - start)
        f[k, 2] = 2.0 * (end - start) - h * (slope + slope_end)
        for r in range(4):
            d = 0.0
            for s in range(STAGES):
                d += DENSE[r, s] * K[s, k * n + i]
            f[k, 3 + r] = h * d
    for j in range(first, stop):
        fraction = (times[j] - t) / h
        mode_x[i - 1, j] = part * _dense(f[0], y[i], fraction)
        mode_v[i - 1, j] = part * _dense(f[1], y[n + i], fraction)


@njit(error_model="numpy", forceinline=True)
def _extremes(x0, v0, x1, v1, h):  # type: ignore[no-untyped-def]
    """Smallest and largest x of the cubic through both ends of a step, with their slopes."""
    low, high = min(x0, x1), max(x0, x1)
    if v0 * v1 < 0.0:  # one turning point, which the cubic has in closed form: x' = v0 + 2 b s + 3 c s², s in (0, 1)
        d = x1 - x0
        b, c = 3.0 * d - h * (2.0 * v0 + v1), h * (v0 + v1) - 2.0 * d
        root = math.sqrt(max(b * b - 3.0 * c * h * v0, 0.0))
        s = -h * v0 / (b + root) if v0 < 0.0 else h * v0 / (root - b)
        x = x0 + s * (h * v0 + s * (b + s * c))
        low, high = min(low, x), max(high, x)
    return low, high


@njit(error_model="numpy")
def _first_root(fx, x0, fv, v0, travel, way):  # type: ignore[no-untyped-def]
    """First theta in (0, 1] at which x comes to the travel, on the dense output of x and v; -1 where it does not.

    way: 1 from below, -1 from above, the same search on the mirror image.
    """
    a, va = 0.0, way * v0
    for look in range(1, _LOOKS + 1):
        b = look / _LOOKS
        vb = way * _dense(fv, v0, b)
        lo, hi = a, b
        if va * vb < 0.0 or (va == 0.0 and vb > 0.0):
            p, q = a, b
            for _ in range(50):
                m = 0.5 * (p + q)
                if (way * _dense(fv, v0, m) > 0.0) == (vb > 0.0):
                    q = m
                else:
                    p = m
            if vb > 0.0:
                lo = q
            else:
                hi = p
        if (vb > 0.0 or hi < b) and way * (_dense(fx, x0, hi) - travel) >= 0.0:
            for _ in range(50):
                m = 0.5 * (lo + hi)
                if way * (_dense(fx, x0, m) - travel) < 0.0:
                    lo = m
                else:
                    hi = m
            return hi
        a, va = b, vb
    return -1.0


@njit(error_model="numpy", inline="always")
def _run_switch(  # type: ignore[no-untyped-def]
    n,
    switch,
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
    mode_x,
    mode_v,
    impact_time,
    impact_speed,
    peaks,
    K,
    y,
    work,
    fx,
    fv,
    fm,
):
    """One trajectory. Returns (V, first contact, settling, impacts, x, v, held, status); fills the given rows."""
    travel, gap, _half_area, film, adhesion, modes, contact, knots, _slopes_of, shrink, coat, _free_path = switch
    n2 = 2 * n
    compliant = contact[0] > 0.0
    fastest = 0.0
    for i in range(n):
        fastest = max(fastest, math.sqrt(modes[i, 1]))
        peaks[i] = 0.0
    longest = 1.6 / fastest
    mobility = 0.0
    for i in range(n):
        mobility += modes[i, 3] * modes[i, 3] / modes[i, 0]
    y[:] = 0.0
    v_max, first, settled = math.nan, math.inf, math.inf
    state, launched = FREE, False
    n_impacts, n_steps, i_time, status = 0, 0, 0, 0
    n_times = times.shape[0]
    wall = gap + coat if film == 0.0 else gap  # where a force is infinite
    closest = gap - _COLLAPSED_AT * (gap - modes[0, 4] * travel)
    lowest, highest = -math.inf, math.inf
    if knots.shape[0] > 0:
        lowest, highest = knots[0] / shrink, knots[-1] / shrink
    h, known, pushed = 0.1, False, 0.0
    for piece in range(pieces.shape[0]):
        t, end = pieces[piece, 0], pieces[piece, 1]
        if piece > 0:
            before = voltage(pieces, n_ramps, ramps, piece - 1, t)
            known = known and abs(voltage(pieces, n_ramps, ramps, piece, t) - before) <= _JUMP
        while t < end and status == 0:
            n_steps += 1
            if n_steps > max_steps:
                status = WORK_LIMIT
                break
            if not known:
                u = voltage(pieces, n_ramps, ramps, piece, t)
                pushed = _slopes(K[0], y, u, state, n, switch)
                known = True
            if state == HELD and pushed < -adhesion:
                state, launched, settled, known = FREE, True, math.inf, False
                h = _RELEASE_STEP_US  # what the search for this instant left of the step is below rounding
                continue
            x0 = v0 = a0 = xe0 = ve0 = 0.0
            for i in range(n):
                x0 += modes[i, 3] * y[i]
                v0 += modes[i, 3] * y[n + i]
                a0 += modes[i, 3] * K[0, n + i]
                xe0 += modes[i, 4] * y[i]
                ve0 += modes[i, 4] * y[n + i]
            if launched and state == FREE:
                v0 = min(v0, 0.0)  # let go at rest: a rounding inwards is no motion, and its return no impact
            h = min(h, longest)
            if state == TOUCHING:
                h = min(h, 0.5 / math.sqrt(contact[0] * mobility + fastest * fastest))
            if launched and state == FREE and v0 < 0.0 and a0 > 0.0:
                h = min(h, -4.0 * v0 / a0)  # else a low flight is all error
            last = h >= end - t
            hs = end - t if last else h
            tension = False
            pressed = 0.0
            for s in range(1, LAST + 1):
                if s < LAST:  # the last two are at the same instant
                    u = voltage(pieces, n_ramps, ramps, piece, t + NODES[s] * hs)
                pressed = _stage(K, s, y, hs, work, u, state, n, switch)
                tension = tension or pressed < -adhesion
            five = three = 0.0
            for j in range(n2):
                e5 = e3 = 0.0
                for m in range(LAST + 1):
                    e5 += E5[m] * K[m, j]
                    e3 += E3[m] * K[m, j]
                scale = rtol * ((1.0 if j < n else 0.1) + max(abs(y[j]), abs(work[j])))
                five += (e5 / scale) ** 2
                three += (e3 / scale) ** 2
            error = 0.0
            if five > 0.0:
                error = hs * five / math.sqrt((five + 0.01 * three) * n2)
            xe = ve = 0.0
            for i in range(n):
                xe += modes[i, 4] * work[i]
                ve += modes[i, 4] * work[n + i]
            inside = xe < wall and not math.isnan(error)
            if hs > _MIN_STEP_US and (error > 1.0 or not inside or (state == HELD and tension)):
                factor = 0.5 if inside and error <= 1.0 else (max(0.2, 0.9 * error**-0.125) if inside else 0.2)
                h = hs * factor
                continue
            if not inside:
                status = COLLAPSED
                break
            grown = hs * min(5.0, 0.9 * max(error, 1e-10) ** -0.125)
            x1 = v1 = a1 = 0.0
            for i in range(n):
                x1 += modes[i, 3] * work[i]
                v1 += modes[i, 3] * work[n + i]
                a1 += modes[i, 3] * K[LAST, n + i]
            t_next = end if last else t + hs
            # Whether anything has to be read within the step: only then the dense output is made.
            reach = max(x0, x1) + 0.25 * hs * hs * (abs(a0) + abs(a1))
            crossing = (state == FREE and reach >= travel) or (state == TOUCHING and (x1 < travel or launched))
            sampled = i_time < n_times and times[i_time] <= t_next
            theta = -1.0
            if crossing or sampled:
                for s in range(LAST + 1, STAGES):
                    u = voltage(pieces, n_ramps, ramps, piece, t + NODES[s] * hs)
                    _stage(K, s, y, hs, K[STAGES], u, state, n, switch)
                fx[0], fx[1], fx[2] = x1 - x0, hs * v0 - (x1 - x0), 2.0 * (x1 - x0) - hs * (v0 + v1)
                fv[0], fv[1], fv[2] = v1 - v0, hs * a0 - (v1 - v0), 2.0 * (v1 - v0) - hs * (a0 + a1)
                for r in range(4):
                    dx = dv = 0.0
                    for s in range(STAGES):
                        vs = as_ = 0.0
                        for i in range(n):
                            vs += modes[i, 3] * K[s, i]
                            as_ += modes[i, 3] * K[s, n + i]
                        dx += DENSE[r, s] * vs
                        dv += DENSE[r, s] * as_
                    fx[3 + r] = hs * dx
                    fv[3 + r] = hs * dv
                if crossing:
                    theta = _first_root(fx, x0, fv, v0, travel, 1.0 if state == FREE else -1.0)
                if theta >= 0.0:
                    t_next = min(t + theta * hs, end)
                if mode_x.shape[1] > 0 and sampled:
                    stop = i_time
                    while stop < n_times and times[stop] <= t_next:
                        stop += 1
                    for i in range(1, n):
                        _sample_mode(i, n, K, y, work, t, hs, fm, times, i_time, stop, modes[i, 3], mode_x, mode_v)
                while i_time < n_times and times[i_time] <= t_next:
                    fraction = (times[i_time] - t) / hs
                    x_out[i_time] = _dense(fx, x0, fraction)
                    v_out[i_time] = _dense(fv, v0, fraction)
                    i_time += 1
            launched = False
            if theta < 0.0:
                for j in range(n2):
                    y[j] = work[j]
                    K[0, j] = K[LAST, j]  # the last stage of a step is the first of the next
                pushed = pressed
                t = t_next
                h = grown
                if xe >= closest:
                    status = COLLAPSED
                if knots.shape[0] > 0:
                    low, high = _extremes(xe0, ve0, xe, ve, hs)
                    if low < lowest or high > highest:
                        status = LEFT_TABLE
                if n_impacts == 0:
                    for i in range(n):
                        peaks[i] = max(peaks[i], abs(modes[i, 3] * y[i]))
                continue
            # A contact made or lost: a step of just that length.
            known = False
            tau = theta * hs
            for s in range(1, LAST + 1):
                u = voltage(pieces, n_ramps, ramps, piece, t + NODES[s] * tau)
                _stage(K, s, y, tau, work, u, state, n, switch)
            xc = vc = ac = 0.0
            for i in range(n):
                xc += modes[i, 3] * work[i]
                vc += modes[i, 3] * work[n + i]
                ac += modes[i, 3] * K[LAST, n + i]
            # What the dense output missed the contact by, a rounding of the step's own error: to first order.
            shift = (travel - xc) / vc if vc != 0.0 else 0.0
            if abs(shift) < 0.1 * tau:
                tau += shift
                vc += shift * ac
                for j in range(n2):
                    work[j] += shift * K[LAST, j]
            for j in range(n2):
                y[j] = work[j]
            t = min(t + tau, end)
            launched = True
            if state == TOUCHING:
                state, settled = FREE, math.inf
                h = grown
                continue
            speed = max(vc, 0.0)
            if n_impacts == 0:
                first, v_max = t, speed
            h = min(h, hs)
            if n_impacts == 0 or speed > _REST:
                v_max = max(v_max, speed)
                if n_impacts < impact_time.shape[0]:
                    impact_time[n_impacts] = t
                    impact_speed[n_impacts] = speed
                n_impacts += 1
            else:
                h = _RELEASE_STEP_US
            if compliant:
                state, settled = TOUCHING, t
                continue
            stays = restitution * speed < v_stick
            if stays:
                u = voltage(pieces, n_ramps, ramps, piece, t)
                pushed = _slopes(K[0], y, u, FREE, n, switch)
                stays = pushed >= -adhesion
            impulse = (1.0 + (0.0 if stays else restitution)) * vc / mobility
            for i in range(n):
                y[n + i] -= modes[i, 3] / modes[i, 0] * impulse
            if stays:
                state, launched, settled = HELD, False, t
        if status != 0:
            break
    x = v = 0.0
    for i in range(n):
        x += modes[i, 3] * y[i]
        v += modes[i, 3] * y[n + i]
    if status != 0:
        x, v, state = math.nan, math.nan, FREE
    if mode_x.shape[1] > 0:
        for i in range(1, n):
            mode_x[i - 1, i_time:] = modes[i, 3] * y[i] if status == 0 else math.nan
            mode_v[i - 1, i_time:] = modes[i, 3] * y[n + i] if status == 0 else math.nan
    while i_time < n_times:
        x_out[i_time] = x
        v_out[i_time] = v
        i_time += 1
    return v_max, first, settled, n_impacts, x, v, state != FREE, status


def _build(source: int, n_modes: int) -> Callable[..., None]:
    @cached_njit(nogil=True, error_model="numpy", **UNCOUNTED)
    def run_block(  # type: ignore[no-untyped-def]
        lo,
        hi,
        devices,
        ratios,
        contact,
        knots,
        slopes,
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
        x_out,
        v_out,
        mode_x,
        mode_v,
        peaks,
        scratch,
    ):
        """Switches lo..hi-1 of `devices`; outputs are rows of whole arrays.

        devices: (n, 10) travel, gap [µm], half the plate's area times the permittivity [mN µm²/V²], film
        [mN µm³ µs/µm], adhesion [mN], mass [µg], stiffness [mN/µm] of the first mode, nominal gap over gap,
        thickness over permittivity of a dielectric, mean free path [µm]; ratios: (n_modes, 6) mass, stiffness over mass
        and damping rate over frequency as parts of the first mode's, participations in contact and electrode, cubic
        stiffness over stiffness [1/µm²]; contact: (4,) stiffness, exponent, loss, dashpot [mN µs/µm]; mode_x, mode_v:
        (n, n_modes - 1, n_times) parts of the further modes in x and v, no times where they are not wanted; scratch:
        (28, 7 or 2 n_modes) for what is in work.
        """
        if source < 0:  # never: closes over the fingerprint, see source.py
            return
        n2 = 2 * n_modes
        K, y, work = scratch[: STAGES + 1, :n2], scratch[17, :n2], scratch[18, :n2]
        fx, fv, fm = scratch[19], scratch[20], scratch[21:23]
        modes = scratch[23:].reshape(-1)[: 6 * n_modes].reshape(n_modes, 6)
        for i in range(lo, hi):
            row = i if impact_time.shape[1] > 0 else 0
            out = i if times.shape[0] > 0 else 0
            further = i if mode_x.shape[2] > 0 else 0
            first_k = devices[i, 6] / devices[i, 5]
            for j in range(n_modes):
                modes[j, 0] = ratios[j, 0] * devices[i, 5]
                modes[j, 1] = ratios[j, 1] * first_k
                modes[j, 2] = ratios[j, 2] * math.sqrt(modes[j, 1])
                modes[j, 3] = ratios[j, 3]
                modes[j, 4] = ratios[j, 4]
                modes[j, 5] = ratios[j, 5]
            found = _run_switch(
                n_modes,
                (
                    devices[i, 0],
                    devices[i, 1],
                    devices[i, 2],
                    devices[i, 3],
                    devices[i, 4],
                    modes,
                    contact,
                    knots,
                    slopes,
                    devices[i, 7],
                    devices[i, 8],
                    devices[i, 9],
                ),
                pieces,
                n_ramps,
                ramps,
                restitution,
                v_stick,
                rtol,
                max_steps,
                times,
                x_out[out],
                v_out[out],
                mode_x[further],
                mode_v[further],
                impact_time[row],
                impact_speed[row],
                peaks[i],
                K,
                y,
                work,
                fx,
                fv,
                fm,
            )
            store(i, found, metrics, n_impacts, closed, status)

    return cast("Callable[..., None]", run_block)


@lru_cache
def block(n_modes: int) -> Callable[..., None]:
    """`run_block` for that number of modes, but for its scratch: a number known to the compiler doubles the speed."""
    compiled = _build(fingerprint(), n_modes)

    def run(*arguments: Any) -> None:
        compiled(*arguments, np.zeros((28, max(7, 2 * n_modes))))

    return run
