"""Owns the creation of a campaign's store: population, layout and identity, from the configuration alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from softclose import ALGORITHM
from softclose.arrays import FloatArray
from softclose.evaluate import combinations
from softclose.evaluate.asked import asked
from softclose.evaluate.chain import chain_of, device_of
from softclose.evaluate.realise import column_names as names_of_lot
from softclose.evaluate.realise import draw_after
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

REPLICATE = "replicate"
"""The column that says which scrambling a switch is of."""


def create_store(config: CampaignConfig, path: str, contacts: Sequence[FloatArray] = ()) -> None:
    """Create the store of a campaign, or accept the one that is there if it holds this very campaign.

    contacts: (n_switches_max,) first contacts of each actuation that a trim learns from, where they have been made.
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
            population=lambda: population_columns(config, contacts),
            constants=constants_of(config),
            runtime=runtime(),
            exist_ok=True,
        )
    except OSError as e:
        raise StoreError(f"no store can be created at {path}: {e.strerror or e}; give a writable path") from e


def lot_of(config: CampaignConfig, contacts: Sequence[FloatArray] = ()) -> Lot:
    """The campaign's whole ensemble, with everything that its conditions add to it."""
    n, seed, sampling = config.n_switches_max, config.campaign.seed, config.population.sampling
    return draw_after(config, n, contacts, seed=seed, sampling=sampling)


def population_columns(config: CampaignConfig, contacts: Sequence[FloatArray] = ()) -> dict[str, FloatArray]:
    """The columns of the campaign's ensemble as they are stored, (n_switches_max,) each."""
    lot = lot_of(config, contacts)
    return {name: lot[name] for name in lot} | (
        # A reader's intervals rest on which scrambling a switch is of.
        {REPLICATE: np.arange(len(lot), dtype=np.float64) % REPLICATES} if _is_replicated(config) else {}
    )


def column_names(config: CampaignConfig) -> tuple[PopulationColumn, ...]:
    """What the columns of the campaign's ensemble are."""
    names = (*names_of_lot(config), *([REPLICATE] if _is_replicated(config) else []))
    return tuple(PopulationColumn(name, COLUMNS[name].unit, COLUMNS[name].long_name) for name in names)


def _is_replicated(config: CampaignConfig) -> bool:
    return config.population.sampling == "replicated"


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
