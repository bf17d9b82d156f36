"""Claims about trajectories kept beside the blocks: right to the bit, whoever computes them, and recomputable."""

from __future__ import annotations

import os
import shutil
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner, Result

from examples import in_turn, is_whole
from small_campaigns import COARSE
from softclose.evaluate import respond_each
from softclose.opening import LOOKS, judge_opening
from softclose.population.lot import Lot
from softclose.settings import CampaignConfig, load_config
from softclose.waveform import Waveform
from softclose_store import list_groups, open_campaign, read_group, verify
from softclose_workflows.analyses.certify import certify, fresh_switches
from softclose_workflows.analyses.finalists import certify_within
from softclose_workflows.analyses.recompute import recompute
from softclose_workflows.cli import main
from softclose_workflows.run import actuations, creation, needs, opening, releases
from softclose_workflows.run.crew import open_crew
from softclose_workflows.run.executors import Placement
from softclose_workflows.run.tasks import times_us
from stores import differences

SETTINGS = (
    *COARSE,
    "trim.measured=contact times",
    "model.quality_factor=20",
    "opening.release_us=300",
    "opening.brake=24",
    "opening.n_switches=60",
    "opening.watch_us=100",
)


N_FRESH = 100 if is_whole() else 80
"""Fresh switches of a certificate whose trajectories are all looked at."""


def softclose(*arguments: str, code: int = 0) -> Result:
    done = CliRunner().invoke(main, list(arguments))
    assert done.exit_code == code, (done.output, done.exception)
    return done


def run(path: Path, *settings: str, workers: str = "--serial") -> None:
    sets = [part for setting in settings for part in ("--set", setting)]
    softclose("run", "current", "--store", str(path), *workers.split(), "--quiet", *sets)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("kept") / "a.zarr"
    run(path, *SETTINGS)
    return path


@pytest.fixture
def store(finished: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(finished, tmp_path / "a.zarr"))


def config_of(path: Path) -> CampaignConfig:
    return CampaignConfig.from_dict(open_campaign(path).config)


def best_of(path: Path) -> int:
    best = open_campaign(path).best()
    assert best is not None
    return best.candidate


def test_kept_actuations_are_those_that_the_scales_were_learned_from(finished: Path) -> None:
    config, lot = config_of(finished), open_campaign(finished).population()
    with xr.open_datatree(finished, engine="zarr") as tree:
        made = tree[actuations.NAME].to_dataset().load()
    assert made["x"].dims == ("actuation", "switch", "time")
    volts, first = made["volts"].to_numpy(), made["first_contact"].to_numpy()
    # Bisection by hand: the bracket of each switch, closed in by whether it touched.
    touched = np.isfinite(first[:-1])
    lower = np.where(touched, -np.inf, volts[:-1]).max(axis=0)
    upper = np.where(touched, volts[:-1], np.inf).min(axis=0)
    threshold = lot["threshold"]
    assert ((lower < threshold) & (threshold < upper)).all()
    np.testing.assert_allclose(volts[-1], np.minimum(1.25 * threshold, config.waveform.max_volts))
    apart = np.abs(first[-1] - lot["contact_time"])
    assert np.median(apart[np.isfinite(apart)]) < 0.2, "the rest is the error of timing"
    np.testing.assert_allclose(np.nanmax(made["x"].to_numpy()[-1], axis=-1), lot["D"], rtol=2e-2)


def test_kept_releases_are_those_that_the_brake_was_chosen_from(finished: Path) -> None:
    config, best = config_of(finished), best_of(finished)
    lot = Lot(open_campaign(finished).population()).rows(slice(60))
    with xr.open_datatree(finished, engine="zarr") as tree:
        tried = tree[releases.name_of(best)].to_dataset().load()
    stored = opening.read_opening(str(finished), best)
    assert stored is not None
    assert stored.braked is not None
    assert tried.sizes["trial"] == 13
    looks = releases.looks_of(config)
    assert looks[0] == 0
    assert looks[-1] == LOOKS
    np.testing.assert_allclose(tried["release_time"], looks * config.opening.watch_us / LOOKS)
    costs = tried["cost"].to_numpy()
    chosen = Waveform.from_rows(_rows(tried["release_waveform"].to_numpy()[int(np.argmin(costs))]))
    assert chosen == stored.braked.released.waveform
    at = config.opening.release_us
    for k in (0, int(np.argmin(costs))):
        waveform = Waveform.from_rows(_rows(tried["release_waveform"].to_numpy()[k]))
        times = at + looks * (config.opening.watch_us / LOOKS)
        horizon = at + config.opening.watch_us
        (each,) = respond_each(config, lot, waveform, horizon_us=horizon, times_us=times, dtype=np.float32)
        np.testing.assert_allclose(tried["x"].to_numpy()[k], each.x, atol=1e-5)
        np.testing.assert_allclose(tried["v"].to_numpy()[k], each.v, atol=1e-4)
        o = judge_opening(config, lot, waveform, at_us=at)
        assert costs[k] == o.overshoot + o.p_rebound.estimate + o.p_stuck.estimate


def _rows(rows: Any) -> Any:
    return rows[~np.isnan(rows).all(axis=1)]


@pytest.mark.sampled
def test_kept_trajectories_of_a_certificate_are_those_of_its_switches(store: Path) -> None:
    path, config = str(store), config_of(store)
    plain = shutil.copytree(store, store.parent / "plain.zarr")
    found = certify(path, n_switches=N_FRESH, top=2, store_trajectories=True)
    certify(str(plain), n_switches=N_FRESH, top=2)
    kept_too = read_group(path, f"certification/{N_FRESH}-1").arrays
    for name, values in read_group(plain, f"certification/{N_FRESH}-1").arrays.items():
        np.testing.assert_array_equal(kept_too[name], values, name)
    fresh = fresh_switches(config, N_FRESH, seed=1)
    with xr.open_datatree(store, engine="zarr") as tree:
        kept = tree[f"trajectories/certification-{N_FRESH}-1"].load()
    names = {d.name for d in (*found.candidates, *found.references)}
    assert {str(c.attrs["design"]) for c in kept.children.values() if "release_us" not in c.attrs} == names
    assert sum("release_us" in c.attrs for c in kept.children.values()) == 2
    for d in (*found.candidates, *found.references):
        own = kept[d.name.replace(" ", "-")]
        (each,) = respond_each(
            config, fresh, d.waveform, times_us=times_us(config), dtype=np.float32, for_everybody=d.candidate is None
        )
        np.testing.assert_array_equal(own["x"], each.x)
        np.testing.assert_array_equal(own["v"], each.v)
        assert own["x"].dims == ("fresh_switch", "time")
        assert own["v"].attrs["units"] == "µm/µs"
    before = {f: f.stat().st_mtime_ns for f in (store / "trajectories").rglob("*") if f.is_file()}
    certify(path, n_switches=N_FRESH, top=2, store_trajectories=True)
    assert before == {f: f.stat().st_mtime_ns for f in (store / "trajectories").rglob("*") if f.is_file()}
    if not is_whole():
        return
    certify(path, n_switches=N_FRESH, top=3, store_trajectories=True)
    more = {g for g in list_groups(path) if f"certification-{N_FRESH}-1/candidate" in g}
    assert len(more) == len(read_group(path, f"certification/{N_FRESH}-1").arrays["candidate"]) - len(found.references)


def test_a_certificate_that_is_there_gets_its_trajectories(store: Path) -> None:
    path = str(store)
    certify(path, n_switches=100, top=2)
    assert not [g for g in list_groups(path) if "certification-100" in g]
    certify(path, n_switches=100, top=2, store_trajectories=True)
    assert len([g for g in list_groups(path) if "certification-100" in g]) >= 5


def test_a_race_keeps_every_racer_on_the_switches_that_it_ran_on(store: Path) -> None:
    path = str(store)
    _, race = certify_within(path, 0.02, n_switches=4000, top=3, store_trajectories=True)
    ran = {i: lap.n_switches for lap in race.laps for i in lap.racing}
    for i, n in ran.items():
        assert read_group(path, f"trajectories/certification-{n}-1/candidate-{i}").arrays["x"].shape[0] == n
    assert verify(path).ok


@pytest.mark.long
def test_two_workers_keep_the_same_bits_as_this_process(finished: Path, tmp_path: Path) -> None:
    run(tmp_path / "b.zarr", *SETTINGS, workers="--workers 2")
    assert differences(finished, tmp_path / "b.zarr") == []
    one = Path(shutil.copytree(finished, tmp_path / "a.zarr"))
    certify(str(one), n_switches=100, top=1, store_trajectories=True)
    with open_crew(Placement(workers=2), store=str(tmp_path / "b.zarr")) as crew:
        certify(str(tmp_path / "b.zarr"), n_switches=100, top=1, store_trajectories=True, mapper=crew)
    assert differences(one, tmp_path / "b.zarr") == []


@pytest.mark.parametrize("passage", in_turn([1, 2, 5, 20], 4, first=1))
def test_a_run_killed_as_it_keeps_trajectories_resumes_to_the_same_store(
    finished: Path, tmp_path: Path, passage: int
) -> None:
    path = tmp_path / "a.zarr"
    child = os.fork()
    if child == 0:  # pragma: no cover - the child is killed
        os.environ["SOFTCLOSE_FAULT"] = f"inside-part:{passage}"
        run(path, *SETTINGS)
        os._exit(0)
    assert os.waitpid(child, 0)[1] == signal.SIGKILL
    assert verify(path).ok
    softclose("resume", str(path), "--serial", "--quiet")
    assert differences(finished, path) == []
    assert verify(path).orphans == ()


@pytest.mark.long
def test_damaged_trajectories_are_computed_again_bit_for_bit(store: Path) -> None:
    path = str(store)
    certify(path, n_switches=100, top=1, store_trajectories=True)
    groups = [g for g in list_groups(path) if g.startswith("trajectories/")]
    assert len(groups) >= 6
    for k, group in enumerate(groups, 1):
        chunk = next(f for f in sorted((store / group / "x").rglob("*")) if f.is_file() and f.name.isdigit())
        content = chunk.read_bytes()
        chunk.write_bytes(content[:-1])
        assert verify(path).damaged_groups == groups[:k]
    report = softclose("verify", path, "--repair")
    assert "proved equal" in report.output
    assert verify(path).ok
    for group in groups[:2]:  # metadata and their copy lost: the name alone says what it was
        for f in [*(store / group).glob("zarr.json"), *(store / group).rglob("group.json")]:
            f.unlink()
        assert group in verify(path).damaged_groups
        softclose("verify", path, "--repair")
        assert verify(path).ok


def test_groups_of_nothing_are_not_computed_again(finished: Path) -> None:
    again = recompute().group
    assert again is not None
    for name in ("trajectories/certification-100-1/candidate-99", "trajectories/certification-100-1/nothing"):
        assert "delete that group" in again(str(finished), name, None)
    assert "delete that group" in again(str(finished), "trajectories/certification-x/unshaped", None)


def test_without_trials_nothing_is_kept_of_them(tmp_path: Path) -> None:
    path = tmp_path / "a.zarr"
    run(path, *SETTINGS, "store.trials=false")
    assert [group.partition("/")[0] for group in list_groups(path)] == ["opening"]
    again = recompute().group
    assert again is not None
    assert "delete" in again(str(path), actuations.NAME, None)
    assert "delete" in again(str(path), releases.name_of(best_of(path)), None)


def test_a_release_without_a_brake_is_kept_in_every_case(tmp_path: Path) -> None:
    path = tmp_path / "a.zarr"
    warm = ("temperature.celsius=[0,50]", "temperature.stiffness=[1.0,0.999]", "temperature.low_C=0")
    run(path, *SETTINGS, "opening.brake=0", *warm, "temperature.high_C=50", "temperature.worst_of=2")
    config, best = config_of(path), best_of(path)
    with xr.open_datatree(path, engine="zarr") as tree:
        tried = tree[releases.name_of(best)].to_dataset().load()
    assert tried["case_x"].dims == ("trial", "switch", "case", "release_time")
    assert tried["celsius"].to_numpy().tolist() == [0.0, 50.0]
    lot = Lot(open_campaign(path).population()).rows(slice(60))
    waveform = Waveform.from_rows(_rows(tried["release_waveform"].to_numpy()[0]))
    looks = releases.looks_of(config)
    each = respond_each(
        config,
        lot,
        waveform,
        horizon_us=config.opening.release_us + config.opening.watch_us,
        times_us=config.opening.release_us + looks * (config.opening.watch_us / LOOKS),
    )
    for k, found in enumerate(each):
        np.testing.assert_allclose(tried["case_x"].to_numpy()[0, :, k], found.x, atol=1e-5)


def test_bytes_are_said_before_with_all_that_is_kept(store: Path) -> None:
    def disk(preset: str, *settings: str) -> float:
        return needs.of_run(load_config(preset, list(settings)), workers=1).disk_bytes

    for preset, more, factor in (
        ("current-opening", (), 2.0),
        ("current", ("trim.measured=contact times", "explore.budget=0", "campaign.budget=8"), 1.5),
    ):
        assert disk(preset, *more) > factor * disk(preset, *more, "store.trials=false")
    modes, cases = load_config("current-two-modes"), load_config("current-temperature")
    assert needs.motion_bytes(modes) == pytest.approx(3.4 * needs.TIME_DISK_BYTES * modes.store.n_times)
    n = cases.population.n_switches * cases.campaign.budget + cases.finish.n_switches * cases.finish.budget
    assert disk("current-temperature") == pytest.approx(
        4.0 * n * (needs.TRAJECTORY_DISK_BYTES + needs.motion_bytes(cases))
    ), "at three temperatures, and what counts of them"
    long = ("opening.release_us=300", "opening.brake=5000")
    assert "store.trials=false" in needs.announced(load_config("current", list(long)))
    assert "store.trials" not in needs.announced(load_config("current", [*long, "store.trials=false"]))
    measured = sum(f.stat().st_size for f in (store / "trajectories").rglob("*") if f.is_file() and f.name.isdigit())
    config = config_of(store)
    assert 0.2 < measured / (needs.n_beside(config) * needs.motion_bytes(config)) < 5.0
    told = softclose("certify", str(store), "--switches", "100", "--top", "1", "--store-trajectories", "--threads", "1")
    assert "the trajectories will take up to" in told.stderr


def test_actuations_that_are_not_held_are_simulated_again_to_the_same_store(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sets = [part for s in (*COARSE, "trim.measured=contact times") for part in ("--set", s)]
    stores = []
    for most in (actuations.MOST_HELD_BYTES, 0.0):
        monkeypatch.setattr(actuations, "MOST_HELD_BYTES", most)
        stores.append(tmp_path / f"{most:g}.zarr")
        done = CliRunner().invoke(main, ["run", "current", "--store", str(stores[-1]), "--serial", "--quiet", *sets])
        assert done.exit_code == 0, done.output
    assert differences(*stores) == []


def test_a_store_that_is_there_has_its_lot_already(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config = load_config("current", [*COARSE, "trim.measured=contact times"])
    creation.create_store(config, str(tmp_path / "a.zarr"))
    monkeypatch.setattr(creation, "lot_of", lambda *_: pytest.fail("the lot is in the store"))
    creation.create_store(config, str(tmp_path / "a.zarr"))
