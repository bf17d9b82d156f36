"""Owns running the generated series as plain Python: what a recurrence says is tested without compiling it."""

from __future__ import annotations

import re
from typing import Any


def functions_of(*texts: str) -> dict[str, Any]:
    """The functions of generated modules by their names, those of `series` first; nothing is compiled by numba."""
    made: dict[str, Any] = {}
    for text in texts:
        plain = text.replace("from softclose.kernel.series import _FAST", "")
        exec(re.sub(r"@njit\(.*\)", "", plain), made)
    return made
