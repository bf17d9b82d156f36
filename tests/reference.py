"""Slow, obvious oracle for one switch: scipy's DOP853 with events, restarted at every knot, impact and release.

Shares no code with the kernels except `Waveform.voltage`. Tolerance 1e-12 and steps of at most 0.5 µs, since scipy
looks for events only between the ends of steps.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from softclose.waveform import Waveform

EPS0_F_PER_M = 8.8541878128e-12


@dataclass
class ReferenceResponse:
    max_contact_speed: float = math.nan
    first_contact_us: float = math.inf
    settling_us: float = math.inf
    closed: bool = False
    n_impacts: int = 0
    final_x: float = 0.0
    final_v: float = 0.0
    impact_time_us: list[float] = field(default_factory=list)
    impact_speed: list[float] = field(default_factory=list)
    closest_miss_um: float = math.inf
    """Smallest D - x at an interior maximum of x that did not reach the contact [µm]."""
    samples: list[tuple[float, float, float]] = field(default_factory=list)
    """(t, x, v) at every step of the integrator."""


def reference(
    switch: np.ndarray,
    waveform: Waveform,
    *,
    horizon_us: float = 250.0,
    restitution: float = 0.5,
    plate_area_um2: float = 16700.0,
    v_stick: float = 1e-5,
    rtol: float = 1e-12,
) -> ReferenceResponse:
    """Integrate Eqs. 1-2 for one switch (D, G [µm], K [N/m], M [µg]) as SPEC §2 says, contact and release included."""
    travel, gap, stiffness, mass = (float(s) for s in switch)
    c = EPS0_F_PER_M * 1e6 * plate_area_um2 / (2000.0 * mass)
    k = stiffness / (1000.0 * mass)
    hold = (gap - travel) * math.sqrt(k * travel / c)
    out = ReferenceResponse()
    knots = [t for t in waveform.breakpoints(horizon_us) if t < horizon_us]
    knots.append(horizon_us)

    def contact(t: float, y: np.ndarray) -> float:
        return float(y[0]) - travel

    def apex(t: float, y: np.ndarray) -> float:
        return float(y[1])

    contact.terminal, contact.direction = True, 1.0
    apex.direction = -1.0
    state, held = np.array([0.0, 0.0]), False
    for start, end in itertools.pairwise(knots):
        # Exactly at a knot an ideal step belongs to the piece that follows; inside a piece u is continuous.
        inner = 1e-12 * max(1.0, end)

        def u(t: float, lo: float = start + inner, hi: float = end - inner) -> float:
            return float(waveform.voltage(min(max(t, lo), hi)))

        def rhs(t: float, y: np.ndarray, u=u) -> list[float]:
            return [y[1], c * (u(t) / (gap - y[0])) ** 2 - k * y[0]]

        t = start
        while t < end:
            if held:
                t = _first_below(waveform, u, t, end, hold)
                if t >= end:
                    break
                held, state, out.settling_us = False, np.array([travel, 0.0]), math.inf
                # At the release the force is exactly balanced: without a first small step the root is found again.
                t_safe = min(t + 1e-3, end)
                leg = solve_ivp(rhs, (t, t_safe), state, "DOP853", rtol=rtol, atol=1e-15, first_step=(t_safe - t) / 4)
                t, state = t_safe, leg.y[:, -1]
                continue
            stop, max_step = end, 0.5
            pressed = c * (u(t) / (gap - travel)) ** 2 - k * travel
            if state[0] == travel and state[1] < 0.0 and pressed > 0.0:
                # A rebound: resolve the flight, and step away from the contact before looking for it.
                flight = -2.0 * state[1] / pressed
                if flight < 2.0:
                    stop, max_step = min(end, t + 4.0 * flight), min(0.5, 0.1 * flight)
                    away = min(t + 0.25 * flight, stop)
                    leg = solve_ivp(rhs, (t, away), state, "DOP853", rtol=rtol, atol=1e-15, max_step=max_step)
                    t, state = away, leg.y[:, -1]
                    if t >= stop:
                        continue
            leg = solve_ivp(
                rhs, (t, stop), state, "DOP853", rtol=rtol, atol=1e-14, max_step=max_step, events=(contact, apex)
            )
            assert leg.status >= 0, leg.message
            out.samples.extend(zip(leg.t, leg.y[0], leg.y[1], strict=True))
            for y in leg.y_events[1]:
                if y[0] < travel:
                    out.closest_miss_um = min(out.closest_miss_um, travel - float(y[0]))
            if leg.status == 0:
                t, state = stop, leg.y[:, -1]
                continue
            t, speed = float(leg.t_events[0][0]), float(leg.y_events[0][0][1])
            out.impact_time_us.append(t)
            out.impact_speed.append(speed)
            state = np.array([travel, -restitution * speed])
            if restitution * speed < v_stick and u(t) >= hold:
                held, state[1], out.settling_us = True, 0.0, t
    out.n_impacts = len(out.impact_speed)
    if out.n_impacts:
        out.max_contact_speed = max(out.impact_speed)
        out.first_contact_us = out.impact_time_us[0]
    out.closed = held
    out.final_x, out.final_v = float(state[0]), float(state[1])
    if held:
        out.final_x, out.final_v = travel, 0.0
    else:
        out.settling_us = math.inf
    return out


def _first_below(waveform: Waveform, u, t: float, end: float, hold: float) -> float:
    """First instant at or after t with u < hold, by a dense scan and bisection; end if there is none."""
    grid = np.linspace(t, end, max(20, int((end - t) / 0.002)))
    low = np.flatnonzero(waveform.voltage(grid) < hold)
    if not len(low):
        return end
    i = int(low[0])
    if i == 0:
        return t
    return float(brentq(lambda s: u(s) - hold, grid[i - 1], grid[i], xtol=1e-13))
