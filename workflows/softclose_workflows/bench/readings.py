"""Owns what people say that they read of devices: numbers that are missing, open or lost, as they are judged."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from softclose.metrics.objective import CM_S, MISSING, Judged
from softclose_store import DriverStore
from softclose_workflows.errors import BenchError
from softclose_workflows.terminal import say

BELOW, ABOVE = 40.0, 10.0
"""Median speeds below or above the lot's own by more than this are asked about: m/s taken for cm/s, and the like."""


def judged(
    speeds_cm_s: ArrayLike, closed: ArrayLike | None, status: ArrayLike | None, n: int, scale_cm_s: float | None
) -> Judged:
    """Readings as they are judged; scale_cm_s: what speeds are held against, None: nothing."""
    try:
        speeds = np.ma.asarray(speeds_cm_s, dtype=np.float64)
        given: Any = np.ma.asarray(~np.isnan(speeds.data) if closed is None else closed)
        outcome: Any = np.ma.asarray(np.zeros(n, dtype=np.int8) if status is None else status)
        if not (speeds.shape == given.shape == outcome.shape == (n,) and given.dtype == np.bool_):
            raise ValueError
        if outcome.dtype.kind not in "iub" or ((outcome.data < 0) | (outcome.data >= MISSING)).any():
            raise ValueError
        missing = np.ma.getmaskarray(speeds) | np.ma.getmaskarray(given) | np.ma.getmaskarray(outcome)
        lost = ~missing & (outcome.data != 0)
        unsaid = np.isnan(speeds.data) & ~missing & ~lost & (closed is None)
        missing |= unsaid
        speed = np.where(missing | lost, np.nan, speeds.data)
        held = np.asarray(given.data) & ~lost & ~missing
        known = ~np.isnan(speed)
        n_known, n_touched = int(known.sum()), int((known | held).sum())
        if missing.all() or np.isinf(speed).any() or (speed < 0.0).any() or 2 * n_known < n_touched:
            raise ValueError
    except (TypeError, ValueError, OverflowError) as e:
        raise BenchError(
            f"the measurements are {speeds_cm_s!r}, closed {closed!r}, status {status!r}; expected are {n} speeds of 0 "
            "cm/s or more, NaN where there is none, whether each is closed (True or False), a status from 0 to 126, "
            "each masked where nothing was read; at least one device has to be read, and at least half of those that "
            "touched need a speed"
        ) from e
    if n_known and scale_cm_s is not None:
        _check_scale(float(np.median(speed[known])), scale_cm_s)
    if unsaid.any():
        say(
            f"note: {unsaid.sum()} of {n} speeds are NaN and `closed` is not given: these readings count as "
            "missing; a device that stayed open is False in `closed`",
            err=True,
        )
    coded = np.where(missing, MISSING, np.where(lost, outcome.data, 0)).astype(np.int8)
    return Judged(max_contact_speed=speed / CM_S, closed=held, status=coded)


def nothing_read(n: int) -> Judged:
    return Judged(
        max_contact_speed=np.full(n, np.nan),
        closed=np.zeros(n, dtype=np.bool_),
        status=np.full(n, MISSING, dtype=np.int8),
    )


def scale_of(store: DriverStore) -> float:
    """Median speed of the lot's own motion, travel times angular resonance D sqrt(K/M) [cm/s].

    A step of the full voltage closes the shipped lots at two to four times that, soft closings are at a tenth and more.
    """
    lot = store.population
    per_us = np.sqrt(lot["K"] / lot["M"] * 1e-3)  # N/m over µg is 1e9/s²
    return float(np.median(lot["D"] * per_us)) * CM_S


def _check_scale(median_cm_s: float, scale_cm_s: float) -> None:
    lower, upper = scale_cm_s / BELOW, scale_cm_s * ABOVE
    if not lower <= median_cm_s <= upper:
        raise BenchError(
            f"the median of the speeds is {median_cm_s:.3g} cm/s; devices of this lot close at some {lower:.2g} to "
            f"{upper:.2g} cm/s. Are the speeds in cm/s (1 m/s is 100 cm/s)? Where they are, say unusual=True"
        )
