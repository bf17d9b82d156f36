"""Owns the actuations by which a trim learns what each switch is like, kept with their motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

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


MOST_HELD_BYTES = 2.56e8
"""Motion that is held between a lot's drawing and its store's creation. What is more is simulated twice instead: of a
lot so large a trajectory is cheap."""


def are_kept(config: CampaignConfig) -> bool:
    """Whether the campaign has actuations that are kept."""
    return config.store.trials and config.model.name != MEASURED and n_actuations(config) > 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Actuated:
    """The actuations of a part of the ensemble."""

    volts: NDArray[np.float64]
    """(actuation, switch) [V]."""
    first_contact_us: NDArray[np.float64]
    """(actuation, switch) [µs]."""
    motion: dict[str, NDArray[Any]]
    """(actuation, switch, …, time) each."""


def actuate_lot(config: CampaignConfig, *, mapper: Mapper = here) -> list[Actuated]:
    """The actuations of the training ensemble, part by part, before there is a store that could keep them.

    [] where none are kept, or where their motion is more than is held.
    """
    if not are_kept(config):
        return []
    a_motion = 8.0 * config.store.n_times * config.n_modes
    if a_motion * n_actuations(config) * config.n_switches_max > MOST_HELD_BYTES:
        return []
    sent = Sent(config)
    return list(mapper(_actuate, [_Piece(sent, rows) for rows in _parts(config)]))


def contacts_of(made: Sequence[Actuated]) -> list[NDArray[np.float64]]:
    """(n_switches,) first contacts [µs] of each actuation of the whole ensemble; [] of nothing."""
    return list(np.concatenate([part.first_contact_us for part in made], axis=1)) if made else []


def keep_actuations(path: str, config: CampaignConfig, *, mapper: Mapper = here, made: Sequence[Actuated] = ()) -> None:
    """Keep the motion of the actuations of the training ensemble, which are simulated again where they are not given.

    A pure function of the campaign; nothing is done where they are there, or where there are none.
    made: what `actuate_lot` has simulated.
    """
    if are_kept(config) and not has_group(path, NAME):
        _keep(path, config, mapper, made)


def actuated_again(path: str) -> str:
    """Keep the actuations of a store's campaign again. Returns why not; empty where it is done."""
    config = CampaignConfig.from_dict(open_campaign(path).config)
    if not are_kept(config):
        return f"{NAME} of {path} belongs to no actuations that this campaign keeps: delete that group"
    _keep(path, config, here)
    return ""


def _parts(config: CampaignConfig) -> list[range]:
    """The rows of each part."""
    n = config.n_switches_max
    rows = rows_of_parts(config, n, most=MOST_ROWS, motions=n_actuations(config))
    return [range(i, min(i + rows, n)) for i in range(0, n, rows)]


def _keep(path: str, config: CampaignConfig, mapper: Mapper, made: Sequence[Actuated] = ()) -> None:
    n, n_made, times, parts = config.n_switches_max, n_actuations(config), times_us(config), _parts(config)
    rows = len(parts[0])
    keeper = Keeper.of(
        config, path, NAME, {"actuation": n_made, "switch": rows}, n_cases=1, time="time", n_times=len(times)
    )
    sent = Sent(config)
    files: dict[str, str] = {}
    volts, first = [], []
    kept = (
        (_kept(keeper, k, part) for k, part in enumerate(made))
        if made
        else mapper(_actuate_and_keep, [_Kept(sent, keeper, k, own) for k, own in enumerate(parts)])
    )
    for found in kept:
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
class _Piece:
    """Rows of the ensemble that are actuated."""

    sent: Sent
    rows: range


@dataclass(frozen=True, slots=True)
class _Kept:
    """Rows of the ensemble that are actuated, and whose motion is kept where they are."""

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


def _actuate(piece: _Piece) -> Actuated:
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
    return Actuated(
        motion={name: np.stack([m[name] for m in each]) for name in each[0]},
        volts=np.stack([a.volts for a in made]),
        first_contact_us=np.stack([a.response.first_contact_us for a in made]),
    )


def _actuate_and_keep(piece: _Kept) -> _Made:
    return _kept(piece.keeper, piece.part, _actuate(_Piece(piece.sent, piece.rows)))


def _kept(keeper: Keeper, part: int, made: Actuated) -> _Made:
    return _Made(files=keeper.keep((0, part), made.motion), volts=made.volts, first_contact_us=made.first_contact_us)
