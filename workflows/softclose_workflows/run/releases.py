"""Owns the releases that were tried for a candidate, without a brake and with each: kept with their motion."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from softclose.opening import (
    LOOKS,
    TOO_HIGH,
    WATCHED,
    Trial,
    Tried,
    assess_opening,
    cost_of,
    joined,
    looks_us,
    watched,
)
from softclose.settings import CampaignConfig
from softclose.waveform import Waveform
from softclose_store import GroupArray
from softclose_workflows.run.records import padded_rows, parameters
from softclose_workflows.run.trajectories import GROUP, Keeper, motion_of, rows_of_parts

_NAME = re.compile(rf"{GROUP}/release-(\d+)")


def name_of(candidate: int) -> str:
    """The group of the releases tried for a candidate."""
    return f"{GROUP}/release-{candidate}"


def candidate_of(group: str) -> int | None:
    """The inverse of `name_of`; None for a group of another kind."""
    match = _NAME.fullmatch(group)
    return int(match[1]) if match else None


def looks_of(config: CampaignConfig) -> NDArray[np.int64]:
    """Which of the instants at which a release is watched are kept: `store.n_times` of them, or all."""
    return np.unique(np.round(np.linspace(0, LOOKS, min(config.store.n_times, LOOKS + 1))).astype(np.int64))


@dataclass(frozen=True, slots=True)
class KeptTrial:
    """Tries a waveform in whichever process, and keeps its motion."""

    keeper: Keeper
    rows: int
    """Switches in a part."""

    def __call__(self, trial: Trial) -> Tried:
        """As `softclose.opening.tried`."""
        config, lot, looks = trial.sent.config, trial.lot, looks_of(trial.sent.config)
        files: dict[str, str] = {}
        released = []
        for part, start in enumerate(range(0, len(lot), self.rows)):
            rows = lot.rows(slice(start, start + self.rows))
            if trial.is_allowed:
                found, each = watched(config, rows, trial.waveform, trial.at_us, further_modes=config.n_modes > 1)
                released.append(found)
                motion = motion_of(config, each, looks)
            else:
                motion = self.keeper.nothing(len(rows))
            files |= self.keeper.keep((trial.number, part), motion)
        return Tried(cost_of(assess_opening(config, joined(released))) if released else TOO_HIGH, files)


class Releases:
    """The releases tried for a candidate, on the way into the store."""

    def __init__(self, path: str, config: CampaignConfig, candidate: int, n_switches: int) -> None:
        self._config, self._candidate, self._n = config, candidate, n_switches
        rows = rows_of_parts(config, n_switches, most=WATCHED, motions=config.n_cases)
        self._keeper = Keeper.of(
            config,
            path,
            name_of(candidate),
            {"trial": 1, "switch": rows},
            n_cases=config.n_cases,
            time="release_time",
            n_times=len(looks_of(config)),
        )
        self.attempt = KeptTrial(self._keeper, rows)
        """Of `design_brake`."""
        self._waveforms: list[Waveform] = []
        self._costs: list[float] = []
        self._files: dict[str, str] = {}

    def told(self, trial: Trial, found: Tried) -> None:
        """Of `design_brake`."""
        self._waveforms.append(trial.waveform)
        self._costs.append(found.cost)
        self._files |= found.kept

    def finish(self) -> None:
        """All of them are tried."""
        n, config = len(self._costs), self._config
        self._keeper.finish(
            config,
            (n, self._n),
            self._files,
            {
                "trial": GroupArray(dims=("trial",), values=np.arange(n), long_name="in order; 0: without a brake"),
                "switch": GroupArray(dims=("switch",), values=np.arange(self._n), long_name="index of the switch"),
                "release_time": GroupArray(
                    dims=("release_time",),
                    values=looks_us(config)[looks_of(config)],
                    unit="µs",
                    long_name="since the begin of the fall",
                ),
                "parameter": parameters(),
                "release_waveform": GroupArray(
                    dims=("trial", "release_pulse", "parameter"),
                    values=padded_rows(self._waveforms),
                    unit="µs or V",
                    long_name="start, rise, peak, volts of the whole drive; rows of NaN are absent",
                ),
                "cost": GroupArray(
                    dims=("trial",),
                    values=np.array(self._costs),
                    long_name="what the brake is chosen by: overshoot, and what touches again or stays",
                ),
            },
            {"candidate": self._candidate, "release_us": config.opening.release_us},
        )
