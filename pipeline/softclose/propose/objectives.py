"""Owns the objectives that a front may weigh against each other, each of one candidate and smaller is better."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from softclose.arrays import FloatArray
from softclose.evaluate.quantities import quantity
from softclose.propose.protocol import Observation
from softclose.settings import CampaignConfig

HORIZON, VOLTS = "closing", "peak"


def sign_of(objective: str) -> float:
    """-1 of a quantity of which more is better: a front has it with the other sign."""
    return 1.0 if quantity(objective).better == "low" else -1.0


def front_values(config: CampaignConfig, observations: Sequence[Observation], objectives: Sequence[str]) -> FloatArray:
    """(n, k) objectives of each candidate, smaller is better; NaN where undefined or failed.

    closing: the lot's closing time [µs], the horizon where too many stay open; peak: the largest voltage that is
    commanded [V]; others as records have them, with the other sign where more is better.
    """
    horizon = config.model.horizon_us
    signs = [sign_of(name) for name in objectives]

    def value(o: Observation, objective: str) -> float:
        if objective == "v_u":
            return o.v_u_cm_s
        if objective == "p_nc":
            return o.p_nc
        if objective == HORIZON:
            return min(o.closing_us, horizon)  # NaN stays NaN
        if objective == VOLTS:
            return o.waveform.max_voltage(horizon)
        return o.quantities.get(objective, math.nan)

    rows = [
        [math.nan if o.failed else sign * value(o, name) for name, sign in zip(objectives, signs, strict=True)]
        for o in observations
    ]
    return np.array(rows, dtype=np.float64).reshape(len(observations), len(objectives))


def worst_values(config: CampaignConfig, objectives: Sequence[str], values: FloatArray | None = None) -> FloatArray:
    """(k,) what each objective is at worst: the corner of the hypervolume, and what an undefined one counts as.

    values: (n, k) of the candidates; of a quantity that nothing bounds the worst is the worst of theirs.
    """
    values = np.empty((0, len(objectives))) if values is None else values
    bounds = {
        "v_u": config.objective.undefined_v_u_cm_s,
        "p_nc": 1.0,
        HORIZON: config.model.horizon_us,
        VOLTS: config.waveform.max_volts,
    }
    seen = np.where(np.isfinite(values), values, -math.inf).max(axis=0, initial=-math.inf)
    found = [bounds.get(name, float(seen[k])) for k, name in enumerate(objectives)]
    return np.array([worst if math.isfinite(worst) else 0.0 for worst in found])


BOUNDED = ("v_u", "p_nc", HORIZON, VOLTS)
"""Objectives that are 0 at best."""


def ideal_values(objectives: Sequence[str], values: FloatArray) -> FloatArray:
    """(k,) what each objective is at best, where the box of the hypervolume begins: 0, or the best of the candidates.

    values: (n, k) of the candidates.
    """
    best = np.where(np.isfinite(values), values, math.inf).min(axis=0, initial=math.inf)
    return np.array(
        [0.0 if name in BOUNDED or not math.isfinite(best[k]) else float(best[k]) for k, name in enumerate(objectives)]
    )
