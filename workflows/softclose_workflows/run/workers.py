"""Owns what a Dask worker does before its first block."""

from __future__ import annotations

import signal
import threading
from typing import Any

from distributed import WorkerPlugin


class WorkerSetup(WorkerPlugin):
    """Leaves Ctrl-C to the driver, and loads the compiled kernel before the first block needs it."""

    def setup(self, worker: Any) -> None:
        """Runs once in each worker, also in one that replaces a dead one."""
        if threading.current_thread() is threading.main_thread():
            # The terminal sends Ctrl-C to the whole group; the driver decides what is finished first.
            signal.signal(signal.SIGINT, signal.SIG_IGN)
