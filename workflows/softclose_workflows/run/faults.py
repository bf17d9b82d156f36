"""Owns what a fault of the machine leads to: the work is tried elsewhere, or the run stops."""

from __future__ import annotations

import errno

MAX_TRIES = 3
"""How often one block is tried, and how many workers it may kill, before the run stops."""

_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EROFS)


def stops_at_once(failure: BaseException) -> bool:
    """True where another try would meet the same: a disk that is full or cannot be written."""
    return isinstance(failure, OSError) and failure.errno in _NO_ROOM
