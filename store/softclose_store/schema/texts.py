"""Owns reading JSON that comes out of a store: of bounded size and depth, and of finite numbers."""

from __future__ import annotations

import json
import re
from typing import Any, NoReturn

import numpy as np

MOST_DEEP = 64
"""Most brackets around anything. The metadata of a store are ten deep, and a configuration six."""

_STRINGS = re.compile(rb'"(?:[^"\\]|\\.)*"', re.DOTALL)


def read_json(content: bytes) -> Any:
    """The value that JSON text says.

    Parameters
    ----------
    content : bytes
        UTF-8 text, whose size whoever read it has bounded.

    Returns
    -------
    object

    Raises
    ------
    ValueError
        For what is no JSON, deeper than `MOST_DEEP`, or says NaN or infinity.
    """
    if _depth(content) > MOST_DEEP and _depth(_STRINGS.sub(b"", content)) > MOST_DEEP:
        raise ValueError(f"it is nested more than {MOST_DEEP} deep")
    try:
        return json.loads(content, parse_constant=_refuse)
    except RecursionError as e:
        raise ValueError("it is nested too deep") from e


def _depth(content: bytes) -> int:
    """Most brackets that are open at once, those within strings included."""
    text = np.frombuffer(content, dtype=np.uint8) | 0x20  # [ and {, ] and } differ by this bit
    steps = (text == ord("{")).astype(np.int8) - (text == ord("}")).astype(np.int8)
    return int(np.cumsum(steps, dtype=np.int64).max(initial=0))


def _refuse(name: str) -> NoReturn:
    raise ValueError(f"{name} is no number of JSON")
