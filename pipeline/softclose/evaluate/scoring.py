"""Owns Eqs. 7-11 of a response by a campaign's settings, apart from any further quantity that it weighs."""

from __future__ import annotations

from typing import Any

from softclose.metrics.control import Control, controlled
from softclose.metrics.objective import Assessment, Response, assess
from softclose.settings import CampaignConfig


def score(
    config: CampaignConfig, response: Response, *, fresh: bool, control: Control | None = None, **changes: Any
) -> Assessment:
    """Eqs. 7-11 of a response.

    fresh: independent random draws, whatever the campaign trains on; control: what the prior says of the same switches
    and of many more; changes: to the arguments of `assess`.
    """
    settings = objective_settings(config) | changes
    if fresh:
        settings |= {"sampling": "monte-carlo"}
    found = assess(response, **settings)
    if control is None:
        return found
    return controlled(found, response, control, **{name: settings[name] for name in OF_CONTROL})


OF_CONTROL = ("form", "c1_cm_s", "chance_penalty_cm_s", "p_max", "assured", "sampling")
"""Settings of an assessment that it has with a control variate too."""


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
