"""Owns the executor of threads: tasks run in this process, several at a time. The kernel holds no lock meanwhile."""

from __future__ import annotations

import queue
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

from softclose_workflows.run.executors.protocol import Contact, Event, Task, run_task


class ThreadExecutor:
    """Runs tasks on threads of this process."""

    dashboard: str | None = None
    contact: Contact | None = None
    n_retries = 0

    def __init__(self, n_threads: int) -> None:
        self.n_workers = n_threads
        self._pool = ThreadPoolExecutor(n_threads, thread_name_prefix="softclose")
        self._events: queue.SimpleQueue[Event] = queue.SimpleQueue()

    @property
    def has_finished(self) -> bool:
        """True where an answer waits to be asked for."""
        return not self._events.empty()

    def probe(self, store: str, fingerprint: str) -> None:
        """Nothing to ask: this process loads the kernel with its first task."""

    def submit(self, task: Task) -> None:
        """Queue one task."""
        self._pool.submit(run_task, task).add_done_callback(lambda done: self._finished(task, done))

    def _finished(self, task: Task, done: Future[Any]) -> None:
        if not done.cancelled():
            self._events.put((task, done.exception() or done.result()))

    def next_event(self, timeout_s: float) -> Event | None:
        """The next finished task, or None after timeout_s."""
        try:
            return self._events.get(timeout=timeout_s)
        except queue.Empty:
            return None

    def close(self) -> None:
        """Wait for what runs, and forget the rest."""
        self._pool.shutdown(cancel_futures=True)
