"""Owns the trade-off between upper velocity and switches that do not close: which candidates nothing else beats."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def pareto_front(v_u_cm_s: ArrayLike, p_nc: ArrayLike) -> NDArray[np.intp]:
    """Positions of the candidates that no other beats in both v_u and p_nc, by rising p_nc.

    v_u_cm_s, p_nc: (n,) of any store; NaN (undefined or failed) never belongs to the front. Of equal candidates the
    first is kept. Compare only candidates assessed on the same ensemble: a smaller one flatters (SPEC §7).
    """
    v, p = np.asarray(v_u_cm_s, dtype=np.float64), np.asarray(p_nc, dtype=np.float64)
    if v.shape != p.shape or v.ndim != 1:
        raise ValueError(f"v_u_cm_s and p_nc must be two (n,) arrays; got shapes {v.shape} and {p.shape}")
    usable = np.flatnonzero(np.isfinite(v) & np.isfinite(p))
    order = usable[np.lexsort((usable, v[usable], p[usable]))]
    lowest = np.minimum.accumulate(np.append(np.inf, v[order]))[:-1]
    return np.asarray(order[v[order] < lowest])


def hypervolume(v_u_cm_s: ArrayLike, p_nc: ArrayLike, *, worst_v_u_cm_s: float) -> float:
    """Area [cm/s] that a front dominates, below v_u = worst and p_nc = 1: it grows as the front gets better.

    v_u_cm_s, p_nc: (n,) of any candidates; those that are dominated, undefined or worse than the corner add nothing.
    """
    v, p = np.asarray(v_u_cm_s, dtype=np.float64), np.asarray(p_nc, dtype=np.float64)
    front = pareto_front(v, p)
    v, p = v[front], p[front]
    edges = np.append(p, 1.0)[1:]  # by rising p_nc, v_u falls: each holds until the next
    return float((np.maximum(worst_v_u_cm_s - v, 0.0) * (edges - p)).sum())
