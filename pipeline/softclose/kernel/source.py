"""Owns how kernels are compiled: the fingerprint that keeps numba's cache from serving stale code, and an option."""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import Any

from numba.core.options import DefaultOptions

# The kernels allocate nothing, yet numba would count references to their arrays: 5-15 % of the time, and more where
# many are passed on. The option is private, hence asked for only where it exists.
UNCOUNTED: dict[str, Any] = {"_nrt": False} if hasattr(DefaultOptions, "_nrt") else {}
_FILES = (
    "series",
    "lossy_series",
    "drive_series",
    "step",
    "expansion",
    "samples",
    "bounces",
    "contact",
    "release",
    "pieces",
    "results",
    "rk",
    "taylor",
    "modes_series",
    "shaped_series",
    "table_series",
    "cells",
    "two_modes",
    "modal",
)


def fingerprint() -> int:
    """CRC of every file that a kernel's machine code is made of.

    numba checks the file of the cached function only, not those of the functions that it calls: after an update that
    changes `series.py` alone, the old code would go on running. Its cache is also keyed by the values a function
    closes over, so an entry point that closes over this number is compiled again whenever one of the files changes.
    """
    crc = 0
    here = Path(__file__).parent
    for path in (*(here / f"{name}.py" for name in _FILES), here.parent / "waveform" / "lowpass.py"):
        crc = zlib.crc32(path.read_bytes(), crc)
    return crc
