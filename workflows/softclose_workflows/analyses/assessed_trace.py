"""Owns what a lot does under a drive that was recorded: on new switches, beside a campaign's best waveform."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from softclose.evaluate import judge
from softclose.evaluate.pieces import Mapper, here
from softclose.evaluate.quantities import Value
from softclose.evaluate.touching import contacts
from softclose.metrics.objective import Assessment, Judged
from softclose.metrics.paired import Comparison, compare
from softclose.settings import CampaignConfig, load_config
from softclose.switch.plate import pull_in_voltage
from softclose.waveform import Drive, Trace, WaveformError, is_above
from softclose_store import GroupArray, StoreMissingError, open_campaign, store_state, write_group
from softclose_workflows.analyses.certify import check_size, simulate_fresh
from softclose_workflows.analyses.chosen import Chosen, choose
from softclose_workflows.run import needs
from softclose_workflows.tell.console import OnStep
from softclose_workflows.tell.plain import finite

FOLDER = "traces"
"""Groups of a store that hold assessed drives."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AssessedTrace:
    """A recorded drive on new switches."""

    trace: Trace
    """What was applied."""
    response: Judged
    """V, closed and status of every switch."""
    assessment: Assessment
    """The campaign's objective of them."""
    seed: int
    """Seed of the new switches: those of a certificate of this seed."""
    best: Chosen | None
    """The campaign's best waveform; None where there is no campaign."""
    best_assessment: Assessment | None
    """The same of that waveform."""
    comparison: Comparison | None
    """The trace against it, switch by switch."""
    config: CampaignConfig
    """Lot and objective."""
    contacts: Mapping[str, Value] = field(default_factory=dict)
    """When the switches first touch, and how often they hit."""
    best_contacts: Mapping[str, Value] = field(default_factory=dict)
    """The same of the campaign's best waveform."""

    def to_json(self) -> dict[str, Any]:
        """Plain values."""
        plain: dict[str, Any] = finite(
            {
                "n_samples": len(self.trace.times_us),
                "max_volts": self.trace.max_voltage(self.config.model.horizon_us),
                "seed": self.seed,
                "assessment": self.assessment.to_dict(),
                "best_candidate": None if self.best is None else self.best.candidate,
                "best_assessment": None if self.best_assessment is None else self.best_assessment.to_dict(),
                "against_best": None if self.comparison is None else self.comparison.to_dict(),
            }
        )
        return plain


def assess_trace(
    source: str,
    trace: Trace,
    *,
    n_switches: int = 100_000,
    seed: int | None = None,
    mapper: Mapper = here,
    listener: OnStep | None = None,
    max_volts: float | None = None,
    scaled: bool = False,
) -> AssessedTrace:
    """Assess a drive on new switches of a lot.

    source: a store, whose best waveform runs on the same switches; or a preset or TOML file, for its lot and objective.
    Every switch gets the drive as it is, also where the campaign trims. max_volts: the highest voltage that the drive
    may reach, the campaign's where it is None; scaled: the caller has said what the record has to be multiplied by.
    Raises CertifyError for too few switches, WaveformError for a drive that is too high, or so low that it is none.
    """
    best = None
    if _is_store(source):
        best = choose(source)
        config = best.config
    else:
        config = load_config(source)
    check_size(config, n_switches, 1)
    needs.check_fresh(n_switches, 2)
    check_drive(trace, config, max_volts=max_volts, scaled=scaled)
    chosen_seed = seed if seed is not None else best.seed if best is not None else config.campaign.seed
    drives: list[Drive] = [trace] if best is None else [trace, best.waveform]
    judged = simulate_fresh(
        config, drives, n_switches=n_switches, seed=chosen_seed, for_everybody=[0], mapper=mapper, listener=listener
    )
    assessments = [judge(config, j, fresh=True) for j in judged]
    return AssessedTrace(
        trace=trace,
        response=judged[0],
        assessment=assessments[0],
        seed=chosen_seed,
        best=best,
        best_assessment=None if best is None else assessments[1],
        comparison=None
        if best is None
        else compare((judged[0], assessments[0]), (judged[1], assessments[1]), config.objective.confidence),
        config=config,
        contacts=contacts(config, judged[0], assessments[0], fresh=True),
        best_contacts={} if best is None else contacts(config, judged[1], assessments[1], fresh=True),
    )


def check_drive(trace: Trace, config: CampaignConfig, *, max_volts: float | None, scaled: bool) -> None:
    """Raise WaveformError for a record that no drive of this lot can be.

    Above what is allowed; or below half of the mean switch's pull-in voltage, where nothing closes: a monitor output,
    an amplifier's input, or another unit, unless the caller says `scaled`.
    """
    horizon = config.model.horizon_us
    peak = trace.max_voltage(horizon)
    allowed = config.waveform.max_volts if max_volts is None else max_volts
    if is_above(peak, allowed):
        raise WaveformError(
            f"the record reaches {peak:.6g} V within {horizon:g} µs; {allowed:g} V are allowed (waveform.max_volts). "
            f"Are its voltages in mV? If it is the drive, say --max-volts {math.ceil(peak)} (in Python max_volts)"
        )
    population = config.build_population()
    pull_in = float(pull_in_voltage(population.mean_switch, population.plate_area(config.model.plate_area_um2)))
    if not scaled and peak < 0.5 * pull_in:
        raise WaveformError(
            f"the record reaches {peak:.4g} V within {horizon:g} µs, and the mean switch pulls in at {pull_in:.4g} V: "
            "nothing would close. If it is a monitor output or an amplifier's input, say what it has to be multiplied "
            "by (--scale 1000, in Python scale=1000); a scale of 1 says that it is the drive"
        )


def keep(path: str, name: str, found: AssessedTrace) -> str:
    """Write an assessed drive into a store; gives the group's name. Raises StoreExistsError where there is one."""
    group = f"{FOLDER}/{name}"
    arrays = {
        "time": GroupArray(dims=("sample",), values=found.trace.times_us, unit="µs", long_name="instant"),
        "volts": GroupArray(dims=("sample",), values=found.trace.volts, unit="V", long_name="drive voltage"),
        "max_contact_speed": GroupArray(
            dims=("fresh_switch",), values=found.response.max_contact_speed, unit="µm/µs", long_name="V of Eq. 7"
        ),
        "closed": GroupArray(dims=("fresh_switch",), values=found.response.closed, long_name="held in contact"),
        "status": GroupArray(dims=("fresh_switch",), values=found.response.status, long_name="0: integrated"),
    }
    write_group(path, group, arrays, {"seed": found.seed, "assessment": finite(found.assessment.to_dict())})
    return group


def _is_store(source: str) -> bool:
    try:
        return store_state(source).kind not in ("absent", "unfinished") and bool(open_campaign(source))
    except StoreMissingError:
        return False
