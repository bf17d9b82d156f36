"""Owns the interval of a sum of two estimates from the interval of each (Zou and Donner's MOVER, 2008).

A difference is the sum with the other end of the second interval, and the correlation of the other sign.
"""

from __future__ import annotations

import math


def joint(a: float, b: float, correlation: float) -> float:
    """Deviation of a sum of two estimates from the deviations of each (for intervals: Zou and Donner's MOVER)."""
    if not math.isfinite(a):
        return math.inf
    return math.sqrt(max(a * a + b * b + 2.0 * correlation * a * b, 0.0))


def reach(a: float, b: float, correlation: float, jump: float) -> float:
    """How far a sum of two estimates reaches, the first of which may jump by `jump` of its own reach a.

    A quantile jumps over a gap in V, and between an atom and its neighbours: it lies at one end of its interval or at
    the other, so its whole reach adds up, where smooth figures join in quadrature. Where V has a density at the
    quantile the jump is a small share of a, and this is `joint`.
    """
    smooth = joint(a, b, correlation)
    if not (math.isfinite(a) and a > 0.0):
        return smooth
    share = min(max((jump / a - 0.3) / 0.4, 0.0), 1.0)
    return share * (a + b) + (1.0 - share) * smooth
