"""Owns when a limit passes and when it fails: the interval decides, not the estimate."""

from __future__ import annotations

from typing import Literal

from softclose.evaluate.quantities import Quantity, Value

LineVerdict = Literal["pass", "fail", "not established", "not judged"]


def verdict_of(q: Quantity, value: Value, limit: float | None) -> LineVerdict:
    """The interval decides, not the estimate: pass and fail need all of it on one side of the limit."""
    if limit is None:
        return "not judged"
    low, high = value.interval
    if q.better == "high":
        low, high, limit = -high, -low, -limit
    if high <= limit:
        return "pass"
    return "fail" if low > limit else "not established"
