"""Owns what a fault of the machine leads to: the work is tried elsewhere a few times, then the run stops."""

from __future__ import annotations

import errno
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol

from softclose_workflows.errors import Stopped

MAX_TRIES = 3
"""How often one task is tried, and how many workers it may kill, before the run stops."""

_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EROFS)


class Failed(Protocol):
    """What is told of a task that failed."""

    @property
    def name(self) -> str:
        """For messages."""
        ...

    @property
    def key(self) -> str:
        """Tells the tasks of one count apart."""
        ...


@dataclass(slots=True, eq=False)
class Retries:
    """The one policy: a task that met a fault of the machine is submitted again, until it was tried `MAX_TRIES` times.

    What the executor itself says (Stopped) ends the run at once, and so does what another try would meet again.
    """

    submit: Callable[[Any], None]
    """Starts a task once more."""
    _tries: Counter[str] = field(default_factory=Counter)

    def again(self, task: Failed, failure: BaseException) -> None:
        """Try a task that failed once more. Raises Stopped where it is not to be tried again."""
        if isinstance(failure, Stopped):
            raise failure
        self._tries[task.key] += 1
        n = self._tries[task.key]
        if n >= MAX_TRIES or _stops_at_once(failure):
            tried = "once" if n == 1 else f"{n} times"
            raise Stopped(
                f"{task.name} could not be computed, tried {tried} ({type(failure).__name__}: {failure}); nothing of "
                "it is recorded"
            ) from failure
        self.submit(task)


def _stops_at_once(failure: BaseException) -> bool:
    """True where another try would meet the same: a disk that is full or cannot be written."""
    return isinstance(failure, OSError) and failure.errno in _NO_ROOM
