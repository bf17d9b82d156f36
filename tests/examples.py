"""Owns how many examples a property is tried on: a quarter in `make test`, all in `make long`."""

from __future__ import annotations

import os

WHOLE = "SOFTCLOSE_WHOLE"
"""The environment variable that `make long` sets."""


def is_whole() -> bool:
    """Whether every example is tried."""
    return bool(os.environ.get(WHOLE))


def examples(n: int) -> int:
    """Of n examples those that are tried here, five at least."""
    return n if is_whole() else min(n, max(n // 4, 5))
