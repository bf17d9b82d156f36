"""Owns the process that a local cluster's workers are forked from: it imports, once, what each of them needs.

It begins with the command, beside the imports of this process, and serves as many workers as there are, also those that
take a dead one's place.
"""

from __future__ import annotations

import os
import sys

METHOD = "forkserver" if sys.platform == "linux" else "spawn"
"""How workers start. Elsewhere the system's own libraries do not bear a fork: each worker imports for itself."""

PRELOADED = "softclose_workflows.run.preloaded"
"""Imports it all."""

ALLOCATOR = {"MALLOC_TRIM_THRESHOLD_": 2**28, "MALLOC_MMAP_THRESHOLD_": 2**25}
"""Environment of a local worker's C library [bytes].

Blocks of one size follow each other: memory that is handed back after each is fetched and cleared again page by page, a
quarter of a large block's time. Dask hands back all above 64 KiB.
"""

_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def start_ahead() -> None:
    """Start it, where it does not run: it imports while this process does other things."""
    if METHOD != "forkserver":
        return
    from multiprocessing import forkserver

    # The C library and numerical libraries read the environment as they start, which is now. Workers get the rest of it
    # as it is when they begin, and may do nothing that was allowed to an earlier run of this process.
    before = dict(os.environ)
    try:
        for name in before:
            if name.startswith("SOFTCLOSE"):
                del os.environ[name]
        os.environ.update({name: str(size) for name, size in ALLOCATOR.items()} | dict.fromkeys(_ONE_THREAD, "1"))
        forkserver.set_forkserver_preload([PRELOADED])
        forkserver.ensure_running()
    finally:
        for name in os.environ.keys() - before.keys():
            del os.environ[name]
        os.environ.update(before)
