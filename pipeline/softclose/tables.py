"""Owns how tables of a user's TOML are read: known keys, finite numbers, each with the reader's own error."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from softclose.naming import did_you_mean


def finite_number(key: str, value: Any, error: type[ValueError]) -> float:
    """The value as a float; raises `error` where it is none, or not finite."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise error(f"{key} is {value!r}; it must be a finite number")
    return float(value)


def check_keys(keys: Iterable[str], allowed: Iterable[str], where: str, error: type[ValueError]) -> None:
    """Raise `error`, naming the nearest one, for a key that is not allowed; where: how the message begins."""
    allowed = tuple(allowed)
    for key in keys:
        if key not in allowed:
            raise error(f"{where}unknown key {key!r}; {did_you_mean(key, allowed)}known: {', '.join(allowed)}")
