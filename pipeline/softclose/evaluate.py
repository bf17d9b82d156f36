"""Owns the one place where a configuration meets a waveform: switches × waveform -> responses -> assessment.

Every command and every engine's evaluation goes through here, so that each device model, objective and setting counts
everywhere.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from softclose.device import load_model
from softclose.metrics.objective import Assessment, Response, assess
from softclose.waveform import FloatArray, Waveform

if TYPE_CHECKING:
    from softclose.config import CampaignConfig
    from softclose.ensemble import Responses


def respond(
    config: CampaignConfig, switches: FloatArray, waveform: Waveform, *, max_volts: float = math.inf, **outputs: Any
) -> Responses:
    """Responses of switches (n, 4) to one waveform, by the campaign's device model and with its settings.

    max_volts [V]: above it WaveformError; reference designs and faulty drives are simulated whatever the campaign's
    limit. outputs: `times_us`, `max_impacts`, `dtype` and `threads` of the device model.
    """
    model, compute = config.model, config.compute
    return load_model(model.name)(
        switches,
        waveform,
        horizon_us=model.horizon_us,
        restitution=model.restitution,
        plate_area_um2=model.plate_area_um2,
        rtol=compute.rtol,
        method=compute.method,
        max_volts=max_volts,
        **outputs,
    )


def judge(config: CampaignConfig, response: Response, *, fresh: bool = False) -> Assessment:
    """Eqs. 7-11 of a response with the campaign's objective.

    fresh: the switches are independent random draws, whatever the campaign trains on, so that intervals hold.
    """
    settings = objective_settings(config)
    return assess(response, **(settings | {"sampling": "monte-carlo"} if fresh else settings))


def evaluate(
    config: CampaignConfig,
    switches: FloatArray,
    waveform: Waveform,
    *,
    max_volts: float = math.inf,
    fresh: bool = False,
    threads: int = 1,
) -> Assessment:
    """Assess one waveform on switches (n, 4); see `respond` and `judge`."""
    return judge(config, respond(config, switches, waveform, max_volts=max_volts, threads=threads), fresh=fresh)


def objective_settings(config: CampaignConfig) -> dict[str, Any]:
    """The keyword arguments of `assess` that a configuration stands for."""
    o = config.objective
    return {
        "form": o.form,
        "level": o.level,
        "c1_cm_s": o.c1_cm_s,
        "p_max": o.p_max if o.form == "chance" else None,
        "limits_cm_s": o.limits_cm_s,
        "min_contact": o.min_contact,
        "undefined_v_u_cm_s": o.undefined_v_u_cm_s,
        "confidence": o.confidence,
        "sampling": config.population.sampling,
    }
