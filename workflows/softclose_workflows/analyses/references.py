"""Owns the reference designs of a campaign: what every optimum must beat, and why one of them may be missing."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from softclose.device.protocol import ModelError
from softclose.evaluate.chain import chain_of
from softclose.evaluate.pieces import Mapper, Sent, Work, here, respond_to_all
from softclose.metrics.objective import Assessment, Judged
from softclose.metrics.ranking import is_beyond
from softclose.plugins import REDUCED_ORDER, SINGLE_MODE
from softclose.population.lot import Lot
from softclose.settings import CampaignConfig
from softclose.waveform import Waveform
from softclose_workflows.tell.labels import in_percent

UNSHAPED = "unshaped"
DETERMINISTIC = "deterministic"
REFERENCES = {
    UNSHAPED: "the drive voltage is switched on at once and held",
    DETERMINISTIC: "it closes the mean switch without impact and takes no account of the spread of the lot",
}
"""What each reference design is, in words."""


@dataclass(frozen=True, slots=True, kw_only=True)
class References:
    """The reference designs within a campaign's limits."""

    designs: dict[str, Waveform]
    """By name."""
    missing: dict[str, str] = field(default_factory=dict)
    """Those that cannot be had, and why, in one sentence."""


def reference_designs(config: CampaignConfig) -> References:
    """The unshaped step, at `reference.step_volts`, and the deterministic design where the limits allow one: as fast
    as `waveform.min_rise_us` lets it rise. It is designed in the campaign's device model, its amplifier aside; a model
    of somebody else's may be costly, and gets that of an ideal plate."""
    from softclose.baselines import BaselineError, deterministic_design, unshaped

    designs, missing = {UNSHAPED: unshaped(config.reference.step_volts)}, {}
    try:
        designs[DETERMINISTIC] = deterministic_design(
            config.build_population(),
            max_volts=config.waveform.max_volts,
            plate_area_um2=config.model.plate_area_um2,
            horizon_us=config.model.horizon_us,
            rise_us=config.waveform.min_rise_us,
            device=chain_of(config).device if config.model.name in (SINGLE_MODE, REDUCED_ORDER) else None,
        )
    except BaselineError as e:
        missing[DETERMINISTIC] = str(e)
    return References(designs=designs, missing=missing)


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedReferences:
    """The reference designs on given switches."""

    responses: dict[str, tuple[Waveform, Judged]]
    """Each with what the switches did."""
    missing: dict[str, str]
    """Those that there is nothing to show of, and why."""


def simulate_references(config: CampaignConfig, lot: Lot, mapper: Mapper = here) -> SimulatedReferences:
    """What a lot does under the reference designs; without the campaign's device model all are missing.

    Reference designs are what a lot is driven with today: nothing is tailored to a switch.
    """
    references, sent = reference_designs(config), Sent(config)
    works = [Work(sent=sent, lot=lot, drive=u, for_everybody=True) for u in references.designs.values()]
    try:
        found = zip(references.designs.items(), respond_to_all(works, mapper), strict=True)
        responses = {name: (u, response) for (name, u), response in found}
    except ModelError as e:
        return SimulatedReferences(responses={}, missing=dict.fromkeys(references.designs, str(e)) | references.missing)
    return SimulatedReferences(responses=responses, missing=references.missing)


def beaten_lines(best: Assessment, references: Mapping[str, Assessment]) -> list[str]:
    """One line for people for each reference design that ranks before the best candidate, and one where it is slow.

    references: by name, on the same switches. A reference competes: what a search finds should beat it.
    """

    def compared(a: Assessment) -> str:
        if is_beyond(best.rank_cm_s):
            return f"{in_percent(a.p_nc, 1)} of the switches open against {in_percent(best.p_nc, 1)}"
        return f"g {a.g_cm_s:.2f} against {best.g_cm_s:.2f} cm/s on the same switches"

    lines = [
        f"the {name} design is better than the best candidate ({compared(a)}): give the search more candidates "
        "(resume --budget), or widen its space and limits"
        for name, a in references.items()
        if a.rank_cm_s < best.rank_cm_s
    ]
    step = references.get("unshaped")
    return [*lines, *(slow_lines(best, step) if step is not None else [])]


SLOW = 4.0
"""A drive that takes so many times a step's closing time is a slow ramp: nobody asked it to be quick."""


def slow_lines(best: Assessment, step: Assessment) -> list[str]:
    """What to ask for where the best candidate is a slow ramp and nothing says until when switches must be closed."""
    if best.closed_by_us or not SLOW * step.closing_us < best.closing_us < math.inf:
        return []
    limit = 0.5 * (best.closing_us + step.closing_us)
    return [
        f"the best candidate takes {best.closing_us:.3g} µs to close, a step {step.closing_us:.3g}: where that is too "
        f"slow, say until when a switch must be closed and search again (such as objective.closed_by_us={limit:.0f})"
    ]


def missing_lines(missing: Mapping[str, str]) -> list[str]:
    """One line for people for each reference design that is missing."""
    return [f"no {name} design to compare with: {why}" for name, why in missing.items()]
