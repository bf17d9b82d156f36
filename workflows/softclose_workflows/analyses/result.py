"""Owns the table at the end of a run: the best waveform beside reference designs on the same switches."""

from __future__ import annotations

from softclose.config import CampaignConfig
from softclose.evaluate import evaluate
from softclose_store import open_campaign
from softclose_workflows.analyses.certify import reference_designs
from softclose_workflows.run.records import assessment_record
from softclose_workflows.tell.plain import waveform_rows
from softclose_workflows.tell.tables import print_designs


def print_result(path: str) -> None:
    """The best candidate of the store against the unshaped step, each number with its interval."""
    campaign = open_campaign(path)
    config = CampaignConfig.from_dict(campaign.config)
    best = campaign.best()
    if best is None:
        print("no candidate could be assessed")
        return
    switches = campaign.switches()[: best.n_switches]
    record = {name: values[best.candidate] for name, values in campaign.records().items()}
    interval = f"{config.objective.confidence:.0%}"
    kind = (
        f"{interval} intervals in brackets"
        if config.population.sampling == "monte-carlo"
        else "quasi-random sample: the bracketed intervals do not hold"
    )
    print_designs(
        f"{config.campaign.name}: {campaign.committed} candidates, {best.n_switches} switches",
        [
            *(
                (name, waveform_rows(design.rows()), assessment_record(evaluate(config, switches, design)))
                for name, design in reference_designs(config).items()
            ),
            (f"best (candidate {best.candidate})", waveform_rows(best.waveform), record),
        ],
        f"{kind}; training ensemble: an optimum flatters itself on the switches it was chosen on",
    )
    print(f"store: {path}")
