"""Owns the fast kernel of two modes with a rigid contact: two Taylor series that share the electrode.

`modal.py` is its readable twin, for any number of modes. Away from the contact the switch has two coordinates. Held, it
has one: the contact stands still, and the electrode e moves as a plate with damping would,
e'' = c (u / (G - e))² - k (e - e0) - d e' - ..., whose series is that of one mode. An electrode that is the
contact stands still too; what is left then swings freely. The switch is let go where the contact would have to pull
harder than the adhesion. Impulses act on the contact.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import cast

from softclose.compiled import cached_njit
from softclose.kernel.contact import NONE, UNDECIDED, first_contact
from softclose.kernel.expansion import drive_series, expand
from softclose.kernel.modes_series import at_rest, blend, press, press_under, two, two_film
from softclose.kernel.pieces import DECAYING, deliver, voltage
from softclose.kernel.results import store
from softclose.kernel.samples import peak_of, sample_further, sample_until, stop_at, write
from softclose.kernel.series import ORDER, bend, constant, evaluate
from softclose.kernel.source import UNCOUNTED, fingerprint
from softclose.kernel.step import step_of, step_size

WORK_LIMIT, COLLAPSED = 1, 2
_SAFETY = 4.0
_RELEASE_STEP_US = 0.5
_FAR = 1e9
"""Gap [µm] of what does not feel the voltage."""
_REST = 1e-12
"""Speed [µm/µs] that rounding leaves of a switch at rest on its contact: no impact once it has touched."""
_COLLAPSED_AT = 1e-3
"""Part of the gap that mode 1 leaves at contact; where no more is left, nothing stops the electrode."""
TOGETHER = 1e-9
"""Sine of the angle between contact and electrode, directions in the space of both modes, below which they are one."""
N_MODES = 2
N_COLUMNS = 17
"""Travel, gap [µm], restitution, v_stick [µm/µs], adhesion [mN], half the plate's area times the permittivity
[mN µm²/V²], film [mN µm² µs]; and of both modes mass [µg], k/m [1/µs²], damping rate [1/µs], participation of contact
and of electrode."""


def _build(source: int, form: int, film: bool) -> Callable[..., None]:
    @cached_njit(nogil=True, error_model="numpy", **UNCOUNTED)
    def run_block(  # type: ignore[no-untyped-def]
        lo,
        hi,
        devices,
        command,
        command_n,
        command_ramps,
        path,
        scales,
        out_pieces,
        out_n,
        out_ramps,
        rtol,
        max_steps,
        times,
        metrics,
        counts,
        closed,
        statuses,
        impact_time,
        impact_speed,
        x64,
        v64,
        x32,
        v32,
        m64,
        w64,
        m32,
        w32,
        peaks,
    ):
        """Switches lo..hi-1 of `devices` (n, N_COLUMNS); the rest is as in `taylor.run_block`. peaks: (n, 2).

        m64, w64 or m32, w32: (n, n_times) part of the second mode in x and v; no times where they are not wanted.
        Below, a and b are the modes, ca, cb their participations in the contact and ea, eb in the electrode.
        """
        if source < 0:  # never: closes over the fingerprint, see source.py
            return
        n_pieces = command.shape[0]
        if form == DECAYING:
            pieces, n_ramps, ramps = out_pieces, out_n, out_ramps
        else:
            pieces, n_ramps, ramps = command, command_n, command_ramps
        tolerance = _SAFETY * rtol
        near = 0.3 * math.sqrt(rtol)
        for switch in range(lo, hi):
            if form == DECAYING and (switch == lo or scales.shape[0] > 1):
                n_pieces = deliver(
                    switch, command, command_n, command_ramps, path, scales, out_pieces, out_n, out_ramps
                )
            row = switch if times.shape[0] > 0 else 0
            further = switch if max(m64.shape[1], m32.shape[1]) > 0 else 0
            event_row = switch if impact_time.shape[1] > 0 else 0
            travel, gap, restitution, v_stick = (
                devices[switch, 0],
                devices[switch, 1],
                devices[switch, 2],
                devices[switch, 3],
            )
            adhesion, half_area, thick = devices[switch, 4], devices[switch, 5], devices[switch, 6]
            ma, mb, ka, kb = devices[switch, 7], devices[switch, 8], devices[switch, 9], devices[switch, 10]
            da, db, ca, cb = devices[switch, 11], devices[switch, 12], devices[switch, 13], devices[switch, 14]
            ea, eb = devices[switch, 15], devices[switch, 16]
            ha, hb = half_area * ea / ma, half_area * eb / mb
            fa, fb = thick * ea / ma, thick * eb / mb
            mobility = ca * ca / ma + cb * cb / mb
            both = ca * ea / ma + cb * eb / mb
            largest_a, largest_b = max(abs(ca), abs(ea)), max(abs(cb), abs(eb))
            first_step = min(_RELEASE_STEP_US, 0.5 / math.sqrt(max(ka, kb)))
            closest = gap - _COLLAPSED_AT * (gap - ea * travel / ca)
            # Held, the modes move along (na, nb), which leaves the contact where it is and takes the electrode by 1 or
            # nowhere.
            along = ea * cb - eb * ca
            coupled = abs(along) > TOGETHER * math.hypot(ca, cb) * math.hypot(ea, eb)
            if not coupled:
                along = ca
            na, nb = cb / along, -ca / along
            mass = ma * na * na + mb * nb * nb
            stiffness = ma * ka * na * na + mb * kb * nb * nb
            a_closed = travel / ca
            at = -ma * ka * na * a_closed / stiffness
            a_rest, b_rest = a_closed + na * at, nb * at
            held_c, held_k, held_f = half_area / mass, stiffness / mass, thick / mass
            held_d = (ma * da * na * na + mb * db * nb * nb) / mass
            e_rest = ea * a_closed + at
            held_gap = gap - e_rest
            if not coupled:
                held_c, held_f, held_gap = 0.0, 0.0, _FAR
            # What presses on the contact, from that motion: p2 x'' + p1 x' + p0 x + pc, and pu u² where it does not
            # feel u.
            pu = both * half_area / (gap - ea * a_closed) ** 2 / mobility
            p2 = both * mass / mobility if coupled else 0.0
            p1 = p2 * held_d - (ca * da * na + cb * db * nb) / mobility
            p0 = p2 * held_k - (ca * ka * na + cb * kb * nb) / mobility
            pc = -(ca * ka * a_rest + cb * kb * b_rest) / mobility + adhesion
            a = va = b = vb = 0.0
            x = v = 0.0
            peak_a = peak_b = 0.0
            v_max, first, settled = math.nan, math.inf, math.inf
            held, launched, rests = False, False, False
            n_impacts, n_steps, status = 0, 0, 0
            n_times, i_time = times.shape[0], 0
            n_events = impact_time.shape[1]
            wants = m64.shape[1] > 0 or m32.shape[1] > 0
            for i in range(n_pieces):
                t, end = pieces[i, 0], pieces[i, 1]
                while t < end and status == 0:
                    n_steps += 1
                    if n_steps > max_steps:
                        status = WORK_LIMIT
                        break
                    if held:
                        series = expand(
                            form,
                            True,
                            film,
                            pieces,
                            n_ramps,
                            ramps,
                            i,
                            t,
                            x,
                            v,
                            held_gap,
                            held_c,
                            held_k,
                            held_d,
                            held_f,
                        )
                        h = step_size(series, tolerance)
                        last = h >= end - t
                        if last:
                            h = end - t
                        if coupled:
                            pull = press(series, p2, p1, p0, pc)
                        else:
                            u = (
                                drive_series(form, pieces, n_ramps, ramps, i, t)
                                if n_ramps[i] > 0
                                else constant(pieces[i, 2])
                            )
                            pull = press_under(series, u, p1, p0, pc, pu)
                        tau = 0.0
                        if pull[0] < 0.0:
                            bound = bend(pull, h)
                            tau = NONE
                            if max(pull[0], evaluate(pull, h)[0]) + 0.125 * bound * h * h >= 0.0:
                                tau, until = first_contact(pull, h, -pull[0], False, 0.0, bound, near)
                                if tau == UNDECIDED:
                                    h, last, tau = until, False, NONE
                        t_next = end if last else t + h
                        if tau >= 0.0:
                            h, t_next = tau, min(t + tau, end)
                        if wants and i_time < n_times:
                            at, by = cb * b_rest, cb * nb
                            sample_further(series, at, by, t, t_next, times, i_time, further, m64, w64, m32, w32)
                        if i_time < n_times:
                            stop = stop_at(times, i_time, t_next)
                            write(row, i_time, stop, travel, 0.0, x64, v64, x32, v32)
                            i_time = stop
                        x, v = evaluate(series, h)
                        t = t_next
                        if coupled and not x + e_rest < closest:
                            status = COLLAPSED
                        if tau >= 0.0:
                            held, launched, rests, settled = False, True, True, math.inf
                            a, va, b, vb = a_rest + na * x, na * v, b_rest + nb * x, nb * v
                        continue
                    u = drive_series(form, pieces, n_ramps, ramps, i, t) if n_ramps[i] > 0 else constant(pieces[i, 2])
                    if film:
                        series_a, series_b = two_film(a, va, b, vb, u, gap, ea, eb, ha, hb, ka, kb, da, db, fa, fb)
                    else:
                        series_a, series_b = two(a, va, b, vb, u, gap, ea, eb, ha, hb, ka, kb, da, db)
                    c = blend(series_a, series_b, ca, cb)
                    if rests:
                        c = at_rest(c)
                    h = step_of(
                        largest_a * abs(series_a[ORDER - 4]) + largest_b * abs(series_b[ORDER - 4]),
                        largest_a * abs(series_a[ORDER - 1]) + largest_b * abs(series_b[ORDER - 1]),
                        largest_a * abs(series_a[ORDER]) + largest_b * abs(series_b[ORDER]),
                        tolerance,
                    )
                    if rests:
                        h = min(h, first_step)
                    last = h >= end - t
                    if last:
                        h = end - t
                    xc = travel if launched else c[0]
                    x1, v1 = evaluate(c, h)
                    bound = bend(c, h)
                    tau, speed = NONE, 0.0
                    if launched or max(xc, x1) + 0.125 * bound * h * h >= travel:
                        tau, speed = first_contact(c, h, travel - xc, launched, v1, bound, near)
                        if tau == UNDECIDED:
                            h, last, tau = speed, False, NONE
                    launched = rests = False
                    t_next = end if last else t + h
                    if tau != NONE:
                        h, t_next = tau, min(t + tau, end)
                    if wants and i_time < n_times:
                        sample_further(series_b, 0.0, cb, t, t_next, times, i_time, further, m64, w64, m32, w32)
                    if i_time < n_times:
                        i_time = sample_until(c, t, t_next, times, i_time, row, x64, v64, x32, v32)
                    a1, va1 = evaluate(series_a, h)
                    b1, vb1 = evaluate(series_b, h)
                    if n_impacts == 0:
                        peak_a = peak_of(a, va, a1, va1, series_a, h, peak_a)
                        peak_b = peak_of(b, vb, b1, vb1, series_b, h, peak_b)
                    a, va, b, vb, t = a1, va1, b1, vb1, t_next
                    if not ea * a + eb * b < closest:
                        status = COLLAPSED
                        break
                    if tau == NONE:
                        continue
                    if n_impacts == 0:
                        first, v_max = t, speed
                    if n_impacts == 0 or speed > _REST:
                        v_max = max(v_max, speed)
                        if n_impacts < n_events:
                            impact_time[event_row, n_impacts] = t
                            impact_speed[event_row, n_impacts] = speed
                        n_impacts += 1
                    else:
                        rests = True
                    stays = restitution * speed < v_stick
                    if stays:
                        left = gap - ea * a - eb * b
                        force = half_area * (voltage(pieces, n_ramps, ramps, i, t) / left) ** 2
                        if film:
                            force -= thick * (ea * va + eb * vb) / left**3
                        pressed = both * force - ca * (ka * a + da * va) - cb * (kb * b + db * vb)
                        stays = pressed / mobility >= -adhesion
                    impulse = ((1.0 if stays else 1.0 + restitution) * (ca * va + cb * vb)) / mobility
                    shift = (ca * a + cb * b - travel) / mobility
                    va -= ca / ma * impulse
                    vb -= cb / mb * impulse
                    a -= ca / ma * shift
                    b -= cb / mb * shift
                    launched = True
                    if stays:
                        held, launched, rests, settled = True, False, False, t
                        x, v = (b - b_rest) / nb, vb / nb
            if held:
                b, vb = b_rest + nb * x, nb * v
                x, v = travel, 0.0
            else:
                x, v = ca * a + cb * b, ca * va + cb * vb
            if status != 0:
                x, v, b, vb, held, settled = math.nan, math.nan, math.nan, math.nan, False, math.inf
            if wants and i_time < n_times:
                write(further, i_time, n_times, cb * b, cb * vb, m64, w64, m32, w32)
            if i_time < n_times:
                write(row, i_time, n_times, x, v, x64, v64, x32, v32)
            peaks[switch, 0], peaks[switch, 1] = abs(ca) * peak_a, abs(cb) * peak_b
            found = v_max, first, settled, n_impacts, x, v, held, status
            store(switch, found, metrics, counts, closed, statuses)

    return cast("Callable[..., None]", run_block)


@lru_cache
def block(*, form: int, film: bool) -> Callable[..., None]:
    """`run_block` for such drives, with a film or without; each is compiled where it is first used, and cached."""
    return _build(fingerprint(), form, film)
