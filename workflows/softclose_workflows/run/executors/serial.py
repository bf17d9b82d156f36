"""Owns the serial executor: blocks run in this process, one after the other. For debugging and tests."""

from __future__ import annotations

from collections import deque

from softclose_workflows.run.executors.protocol import Contact, Event
from softclose_workflows.run.tasks import BlockTask, run_block


class SerialExecutor:
    """Runs each block in this process, when its result is asked for."""

    n_workers = 1
    dashboard: str | None = None
    contact: Contact | None = None
    n_retries = 0
    has_finished = False

    def __init__(self) -> None:
        self._waiting: deque[BlockTask] = deque()

    def probe(self, store: str, fingerprint: str) -> None:
        """Nothing to ask: this process has the store open, and loads the kernel with its first block."""

    def submit(self, task: BlockTask) -> None:
        """Queue one block."""
        self._waiting.append(task)

    def next_event(self, timeout_s: float) -> Event | None:
        """Compute the oldest queued block."""
        if not self._waiting:
            return None
        task = self._waiting.popleft()
        try:
            return task, run_block(task)
        except Exception as e:
            return task, e
