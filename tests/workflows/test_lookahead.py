"""Claims about looking ahead: waves that do not wait for each other keep workers busy, and show nowhere in a store."""

from __future__ import annotations

import heapq
import itertools
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from campaigns import LED, softclose, softclose_process
from examples import in_turn
from softclose.propose.protocol import Problem
from softclose.settings import load_config
from softclose_store import DriverStore, faults, open_campaign
from softclose_workflows.run.campaign import Driver
from softclose_workflows.run.creation import create_store
from softclose_workflows.run.executors.serial import SerialExecutor
from softclose_workflows.run.executors.threads import ThreadExecutor
from softclose_workflows.run.prior import PriorAtWork, PriorOfStore, PriorTask, StretchTask
from softclose_workflows.run.stopping import StopRequest
from softclose_workflows.run.tasks import BlockTask
from stores import differences

LAG = 3

SETTINGS = (*LED, f"campaign.lag={LAG}", "campaign.budget=22", "compute.block_switches=10")
"""Eleven waves of two candidates, each of eight blocks; the Gaussian process from a prior."""


def made(path: Path, *settings: str) -> Path:
    create_store(load_config("current", (*SETTINGS, *settings)), str(path))
    return path


def run(path: Path, executor: Any, **options: Any) -> Driver:
    with DriverStore(path) as store:
        driver = Driver(store, executor, **options)
        driver.run()
    return driver


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = made(tmp_path_factory.mktemp("whole") / "a.zarr")
    run(path, SerialExecutor())
    assert (open_campaign(path).records()["origin"] == "trust-region").sum() == 16
    return path


def arguments(path: Path) -> list[str]:
    sets = [part for setting in SETTINGS for part in ("--set", setting)]
    return ["run", "current", "--store", str(path), "--quiet", *sets]


@pytest.mark.parametrize("workers", in_turn([1, 2, 4], 3, 1))
def test_any_number_of_workers_gives_the_store_of_one_process(workers: int, tmp_path: Path, whole: Path) -> None:
    path, executor = made(tmp_path / "a.zarr"), ThreadExecutor(workers)
    run(path, executor)
    executor.close()
    assert differences(path, whole) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    "workers", [pytest.param(1, marks=pytest.mark.long), 2, pytest.param(4, marks=pytest.mark.long)]
)
def test_any_number_of_processes_gives_the_store_of_one(workers: int, tmp_path: Path, whole: Path) -> None:
    path = tmp_path / "a.zarr"
    done = softclose(*arguments(path), "--workers", str(workers))
    assert done.returncode == 0, done.stderr
    assert differences(path, whole) == []


class Gone(Exception):
    """The process is gone."""


@pytest.mark.parametrize("wave", in_turn(range(11), 11, 8))
def test_a_run_that_ends_behind_any_wave_is_resumed_to_the_same_store(wave: int, tmp_path: Path, whole: Path) -> None:
    """With blocks of later waves stored, and what was proposed of them forgotten."""
    path = made(tmp_path / "a.zarr")

    def ends(progress: Any) -> None:
        if progress.stage != "prior" and store.n_waves == wave and progress.simulated > progress.committed:
            raise Gone

    with DriverStore(path) as store, pytest.raises(Gone):
        Driver(store, Backwards(), listener=ends).run()
    assert open_campaign(path).n_waves == wave
    run(path, Backwards())
    assert differences(path, whole) == []


class Backwards(SerialExecutor):
    """Does the latest block first, so that those of later waves are stored before the next to be committed."""

    def next_event(self, timeout_s: float) -> Any:
        self._waiting.rotate(1)
        return super().next_event(timeout_s)


@pytest.mark.parametrize("wave", [pytest.param(w, marks=() if w == 6 else pytest.mark.long) for w in range(1, 12)])
def test_a_driver_that_is_killed_at_the_commit_of_any_wave_is_resumed_to_the_same_store(
    wave: int, tmp_path: Path, whole: Path
) -> None:
    path = tmp_path / "a.zarr"
    killed = softclose_process(*arguments(path), "--workers", "2", env={faults.VARIABLE: f"before-commit:{wave}"})
    assert killed.returncode == -signal.SIGKILL, killed.stderr
    done = softclose("resume", str(path), "--serial", "--quiet")
    assert done.returncode == 0, done.stderr
    assert differences(path, whole) == []


# What it is for.


class Clock(SerialExecutor):
    """Many workers on a clock of its own: a block takes 0.1 s a switch of it, everything else no time."""

    def __init__(self, n_workers: int) -> None:
        super().__init__()
        self.n_workers = n_workers
        self._now, self._count = 0.0, itertools.count()
        self._running: list[tuple[float, int, BlockTask]] = []
        self.worked = 0.0

    def next_event(self, timeout_s: float) -> Any:
        prior = next((task for task in self._waiting if isinstance(task, PriorTask | StretchTask)), None)
        if prior is not None:
            self._waiting.remove(prior)
            return prior, prior.run()
        while len(self._running) < self.n_workers and self._waiting:
            task = self._waiting.popleft()
            takes = 0.1 * (task.stop - task.start) * len(task.waveforms)
            heapq.heappush(self._running, (self._now + takes, next(self._count), task))
            self.worked += takes
        if not self._running:
            return None
        self._now, _, done = heapq.heappop(self._running)
        return done, done.run()

    @property
    def busy(self) -> float:
        """Part of the workers' time in which they had a block."""
        return self.worked / (self.n_workers * self._now)


@pytest.mark.parametrize(("lag", "is_enough"), [pytest.param(1, False, marks=pytest.mark.long), (LAG, True)])
def test_looking_ahead_keeps_many_workers_busy(lag: int, is_enough: bool, tmp_path: Path) -> None:
    """A wave of four candidates is 28 blocks, fewer than there are workers."""
    sizes = ("campaign.budget=82", "optimiser.batch=4", "population.n_switches=64", f"campaign.lag={lag}")
    path = made(tmp_path / "a.zarr", *sizes)
    PriorOfStore(str(path), load_config("current", (*SETTINGS, *sizes)), keeps=True).basins()
    clock = Clock(32)
    run(path, clock)
    assert (clock.busy >= 0.85) == is_enough, clock.busy


def test_a_proposal_does_not_wait_behind_blocks_for_the_prior(tmp_path: Path) -> None:
    """While every worker has a block, the driver evaluates the prior: what it asks for would wait, and then they."""
    path, config = made(tmp_path / "a.zarr"), load_config("current", SETTINGS)
    asked: list[Any] = []

    class Asked(SerialExecutor):
        def submit(self, task: Any) -> None:
            asked.append(task)
            super().submit(task)

    def prior(is_busy: bool) -> PriorAtWork:
        return PriorAtWork(
            str(path), config, config.fingerprint(), Asked(), StopRequest(), print, print, lambda: is_busy
        )

    waveforms = Problem(config).space.waveforms(np.random.default_rng(1).random((5, 6)))
    here = prior(True).values(waveforms)
    assert not asked
    there = prior(False).values(waveforms)
    assert asked
    assert here.g_cm_s.tobytes() == there.g_cm_s.tobytes()


@pytest.mark.parametrize(("n_workers", "is_busy"), [(24, True), (25, False)])
def test_workers_are_busy_where_there_is_a_block_for_each(n_workers: int, is_busy: bool, tmp_path: Path) -> None:
    """Three waves of eight blocks are in flight at once."""
    with DriverStore(made(tmp_path / "a.zarr")) as store:
        driver = Driver(store, Clock(n_workers))
        driver.launch()
        assert driver.is_busy == is_busy
