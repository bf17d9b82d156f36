"""Owns what a worker does before its first block: it loads the kernel, and is asked whether it can do the work."""

from __future__ import annotations

import asyncio
import signal
import threading
from typing import Any

import numpy as np
from distributed import WorkerPlugin

from softclose import ALGORITHM


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


def probe(store: str, fingerprint: str, algorithm: str, dask_worker: Any = None) -> str:
    """What keeps this process from computing blocks of a campaign; empty where nothing does. store: "" for none.

    The versions, the store as it is seen from here, a write to it, the kernel, the memory: in the order in which they
    are needed. dask_worker: Dask gives it, by this very name.
    """
    from softclose_store import check_writable
    from softclose_workflows.run.block_memory import too_large_for
    from softclose_workflows.run.tasks import campaign_of

    if algorithm != ALGORITHM:
        return f"its softclose computes by algorithm {ALGORITHM}, the driver's by {algorithm}: install the same version"
    if not store:
        try:
            warm_up()
        except Exception as e:
            return f"{type(e).__name__}: {e}"
        return ""
    try:
        config, _ = campaign_of(store, fingerprint)
        config.check_models()
        check_writable(store)
        warm_up()
    except Exception as e:
        return f"{type(e).__name__}: {e}"
    limit = None if dask_worker is None else dask_worker.memory_manager.memory_limit
    return too_large_for(config, limit - dask_worker.monitor.get_process_memory()) if limit else ""
