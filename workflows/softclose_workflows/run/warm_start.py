"""Owns the start of a campaign from the candidates of another one's store."""

from __future__ import annotations

from softclose.propose.basins import distinct_basins
from softclose.propose.protocol import Observation, Problem
from softclose.settings import CampaignConfig, ConfigError
from softclose_store import open_campaign
from softclose_workflows.run import records


def warm_started(config: CampaignConfig) -> CampaignConfig:
    """The configuration with `waveform.initial` filled from the store that `waveform.initial_from` names.

    Taken are the best candidates that lie apart, of the largest ensemble first, as far as they are points of this
    search space within its limits. A configuration without `initial_from`, or filled already, is returned as it is.
    What is kept of the store's path is its name: the waveforms are what counts, from wherever it was read.
    Raises ConfigError where the store has no such candidate, a StoreError where it cannot be read.
    """
    w = config.waveform
    if not w.initial_from or w.initial:
        return config
    found = records.observations(open_campaign(w.initial_from).records())
    problem = Problem(config)
    usable = [o for o in found if o.usable and _fits(config, o)]
    most = max((o.n_switches for o in usable), default=0)
    regions = config.optimiser.n_regions if config.has_prior else 0  # each has a candidate of its own
    wanted = min(w.initial_count, config.campaign.budget - regions)
    chosen: list[Observation] = []
    for judged in ([o for o in usable if o.n_switches == most], [o for o in usable if o.n_switches < most]):
        chosen += distinct_basins(problem, judged, wanted - len(chosen), config.finish.distance)
    if not chosen:
        raise ConfigError(
            f"{w.initial_from} has no candidate to begin with: campaign.budget is {config.campaign.budget}, and "
            f"{len(usable)} of its {len(found)} candidates are within waveform.max_volts {w.max_volts:g}; leave "
            "waveform.initial_from out, or change these"
        )
    data = config.to_dict()
    data["waveform"]["initial_from"] = w.initial_from.rstrip("/").rpartition("/")[2]
    data["waveform"]["initial"] = [o.waveform.rows().tolist() for o in chosen]
    return CampaignConfig.from_dict(data)


def _fits(config: CampaignConfig, o: Observation) -> bool:
    try:
        o.waveform.check(config.waveform.max_volts, config.model.horizon_us, config.waveform.least_rise_us)
    except ValueError:
        return False
    return True
