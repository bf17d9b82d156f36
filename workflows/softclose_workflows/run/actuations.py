"""Owns the actuations by which a trim learns what each switch is like, kept with their motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from softclose.evaluate.pieces import Mapper, Sent, here
from softclose.evaluate.realise import actuations, n_actuations
from softclose.plugins import MEASURED
from softclose.settings import CampaignConfig
from softclose_store import GroupArray, open_campaign
from softclose_workflows.run.tasks import times_us
from softclose_workflows.run.trajectories import GROUP, Keeper, has_group, motion_of, outputs_of, rows_of_parts

NAME = f"{GROUP}/actuations"
"""The group that holds them."""

MOST_ROWS = 2_000
"""Switches that are actuated at once."""


def are_kept(config: CampaignConfig) -> bool:
    """Whether the campaign has actuations that are kept."""
    return config.store.trials and config.model.name != MEASURED and n_actuations(config) > 0


def keep_actuations(path: str, config: CampaignConfig, *, mapper: Mapper = here) -> None:
    """Simulate the actuations of the training ensemble as the lot's creation did, and keep their motion.

    A pure function of the campaign; nothing is done where they are there, or where there are none.
    """
    if are_kept(config) and not has_group(path, NAME):
        _keep(path, config, mapper)


def actuated_again(path: str) -> str:
    """Keep the actuations of a store's campaign again. Returns why not; empty where it is done."""
    config = CampaignConfig.from_dict(open_campaign(path).config)
    if not are_kept(config):
        return f"{NAME} of {path} belongs to no actuations that this campaign keeps: delete that group"
    _keep(path, config, here)
    return ""


def _keep(path: str, config: CampaignConfig, mapper: Mapper) -> None:
    n, n_made, times = config.n_switches_max, n_actuations(config), times_us(config)
    rows = rows_of_parts(config, n, most=MOST_ROWS, motions=n_made)
    keeper = Keeper.of(
        config, path, NAME, {"actuation": n_made, "switch": rows}, n_cases=1, time="time", n_times=len(times)
    )
    sent = Sent(config)
    pieces = [_Actuated(sent, keeper, k, range(i, min(i + rows, n))) for k, i in enumerate(range(0, n, rows))]
    files: dict[str, str] = {}
    volts, first = [], []
    for found in mapper(_actuate, pieces):
        files |= found.files
        volts.append(found.volts)
        first.append(found.first_contact_us)
    columns = ("actuation", "switch")
    keeper.finish(
        config,
        (n_made, n),
        files,
        {
            "actuation": GroupArray(
                dims=("actuation",), values=np.arange(n_made), long_name="in order; the last is the one that is timed"
            ),
            "switch": GroupArray(dims=("switch",), values=np.arange(n), long_name="index of the switch"),
            "time": GroupArray(dims=("time",), values=times, unit="µs", long_name="since the step starts"),
            "volts": GroupArray(
                dims=columns, values=np.concatenate(volts, axis=1), unit="V", long_name="step of each switch"
            ),
            "first_contact": GroupArray(
                dims=columns, values=np.concatenate(first, axis=1), unit="µs", long_name="first contact; inf: never"
            ),
        },
        {"seed": config.campaign.seed, "sampling": config.population.sampling},
    )


@dataclass(frozen=True, slots=True)
class _Actuated:
    """Rows of the ensemble that are actuated."""

    sent: Sent
    keeper: Keeper
    part: int
    rows: range


@dataclass(frozen=True, slots=True)
class _Made:
    """What is said of them; everything else went to the store."""

    files: dict[str, str]
    volts: NDArray[np.float64]
    """(actuation, switch) [V]."""
    first_contact_us: NDArray[np.float64]
    """(actuation, switch) [µs]."""


def _actuate(piece: _Actuated) -> _Made:
    config, rows = piece.sent.config, piece.rows
    made = actuations(
        config,
        len(rows),
        seed=config.campaign.seed,
        sampling=config.population.sampling,
        start=rows.start,
        times_us=times_us(config),
        **outputs_of(config),
    )
    each = [motion_of(config, [a.response]) for a in made]
    motion = {name: np.stack([m[name] for m in each]) for name in each[0]}
    return _Made(
        files=piece.keeper.keep((0, piece.part), motion),
        volts=np.stack([a.volts for a in made]),
        first_contact_us=np.stack([a.response.first_contact_us for a in made]),
    )
