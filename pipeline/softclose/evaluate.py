"""Owns calling a campaign's device model with the campaign's settings: the one place that does."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from softclose.config import ComputeSection, ModelSection
from softclose.device import load_model
from softclose.waveform import FloatArray, Waveform

if TYPE_CHECKING:
    from softclose.ensemble import Responses


def respond(
    model: ModelSection,
    compute: ComputeSection,
    switches: FloatArray,
    waveform: Waveform,
    *,
    max_volts: float = math.inf,
    **outputs: Any,
) -> Responses:
    """Responses of switches (n, 4) to one waveform. outputs: `times_us`, `max_impacts`, `dtype` and `threads`.

    max_volts [V]: above it WaveformError; reference designs are simulated whatever the campaign's limit.
    """
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
