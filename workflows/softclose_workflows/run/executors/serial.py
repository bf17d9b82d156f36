"""Owns the serial executor: chunks run in this process, one after the other. For debugging and tests."""

from __future__ import annotations

from collections import deque

from softclose_workflows.run.executors.protocol import Event
from softclose_workflows.run.tasks import ChunkTask, run_chunk


class SerialExecutor:
    """Runs each chunk in this process, when its result is asked for. For debugging and tests."""

    n_workers = 1
    dashboard: str | None = None
    n_retries = 0

    def __init__(self) -> None:
        self._waiting: deque[ChunkTask] = deque()

    def submit(self, task: ChunkTask) -> None:
        """Queue one chunk."""
        self._waiting.append(task)

    def next_event(self, timeout_s: float) -> Event | None:
        """Compute the oldest queued chunk."""
        if not self._waiting:
            return None
        task = self._waiting.popleft()
        try:
            return task, run_chunk(task)
        except Exception as e:
            return task, e
