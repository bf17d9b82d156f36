"""Owns the order of candidates: by g where few enough switches stay open, behind all of these by the share open.

Every engine, race, front and choice of a best asks here. A price per open switch alone does not do it: where soft
contacts are bought with switches that never close, some price always pays.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softclose.arrays import FloatArray

BEYOND_CM_S = 1e7
"""Larger than any g that the settings allow [cm/s]; a double still tells p_nc of 1e8 switches apart above it."""


def rank_cm_s(g_cm_s: float, p_nc: float, max_open: float) -> float:
    """What candidates are ranked by, smaller is better [cm/s].

    Parameters
    ----------
    g_cm_s : float
        Objective [cm/s]; NaN where there is none.
    p_nc : float
        Fraction of the switches not closed, from 0 to 1.
    max_open : float
        Largest fraction up to which g decides; with 1 it always does.

    Returns
    -------
    float
        g, or beyond max_open `BEYOND_CM_S` + p_nc; NaN where g is.
    """
    return BEYOND_CM_S + p_nc if p_nc > max_open and g_cm_s == g_cm_s else g_cm_s


def is_beyond(ranks: ArrayLike) -> NDArray[np.bool_]:
    """Which ranks, any shape, are of candidates that leave more than `max_open` open."""
    return np.asarray(ranks, dtype=np.float64) >= BEYOND_CM_S


def levelled(ranks: ArrayLike) -> FloatArray:
    """The same order without the step, for whatever fits a model to it.

    Candidates beyond `max_open` follow directly behind the worst before them, as far apart as that one is from the
    best, at most.

    Parameters
    ----------
    ranks : (n,) array-like
        As `rank_cm_s` gives them, finite.

    Returns
    -------
    (n,) ndarray of float64
        In cm/s; the ranks themselves where none is beyond.
    """
    found = np.array(ranks, dtype=np.float64)
    beyond = is_beyond(found)
    if not beyond.any():
        return found
    within = found[~beyond]
    worst = float(within.max()) if within.size else 0.0
    spread = max(worst - float(within.min()), 1.0) if within.size else 1.0
    found[beyond] = worst + spread * (found[beyond] - BEYOND_CM_S)
    return found


def open_warning(p_nc: float, *, max_open: float, warn_open: float) -> str:
    """A sentence wherever a waveform is told or exported that leaves more than warn_open open; else ""."""
    if not p_nc > warn_open:
        return ""
    beyond = p_nc > max_open
    said = f"WARNING: {100.0 * p_nc:.1f} % of the switches stay open under this waveform, more than "
    if beyond:
        return said + (
            f"objective.max_open ({100.0 * max_open:g} %): a candidate that leaves fewer open ranks before it, however "
            "fast; none was found, or it was not asked for"
        )
    limit = f"objective.warn_open ({100.0 * warn_open:g} %)"
    return f"{said}{limit}: switches that never close make the others look softer"
