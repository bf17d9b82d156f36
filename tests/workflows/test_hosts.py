"""Claims about several hosts: cut off, healed or with a wrong clock, they leave the store as one process does."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from campaigns import committed, softclose, until
from hosts import PROGRAMS, Hosts, hosts_on_a_network
from programs import require
from softclose_store import verify
from stores import differences

pytestmark = pytest.mark.slow

SETTINGS = (
    "campaign.budget=120",
    "prior.model=none",
    "campaign.wave=8",
    "population.n_switches=3000",
    "compute.block_switches=3000",
    "store.n_times=2",
    "optimiser.engine=sobol",
    "explore.budget=0",
    "finish.budget=0",
)

PORT = "8786"
DASK = "from dask.__main__ import main; main()"

# How long a silent connection counts as alive: the least that Dask takes; half a minute by default.
QUICK = {"DASK_DISTRIBUTED__COMM__TIMEOUTS__TCP": "11s", "DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT": "3s"}


@pytest.fixture(scope="module")
def local(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The campaign, run in one process and never interrupted."""
    store = tmp_path_factory.mktemp("local") / "a.zarr"
    done = softclose(*_arguments(store), "--serial")
    assert done.returncode == 0, done.stderr
    return store


@pytest.fixture
def hosts() -> Iterator[Hosts]:
    for program in PROGRAMS:
        require(program)
    if os.geteuid() != 0:
        pytest.skip("network namespaces need root")
    with hosts_on_a_network("driver", "scheduler", "one", "two") as found:
        yield found


def _arguments(store: Path) -> list[str]:
    settings = [part for setting in SETTINGS for part in ("--set", setting)]
    return ["run", "current", "--store", str(store), "--quiet", *settings]


def _cluster(hosts: Hosts, *before: str) -> str:
    """A scheduler, and a worker on each of two hosts; before: what starts the second worker."""
    environment = QUICK | {"OMP_NUM_THREADS": "1"}
    address = f"tcp://{hosts.address('scheduler')}:{PORT}"
    listening = ["--host", hosts.address("scheduler"), "--port", PORT, "--no-dashboard"]
    hosts.begin("scheduler", "scheduler", *listening, program=DASK, env=environment)
    for name in ("one", "two"):
        worker = ["worker", address, "--host", hosts.address(name), "--nthreads", "1", "--no-dashboard"]
        if before and name == "two":
            hosts.start(name, *before, sys.executable, "-m", "dask", *worker, env=environment)
        else:
            hosts.begin(name, *worker, program=DASK, env=environment)
    return address


def _drive(hosts: Hosts, store: Path, address: str, *more: str) -> Any:
    arguments = [*_arguments(store), "--scheduler", address, "--plain-tcp", *more]
    return hosts.begin("driver", *arguments, env=QUICK, stderr=subprocess.PIPE)


def _ends_well(driver: Any, store: Path, local: Path) -> None:
    _, said = driver.communicate(timeout=150)
    assert driver.returncode == 0, said
    assert differences(store, local) == []
    assert verify(str(store)).ok


@pytest.mark.long
def test_a_worker_that_is_cut_off_and_comes_back_spoils_nothing(hosts: Hosts, local: Path, tmp_path: Path) -> None:
    store = tmp_path / "a.zarr"
    driver = _drive(hosts, store, _cluster(hosts))
    until(lambda: committed(store) >= 24)
    hosts.cut("one")
    before = committed(store)
    until(lambda: committed(store) >= before + 24)  # another computes its blocks
    assert driver.poll() is None
    hosts.heal("one")
    _ends_well(driver, store, local)


def test_a_driver_that_is_cut_off_stops_and_is_resumed(hosts: Hosts, local: Path, tmp_path: Path) -> None:
    store = tmp_path / "a.zarr"
    address = _cluster(hosts)
    driver = _drive(hosts, store, address, "--patience", "2")
    until(lambda: committed(store) >= 24)
    hosts.cut("driver")
    _, said = driver.communicate(timeout=60)
    assert driver.returncode == 3, said
    assert "softclose resume" in said
    assert 24 <= committed(store) < 120
    hosts.heal("driver")
    again = _drive(hosts, store, address)
    _ends_well(again, store, local)


@pytest.mark.long
def test_a_driver_that_is_cut_off_for_a_moment_goes_on(hosts: Hosts, local: Path, tmp_path: Path) -> None:
    store = tmp_path / "a.zarr"
    driver = _drive(hosts, store, _cluster(hosts))
    until(lambda: committed(store) >= 24)
    hosts.cut("driver")
    time.sleep(1.0)
    hosts.heal("driver")
    _ends_well(driver, store, local)


@pytest.mark.long
def test_a_worker_whose_clock_is_two_days_ahead_changes_nothing(hosts: Hosts, local: Path, tmp_path: Path) -> None:
    store = tmp_path / "a.zarr"
    driver = _drive(hosts, store, _cluster(hosts, require("faketime"), "-f", "+2d"))
    _ends_well(driver, store, local)
