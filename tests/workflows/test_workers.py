"""Claims about a worker's setup: the kernel is there before the first task, in the form that tasks call."""

from __future__ import annotations

import subprocess
import sys

import pytest

PROGRAM = """
import asyncio
import numpy as np
from softclose import Pulse, Waveform, simulate
from softclose.kernel import taylor
from softclose_workflows.run.workers import WorkerSetup

compiled = lambda: len(taylor.run_block.signatures)
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
