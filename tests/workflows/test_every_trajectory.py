"""Claims about what is stored of what was simulated: of a campaign's candidates every trajectory, in every case."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from small_campaigns import make_campaign
from softclose.device.device import Device
from softclose.evaluate import respond, respond_each
from softclose.plugins import MEASURED
from softclose.population.lot import Lot
from softclose.presets import preset_names
from softclose.settings import CampaignConfig, load_config
from softclose.waveform import Waveform
from softclose_store import CASE_PREFIX, open_campaign
from softclose_workflows.run import tasks

SMALL = {
    "prior.model": "none",
    "population.n_switches": 16,
    "finish.n_switches": 32,
    "finish.n_basins": 2,
    "finish.grows": "false",
    "explore.n_descents": 2,
    "explore.n_scouts": 4,
    "explore.generation": 4,
    "store.n_times": 5,
    "store.max_impacts": 2,
    "optimiser.n_initial": 4,
    "opening.brake": 0,
    "opening.release_us": 0,
}
BUDGETS = {"campaign.budget": 8, "explore.budget": 16, "finish.budget": 6}


def _small(name: str) -> list[str]:
    """The stages that a preset has, with a few candidates each."""
    config = load_config(name)
    stages = {key: n for key, n in BUDGETS.items() if getattr(config, key.split(".")[0]).budget}
    return [f"{key}={value}" for key, value in (SMALL | stages).items()]


@pytest.mark.parametrize("name", [n for n in preset_names() if load_config(n).model.name != MEASURED])
def test_every_trajectory_of_every_preset_is_stored(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Counted where the device model is asked, stage by stage, and again in the store."""
    simulated: dict[str, int] = {}
    stage: list[str] = []
    plain, block = Device.respond, tasks.run_block

    def counted(self: Device, lot: Lot, drives: Any, **settings: Any) -> Any:
        if stage:
            simulated[stage[0]] = simulated.get(stage[0], 0) + len(lot)
        return plain(self, lot, drives, **settings)

    def in_stage(task: tasks.BlockTask) -> tasks.BlockResult:
        stage.append(task.stage)
        try:
            return block(task)
        finally:
            stage.pop()

    monkeypatch.setattr(Device, "respond", counted)
    monkeypatch.setattr(tasks, "run_block", in_stage)
    path = make_campaign(tmp_path / "a.zarr", *_small(name), preset=name)
    campaign = open_campaign(path)
    stored = {}
    for own in campaign.layout.stages:
        with campaign.dataset(own.name) as dataset:
            x = dataset[f"{CASE_PREFIX}x" if campaign.layout.n_cases > 1 else "x"].to_numpy()
        assert x.shape[:2] == (own.n_candidates, own.n_switches)
        stored[own.name] = int((~np.isnan(x).all(axis=-1)).sum())
    assert stored == simulated
    assert sum(stored.values()) > 0


def test_what_is_stored_of_a_case_is_what_a_switch_does_in_it_and_the_worst_counts(tmp_path: Path) -> None:
    path = make_campaign(tmp_path / "a.zarr", *_small("current-temperature"), preset="current-temperature")
    campaign = open_campaign(path)
    config = CampaignConfig.from_dict(campaign.config)
    own = campaign.layout.stages[0]
    waveform = Waveform.from_rows(campaign.waveform(3))
    lot = Lot(campaign.population()).rows(slice(0, own.n_switches))
    asked: dict[str, Any] = {"times_us": tasks.times_us(config), "max_impacts": 2, "dtype": np.float32}
    each = respond_each(config, lot, waveform, **asked)
    with campaign.dataset(own.name) as dataset:
        assert dataset["celsius"].to_numpy().tolist() == [-40.0, 22.5, 85.0]
        assert dataset["celsius"].attrs["units"] == "°C"
        for k, found in enumerate(each):
            np.testing.assert_array_equal(dataset["case_x"][3, :, k].to_numpy(), found.x)
            np.testing.assert_array_equal(dataset["case_v"][3, :, k].to_numpy(), found.v)
            np.testing.assert_array_equal(dataset["case_impact"][3, :, k, :, 1].to_numpy(), found.impact_speed)
            np.testing.assert_array_equal(dataset["case_response"][3, :, k, 0].to_numpy(), found.max_contact_speed)
        worst = respond(config, lot, waveform, **asked)
        np.testing.assert_array_equal(dataset["x"][3].to_numpy(), worst.x)
        np.testing.assert_array_equal(dataset["response"][3, :, 0].to_numpy(), worst.max_contact_speed)
