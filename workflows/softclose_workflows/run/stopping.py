"""Owns the answer to Ctrl-C and SIGTERM: the first finishes what is in flight, the second stops at once.

Python runs a handler between two of its own instructions. A library that never returns (OpenBLAS without memory for its
buffers) would keep it from running for ever, so that a small process beside this one counts the signals too.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from types import FrameType

from softclose_workflows.errors import Stopped

GRACE_S = 10.0
"""How long after the second signal a run may still take to end by itself [s]."""

_WATCH = f"""
import os, select, signal
stop = signal.SIGINT, signal.SIGTERM
for number in stop:
    signal.signal(number, signal.SIG_IGN)
parent, left = os.getppid(), 2
while left > 0:
    received = os.read(0, 1)
    if not received:
        raise SystemExit
    left -= received[0] in stop
if not select.select([0], [], [], {GRACE_S})[0] or os.read(0, 1):
    os.kill(parent, signal.SIGKILL)
"""


class StopRequest:
    """Set by the first signal; the campaign looks at it between candidates."""

    def __init__(self) -> None:
        self.signal_name: str | None = None

    def __bool__(self) -> bool:
        return self.signal_name is not None

    def receive(self, number: int, frame: FrameType | None) -> None:
        """The signal handler."""
        name = signal.Signals(number).name
        if self.signal_name is not None:
            raise Stopped(f"stopped at once by a second {name}")
        self.signal_name = name


@contextlib.contextmanager
def stop_on_signals() -> Iterator[StopRequest]:
    """Listen for SIGINT and SIGTERM inside the block. In a thread other than the main one nothing is installed."""
    request = StopRequest()
    if threading.current_thread() is not threading.main_thread():
        yield request
        return
    with _watched():
        yield from _with_handlers(request)


def _with_handlers(request: StopRequest) -> Iterator[StopRequest]:
    previous = {number: signal.signal(number, request.receive) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield request
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def _watched() -> Iterator[None]:
    """Beside the block, a process that ends this one where a second signal does not, or a third comes."""
    ours, theirs = os.pipe()
    os.set_blocking(theirs, False)  # what a signal may write to
    try:
        watch = subprocess.Popen([sys.executable, "-I", "-S", "-c", _WATCH], stdin=ours)
    except OSError:  # no room for another process: the handlers have to do
        os.close(theirs)
        yield
        return
    finally:
        os.close(ours)
    previous = signal.set_wakeup_fd(theirs, warn_on_full_buffer=False)
    try:
        yield
    finally:
        signal.set_wakeup_fd(previous)
        os.close(theirs)
        watch.wait()
