"""Owns what a Dask worker does before its first block."""

from __future__ import annotations

import asyncio
import signal
import threading
from typing import Any

import numpy as np
from distributed import WorkerPlugin


class WorkerSetup(WorkerPlugin):
    """Leaves Ctrl-C to the driver, and loads the compiled kernel before the first block needs it."""

    async def setup(self, worker: Any) -> None:
        """Runs once in each worker, also in one that replaces a dead one."""
        if threading.current_thread() is threading.main_thread():
            # The terminal sends Ctrl-C to the whole group; the driver decides what is finished first.
            signal.signal(signal.SIGINT, signal.SIG_IGN)
        # Beside the event loop: a worker that compiles for a minute still answers its scheduler.
        await asyncio.to_thread(warm_up)


def warm_up() -> None:
    """Compile the kernel, or load it from numba's cache: half a second to half a minute that no task should wait for.

    One switch, as tasks ask for it: x and v in float32, impacts kept.
    """
    from softclose import Pulse, Waveform, simulate

    drive = Waveform([Pulse(0.0, 4.0, 4.0, 100.0)])
    simulate([[2.4, 3.7, 65.0, 3.4]], drive, horizon_us=20.0, times_us=[0.0], max_impacts=1, dtype=np.float32)
