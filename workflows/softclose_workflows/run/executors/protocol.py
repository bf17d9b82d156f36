"""Owns the protocol of executors: tasks in, finished blocks back, in any order.

Nothing in a campaign may depend on that order.
"""

from __future__ import annotations

from typing import Protocol

from softclose_workflows.run.tasks import ChunkResult, ChunkTask

Event = tuple[ChunkTask, ChunkResult | BaseException]


class Executor(Protocol):
    """Runs chunk tasks; results come back in any order."""

    dashboard: str | None
    """Address of the dashboard, where there is one."""
    n_retries: int
    """Workers lost so far, for the status view."""

    @property
    def n_workers(self) -> int:
        """Workers connected now."""
        ...

    def submit(self, task: ChunkTask) -> None:
        """Start one chunk."""
        ...

    def next_event(self, timeout_s: float) -> Event | None:
        """The next finished chunk with its result or its failure, or None after timeout_s.

        Raises Stopped when the workers or the scheduler are gone.
        """
        ...
