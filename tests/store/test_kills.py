"""Claims about processes that die: a real one is killed at every durability step of the store."""

import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import xarray
from numpy.testing import assert_array_equal

import small_store
from examples import in_turn
from forked import Forked
from small_store import create
from softclose_store import DriverStore, LockedError, faults, lock_holder, open_campaign, remove_orphans, verify
from stores import differences

DRIVE = """
import sys, small_store
from softclose_store import store_state
if store_state(sys.argv[1]).kind != "campaign":
    small_store.create(sys.argv[1])
small_store.run(sys.argv[1])
"""


def drive(path: Path, fault: str = "") -> Forked:
    """Create or continue the small campaign in another process."""
    return Forked(str(path), env=os.environ | {faults.VARIABLE: fault}, program=DRIVE)


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    path = tmp_path_factory.mktemp("reference") / "a.zarr"
    create(path)
    small_store.run(path)
    return path


@pytest.mark.parametrize("point", in_turn(faults.POINTS, 3))
def test_a_kill_at_a_named_step_loses_nothing_committed_and_ends_in_the_same_store(point, tmp_path, reference):
    rng = random.Random(point)
    path = tmp_path / "a.zarr"
    passages = {"inside-creation": [1], "inside-record": [4, 9], "inside-chunk-write": [5, 30]}
    for passage in passages.get(point, [rng.randrange(1, 4)]):
        killed = drive(path, f"{point}:{passage}")
        assert killed.wait(timeout=60) == -signal.SIGKILL
        if point == "inside-creation":
            assert not path.exists()
            continue
        assert verify(path).ok
        committed = open_campaign(path).committed
        assert xarray.open_zarr(path, group="candidates").sizes["candidate"] == committed
    assert drive(path).wait(timeout=60) == 0
    remove_orphans(path)
    assert differences(path, reference) == []
    assert verify(path).ok


def test_a_block_is_not_computed_again_after_a_kill(tmp_path):
    path = tmp_path / "a.zarr"
    assert drive(path, "after-marker:5").wait(timeout=60) == -signal.SIGKILL
    assert open_campaign(path).committed == 0
    done = {p: p.stat().st_mtime_ns for p in path.glob("search/x/c.*")}
    assert len(done) == 5
    assert drive(path).wait(timeout=60) == 0
    assert {p: p.stat().st_mtime_ns for p in done} == done


def test_xarray_reads_committed_candidates_while_a_writer_commits(tmp_path, reference):
    path = tmp_path / "a.zarr"
    create(path)
    expected = xarray.open_datatree(reference, engine="zarr").load()
    writer = drive(path)
    seen = set()
    try:
        while writer.poll() is None:
            data = xarray.open_datatree(path, engine="zarr")
            table = data["candidates"]
            n = table.sizes["candidate"]
            seen.add(n)
            for name in ("records", "words", "surrogate", "digests"):
                known = expected["candidates"][name][:n]
                if name == "surrogate":
                    known = known[:, : table.sizes["hyperparameter"]]
                assert_array_equal(table[name].load(), known, err_msg=f"{name} of {n}")
            sizes = [data[stage].sizes["candidate"] for stage in ("search", "finish")]
            assert sizes == [min(n, 5), max(n - 5, 0)]
            for stage, size in zip(("search", "finish"), sizes, strict=True):
                for name in ("x", "response", "impact"):
                    assert_array_equal(
                        data[stage][name].load(), expected[stage][name][:size], err_msg=f"{stage} of {n}"
                    )
            assert open_campaign(path).committed >= n
    finally:
        writer.kill()
    assert writer.wait(timeout=60) == 0
    assert xarray.open_zarr(path, group="candidates").sizes["candidate"] == 8
    assert min(seen) < 8
    assert seen <= {0, 4, 5, 7, 8}


def test_a_second_driver_is_refused_and_told_whose_the_store_is(tmp_path):
    path = tmp_path / "a.zarr"
    create(path)
    with DriverStore(path):
        assert lock_holder(path).pid == os.getpid()
        with pytest.raises(LockedError, match=rf"process {os.getpid()} of .* since .*--break-lock"):
            DriverStore(path)
    assert lock_holder(path) is None
    DriverStore(path).close()


def test_a_dead_drivers_lock_is_nobodys(tmp_path):
    path = tmp_path / "a.zarr"
    assert drive(path, "before-commit:2").wait(timeout=60) == -signal.SIGKILL
    assert (path / "candidates" / "digests" / "driver.lock").exists()
    assert lock_holder(path) is None
    with DriverStore(path) as store:
        assert (store.n_committed, store.n_waves) == (4, 1)


def test_a_broken_lock_belongs_to_its_breaker_and_the_old_driver_stops(tmp_path):
    path = tmp_path / "a.zarr"
    create(path)
    old = DriverStore(path)
    with DriverStore(path, break_lock=True) as new:
        with pytest.raises(LockedError, match="was broken"):
            small_store.run_wave(old)
        assert new.n_committed == 0
        small_store.run_wave(new)
        old.close()
        with pytest.raises(LockedError, match="is being driven"):
            DriverStore(path)
    DriverStore(path).close()


@pytest.mark.parametrize(("host", "refused"), [("here", False), ("elsewhere", True)])
def test_behind_a_url_a_dead_holder_on_this_host_is_recognised_and_any_other_must_be_broken(host, refused):
    import socket

    from softclose_store.disk.files import open_files, write_key
    from softclose_store.disk.lock import LOCK_KEY

    url = f"memory://test-lock-{host}/a.zarr"
    create(url)
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    holder = {
        "host": socket.gethostname() if host == "here" else host,
        "pid": dead.pid,
        "started": "1",
        "boot": "",
        "user": "ann",
        "since": "2026-01-01",
    }
    write_key(open_files(url, read_only=False), LOCK_KEY, json.dumps(holder).encode())
    if refused:
        with pytest.raises(LockedError, match="ann on elsewhere, since 2026-01-01"):
            DriverStore(url)
    with DriverStore(url, break_lock=refused), pytest.raises(LockedError, match=str(os.getpid())):
        DriverStore(url)
    DriverStore(url).close()


@pytest.mark.slow
def test_kills_at_random_instants_end_in_the_same_store(tmp_path, reference):
    rng = random.Random(20)
    path = tmp_path / "a.zarr"
    create(path)
    for _ in range(6):
        driver = drive(path)
        time.sleep(0.4 + 0.5 * rng.random())
        driver.kill()
        driver.wait()
        assert verify(path).ok
        if open_campaign(path).finished:
            break
    assert drive(path).wait(timeout=60) == 0
    remove_orphans(path)
    assert differences(path, reference) == []
