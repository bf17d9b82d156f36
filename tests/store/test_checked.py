"""Claims about reading a campaign: committed data are compared with what was written before they are handed out."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from examples import in_turn
from small_store import block, create, proposal, recompute, record, run
from softclose_store import (
    DamageError,
    DriverStore,
    Layout,
    StageLayout,
    open_campaign,
    proposals_digest,
    repair,
    verify,
    write_block,
)
from softclose_store.read import checked

WIDE = StageLayout(name="search", n_candidates=4, n_switches=16_640, block_candidates=2, block_switches=8_320)
"""Blocks of more trajectories than a chunk holds: they are cut, and parts of them are read by themselves."""


@pytest.fixture(scope="module")
def wide(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("wide") / "a.zarr"
    sizes = create(path, Layout(stages=(WIDE,), times_us=np.linspace(0.0, 1.0, 3), max_impacts=0, n_pulses=2))
    with DriverStore(path) as store:
        for i in range(2):
            rows = [proposal(k, WIDE.n_switches) | record(k) for k in (2 * i, 2 * i + 1)]
            digest = proposals_digest([row["waveform"] for row in rows], WIDE.n_switches, 2 * i)
            arrays = {j: block(sizes, "search", i, j) for j in range(2)}
            store.commit(rows, {(i, j): write_block(path, "search", i, j, arrays[j], digest) for j in range(2)})
    return path


def swap(store: Path, a: str, b: str) -> None:
    one, other = (store / a).read_bytes(), (store / b).read_bytes()
    (store / a).write_bytes(other)
    (store / b).write_bytes(one)


def everything(campaign: Any) -> None:
    campaign.population()
    for i in range(campaign.committed):
        campaign.responses(i)
        campaign.responses(i).impact_speed[...]
        campaign.trajectories(i).x[...]
        campaign.trajectories(i).v[2:3]


SWAPS = (
    ("population/D/c.0", "population/G/c.0"),
    ("search/response/c.0.0.0", "search/response/c.1.0.0"),
    ("search/impact/c.0.0.0.0", "search/impact/c.0.1.0.0"),
    ("search/x/c.0.0.0", "search/v/c.0.0.0"),
    ("finish/x/c.0.1.0", "finish/x/c.1.1.0"),
    ("search/block_digest/c.0.0.0", "search/block_digest/c.1.0.0"),
)


@pytest.mark.parametrize(("a", "b"), in_turn((pytest.param(*swap) for swap in SWAPS), 2, 1))
def test_two_files_that_changed_places_are_told_apart_by_every_reader(a: str, b: str, store: Path) -> None:
    everything(open_campaign(store))
    swap(store, a, b)
    with pytest.raises(
        DamageError, match=rf"({a}|{b}) of .* is not what was written.*: run `softclose verify .* --repair`"
    ):
        everything(open_campaign(store))
    group, name, _ = a.split("/")
    if group in open_campaign(store).stages:
        with open_campaign(store).dataset(group) as ds, pytest.raises(DamageError, match="is not what was written"):
            ds[name].to_numpy()
    tree = open_campaign(store).datatree()
    with pytest.raises(DamageError, match="is not what was written"):
        tree[group][name].to_numpy()


@pytest.mark.parametrize("key", in_turn((a for a, _ in SWAPS), 3))
def test_a_file_that_is_lost_is_missed_by_every_reader(key: str, store: Path) -> None:
    (store / key).unlink()
    with pytest.raises(DamageError, match=rf"{key} of .* is missing.*: run `softclose verify .* --repair`"):
        everything(open_campaign(store))
    group, name, _ = key.split("/")
    tree = open_campaign(store).datatree()
    with pytest.raises(DamageError, match=f"{key} of .* is missing"):
        tree[group][name].to_numpy()


def test_labelled_arrays_are_those_of_the_records(whole: Path) -> None:
    campaign = open_campaign(whole)
    with campaign.dataset() as ds:
        assert_array_equal(ds["records"].sel(field="g_cm_s").to_numpy(), campaign.records()["g_cm_s"])
        assert list(ds["hyperparameter"].to_numpy()) == campaign._root.attributes["hyperparameters"]
    with campaign.dataset("search") as ds:
        for i in range(5):
            n = len(campaign.trajectories(i).x)
            assert_array_equal(ds["x"][i].to_numpy()[:n], campaign.trajectories(i).x[...])
        assert np.isnan(ds["x"][4].to_numpy()[8:]).all()  # of a wave that used seven switches: two blocks of four


def test_names_of_columns_are_compared_with_the_root(store: Path, tmp_path: Path) -> None:
    create(tmp_path / "new.zarr")
    shutil.copy(
        tmp_path / "new.zarr" / "candidates" / "hyperparameter" / "c.0", store / "candidates" / "hyperparameter" / "c.0"
    )
    with pytest.raises(DamageError, match=r"candidates/hyperparameter/c.0 of .* is not what was written"):
        open_campaign(store).dataset()  # it is a coordinate, which xarray reads at once


def test_what_is_handed_out_is_ones_own(whole: Path) -> None:
    campaign = open_campaign(whole)
    for i in (0, 5):
        first = campaign.trajectories(i).x[...]
        first[...] = 7.0
        assert not (campaign.trajectories(i).x[...] == 7.0).any()
    lot = campaign.population()["D"]
    lot[...] = 7.0
    assert not (campaign.population()["D"] == 7.0).any()


def test_blocks_that_are_kept_are_bounded(whole: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checked, "KEPT_BYTES", 1)
    campaign = open_campaign(whole)
    everything(campaign)
    assert len(campaign._blocks._kept) == 1


@pytest.mark.parametrize(
    "selection",
    [
        ...,
        3,
        -1,
        slice(2, 16_000, 7),
        slice(None, None, -1),
        slice(5, 5),
        [8_319, 8_320, 1],
        np.arange(16_640) % 2 == 0,
    ],
)
def test_rows_are_those_of_the_whole_array_however_it_is_cut(selection: Any, wide: Path) -> None:
    campaign = open_campaign(wide)
    for i in range(4):
        parts = [block(campaign.layout, "search", i // 2, j)["x"][i % 2] for j in range(2)]
        expected = np.concatenate(parts).astype(np.float32)
        at = list(selection) if isinstance(selection, list) else selection
        assert_array_equal(campaign.trajectories(i).x[at], expected[at])
    assert_array_equal(campaign.trajectories(0).x[3, 1:], campaign.trajectories(0).x[3][1:])
    assert_array_equal(campaign.trajectories(0).x[[3, 4], ::2], campaign.trajectories(0).x[...][[3, 4]][:, ::2])
    assert_array_equal(campaign.responses(3).max_contact_speed, campaign._rows("response", 3)[..., 0])


def test_a_part_of_a_cut_block_is_compared_as_a_whole(wide: Path, tmp_path: Path) -> None:
    path = Path(shutil.copytree(wide, tmp_path / "a.zarr"))
    swap(path, "search/x/c.0.0.0", "search/x/c.1.0.0")
    with pytest.raises(DamageError, match=r"search/x/c.0.0.0 of .* is not what was written"):
        open_campaign(path).trajectories(0).x[5:6]
    assert len(open_campaign(path).trajectories(0).x[9_000:9_001]) == 1  # which the other block holds
    content = (path / "search/x/c.0.1.0").read_bytes()
    index = content[-(4 * 16 + 4) :]
    for forged in ((2**40).to_bytes(8, "little") + index[8:], b""):
        (path / "search/x/c.0.1.0").write_bytes(content[: -len(index)] + forged)
        with pytest.raises(DamageError, match=r"search/x/c.0.1.0 of .* cannot be read"):
            open_campaign(path).trajectories(0).x[9_000:9_001]


def test_a_root_of_an_earlier_time_is_told_by_the_tables(store: Path) -> None:
    (store / "zarr.json").write_bytes((store / "candidates" / "digests" / "root.json").read_bytes())
    with pytest.raises(
        DamageError, match=r"zarr.json of .* is of an earlier time: it says 0 waves, and the tables have 4"
    ):
        open_campaign(store).records()


def test_a_root_of_the_creation_is_told_by_the_run_that_was_noted_beside_it(tmp_path: Path) -> None:
    path = tmp_path / "a.zarr"
    create(path)
    with DriverStore(path) as store:
        store.note_run({"host": "here"})
    run(path, 4)  # one wave: the tables alone could be those of a run that was killed before its commit
    later = (path / "zarr.json").read_bytes()
    (path / "zarr.json").write_bytes((path / "candidates" / "digests" / "root.json").read_bytes())
    with pytest.raises(DamageError, match=r"zarr.json of .* is of an earlier time"):
        open_campaign(path).records()
    assert any("it is of an earlier time" in str(p) for p in verify(path).problems)
    assert repair(path, recompute()).ok
    assert (path / "zarr.json").read_bytes() == later


def test_a_view_that_was_opened_before_further_waves_is_as_it_was(tmp_path: Path) -> None:
    create(tmp_path / "a.zarr")
    run(tmp_path / "a.zarr", 4)
    early = open_campaign(tmp_path / "a.zarr")
    run(tmp_path / "a.zarr", 8)
    assert len(early.records()["g_cm_s"]) == 4
    early.refresh()
    assert len(early.records()["g_cm_s"]) == 8
