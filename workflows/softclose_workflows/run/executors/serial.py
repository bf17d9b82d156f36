"""Owns the serial executor: tasks run in this process, one after the other. For debugging and tests."""

from __future__ import annotations

from collections import deque

from softclose_workflows.run.executors.protocol import Contact, Event, Task, run_task


class SerialExecutor:
    """Runs each task in this process, when its answer is asked for."""

    n_workers = 1
    dashboard: str | None = None
    contact: Contact | None = None
    n_retries = 0
    has_finished = False

    def __init__(self) -> None:
        self._waiting: deque[Task] = deque()

    def probe(self, store: str, fingerprint: str) -> None:
        """Nothing to ask: this process has the store open, and loads the kernel with its first task."""

    def submit(self, task: Task) -> None:
        """Queue one task."""
        self._waiting.append(task)

    def next_event(self, timeout_s: float) -> Event | None:
        """Do the oldest queued task."""
        if not self._waiting:
            return None
        task = self._waiting.popleft()
        try:
            return task, run_task(task)
        except Exception as e:
            return task, e
