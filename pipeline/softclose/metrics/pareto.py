"""Owns the trade-off between several objectives: which candidates nothing else beats, and how much they dominate."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def pareto_front(values: ArrayLike) -> NDArray[np.intp]:
    """Positions of the candidates that no other beats in all objectives, by rising last objective, then the others.

    Compare only candidates assessed on the same ensemble: scores on fewer switches are more optimistic.

    Parameters
    ----------
    values : (n, k) array-like
        Each of k objectives, smaller is better. A row that is not finite (undefined or failed) is never on the front;
        of equal candidates the first is kept.

    Returns
    -------
    (m,) ndarray of int

    Raises
    ------
    ValueError
        Where the values are no table.
    """
    import moocore

    v = _table(values)
    usable = np.flatnonzero(np.isfinite(v).all(axis=1))
    if not usable.size:
        return usable
    front = usable[moocore.is_nondominated(v[usable], keep_weakly=False)]
    return np.asarray(front[np.lexsort(v[front].T)])


def hypervolume(values: ArrayLike, worst: ArrayLike) -> float:
    """Share, from 0 to 1, of the box between 0 and the worst that a front dominates: it grows as the front gets better.

    Parameters
    ----------
    values : (n, k) array-like
        Of any candidates; those that are dominated, undefined or worse than the corner add nothing.
    worst : (k,) array-like
        The corner of the box, above 0.

    Raises
    ------
    ValueError
        Where the values are no table, or the corner does not fit.
    """
    import moocore

    v, corner = _table(values), np.asarray(worst, dtype=np.float64)
    if corner.shape != (v.shape[1],) or not (corner > 0.0).all():
        raise ValueError(f"worst is {worst!r}; it must be {v.shape[1]} positive numbers, one for each objective")
    shares = v[np.isfinite(v).all(axis=1)] / corner
    shares = shares[(shares < 1.0).all(axis=1)]
    return float(moocore.hypervolume(shares, ref=np.ones(corner.size))) if shares.size else 0.0


def _table(values: ArrayLike) -> NDArray[np.float64]:
    v = np.asarray(values, dtype=np.float64)
    if v.ndim != 2 or v.shape[1] < 1:
        raise ValueError(f"values have the shape {v.shape}; they must be an (n, k) table of k objectives")
    return v
