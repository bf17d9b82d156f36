"""Owns where a motion is in its table of capacitance: the cell, and the instant at which it leaves it.

Within a cell dC/dx is a parabola, so that the motion has a series; value and slope go on smoothly from one to the next.
A cell may be left by `SLACK_UM` before the next one begins: a motion that turns on a knot changes cells once.
"""

from __future__ import annotations

import math

from numba import njit

from softclose.kernel.contact import NONE, UNDECIDED, first_contact
from softclose.kernel.modes_series import blend

SLACK_UM = 1e-6
"""By so much a parabola may be asked beyond its ends: what it then misses is the jump of its curvature times 5e-13."""

_NEAR = 1e-5
"""As `first_contact` has it: an end of a cell is found to far less than the slack."""


@njit(error_model="numpy", forceinline=True)
def cell_at(knots, shrink, x):  # type: ignore[no-untyped-def]
    """The cell that x lies in, of 0 .. n - 1; shrink: displacements in the table over those of the switch."""
    s = x * shrink
    which = 0
    while which < knots.shape[0] - 2 and knots[which + 1] <= s:
        which += 1
    return which


@njit(error_model="numpy", forceinline=True)
def parabola(knots, slopes, shrink, c, which):  # type: ignore[no-untyped-def]
    """Origin [µm] and coefficients of the force over u² and mass in a cell, from its lower end.

    slopes: (3, n) of dC/dx, highest power first; c: what makes a force per mass of them.
    """
    origin = knots[which] / shrink
    return origin, c * slopes[2, which], c * shrink * slopes[1, which], c * shrink * shrink * slopes[0, which]


@njit(error_model="numpy", inline="always")
def leaves(series, h, x1, bend, knots, shrink, which, travel):  # type: ignore[no-untyped-def]
    """Until when the motion stays in its cell, within h, and where it goes then: -1, 0 (it stays) or 1 cell further.

    Beyond the contact there is nothing to leave for. With |x''| <= bend a motion towards one end, at a speed of half
    bend h or more, does not turn to the other.
    """
    x, v = series[0], series[1]
    reach, turns = 0.125 * bend * h * h, 0.5 * bend * h
    until, way = h, 0
    high = knots[which + 1] / shrink + SLACK_UM
    if high < travel and v > -turns and max(x, x1) + reach >= high:
        tau, speed = first_contact(series, h, high - x, False, 0.0, bend, _NEAR)
        if tau == UNDECIDED:
            until = speed
        elif tau != NONE:
            until, way = tau, 1
    low = knots[which] / shrink - SLACK_UM
    if v < turns and min(x, x1) - reach <= low:
        mirrored = blend(series, series, -1.0, 0.0)
        tau, speed = first_contact(mirrored, until, x - low, False, 0.0, bend, _NEAR)
        if tau == UNDECIDED:
            until, way = speed, 0
        elif tau != NONE:
            until, way = tau, -1
    return until, way


@njit(error_model="numpy", forceinline=True)
def hold_of(knots, slopes, shrink, c, travel):  # type: ignore[no-untyped-def]
    """Force over u² and mass on the closed switch."""
    origin, q0, q1, q2 = parabola(knots, slopes, shrink, c, cell_at(knots, shrink, travel))
    z = travel - origin
    return q0 + z * (q1 + z * q2)


@njit(error_model="numpy", forceinline=True)
def depth_of(v, tau):  # type: ignore[no-untyped-def]
    """How far a short bounce goes, at most by half again [µm]."""
    return 0.375 * math.fabs(v) * tau
