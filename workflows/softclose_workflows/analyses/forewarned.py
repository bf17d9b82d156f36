"""Owns what can be said of a campaign before it runs: limits that the lot, or the model, may not bear."""

from __future__ import annotations

import numpy as np

from softclose.arrays import FloatArray
from softclose.device.told import sobol_switches
from softclose.evaluate.chain import chain_of
from softclose.plugins import REDUCED_ORDER, SINGLE_MODE
from softclose.settings import CampaignConfig
from softclose.switch.collapse import collapse_voltage
from softclose.waveform import MIN_RISE_US

_N = 4096
"""Switches drawn to estimate a share of the lot; a power of 2, as Sobol points like it."""


def forewarnings(config: CampaignConfig) -> list[str]:
    """One sentence for each thing that a person should know before the campaign runs."""
    if config.model.name not in (REDUCED_ORDER, SINGLE_MODE):
        return []  # another model may have no statics
    switches = sobol_switches(config.build_population(), chain_of(config).device, _N)
    if config.model.name == REDUCED_ORDER:
        return [
            *_ringing(config),
            *_collapse(config, switches),
            *_table(config, switches),
            *_low_limit(config, switches),
        ]
    return [*_fast_edges(config.waveform.min_rise_us), *_low_limit(config, switches)]


def _fast_edges(rise_us: float) -> list[str]:
    if rise_us >= MIN_RISE_US:
        return []
    return [
        f"waveform.min_rise_us is {rise_us:g} µs: edges that fast may excite modes that Eqs. 1-2 leave out (the paper "
        f"keeps {MIN_RISE_US:g} µs for its plate, whose modes are at 20 and 70 kHz); make sure that your device's "
        "second mode allows it"
    ]


def _ringing(config: CampaignConfig) -> list[str]:
    rise, least = config.waveform.min_rise_us, config.build_reduced_order().least_rise_us
    if rise >= least:
        return []
    return [
        f"waveform.min_rise_us is {rise:g} µs: only from {least:.3g} µs on an edge leaves at most a tenth of a step's "
        "ringing in the second mode; the search sees that mode, so a shorter one is no mistake"
    ]


def _collapse(config: CampaignConfig, switches: FloatArray) -> list[str]:
    limit = config.waveform.max_volts
    volts = collapse_voltage(switches, config.build_reduced_order(), config.model.plate_area_um2)
    share = float((volts < limit).mean())
    if share == 0.0:
        return []
    return [
        f"waveform.max_volts is {limit:g} V, and a closed switch of {_percent(share)} of the lot is pulled on, behind "
        f"its contact, until its electrode collapses, from {volts.min():.1f} V on (median {np.median(volts):.1f} V): "
        "such switches end with the status 2; hold lower, or check contact and electrode of the modes"
    ]


def _table(config: CampaignConfig, switches: FloatArray) -> list[str]:
    modes = config.build_reduced_order()
    if modes.capacitance is None:
        return []
    unit = modes.mode[0].electrode / modes.mode[0].contact
    deepest = float((unit * switches[:, 0] / switches[:, 1]).max()) * modes.capacitance.gap_um
    begins = float(modes.capacitance.slope()[0][0])
    if begins <= -deepest:
        return []
    key = "valid_um" if modes.capacitance.polynomial_fF else "travel_um"
    return [
        f"the capacitance is known from {begins:g} µm on ([capacitance] {key}), and a switch that is let go swings "
        f"back to {-deepest:.3g} µm: switches that leave it end with the status 3; give it from there on"
    ]


def _low_limit(config: CampaignConfig, switches: FloatArray) -> list[str]:
    limit = config.waveform.max_volts
    volts = chain_of(config).device.closing_voltage(switches)
    share = float((volts > limit).mean())
    if share == 0.0:
        return []
    return [
        f"waveform.max_volts is {limit:g} V, below the pull-in voltage of {_percent(share)} of the lot "
        f"(median {np.median(volts):.0f} V, up to {volts.max():.0f} V): such switches close only by swinging, if at all"
    ]


def _percent(share: float) -> str:
    if share > 0.999:
        return "all" if share == 1.0 else "more than 99.9 %"
    return f"{100.0 * share:.1f} %" if share > 0.001 else "less than 0.1 %"
