"""Owns the creation of a campaign's store: population, layout and identity, from the configuration alone."""

from __future__ import annotations

import numpy as np

from softclose import ALGORITHM
from softclose.conditions.trim import N_SCALES
from softclose.evaluate import N_PARAMETERS, draw
from softclose.propose.plan import plan
from softclose.propose.protocol import Problem
from softclose.settings import CampaignConfig
from softclose.waveform import FloatArray
from softclose.waveform.spaces import SPACES
from softclose_store import Layout, StoreError, create_campaign
from softclose_workflows.run.blocks import stage_layouts
from softclose_workflows.run.runtime import runtime
from softclose_workflows.run.tasks import times_us


def create_store(config: CampaignConfig, path: str) -> None:
    """Create the store of a campaign, or accept the one that is there if it holds this very campaign.

    Raises a StoreError where the store holds something else, and names what differs.
    """
    try:
        create_campaign(
            path,
            layout=layout_of(config),
            config=config.to_dict(),
            fingerprint=config.fingerprint(),
            algorithm=ALGORITHM,
            durable=config.store.durable,
            population=population_columns(config),
            runtime=runtime(),
            exist_ok=True,
        )
    except OSError as e:
        raise StoreError(f"no store can be created at {path}: {e.strerror or e}; give a writable path") from e


def population_columns(config: CampaignConfig) -> dict[str, FloatArray]:
    """The campaign's whole ensemble: columns D, G, E, T, K, M and the scales of the drives, (n_switches_max,) each.

    E and T are NaN where K and M follow from something else.
    """
    n, seed, sampling = config.n_switches_max, config.campaign.seed, config.population.sampling
    population = config.build_population()
    parameters = population.sample_parameters(n, seed=seed, sampling=sampling)
    plate = parameters[:, 2:] if population.law.variables == ("E", "T") else np.full((n, 2), np.nan)
    lot = draw(config, n, seed=seed, sampling=sampling)
    scales = lot[:, N_PARAMETERS:] if lot.shape[1] > N_PARAMETERS else np.ones((n, N_SCALES))
    return {
        "D": lot[:, 0],
        "G": lot[:, 1],
        "E": plate[:, 0],
        "T": plate[:, 1],
        "K": lot[:, 2],
        "M": lot[:, 3],
        "voltage_scale": scales[:, 0],
        "time_scale": scales[:, 1],
    }


def layout_of(config: CampaignConfig) -> Layout:
    """Sizes of a campaign's arrays."""
    n_pulses, _ = SPACES[config.waveform.space]
    longest = max([n_pulses, *(len(rows) for rows in config.waveform.initial)])
    return Layout(
        stages=stage_layouts(config, plan(Problem(config))),
        times_us=times_us(config),
        max_impacts=config.store.max_impacts,
        n_pulses=longest,
        limits_cm_s=config.objective.limits_cm_s,
    )
