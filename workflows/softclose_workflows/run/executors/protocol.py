"""Owns the protocol of executors: tasks in, their answers back, in any order.

Nothing in a campaign may depend on that order.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol


class Task(Protocol):
    """A piece of work that any process can do: it can be pickled, and doing it twice gives bit-identical results."""

    @property
    def name(self) -> str:
        """What it is, for messages."""
        ...

    @property
    def key(self) -> str:
        """What a scheduler calls it; no two tasks of a run have the same."""
        ...

    def run(self) -> Any:
        """Do it; what comes back."""
        ...


def run_task(task: Task) -> Any:
    """Do a piece of work: what a worker is asked for."""
    return task.run()


Event = tuple[Any, Any]
"""A task and its answer, or what it failed with."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Contact:
    """How another process of this user reaches the same cluster."""

    address: str
    """Of the scheduler."""
    environment: dict[str, str]
    """Dask's settings, with the keys themselves: of a process's environment only its user can read."""


class Executor(Protocol):
    """Runs tasks; answers come back in any order."""

    dashboard: str | None
    """Address of the dashboard, where there is one."""
    contact: Contact | None
    """How other drivers use the same workers; None where nobody can."""
    n_retries: int
    """Workers lost so far, for the status view."""

    @property
    def n_workers(self) -> int:
        """Workers connected now."""
        ...

    @property
    def has_finished(self) -> bool:
        """True where `next_event` has something to hand back at once."""
        ...

    def probe(self, store: str, fingerprint: str) -> None:
        """Ask every worker, also those to come, whether it can compute blocks of a campaign; others get none.

        store: "" where the work touches none. Raises Stopped, with the reasons, where no worker can.
        """
        ...

    def submit(self, task: Task) -> None:
        """Start one task, now or when there is room for it."""
        ...

    def next_event(self, timeout_s: float) -> Event | None:
        """The next finished task with its answer or its failure, or None after timeout_s.

        Raises Stopped when the workers or the scheduler are gone.
        """
        ...
