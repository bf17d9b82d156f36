"""Owns judging: a response and the campaign's objective make an assessment (Eqs. 7-11)."""

from __future__ import annotations

import math
from typing import Any

from numpy.typing import ArrayLike

from softclose.evaluate.respond import respond
from softclose.metrics.objective import Assessment, Response, assess
from softclose.population.lot import Lot
from softclose.settings import CampaignConfig
from softclose.waveform import Drive


def judge(config: CampaignConfig, response: Response, *, fresh: bool = False) -> Assessment:
    """Eqs. 7-11 of a response with the campaign's objective.

    Parameters
    ----------
    config : CampaignConfig
        The objective, and how the campaign samples its training ensemble.
    response : Response
        What switches did.
    fresh : bool
        They are independent random draws, whatever the campaign trains on, so that intervals hold.

    Returns
    -------
    Assessment
    """
    settings = objective_settings(config)
    return assess(response, **(settings | {"sampling": "monte-carlo"} if fresh else settings))


def evaluate(
    config: CampaignConfig,
    lot: Lot | ArrayLike,
    waveform: Drive,
    *,
    max_volts: float = math.inf,
    fresh: bool = False,
    threads: int = 1,
) -> Assessment:
    """Assess one waveform on a lot; see `respond` and `judge`."""
    return judge(config, respond(config, lot, waveform, max_volts=max_volts, threads=threads), fresh=fresh)


def objective_settings(config: CampaignConfig) -> dict[str, Any]:
    """The keyword arguments of `assess` that a configuration stands for."""
    o = config.objective
    return {
        "form": o.form,
        "risk": o.risk,
        "level": o.level,
        "closed_by_us": o.closed_by_us,
        "c1_cm_s": o.c1_cm_s,
        "p_max": o.p_max if o.form == "chance" else None,
        "assured": o.assured,
        "chance_penalty_cm_s": o.chance_penalty_cm_s,
        "limits_cm_s": o.limits_cm_s,
        "min_contact": o.min_contact,
        "undefined_v_u_cm_s": o.undefined_v_u_cm_s,
        "max_open": o.max_open,
        "warn_open": o.warn_open,
        "confidence": o.confidence,
        "sampling": config.population.sampling,
    }
