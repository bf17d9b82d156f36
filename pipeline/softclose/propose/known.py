"""Owns what is remembered of records: a proposal looks at thousands of them that the one before has looked at.

Records are held against those that an answer was worked out from. They are the same objects as a rule, which costs
nothing to see; where they are not equal, the answer is worked out again.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from typing import Any, TypeVar

import numpy as np

from softclose.arrays import FloatArray
from softclose.propose.protocol import Observation, Problem

WorkedOut = TypeVar("WorkedOut")


def remembered(
    problem: Problem, key: Hashable, records: Sequence[Observation], work_out: Callable[[list[Observation]], WorkedOut]
) -> WorkedOut:
    """What `work_out` says of these records: from before, where the last question of this key was of the same ones."""
    asked = list(records)
    before: tuple[list[Observation], Any] | None = problem.known.get(key)
    if before is None or before[0] != asked:
        before = problem.known[key] = asked, work_out(asked)
    answer: WorkedOut = before[1]
    return answer


def column(
    problem: Problem, key: Hashable, records: Sequence[Observation], value: Callable[[Observation], float]
) -> FloatArray:
    """(n,) `value` of each record, of which those that are new since the last question of this key are looked at."""
    asked = list(records)
    seen, values = problem.known.get(key, ([], np.empty(0)))
    n = min(len(seen), len(asked))
    if seen[:n] != asked[:n]:
        seen, values, n = [], np.empty(0), 0
    if len(asked) > len(seen):
        values = np.concatenate([values, [value(o) for o in asked[n:]]])
        problem.known[key] = asked, values
    return np.array(values[: len(asked)])
