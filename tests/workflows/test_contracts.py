"""Claims about determinism and durability, on real processes: DESIGN §2 and §3."""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from campaigns import run_arguments, softclose
from forked import Forked
from softclose_store import open_campaign
from stores import differences, visible_lengths
from torture import Plan, run_round


def wait_for_commits(store: Path, n: int, process: subprocess.Popen[bytes], timeout_s: float = 120.0) -> None:
    """Return once n candidates are committed."""
    deadline = time.monotonic() + timeout_s
    while time.monotonic() < deadline:
        if (store / "zarr.json").exists() and open_campaign(store).committed >= n:
            return
        assert process.poll() is None, "the run ended before it was to be killed"
        time.sleep(0.02)
    raise TimeoutError(f"{store} did not reach {n} candidates")


@pytest.mark.slow
@pytest.mark.parametrize("workers", [pytest.param(1, marks=pytest.mark.long), 2])
def test_the_store_does_not_depend_on_the_number_of_workers(
    workers: int, tmp_path: Path, reference_store: Path
) -> None:
    store = tmp_path / "a.zarr"
    done = softclose(*run_arguments(store), "--workers", str(workers))
    assert done.returncode == 0, done.stderr
    assert differences(reference_store, store) == []


@pytest.mark.slow
def test_a_killed_driver_is_resumed_to_the_same_store(tmp_path: Path, reference_store: Path) -> None:
    store = tmp_path / "a.zarr"
    process = Forked(*run_arguments(store), "--workers", "2", stderr=subprocess.DEVNULL)
    wait_for_commits(store, 3, process)
    process.send_signal(signal.SIGKILL)
    process.wait(timeout=30)
    assert not open_campaign(store).finished
    done = softclose("resume", str(store), "--workers", "2", "--quiet")
    assert done.returncode == 0, done.stderr
    assert differences(reference_store, store) == []


def test_a_round_of_torture_kills_resumes_and_finds_the_same_store(tmp_path: Path, reference_store: Path) -> None:
    """Every named step is tried by tests/store/test_kills.py, and by `make torture` through the whole program."""
    plan = Plan(kind="point", point="inside-record", passage=3)
    assert run_round(tmp_path, reference_store, plan, random.Random(1)) == []


def test_a_killed_worker_is_replaced_and_its_block_retried(tmp_path: Path, reference_store: Path) -> None:
    plan = Plan(kind="point", point="before-marker", passage=4, workers=1)
    assert run_round(tmp_path, reference_store, plan, random.Random(1)) == []


DESCENTS = (
    "campaign.budget=0",
    "explore.budget=160",
    "explore.n_descents=2",
    "finish.budget=14",
    "finish.n_switches=80",
    "compute.block_switches=1200",
)
"""Blocks of twenty candidates, two sets of descents that take turns, and a polish."""


@pytest.mark.parametrize(
    "settings",
    [
        pytest.param(("campaign.lag=2",), marks=pytest.mark.long, id="2"),
        pytest.param(("campaign.lag=3",), id="3"),
        pytest.param(DESCENTS, marks=pytest.mark.long, id="descents"),
    ],
)
def test_waves_in_flight_together_do_not_make_the_result_depend_on_timing(
    settings: tuple[str, ...], tmp_path: Path
) -> None:
    stores = []
    for name, placement in (("serial", ["--serial"]), ("two", ["--workers", "2"])):
        store = tmp_path / f"{name}.zarr"
        done = softclose(*run_arguments(store, *settings), *placement)
        assert done.returncode == 0, done.stderr
        stores.append(store)
    assert differences(*stores) == []


def test_a_growing_store_shows_whole_waves_only(tmp_path: Path, reference_store: Path) -> None:
    xr.open_zarr(
        reference_store, group="candidates"
    ).close()  # what is slow to import must not make the reader miss the growth
    store = tmp_path / "a.zarr"
    arguments = run_arguments(store, "campaign.budget=200", "optimiser.batch=1")
    process = Forked(*arguments, "--serial", stdout=subprocess.DEVNULL)
    seen = set()
    try:
        wait_for_commits(store, 4, process)
        while len(seen) < 4:
            assert process.poll() is None, f"the run ended after {sorted(seen)} had been seen"
            with xr.open_zarr(store, group="candidates") as ds:
                n = ds.sizes["candidate"]
                seen.add(n)
                assert np.isfinite(ds["records"].sel(field="g_cm_s").to_numpy()).all()
            with xr.open_zarr(store, group="search") as stage:
                assert stage.sizes["candidate"] >= n
                assert np.isfinite(stage["x"][n - 1].to_numpy()).all()
            assert len(visible_lengths(store)) == 1
    finally:
        process.kill()
        process.wait()


def test_status_is_one_json_object_also_before_anything_is_committed(tmp_path: Path) -> None:
    store = tmp_path / "a.zarr"
    process = Forked(
        *run_arguments(store),
        "--serial",
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=os.environ | {"SOFTCLOSE_FAULT": "after-marker:1"},
    )
    process.wait(timeout=120)
    standing = json.loads(softclose("status", str(store), "--json").stdout)
    assert (standing["committed"], standing["budget"], standing["finished"], standing["best"]) == (0, 8, False, None)


def test_status_names_the_best_candidate_of_a_finished_store(reference_store: Path) -> None:
    standing = json.loads(softclose("status", str(reference_store), "--json").stdout)
    assert standing["finished"] is True
    records = open_campaign(reference_store).records()
    best = int(np.nanargmin(records["g_cm_s"]))
    assert standing["best"]["candidate"] == best
    assert standing["best"]["g_cm_s"] == records["g_cm_s"][best]
    assert standing["best"]["waveform"][-1][2] is None


def test_running_a_finished_campaign_again_computes_nothing(tmp_path: Path, reference_store: Path) -> None:
    store = tmp_path / "a.zarr"
    shutil.copytree(reference_store, store)
    before = {f: f.stat().st_mtime_ns for f in store.rglob("*") if f.is_file() and "/x/c" in str(f)}
    done = softclose(*run_arguments(store), "--serial")
    assert done.returncode == 0, done.stderr
    assert "best (candidate" in done.stdout
    assert before == {f: f.stat().st_mtime_ns for f in before}
