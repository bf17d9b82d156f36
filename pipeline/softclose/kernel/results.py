"""Owns how one trajectory's results are written into the columns of an ensemble: the same for every kernel."""

from __future__ import annotations

from numba import njit


@njit(error_model="numpy", forceinline=True)
def store(i, found, metrics, n_impacts, closed, status):  # type: ignore[no-untyped-def]
    """found: (V, first contact, settling, impacts, x, v, held, status) of switch i."""
    metrics[0, i] = found[0]
    metrics[1, i] = found[1]
    metrics[2, i] = found[2]
    metrics[3, i] = found[4]
    metrics[4, i] = found[5]
    n_impacts[i] = found[3]
    closed[i] = found[6]
    status[i] = found[7]
