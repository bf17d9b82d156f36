"""Owns what the report shows of a switch that Eqs. 1-2 do not describe whole: temperatures, further modes, losses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from softclose.conditions.temperature import TemperatureSection, heated
from softclose.device.protocol import ModelError
from softclose.evaluate import draw, judge, respond
from softclose.metrics.objective import Assessment
from softclose.plugins import REDUCED_ORDER
from softclose.population.lot import Lot
from softclose.settings import CampaignConfig
from softclose_workflows.report.data import Design, OverTemperature, Plainer

N_TEMPERATURES = 9
"""Temperatures at which the lot is simulated for the report."""
MOST_SWITCHES = 2000
"""Switches that are simulated beside the campaign's own, at each temperature or on the plainer model."""


def over_temperature(config: CampaignConfig, designs: Sequence[Design]) -> OverTemperature | None:
    """The designs on the same lot at each of some temperatures of the range; None where the campaign has none."""
    tables = config.temperature
    if not tables.celsius or not designs:
        return None
    still = replace(config, temperature=TemperatureSection())
    n = min(MOST_SWITCHES, len(designs[0].speed_cm_s))
    lot = draw(still, n, seed=config.campaign.seed, sampling=config.population.sampling)
    celsius = np.linspace(tables.low_C, tables.high_C, N_TEMPERATURES)

    def at_each(design: Design) -> tuple[Assessment, ...]:
        plain = design.role != "best"  # reference designs are tailored to nobody
        return tuple(
            judge(still, respond(still, heated(tables, lot, c), design.waveform, for_everybody=plain)) for c in celsius
        )

    try:
        assessments = tuple(at_each(design) for design in designs)
    except ModelError:  # the device model is not installed here
        return None
    return OverTemperature(
        celsius=celsius, names=tuple(d.name for d in designs), roles=tuple(d.role for d in designs), found=assessments
    )


def plainer(config: CampaignConfig, best: Design, lot: Lot) -> Plainer | None:
    """The best candidate beside the same switches without their further modes, or else without their losses.

    None where they have neither. lot: the training ensemble, of which the candidate used the first.
    """
    modes = config.build_reduced_order() if config.model.name == REDUCED_ORDER else None
    kind: Literal["modes", "losses"]
    if modes is not None and len(modes.mode) > 1:
        kind, name = "modes", "the first mode alone"
        first = replace(modes, mode=modes.mode[:1]).to_dict()
        simple = replace(config, reduced_order_model=first)
    elif not config.model.build_losses().none:
        kind, name = "losses", "the same switches without losses"
        lossless = replace(config.model, quality_factor=0.0, film_viscosity_uPa_s=0.0, adhesion_uN=0.0)
        simple = replace(config, model=lossless)
    else:
        return None
    n = min(MOST_SWITCHES, len(best.speed_cm_s))
    found, without = (respond(c, lot.rows(slice(n)), best.waveform) for c in (config, simple))
    own, other = (
        Design.of(r, judge(config, r), name=called, role=role, waveform=best.waveform)
        for called, role, r in (
            ("all modes" if kind == "modes" else "as simulated", "best", found),
            (name, "unshaped", without),
        )
    )
    peaks = found.mode_peak_um
    level = config.objective.level
    return Plainer(
        kind=kind,
        own=own,
        without=other,
        peaks_um=() if peaks is None else tuple(np.quantile(peaks[:, 1:], level, axis=0).tolist()),
    )
