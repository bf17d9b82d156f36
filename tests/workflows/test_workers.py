"""Claims about a worker's setup: the kernel is there before the first task, in the form that tasks call."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from softclose import ALGORITHM, load_config
from softclose_store import open_campaign
from softclose_workflows.run.creation import create_store
from softclose_workflows.run.workers import probe

PROGRAM = """
import asyncio
import numpy as np
from softclose import Pulse, Waveform, simulate
from softclose.kernel import taylor
from softclose_workflows.run.workers import WorkerSetup

compiled = lambda: len(taylor.block(form=3, lossy=False, film=False, shaped=False, table=False).signatures)
assert compiled() == 0, compiled()
asyncio.run(WorkerSetup().setup(None))
assert compiled() == 1, compiled()
drive = Waveform([Pulse(0, 4, 5, 140), Pulse(25, 6, float("inf"), 60)])
times = np.linspace(0.0, 250.0, 51)
simulate(np.full((3, 4), [2.4, 3.7, 65.0, 3.4]), drive, times_us=times, max_impacts=8, dtype=np.float32)
assert compiled() == 1, compiled()
"""


@pytest.mark.timeout(600)  # on a fresh install it compiles
def test_a_worker_has_the_kernel_before_its_first_task() -> None:
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr


def test_a_worker_without_the_model_of_the_prior_says_so(tmp_path: Path) -> None:
    store = str(tmp_path / "a.zarr")
    known = load_config("current", ["population.n_switches=64", "store.n_times=11"])
    config = replace(known, prior=replace(known.prior, model="nowhere"))  # as on a machine that has it
    create_store(config, store)
    assert "prior.model: no device model named 'nowhere'" in probe(store, config.fingerprint(), ALGORITHM)


def test_a_worker_without_the_memory_for_a_block_says_so(finished_store: Path) -> None:
    fingerprint = open_campaign(str(finished_store)).fingerprint

    def worker(limit: int | None) -> Any:
        return SimpleNamespace(
            memory_manager=SimpleNamespace(memory_limit=limit),
            monitor=SimpleNamespace(get_process_memory=lambda: 200_000_000),
        )

    for limit in (None, 0, 10**10):
        assert probe(str(finished_store), fingerprint, ALGORITHM, worker(limit)) == ""
    assert "a worker has 0 MB left" in probe(str(finished_store), fingerprint, ALGORITHM, worker(150_000_000))
