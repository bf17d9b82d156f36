"""Claims about batch schedulers, under a real SLURM: jobs are lost, drivers killed, and the store stays the same."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from campaigns import command, committed, softclose, softclose_process, until
from programs import require
from slurm import PROGRAMS, Slurm, running_slurm
from softclose_store import open_campaign, store_state
from stores import differences

SETTINGS = (
    "campaign.budget=480",
    "prior.model=none",
    "campaign.wave=4",
    "population.n_switches=4000",
    "compute.block_switches=2000",
    "store.n_times=2",
    "optimiser.engine=sobol",
    "explore.budget=0",
    "finish.budget=0",
)

SLOWLY = """
import os, time, softclose

def slowly(switches, waveform, **settings):
    if "SLURM_JOB_ID" in os.environ:
        time.sleep(0.6)
    return softclose.simulate(switches, waveform, **settings)
"""
"""A device model that takes its time within a job: how fast a machine is does not decide how long a campaign lasts."""


@pytest.fixture(scope="module")
def slurm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Slurm]:
    for program in PROGRAMS:
        require(program)
    with running_slurm(tmp_path_factory.mktemp("slurm")) as found:
        yield found


@pytest.fixture(scope="module")
def local(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The campaign, run in one process and never interrupted."""
    store = tmp_path_factory.mktemp("local") / "a.zarr"
    done = softclose(*_arguments(store), "--serial")
    assert done.returncode == 0, done.stderr
    return store


def _arguments(store: Path, *, verb: str = "run") -> list[str]:
    settings = [part for setting in SETTINGS for part in ("--set", setting)]
    return [verb, "current", "--store", str(store), "--quiet", *settings]


def _cluster(folder: Path, *more: str) -> str:
    """A file of one-worker jobs, two at once."""
    lines = ['scheduler = "slurm"', "jobs = 2", "cores = 1", 'memory = "1GB"', 'host = "127.0.0.1"', *more]
    file = folder / "slurm.toml"
    file.write_text("\n".join([*lines, f'log_folder = "{folder / "jobs"}"\n']))
    return str(file)


@pytest.mark.long
@pytest.mark.slow
def test_a_cancelled_job_is_replaced_and_a_killed_driver_resumed(slurm: Slurm, local: Path, tmp_path: Path) -> None:
    store, cluster = tmp_path / "a.zarr", _cluster(tmp_path)
    driver = subprocess.Popen(
        command(*_arguments(store), "--cluster", cluster), env=slurm.environment, stderr=subprocess.DEVNULL
    )
    try:
        until(lambda: committed(store) >= 8)
        until(lambda: len(slurm.jobs("softclose-worker")) == 2)
        first = slurm.jobs("softclose-worker")
        slurm.ask("scancel", first[0])
        until(lambda: set(slurm.jobs("softclose-worker")) - set(first))
        assert driver.poll() is None
    finally:
        driver.kill()
        driver.wait()
    assert 8 <= committed(store) < 480
    left = slurm.jobs("softclose-worker", "RUNNING,PENDING")
    if left:  # nobody is there to cancel them; their workers end when the scheduler does not answer
        slurm.ask("scancel", *left)
    done = softclose_process("resume", str(store), "--cluster", cluster, "--quiet", env=slurm.environment)
    assert done.returncode == 0, done.stderr
    assert differences(store, local) == []
    assert open_campaign(str(store)).runtime


@pytest.mark.long
@pytest.mark.slow
def test_a_submitted_driver_that_is_cancelled_goes_on_in_the_next_job(
    slurm: Slurm, local: Path, tmp_path: Path
) -> None:
    store, cluster = tmp_path / "b.zarr", _cluster(tmp_path)
    arguments = [a for a in _arguments(store, verb="submit") if a != "--quiet"]
    shown = softclose_process(*arguments, "--cluster", cluster, "--dry-run", env=slurm.environment)
    assert shown.returncode == 0, shown.stderr
    assert "#SBATCH --job-name=softclose-b" in shown.stdout
    assert "dask_worker tls://" in shown.stdout
    assert not (tmp_path / "jobs" / "softclose-b.sh").exists()
    submitted = softclose_process(*arguments, "--cluster", cluster, env=slurm.environment)
    assert submitted.returncode == 0, submitted.stderr
    first = re.match(r"job (\d+) ", submitted.stdout)
    assert first is not None
    until(lambda: committed(store) >= 8)
    assert len(slurm.jobs("softclose-b", "PENDING")) == 1  # its successor waits
    slurm.ask("scancel", first[1])
    until(lambda: not slurm.jobs("softclose-b", "RUNNING,PENDING,COMPLETING,CONFIGURING"), 240.0)
    assert store_state(str(store)).finished
    assert not slurm.jobs("softclose-worker", "RUNNING,PENDING")
    logs = sorted((tmp_path / "jobs").glob("softclose-b-*.log"))
    assert len(logs) == 2  # the last one cancelled its successor
    assert differences(store, local) == []


@pytest.mark.slow
def test_jobs_that_end_before_a_worker_comes_stop_the_run_with_their_last_words(slurm: Slurm, tmp_path: Path) -> None:
    store = tmp_path / "c.zarr"
    cluster = _cluster(tmp_path, 'prologue = ["echo no such module >&2", "exit 7"]')
    done = softclose_process(*_arguments(store), "--cluster", cluster, env=slurm.environment)
    assert done.returncode == 3
    assert "ended before any worker of theirs came" in done.stderr
    assert "no such module" in done.stderr


def test_a_job_that_slurm_refuses_is_an_error_in_its_own_words(slurm: Slurm, tmp_path: Path) -> None:
    store = tmp_path / "d.zarr"
    cluster = _cluster(tmp_path, 'queue = "nowhere"')
    done = softclose_process(*_arguments(store), "--cluster", cluster, env=slurm.environment)
    assert done.returncode == 2
    assert "invalid partition" in done.stderr
    assert not store.exists()


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(900)
def test_workers_end_before_their_walltime_and_others_take_over(slurm: Slurm, tmp_path: Path) -> None:
    """Jobs of 65 s, a campaign of 90 and more: no job is killed by its walltime, none of the results differ."""
    (tmp_path / "slowly.py").write_text(SLOWLY)
    store, cluster = tmp_path / "e.zarr", _cluster(tmp_path, 'walltime = "00:01:05"')
    few = ("campaign.budget=160", "population.n_switches=200", "compute.block_switches=100", "model.name=slowly:slowly")
    allowed = ("--allow-code", "slowly:slowly")
    more = [part for setting in few for part in ("--set", setting)]
    there = {"PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])}
    environment = slurm.environment | there
    done = softclose_process(*allowed, *_arguments(store), *more, "--cluster", cluster, env=environment, timeout=600.0)
    assert done.returncode == 0, done.stderr
    logs = [p.read_text() for p in sorted((tmp_path / "jobs").glob("softclose-worker-*.err"))]
    assert len(logs) >= 4
    assert not any("DUE TO TIME LIMIT" in log for log in logs)
    serial = tmp_path / "serial.zarr"
    done = softclose_process(*allowed, *_arguments(serial), *more, "--serial", env=there)
    assert done.returncode == 0, done.stderr
    assert differences(store, serial) == []
