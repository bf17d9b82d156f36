"""Owns the search for the first contact on one Taylor polynomial, double crossings and grazing included."""

from __future__ import annotations

import math

from numba import njit

from softclose.kernel.series import descent

NONE = -1.0
UNDECIDED = -2.0
_MAX_MARCH = 60


@njit(error_model="numpy", forceinline=True)
def first_contact(x, h, depth, launched, v_end, bend, near):  # type: ignore[no-untyped-def]
    """First root in (0, h] of f = travel - x(tau), coming from below: (tau, speed) or (NONE, 0).

    x: tuple of Taylor coefficients; depth = f(0); launched: the motion starts on the contact, inwards or at rest;
    v_end = x'(h); |x''| <= bend on [0, h]. f(tau + s) >= f - v s - bend s²/2: stepping to the root of that parabola
    cannot jump over a crossing, which looking at the ends of steps does, and converges like Newton's method.
    (UNDECIDED, tau) after many such steps: no contact until tau.
    """
    tau = 0.0
    if launched:
        if x[1] == 0.0:
            return _after_release(x, h, v_end)
        tau = -2.0 * x[1] / bend
    for _ in range(_MAX_MARCH):
        if tau > h:
            return NONE, 0.0
        y, v = descent(x, tau)
        f = depth + tau * y
        if f <= 0.0:
            return tau, max(v, 0.0)
        root = math.sqrt(v * v + 2.0 * bend * f)
        if root == 0.0:  # at rest with no force
            return NONE, 0.0
        # The two forms of the root avoid cancellation for either sign of v.
        s = 2.0 * f / (root + v) if v > 0.0 else (root - v) / bend
        tau += s
        if s * bend < near * v:  # convergence is quadratic: what is left of tau is below near² v / bend
            return (tau, descent(x, tau)[1]) if tau <= h else (NONE, 0.0)
    return UNDECIDED, tau


@njit(error_model="numpy", forceinline=True)
def _after_release(x, h, v_end):  # type: ignore[no-untyped-def]
    """A switch released at rest moves like t³: no bound finds its scale. Look for a return by bisection instead."""
    if v_end <= 0.0 or descent(x, h)[0] > 0.0:
        return NONE, 0.0
    lo, hi = 0.0, h
    for _ in range(60):
        tau = 0.5 * (lo + hi)
        if descent(x, tau)[1] > 0.0:
            hi = tau
        else:
            lo = tau
    lo, hi = hi, h
    for _ in range(60):
        tau = 0.5 * (lo + hi)
        if descent(x, tau)[0] > 0.0:
            lo = tau
        else:
            hi = tau
    return hi, max(descent(x, hi)[1], 0.0)
