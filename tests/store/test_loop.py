"""Claims about who runs zarr's coroutines for a service."""

from __future__ import annotations

import subprocess
import sys

ENDS = """
import atexit, sys, threading

def left():
    print([t.name for t in threading.enumerate() if t.name == "softclose-store"])

atexit.register(left)  # the first to be registered runs last

from zarr.storage import FsspecStore
from softclose_store.disk.loop import run_here

async def work():
    return threading.current_thread().name

print(run_here(work(), FsspecStore.from_url("memory://somewhere")))
sys.exit(3)
"""


def test_the_thread_of_a_service_has_ended_before_the_interpreter_does() -> None:
    """Otherwise a thread of the service's library aborts the process now and then (4 % on a busy machine)."""
    done = subprocess.run([sys.executable, "-c", ENDS], capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stdout.split("\n")[:2]) == (3, ["softclose-store", "[]"]), done.stderr
