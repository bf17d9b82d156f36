"""Owns the fingerprint of the kernels' source, which keeps numba's cache from serving stale machine code."""

from __future__ import annotations

import zlib
from pathlib import Path


def fingerprint() -> int:
    """CRC of every file that a kernel's machine code is made of.

    numba checks the file of the cached function only, not those of the functions that it calls: after an update that
    changes `series.py` alone, the old code would go on running. Its cache is also keyed by the values a function
    closes over, so an entry point that closes over this number is compiled again whenever one of the files changes.
    """
    crc = 0
    for name in ("series", "contact", "release", "pieces", "rk", "taylor"):
        crc = zlib.crc32((Path(__file__).parent / f"{name}.py").read_bytes(), crc)
    return crc
