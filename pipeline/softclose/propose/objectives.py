"""Owns the objectives that a front may weigh against each other, each of one candidate and smaller is better."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from softclose.propose.protocol import Observation
from softclose.settings import CampaignConfig
from softclose.settings.search import FrontObjective
from softclose.waveform import FloatArray

UNITS: dict[FrontObjective, str] = {"v_u": "cm/s", "p_nc": "", "closing": "µs", "peak": "V"}
"""Unit of each objective."""


def front_values(
    config: CampaignConfig, observations: Sequence[Observation], objectives: Sequence[FrontObjective]
) -> FloatArray:
    """(n, k) objectives of each candidate; NaN where undefined or failed.

    v_u [cm/s]; p_nc; closing: the lot's closing time [µs], the horizon where too many stay open; peak: the largest
    voltage that is commanded [V].
    """
    horizon = config.model.horizon_us

    def value(o: Observation, objective: FrontObjective) -> float:
        if objective == "v_u":
            return o.v_u_cm_s
        if objective == "p_nc":
            return o.p_nc
        if objective == "closing":
            return min(o.closing_us, horizon)  # NaN stays NaN
        return o.waveform.max_voltage(horizon)

    rows = [[math.nan if o.failed else value(o, name) for name in objectives] for o in observations]
    return np.array(rows, dtype=np.float64).reshape(len(observations), len(objectives))


def worst_values(config: CampaignConfig, objectives: Sequence[FrontObjective]) -> FloatArray:
    """(k,) what each objective is at worst: the corner of the hypervolume, and what an undefined one counts as."""
    worst: dict[FrontObjective, float] = {
        "v_u": config.objective.undefined_v_u_cm_s,
        "p_nc": 1.0,
        "closing": config.model.horizon_us,
        "peak": config.waveform.max_volts,
    }
    return np.array([worst[name] for name in objectives])
