"""Owns g alone, without what `assess` says around it: for a search that asks for thousands of values and no interval.

A tenth of the time of an assessment, and bit-identical to it.
"""

from __future__ import annotations

import math

import numpy as np

from softclose.metrics import intervals
from softclose.metrics.objective import (
    CM_S,
    MAX_FAILED,
    Form,
    Response,
    Risk,
    arrays_of,
    penalty_cm_s,
    tail_terms,
    those_read,
)


def objective_value(
    response: Response,
    *,
    c1_cm_s: float,
    level: float,
    form: Form,
    risk: Risk,
    p_max: float | None,
    assured: bool,
    closed_by_us: float,
    chance_penalty_cm_s: float,
    min_contact: float,
    undefined_v_u_cm_s: float,
    confidence: float,
) -> tuple[float, float]:
    """g [cm/s] of Eq. 10, or of its chance-constrained form, and p_nc, as `assess` has them.

    Parameters
    ----------
    response : Response
        max_contact_speed [µm/µs] and closed, (n,) each.
    c1_cm_s, level, form, risk, p_max, assured, closed_by_us, chance_penalty_cm_s, min_contact, undefined_v_u_cm_s,
    confidence
        As in `assess`.

    Returns
    -------
    float
        g [cm/s]; NaN where too many switches failed.
    float
        Fraction of the switches not closed.

    Raises
    ------
    ObjectiveError
        For a response that cannot be assessed.
    """
    response = those_read(response)
    speed, closed, n_failed = arrays_of(response, closed_by_us)
    n = speed.size
    n_open = n - int(closed.sum())
    p_nc = n_open / n
    if n_failed > MAX_FAILED * n:
        return math.nan, p_nc
    ordered = np.sort(speed[~np.isnan(speed)] * CM_S)
    value = undefined_v_u_cm_s
    if ordered.size and ordered.size >= min_contact * n:
        value = float(ordered[intervals.quantile_rank(ordered.size, level) - 1])
        if risk == "cvar":
            value = float(tail_terms(speed[~np.isnan(speed)] * CM_S, value, level).mean())
    counted = intervals.proportion(n_open, n, confidence).wilson[1] if assured and form == "chance" else p_nc
    penalty = penalty_cm_s(
        counted, form=form, c1_cm_s=c1_cm_s, chance_penalty_cm_s=chance_penalty_cm_s, p_max=p_max
    )  # fmt: skip
    return value + penalty, p_nc
