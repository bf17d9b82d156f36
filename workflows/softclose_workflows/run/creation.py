"""Owns the creation of a campaign's store: population, layout and identity, from the configuration alone."""

from __future__ import annotations

import numpy as np

from softclose import ALGORITHM
from softclose.arrays import FloatArray
from softclose.evaluate import combinations, draw
from softclose.evaluate.asked import asked
from softclose.evaluate.chain import chain_of, device_of
from softclose.metrics.replicates import REPLICATES
from softclose.plugins import MEASURED
from softclose.population.lot import COLUMNS, Lot
from softclose.propose.plan import plan
from softclose.propose.protocol import Problem
from softclose.settings import CampaignConfig
from softclose.switch.plate import EPSILON_0, V_STICK
from softclose.waveform.spaces import SPACES
from softclose_store import CaseColumn, Constant, Layout, PopulationColumn, StoreError, create_campaign
from softclose_workflows.run.blocks import stage_layouts
from softclose_workflows.run.controlled import GAIN, GAIN_IN_WORDS
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
            constants=constants_of(config),
            runtime=runtime(),
            exist_ok=True,
        )
    except OSError as e:
        raise StoreError(f"no store can be created at {path}: {e.strerror or e}; give a writable path") from e


def lot_of(config: CampaignConfig) -> Lot:
    """The campaign's whole ensemble, with everything that its conditions add to it."""
    return draw(config, config.n_switches_max, seed=config.campaign.seed, sampling=config.population.sampling)


def population_columns(config: CampaignConfig) -> dict[str, FloatArray]:
    """The columns of the campaign's ensemble as they are stored, (n_switches_max,) each."""
    lot = _numbered(config, lot_of(config))
    return {name: lot[name] for name in lot}


def column_names(config: CampaignConfig) -> tuple[PopulationColumn, ...]:
    """What the columns of the campaign's ensemble are."""
    few = _numbered(config, draw(config, 2, seed=config.campaign.seed))
    return tuple(PopulationColumn(name, COLUMNS[name].unit, COLUMNS[name].long_name) for name in few)


def _numbered(config: CampaignConfig, lot: Lot) -> Lot:
    """The lot with the scrambling of each switch, where it is drawn in several: a reader's intervals rest on it."""
    if config.population.sampling != "replicated":
        return lot
    return lot.with_columns(replicate=np.arange(len(lot)) % REPLICATES)


def constants_of(config: CampaignConfig) -> dict[str, Constant]:
    """What all switches of a campaign share, for readers of its store who have nothing else."""
    device = device_of(config)
    return {
        "epsilon_0": Constant(EPSILON_0, "F/m", "permittivity of the gap"),
        "plate_area": Constant(device.plate_area_um2, "µm²", "area of the plate"),
        "restitution": Constant(device.restitution, "1", "coefficient of restitution"),
        "v_stick": Constant(V_STICK, "µm/µs", "speed of a rebound below which a pressed switch stays closed"),
        "horizon": Constant(device.horizon_us, "µs", "end of the simulated time"),
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
        columns=column_names(config),
        cases=case_columns(config),
        n_modes=config.n_modes,
        asked=tuple(PopulationColumn(q.name, q.unit, q.long_name) for q in asked(config)),
        told=(PopulationColumn(GAIN, "1", GAIN_IN_WORDS),) if config.prior.control else (),
    )


def case_columns(config: CampaignConfig) -> tuple[CaseColumn, ...]:
    """What tells the cases apart in which every switch is simulated; () where there is one, or devices are measured."""
    cases = combinations(chain_of(config)) if config.model.name != MEASURED else [()]
    each = [dict(place for case in chosen for place in case.at) for chosen in cases]
    return tuple(
        CaseColumn(name, COLUMNS[name].unit, "in this case", tuple(values[name] for values in each)) for name in each[0]
    )
