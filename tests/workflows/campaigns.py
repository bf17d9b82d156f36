"""Owns the small campaign that the workflow tests run, and ways to run it: here, or in a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

from click.testing import CliRunner

from forked import Forked
from softclose_store import store_state
from softclose_workflows.cli import main

SMALL = (
    "campaign.budget=8",
    "prior.model=none",
    "population.n_switches=60",
    "compute.block_switches=25",
    "store.n_times=51",
    "optimiser.n_initial=4",
    "optimiser.batch=1",
)
"""Three blocks a candidate; a wave of four design points, then four of the surrogate, one a wave."""

LED = (
    "population.n_switches=40",
    "store.n_times=11",
    "store.max_impacts=3",
    "explore.generation=6",
    "explore.n_scouts=6",
    "optimiser.n_regions=2",
    "optimiser.batch=2",
    "prior.n_switches=24",
    "prior.n_exploring=12",
    "prior.budget=60",
    "prior.n_descents=2",
    "prior.polish=14",
    "prior.looks=24",
)
"""Waves of two candidates, by a Gaussian process that starts from a prior whose basins are found in a second."""


def command(*arguments: str) -> list[str]:
    """The command line of `softclose` under this interpreter."""
    return [sys.executable, "-m", "softclose_workflows", *arguments]


def run_arguments(store: Path, *settings: str, preset: str = "current") -> list[str]:
    """Arguments of `softclose run` for the small campaign."""
    sets = [part for setting in (*SMALL, *settings) for part in ("--set", setting)]
    return ["run", preset, "--store", str(store), "--quiet", *sets]


def softclose(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run `softclose` in this process to its end; its exit code, and what it printed. An error it does not tell raises.

    A process of its own costs seconds of imports: for tests in which it dies, or sees another environment.
    """
    done = CliRunner().invoke(main, list(arguments))
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    return subprocess.CompletedProcess(arguments, done.exit_code, done.stdout, done.stderr)


def softclose_process(
    *arguments: str,
    env: dict[str, str] | None = None,
    timeout: float = 180.0,
) -> subprocess.CompletedProcess[str]:
    """Run `softclose` in a process of its own to its end and return what it printed."""
    environment = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"} | (env or {})
    process = Forked(*arguments, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    try:
        stdout, stderr = process.communicate(timeout)
    finally:
        process.kill()
    return subprocess.CompletedProcess(arguments, process.wait(), stdout, stderr)


def until(true: Callable[[], object], seconds: float = 120.0) -> None:
    """Wait for something that other processes bring about; fail after so long."""
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end
        time.sleep(0.05)


def committed(store: Path) -> int:
    """Committed candidates; 0 where there is no store yet."""
    return store_state(str(store)).n_committed if store.exists() else 0
