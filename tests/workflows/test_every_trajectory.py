"""Claims about what is stored of what was simulated: of a campaign's candidates every trajectory, in every case."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner

from examples import in_turn
from small_campaigns import COARSE, make_campaign
from softclose.conditions import learning
from softclose.device.device import Device
from softclose.evaluate import respond, respond_each
from softclose.plugins import MEASURED
from softclose.population.lot import Lot
from softclose.presets import find_preset, preset_names
from softclose.propose import prior
from softclose.settings import CampaignConfig, load_config
from softclose.settings import config as settings_room
from softclose.waveform import Waveform
from softclose_store import CASE_PREFIX, list_groups, open_campaign
from softclose_workflows.analyses import kept_certificates, references, result
from softclose_workflows.cli import main
from softclose_workflows.run import actuations, creation, opening, releases, tasks

SMALL = {
    "prior.model": "none",
    "prior.control": 0,
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
    "opening.brake": 24,
    "opening.n_switches": 16,
    "opening.watch_us": 20,
}
BUDGETS = {"campaign.budget": 8, "explore.budget": 16, "finish.budget": 6}


def _small(name: str) -> list[str]:
    """The stages that a preset has, with a few candidates each."""
    config = load_config(name)
    stages = {key: n for key, n in BUDGETS.items() if getattr(config, key.split(".")[0]).budget}
    return [f"{key}={value}" for key, value in (SMALL | stages).items()]


class Counted:
    """Trajectories that device models are asked for, by who asks."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.simulated: dict[str, int] = {}
        self._asking = ["nobody that is known"]
        self._patch = patch
        plain = Device.respond

        def respond(device: Device, lot: Lot, drives: Any, **settings: Any) -> Any:
            self.simulated[self._asking[-1]] = self.simulated.get(self._asking[-1], 0) + len(lot)
            return plain(device, lot, drives, **settings)

        patch.setattr(Device, "respond", respond)

    def within(self, owner: Any, name: str, label: Callable[..., str]) -> None:
        """Whatever is asked for within that function is its own, or that of one within it."""
        plain = getattr(owner, name)

        def labelled(*arguments: Any, **named: Any) -> Any:
            self._asking.append(label(*arguments))
            try:
                return plain(*arguments, **named)
            finally:
                self._asking.pop()

        self._patch.setattr(owner, name, labelled)


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> Counted:
    found = Counted(monkeypatch)
    found.within(tasks, "run_block", lambda task: f"stage {task.stage}")
    found.within(releases.KeptTrial, "__call__", lambda *_: "releases")
    found.within(actuations, "_actuate", lambda *_: "actuations")
    found.within(kept_certificates, "_simulate_and_keep", lambda piece: piece.keeper.group)
    # What is not kept, and why: a prior is counted and recomputable; so are the devices that a trim's regression is
    # learned on; the others are simulated again, or have been, among those above, or kept where somebody asks for it.
    found.within(kept_certificates, "draw", lambda *_: "lot")
    found.within(prior.Prior, "values", lambda *_: "prior")
    found.within(learning.Learned, "of", lambda *_: "regression")
    found.within(settings_room, "scaled", lambda *_: "prices")
    found.within(creation, "lot_of", lambda *_: "lot")
    found.within(opening, "judge_opening", lambda *_: "openings")
    found.within(references, "simulate_references", lambda *_: "references")
    found.within(result, "simulate_references", lambda *_: "references")
    return found


def _stored(path: Path) -> dict[str, int]:
    """Trajectories in a store, by the same names; in each case that there is."""
    campaign = open_campaign(path)
    found = {}
    name = f"{CASE_PREFIX}x" if campaign.layout.n_cases > 1 else "x"
    for own in campaign.layout.stages:
        with campaign.dataset(own.name) as dataset:
            x = dataset[name].to_numpy()
            if campaign.layout.n_modes > 1:
                parts = dataset[name.replace("x", "mode_x")].to_numpy()
                assert parts.shape == (*x.shape[:-1], campaign.layout.n_modes - 1, x.shape[-1])
                assert (np.isnan(parts).all(axis=(-2, -1)) == np.isnan(x).all(axis=-1)).all()
        assert x.shape[:2] == (own.n_candidates, own.n_switches)
        found[f"stage {own.name}"] = _told(x)
    with xr.open_datatree(path, engine="zarr") as tree:
        for group in tree.get("trajectories", {}):
            kind = group.partition("-")[0]
            if kind != "certification":
                found[kind.replace("release", "releases")] = _told(tree["trajectories"][group][name].to_numpy())
            else:
                for design, dataset in tree["trajectories"][group].items():
                    found[f"trajectories/{group}/{design}"] = _told(dataset[name].to_numpy())
    return found


def _told(x: Any) -> int:
    return int((~np.isnan(x).all(axis=-1)).sum())


def _run(path: Path, preset: str, *settings: str) -> None:
    sets = [part for setting in settings for part in ("--set", setting)]
    done = CliRunner().invoke(main, ["run", preset, "--store", str(path), "--serial", "--quiet", *sets])
    assert done.exit_code == 0, done.output


ELSEWHERE = {"prior", "regression", "prices", "lot", "openings", "references"}


def is_simulated(name: str) -> bool:
    """Whether a preset has a model to simulate, as its file says: to load it may take seconds, in every process."""
    return tomllib.loads(find_preset(name).read_text("utf-8")).get("model", {}).get("name") != MEASURED


@pytest.mark.parametrize("name", in_turn(filter(is_simulated, preset_names()), 7))
def test_every_trajectory_of_every_preset_is_stored(name: str, tmp_path: Path, counted: Counted) -> None:
    """Counted where the device model is asked, stage by stage, and again in the store."""
    _run(tmp_path / "a.zarr", name, *_small(name))
    stored = _stored(tmp_path / "a.zarr")
    assert {key: n for key, n in counted.simulated.items() if key not in ELSEWHERE} == stored
    assert sum(stored.values()) > 0
    assert ("releases" in stored) == load_config(name).opening.is_designed


def test_every_trajectory_of_releases_actuations_and_a_certificate_is_stored(tmp_path: Path, counted: Counted) -> None:
    path = tmp_path / "a.zarr"
    settings = [*COARSE, "trim.measured=contact times", "model.quality_factor=20", "opening.release_us=300"]
    settings += ["opening.brake=24", "opening.n_switches=60", "opening.watch_us=100", "waveform.max_volts=140"]
    _run(path, "current", *settings)
    stored = _stored(path)
    assert {key: n for key, n in counted.simulated.items() if key not in ELSEWHERE} == stored
    config = CampaignConfig.from_dict(open_campaign(path).config)
    assert stored["actuations"] == 8 * config.n_switches_max
    assert not {"lot", "names"} & counted.simulated.keys(), "the lot is drawn from the actuations that are kept"
    assert 60 < stored["releases"] <= 13 * 60, "what is above the largest voltage is not simulated"
    counted.simulated.clear()
    done = CliRunner().invoke(
        main,
        ["certify", str(path), "--switches", "300", "--top", "2", "--store-trajectories", "--quiet", "--threads=1"],
    )
    assert done.exit_code == 0, done.output
    new = {key: n for key, n in _stored(path).items() if key not in stored}
    assert {key: n for key, n in counted.simulated.items() if key.startswith("trajectories/")} == new
    assert len(new) >= 4
    assert set(new.values()) == {300}


def test_what_is_not_to_be_kept_is_not(tmp_path: Path) -> None:
    path = tmp_path / "a.zarr"
    settings = [*COARSE, "trim.measured=contact times", "store.trials=false", "model.quality_factor=20"]
    settings += ["opening.release_us=300", "opening.brake=12", "opening.n_switches=60", "opening.watch_us=100"]
    _run(path, "current", *settings)
    assert [group.partition("/")[0] for group in list_groups(path)] == ["opening"]


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
