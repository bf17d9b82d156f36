"""Owns how the integration of a switch may end, and what is said of those that ended before the horizon."""

from __future__ import annotations

import enum

import numpy as np
from numpy.typing import ArrayLike


class Status(enum.IntEnum):
    """How the integration of one switch ended."""

    OK = 0
    """Reached the horizon."""
    WORK_LIMIT = 1
    """Gave up after `max_steps` steps."""
    COLLAPSED = 2
    """The electrode reached its counter-electrode, before the contact or behind it: nothing holds it off there."""
    LEFT_TABLE = 3
    """The electrode left the range of its table of capacitance, below or above."""


WORDS = {
    Status.WORK_LIMIT: "took too many steps",
    Status.COLLAPSED: "collapsed onto the counter-electrode",
    Status.LEFT_TABLE: "left the table of capacitance",
}
"""What is said of switches that ended so."""


def not_integrated(n_failed: int, n: int) -> str:
    """`3 of 50 switches could not be integrated`; empty where all could."""
    return f"{n_failed:,} of {n:,} switches could not be integrated" if n_failed else ""


def reasons(status: ArrayLike) -> str:
    """`3 of 50 switches could not be integrated: 3 collapsed onto the counter-electrode`; empty where all could.

    status: (n,) `Status`, or a number of a model's own.
    """
    found = np.asarray(status)
    failed = found[found != Status.OK]
    if not failed.size:
        return ""
    kinds, counts = np.unique(failed, return_counts=True)
    known = {int(s): words for s, words in WORDS.items()}
    each = [f"{c:,} {known.get(int(k), f'ended with status {int(k)}')}" for k, c in zip(kinds, counts, strict=True)]
    return f"{not_integrated(failed.size, found.size)}: {', '.join(each)}"
