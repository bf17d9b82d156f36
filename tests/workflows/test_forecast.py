"""Claims about the forecast of a campaign: what its prior takes, and how a switch is timed."""

from __future__ import annotations

from pathlib import Path

import pytest

from softclose.propose.prior import Prior
from softclose.propose.promises import PriorValues
from softclose.settings import load_config
from softclose_store import DriverStore, open_campaign
from softclose_workflows.analyses import forecast as module
from softclose_workflows.analyses.forecast import prior_trajectories
from softclose_workflows.run.campaign import Driver
from softclose_workflows.run.creation import create_store
from softclose_workflows.run.executors.serial import SerialExecutor
from test_prior_at_work import SETTINGS


def test_trajectories_on_the_prior_are_those_that_the_campaign_takes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = load_config("current", SETTINGS)
    asked: list[int] = []
    values = Prior.values

    def counting(self: Prior, waveforms: list[object], n_switches: int | None = None) -> PriorValues:
        asked.append(len(waveforms) * (n_switches or len(self.lot)))
        return values(self, waveforms, n_switches)

    monkeypatch.setattr(Prior, "values", counting)
    path = tmp_path / "a.zarr"
    create_store(config, str(path))
    with DriverStore(path) as store:
        Driver(store, SerialExecutor()).run()
    assert open_campaign(path).finished
    assert prior_trajectories(config) == sum(asked)
    assert prior_trajectories(load_config("current", [*SETTINGS, "prior.model=none"])) == 0


def test_a_switch_is_timed_until_the_clock_can_tell(monkeypatch: pytest.MonkeyPatch) -> None:
    now, asked = [0.0], list[int]()
    monkeypatch.setattr(module.time, "perf_counter", lambda: now[0])

    def simulate(n: int, each: float) -> None:
        asked.append(n)
        now[0] += each * n + (30.0 if len(asked) == 1 else 0.0)

    assert module.time_of_one(lambda n: simulate(n, 1e-3), 2048) == pytest.approx(1e-3)
    assert asked == [1, 2, 4, 8, 16, 32, 64, 128, 256]
    asked.clear()
    assert module.time_of_one(lambda n: simulate(n, 1.0), 2048) == pytest.approx(1.0)
    assert asked == [1, 2], "a costly simulator is asked for no more than it takes"
