"""Owns how much of a claim is tried in `make test`, where `make long` tries all of it."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import Any

import pytest
from _pytest.mark import ParameterSet

LONG = pytest.mark.long
WHOLE = "SOFTCLOSE_WHOLE"
"""The environment variable that `make long` sets."""


def is_whole() -> bool:
    """Whether every example is tried."""
    return bool(os.environ.get(WHOLE))


def examples(n: int) -> int:
    """Of n examples those that are tried here, five at least."""
    return n if is_whole() else min(n, max(n // 4, 5))


def in_turn(cases: Iterable[Any], step: int, first: int = 0) -> list[ParameterSet]:
    """Parameters of which each step-th is tried here, from `first` on; the others are long.

    Several at a time are a `pytest.param`.
    """
    sets = [case if isinstance(case, ParameterSet) else pytest.param(case) for case in cases]
    return [
        case if i % step == first % step else pytest.param(*case.values, marks=(*case.marks, LONG), id=case.id)
        for i, case in enumerate(sets)
    ]
