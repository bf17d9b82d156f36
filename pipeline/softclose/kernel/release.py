"""Owns the release from contact: when a voltage first is below what holds a switch closed."""

from __future__ import annotations

import math

from numba import njit

from softclose.kernel.pieces import tangent

_NUDGE_US = 1e-9
"""Smallest advance of the search. Also ensures that a released switch starts with a net force away from the contact."""


@njit(error_model="numpy", forceinline=True)
def release_time(pieces, n_ramps, ramps, i, t, hold_voltage):  # type: ignore[no-untyped-def]
    """First instant at or after t on piece i at which |u| < hold_voltage [µs]; inf if there is none on this piece.

    Overlapping ramps are not monotone, so ends and sign changes say too little. With |u''| <= b on the piece,
    u(t + s) >= u + u' s - b s²/2: stepping to the root of that parabola can never jump over a dip, and converges like
    Newton's method at a simple crossing.
    """
    end = pieces[i, 1]
    if n_ramps[i] == 0:
        return t if abs(pieces[i, 2]) < hold_voltage else math.inf
    while t < end:
        u, slope, bend = tangent(pieces, n_ramps, ramps, i, t)
        if u < 0.0:
            u, slope = -u, -slope
        above = u - hold_voltage
        if above < 0.0:
            return t
        root = math.sqrt(slope * slope + 2.0 * bend * above)
        # The two forms of the root avoid cancellation for either sign of the slope.
        s = (slope + root) / bend if slope >= 0.0 else 2.0 * above / (root - slope)
        t += max(s, _NUDGE_US)
    return math.inf
