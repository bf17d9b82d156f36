"""Owns the fast kernel: a Taylor series, contacts marched on the polynomial, bounces in closed form.

`rk.py` is its readable twin. The stepping never depends on which outputs are wanted, so that V and the rest are the
same results, bit for bit, with and without them: samples and impacts are read off what is computed anyway.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import cast

from softclose.compiled import cached_njit
from softclose.kernel.bounces import learn, predict, symmetric_flight
from softclose.kernel.cells import cell_at, depth_of, hold_of, leaves, parabola
from softclose.kernel.contact import NONE, UNDECIDED, first_contact
from softclose.kernel.drive_series import SHORT, short_return
from softclose.kernel.expansion import expand, expand_shaped, short, short_shaped, steady, steady_shaped
from softclose.kernel.pieces import COSINES, DECAYING, deliver, voltage
from softclose.kernel.release import release_time
from softclose.kernel.results import store
from softclose.kernel.samples import peak_of, sample_until, stop_at, write
from softclose.kernel.series import ORDER, TERMS, bend, bounce_duration, evaluate, flight_time
from softclose.kernel.source import UNCOUNTED, fingerprint
from softclose.kernel.step import radius, step_size
from softclose.switch.losses import SLIP_EXPONENT

WORK_LIMIT, LEFT_TABLE = 1, 3
_SAFETY = 4.0
"""The last terms kept may be this much above the tolerance [1 µm/µs]: the first ones dropped are a quarter of them."""
_RELEASE_STEP_US = 0.5
_NO_BOUNCE = (0.0,) * TERMS
_NO_MORE = (0.0,) * (ORDER - SHORT)


def _build(source: int, form: int, lossy: bool, film: bool, shaped: bool, table: bool) -> Callable[..., None]:
    @cached_njit(nogil=True, error_model="numpy", **UNCOUNTED)
    def run_block(  # type: ignore[no-untyped-def]
        lo,
        hi,
        devices,
        knots,
        slopes,
        memo,
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
        peaks,
    ):
        """Switches lo..hi-1 of `devices`, each on its own; outputs are rows of whole arrays.

        devices: (n, 9) travel, gap [µm], c, k, restitution, damping [1/µs], film [µm³/µs], adhesion [µm/µs²] and
        v_stick [µm/µs], all forces per mass; losses are read where there are any. Where `shaped`, four more: cubic
        stiffness per mass [1/(µm² µs²)], dielectric [µm], slip, and what displacements are multiplied by in the table;
        and peaks (n, 1) is filled with the largest |x| until the first impact.
        knots (n + 1,), slopes (3, n): of a table, which is always shaped; empty without one.
        memo: (3, MAX_RETURNS) for what is in work.
        command, command_n, command_ramps: the drive in its flat form. `DECAYING`: what it is made from by path, scales
        (1 or n, 3) and the out_ arrays, as `deliver_flat` takes them; one row of scales is for all.
        form, lossy, film, shaped, table: known when this is compiled, so that what they leave out is no code; what is
        shaped is lossy.
        Samples go to x64 and v64, or to x32 and v32 where those have no columns: one compiled variant for both, so the
        metrics are bit-identical whichever is asked for.
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
            event_row = switch if impact_time.shape[1] > 0 else 0
            travel, gap, scale, k = devices[switch, 0], devices[switch, 1], devices[switch, 2], devices[switch, 3]
            restitution, d, f = devices[switch, 4], devices[switch, 5], devices[switch, 6]
            adhesion, v_stick = devices[switch, 7], devices[switch, 8]
            t, x, v = 0.0, 0.0, 0.0
            v_max, first, settled = math.nan, math.inf, math.inf
            held, launched = False, False
            n_impacts, n_steps, status = 0, 0, 0
            peak = 0.0
            if shaped:
                cubic, coat, slip = devices[switch, 9], devices[switch, 10], devices[switch, 11]
                shape = cubic, coat, slip
                left = gap + coat - travel  # to the electrode, in contact, as is the stiffness of the spring
                stiff = k + cubic * travel * travel
            else:
                left, stiff = gap - travel, k
            cell, which = (0.0, 0.0, 0.0, 0.0), 0
            if table:
                shrink = devices[switch, 12]
                c, left = hold_of(knots, slopes, shrink, scale, travel), 1.0
                which = cell_at(knots, shrink, 0.0)
                cell = parabola(knots, slopes, shrink, scale, which)
            else:
                c = scale
            press_voltage = left * math.sqrt(stiff * travel / c)
            hold_voltage = press_voltage
            if adhesion > 0.0:
                rest = stiff * travel - adhesion  # what the voltage has to hold
                hold_voltage = left * math.sqrt(rest / c) if rest > 0.0 else -1.0
            force = drag = launch = launched_at = 0.0
            n_returns, sure = 0, True
            n_times, i_time = times.shape[0], 0
            n_events = impact_time.shape[1]
            for i in range(n_pieces):
                t, end = pieces[i, 0], pieces[i, 1]
                bounce_limit = -1.0
                bounce = _NO_BOUNCE
                if lossy:
                    force = c * (pieces[i, 2] / left) ** 2 - stiff * travel
                    drag = d
                    if shaped and film:
                        drag += f / ((gap - travel) ** 3 + slip * (gap - travel) ** (3.0 - SLIP_EXPONENT))
                    elif film:
                        drag += f / (gap - travel) ** 3
                    launch, n_returns, sure = 0.0, 0, False
                while t < end and status == 0:
                    if held:
                        if n_ramps[i] > 0:
                            t = min(release_time(pieces, n_ramps, ramps, i, t, hold_voltage), end)
                        elif abs(pieces[i, 2]) >= hold_voltage:
                            t = end
                        if i_time < n_times:
                            stop = stop_at(times, i_time, t)
                            write(row, i_time, stop, travel, 0.0, x64, v64, x32, v32)
                            i_time = stop
                        if t < end:
                            held, launched, settled = False, True, math.inf
                        continue
                    n_steps += 1
                    if n_steps > max_steps:
                        status = WORK_LIMIT
                        break
                    if shaped:
                        series = expand_shaped(
                            form, film, table, pieces, n_ramps, ramps, i, t, x, v, gap, c, k, d, f, shape, cell
                        )
                    else:
                        series = expand(form, lossy, film, pieces, n_ramps, ramps, i, t, x, v, gap, c, k, d, f)
                    h = step_size(series, tolerance)
                    if launched and v == 0.0:
                        h = min(h, _RELEASE_STEP_US)
                    last = h >= end - t
                    if last:
                        h = end - t
                    x1, v1 = evaluate(series, h)
                    way = 0
                    if table:
                        until, way = leaves(series, h, x1, bend(series, h), knots, shrink, which, travel)
                        if until < h:
                            h, last = until, False
                            x1, v1 = evaluate(series, h)
                    tau, speed = NONE, 0.0
                    if lossy:
                        # From a maximum on the plate falls, losses hold it back, and x'' >= -k travel as without them.
                        reaches = stiff * h * h > 1.0 or x1 + 0.5 * stiff * travel * h * h >= travel
                    else:
                        # Below the contact x'' >= -k travel, so between its ends x exceeds the higher by at most
                        # k travel h²/8.
                        reaches = max(x, x1) + 0.125 * k * travel * h * h >= travel
                    if launched or reaches:
                        tau, speed = first_contact(series, h, travel - x, launched, v1, bend(series, h), near)
                        if tau == UNDECIDED:
                            h, last, tau = speed, False, NONE
                            x1, v1 = evaluate(series, h)
                    launched = False
                    t_next = end if last else t + h
                    if tau != NONE:
                        t_next = min(t + tau, end)
                    if i_time < n_times:
                        i_time = sample_until(series, t, t_next, times, i_time, row, x64, v64, x32, v32)
                    t = t_next
                    if tau == NONE:
                        if shaped and n_impacts == 0:
                            peak = peak_of(x, v, x1, v1, series, h, peak)
                        x, v = x1, v1
                        if table and way != 0:
                            which += way
                            launch = 0.0  # what crosses a knot tells nothing of the bounces that do not
                            if which < 0:
                                status = LEFT_TABLE
                                break
                            cell = parabola(knots, slopes, shrink, scale, which)
                        continue
                    if n_impacts == 0:
                        first, v_max = t, speed
                        peak = max(peak, travel)
                    v_max = max(v_max, speed)
                    if n_impacts < n_events:
                        impact_time[event_row, n_impacts] = t
                        impact_speed[event_row, n_impacts] = speed
                    n_impacts += 1
                    x, v, launched = travel, -restitution * speed, True
                    if n_ramps[i] > 0:
                        while True:
                            if -v < v_stick and abs(voltage(pieces, n_ramps, ramps, i, t)) >= hold_voltage:
                                held, launched, v, settled = True, False, 0.0, t
                                break
                            if form == COSINES and not lossy:
                                break
                            # A bounce that is short beside everything else needs few powers.
                            n_steps += 1
                            if shaped:
                                brief = short_shaped(
                                    form,
                                    film,
                                    table,
                                    pieces,
                                    n_ramps,
                                    ramps,
                                    i,
                                    t,
                                    travel,
                                    v,
                                    gap,
                                    c,
                                    k,
                                    d,
                                    f,
                                    shape,
                                    cell,
                                )
                            else:
                                brief = short(
                                    form, lossy, film, pieces, n_ramps, ramps, i, t, travel, v, gap, c, k, d, f
                                )
                            tau, speed = short_return(brief, rtol)
                            if tau <= 0.0 or t + tau > end or n_steps > max_steps:
                                break
                            if table and travel - depth_of(v, tau) < cell[0]:
                                break
                            if i_time < n_times:
                                i_time = sample_until(
                                    brief + _NO_MORE, t, t + tau, times, i_time, row, x64, v64, x32, v32
                                )
                            t += tau
                            if n_impacts < n_events:
                                impact_time[event_row, n_impacts] = t
                                impact_speed[event_row, n_impacts] = speed
                            n_impacts += 1
                            v_max = max(v_max, speed)
                            v = -restitution * speed
                        continue
                    if abs(pieces[i, 2]) < press_voltage:
                        if -v < v_stick and abs(pieces[i, 2]) >= hold_voltage:
                            held, launched, v, settled = True, False, 0.0, t
                        continue
                    if lossy:
                        if launch > 0.0 and force > 0.0:
                            n_returns, sure = learn(memo, n_returns, launch, t - launched_at, speed, force, drag, rtol)
                        launch, launched_at = -v, t
                        if not sure and -v >= v_stick:
                            continue
                    # Constant voltage that presses: energy is conserved, so each later impact has exactly the speed of
                    # the rebound before it, and small bounces last a power series in that speed.
                    elif bounce_limit < 0.0:
                        bounce_limit = 0.0
                        if abs(pieces[i, 2]) > press_voltage:
                            bounce = flight_time(travel, gap, c * pieces[i, 2] ** 2, k)
                            bounce_limit = radius(
                                rtol * bounce[0], bounce[TERMS - 1], 2 * (TERMS - 1), bounce[TERMS - 2], 2 * (TERMS - 2)
                            )
                    while True:
                        if -v < v_stick:
                            held, launched, v, settled = True, False, 0.0, t
                            break
                        n_steps += 1
                        back = -v
                        if lossy:
                            duration, back = predict(memo, n_returns, -v, force, drag)
                        elif -v <= bounce_limit:
                            duration = bounce_duration(bounce, -v)
                        else:
                            duration, n = symmetric_flight(
                                -v, end - t, travel, gap, c, k, pieces[i, 2], tolerance, near, max_steps
                            )
                            n_steps += n
                        t_next = t + duration
                        if t_next > end or n_steps > max_steps:
                            break
                        # For the samples only: what is reported does not depend on it. A bounce may take several steps.
                        ts, xs, vs = t, x, v
                        while i_time < n_times and times[i_time] <= t_next:
                            if shaped:
                                series = steady_shaped(film, table, pieces[i, 2], xs, vs, gap, c, k, d, f, shape, cell)
                            else:
                                series = steady(lossy, film, pieces[i, 2], xs, vs, gap, c, k, d, f)
                            h = step_size(series, tolerance)
                            until = t_next if h >= t_next - ts else ts + h
                            i_time = sample_until(series, ts, until, times, i_time, row, x64, v64, x32, v32)
                            xs, vs = evaluate(series, h)
                            ts = until
                        t = t_next
                        if n_impacts < n_events:
                            impact_time[event_row, n_impacts] = t
                            impact_speed[event_row, n_impacts] = back
                        n_impacts += 1
                        v = -restitution * back
            if status != 0:
                x, v, held, settled = math.nan, math.nan, False, math.inf
            if i_time < n_times:
                write(row, i_time, n_times, x, v, x64, v64, x32, v32)
            found = v_max, first, settled, n_impacts, x, v, held, status
            store(switch, found, metrics, counts, closed, statuses)
            if shaped:
                peaks[switch, 0] = peak

    return cast("Callable[..., None]", run_block)


@lru_cache
def block(*, form: int, lossy: bool, film: bool, shaped: bool, table: bool) -> Callable[..., None]:
    """`run_block` for such drives, losses and forces; each is compiled where it is first used, and cached."""
    return _build(fingerprint(), form, lossy, film, shaped, table)
