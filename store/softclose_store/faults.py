"""Owns named fault points: for tests only, no-ops unless the environment variable SOFTCLOSE_FAULT names one.

`SOFTCLOSE_FAULT=before-commit:3` kills this process with SIGKILL at its third passage of `before-commit`;
`SOFTCLOSE_FAULT=inside-chunk-write:1:raise-enospc` raises "no space left on device" there (once). Entries are
separated by commas. The variable is inherited by workers, so a point fires in every process that reaches it.
"""

from __future__ import annotations

import errno
import os
import signal
from collections import Counter

VARIABLE = "SOFTCLOSE_FAULT"

POINTS = (
    "inside-creation",
    "inside-chunk-write",
    "before-marker",
    "after-marker",
    "before-record",
    "inside-record",
    "after-record",
    "before-commit",
    "after-commit",
)
"""Every durability step, in the order of a wave's life: its blocks, the rows of its records, its commit."""

PART_POINT = "inside-part"
"""Before each part of a group that is written a part at a time: trajectories of releases, actuations, certificates."""

PRIOR_POINTS = ("finding-basins", "before-basins", "inside-group", "after-basins")
"""The steps of a prior's basins, before the first wave: of a campaign that has one. `inside-group` is passed before
each file of any result group."""

_passages: Counter[str] = Counter()


def point(name: str) -> None:
    """Pass the fault point `name`; does nothing in a run that does not ask for a fault."""
    plan = os.environ.get(VARIABLE)
    if not plan:
        return
    _passages[name] += 1
    for entry in plan.split(","):
        wanted, _, rest = entry.strip().partition(":")
        count, _, action = rest.partition(":")
        if wanted == name and _passages[name] == int(count or 1):
            if action in ("", "kill"):
                os.kill(os.getpid(), signal.SIGKILL)
            elif action == "raise-enospc":
                raise OSError(errno.ENOSPC, f"{os.strerror(errno.ENOSPC)} (fault point {name})")
            else:
                raise ValueError(f"{VARIABLE} asks for {action!r}; known actions are kill and raise-enospc")
