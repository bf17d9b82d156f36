"""Owns `[objective]` and `[reference]`: what is minimised, and what results are compared with."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from softclose.allowed.types import (
    MAX_CM_S,
    MAX_HORIZON_US,
    SETTINGS,
    Probability,
)


@dataclass(frozen=True, slots=True, kw_only=True, config=SETTINGS)
class ObjectiveSection:
    """Eqs. 8-11."""

    form: Literal["penalty", "chance"] = "penalty"
    """penalty: g = v_u + c1·p_nc (Eq. 10); chance: minimise v_u subject to p_nc <= p_max."""
    risk: Literal["quantile", "cvar"] = "quantile"
    """What g is made of: the upper velocity v_u, or the mean V above it (conditional value at risk)."""
    level: Probability = 0.9
    """Quantile of V that is v_u."""
    closed_by_us: Annotated[float, Field(ge=0, le=MAX_HORIZON_US)] = 0.0
    """A switch counts as closed if it is held in contact from this instant on [µs]; 0: from any instant."""
    c1_cm_s: Annotated[float, Field(ge=0, le=MAX_CM_S)] = math.nan
    """Penalty per unit probability of not closing [cm/s]. Scales with the lot: 25 where its v_u under a step of 1.24
    times its pull-in voltage is 41.6 cm/s."""
    max_open: Annotated[float, Field(ge=0, le=1)] = 0.1
    """Largest fraction of open switches up to which g decides: candidates that leave more open rank behind all others,
    by that fraction. 1: g always decides."""
    warn_open: Annotated[float, Field(ge=0, le=1)] = 0.05
    """A best candidate that leaves a larger fraction open is printed and exported with a warning."""
    p_max: Annotated[float, Field(ge=0, lt=1)] = 0.05
    """Largest admissible p_nc of the chance-constrained form."""
    assured: bool = False
    """chance: the upper end of the interval of p_nc has to keep p_max, not only its estimate: what a search finds then
    keeps it on other switches too."""
    chance_penalty_cm_s: Annotated[float, Field(gt=0, le=MAX_CM_S)] = math.nan
    """chance: penalty per unit by which p_nc passes p_max [cm/s]. It has to outweigh what v_u gains by letting switches
    stay open: on the published study's lot some 25 cm/s per unit where 5 % do, 500 where one in a thousand does. Scales
    with the lot as c1_cm_s does, from 500."""
    limits_cm_s: tuple[Annotated[float, Field(gt=0, le=MAX_CM_S)], ...] = (math.nan,)
    """Contact speeds for which P(V > limit) is reported [cm/s]. One, which scales with the lot from 19.7."""
    min_contact: Annotated[float, Field(ge=0, le=1)] = 0.1
    """Below this fraction of switches in contact v_u is undefined."""
    undefined_v_u_cm_s: Annotated[float, Field(gt=0, le=MAX_CM_S)] = math.nan
    """What an undefined v_u counts as in g [cm/s]. Scales with the lot, from 60."""
    confidence: Probability = 0.95
    """Confidence of every interval."""
    weights: dict[str, Annotated[float, Field(ge=-1e9, le=1e9)]] = Field(default_factory=dict)
    """Quantities that g weighs beside the speed and p_nc: name = what one unit of it adds to g [cm/s]; negative where
    more is better. `softclose.quantity` says which there are."""
    quantity_limits: dict[str, Annotated[float, Field(ge=-1e12, le=1e12)]] = Field(default_factory=dict)
    """Quantities that are limited: name = the most of it in its unit, the least where more is better. The
    level-quantile of the switches counts, and its interval decides whether a candidate is feasible."""
    limit_penalty_cm_s: Annotated[float, Field(gt=0, le=MAX_CM_S)] = 200.0
    """What passing a limit by its own size adds to g [cm/s]."""
    lines: tuple[str, ...] = ()
    """Further quantities that every record, certificate and report tells."""

    def is_left_out(self, name: str) -> bool:
        """Whether a speed is one that the user does not give: no number that is given is NaN."""
        return bool(np.isnan(getattr(self, name)).any())


@dataclass(frozen=True, slots=True, kw_only=True, config=SETTINGS)
class ReferenceSection:
    """The designs that every result is compared with."""

    step_volts: Annotated[float, Field(ge=0, le=1000)] = 0.0
    """Voltage of the unshaped step [V]; 0: 1.24 times the mean switch's pull-in voltage in the device model, or
    waveform.max_volts where that is less."""
