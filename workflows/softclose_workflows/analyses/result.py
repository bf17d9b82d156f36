"""Owns the table at the end of a run: the best waveform beside reference designs on the same switches."""

from __future__ import annotations

from softclose.evaluate.touching import contacts
from softclose.metrics.open_kinds import open_kinds
from softclose.population.lot import Lot
from softclose.settings import CampaignConfig
from softclose.waveform import Waveform
from softclose_store import open_campaign
from softclose_workflows.analyses.hold import Held, hold_warning, holds_on
from softclose_workflows.analyses.opening import opening_words
from softclose_workflows.analyses.references import beaten_lines, missing_lines, simulate_references
from softclose_workflows.errors import Stopped
from softclose_workflows.run.controlled import judge_as
from softclose_workflows.run.opening import read_opening
from softclose_workflows.run.records import assessment_record, value_record
from softclose_workflows.tell.plain import waveform_rows
from softclose_workflows.tell.standing import read_standing
from softclose_workflows.tell.tables import interval_kinds, print_designs, trouble_lines


def print_result(path: str) -> None:
    """The best candidate of the store against the unshaped step, each number with its interval.

    Raises Stopped where no candidate has a result.
    """
    campaign = open_campaign(path)
    config = CampaignConfig.from_dict(campaign.config)
    best = campaign.best()
    if best is None:
        standing = read_standing(path)
        raise Stopped(
            f"none of its {standing.committed} candidates could be assessed; first reason: {standing.reason}; where "
            f"that is mended: softclose resume {path} --retry-failed"
        )
    switches = Lot(campaign.population()).rows(slice(best.n_switches))
    record = {name: values[best.candidate] for name, values in campaign.records().items()}
    response = campaign.responses(best.candidate)
    found = judge_as(campaign, Waveform.from_rows(best.waveform), response)
    kind = interval_kinds(config.objective.confidence, best.n_switches, config.population.sampling).removesuffix(".")
    references = simulate_references(config, switches)
    judged = {
        name: (design, r, judge_as(campaign, design, r, for_everybody=True))
        for name, (design, r) in references.responses.items()
    }
    print_designs(
        f"{config.campaign.name}: {campaign.committed:,} candidates, {best.n_switches:,} switches",
        [
            *(
                (name, waveform_rows(design.rows()), assessment_record(a, contacts(config, r, a)))
                for name, (design, r, a) in judged.items()
            ),
            (
                f"best (candidate {best.candidate})",
                waveform_rows(best.waveform),
                value_record(contacts(config, response, found)) | record,
            ),
        ],
        f"{kind}; training scores are optimistic: run `softclose certify`",
    )
    said = [found.limit.sentence] if found.limit is not None else []
    said = [open_kinds(response, found.closed_by_us).sentence, *said]
    drive = Waveform.from_rows(best.waveform)
    held = Held(name=f"candidate {best.candidate}", waveform=drive)
    holds = holds_on(config, switches, [held], has_interval=False)
    said = [*filter(None, [found.open_warning, hold_warning(holds)]), *said]
    beaten = beaten_lines(found, {name: a for name, (_, _, a) in judged.items()})
    for line in [*said, *beaten, *missing_lines(references.missing), *trouble_lines(read_standing(path))]:
        print(line)
    openings = read_opening(path, best.candidate)
    if openings is not None:
        print(f"let go at {openings.at_us:g} µs: {opening_words(openings)}")
    print(f"store: {path}")
