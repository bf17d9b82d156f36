"""Owns what is gathered from pieces: each has its place in the whole, in memory, or in a file where that is large.

A certificate of ten candidates on a million switches is 360 MB of which one design is looked at at a time.
"""

from __future__ import annotations

import mmap
import os
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from softclose.metrics.objective import Judged

MOST_BYTES = 64_000_000
"""Responses up to this size are kept in memory."""

NAMES = tuple(field.name for field in fields(Judged))


@dataclass(frozen=True, slots=True)
class _Place:
    """Where a column lies in a file."""

    offset: int
    dtype: np.dtype[Any]
    shape: tuple[int, ...]

    @property
    def row_bytes(self) -> int:
        return int(self.dtype.itemsize * np.prod(self.shape[1:], dtype=np.int64))


class Gathering:
    """What is judged of n switches under each of several drives, put in its place as pieces of it come.

    What is large goes into a file without a name, in the folder for temporary files: its arrays are read from there
    when they are looked at, and the file is gone with the last of them.
    """

    def __init__(self, n_drives: int, n: int) -> None:
        self._n_drives, self._n = n_drives, n
        self._untold: set[tuple[int, str]] = set()
        self._arrays: dict[tuple[int, str], NDArray[Any]] = {}
        self._places: dict[tuple[int, str], _Place] = {}
        self._file: IO[bytes] | None = None
        self._end = 0

    def put(self, drive: int, start: int, part: Judged) -> None:
        """Keep what is judged of the switches from `start` on under one drive. Every switch comes once."""
        columns = {name: values for name in NAMES if (values := getattr(part, name)) is not None}
        if not self._arrays and not self._places:
            self._begin(columns)
        for name in NAMES:
            if name not in columns:
                self._untold.add((drive, name))
                continue
            place, values = (drive, name), np.ascontiguousarray(columns[name])
            if self._file is None:
                if place not in self._arrays:
                    self._arrays[place] = np.empty((self._n, *values.shape[1:]), values.dtype)
                self._arrays[place][start : start + len(values)] = values
                continue
            if place not in self._places:
                self._places[place] = at = _Place(self._end, values.dtype, (self._n, *values.shape[1:]))
                self._end += -(-at.row_bytes * self._n // mmap.ALLOCATIONGRANULARITY) * mmap.ALLOCATIONGRANULARITY
            at = self._places[place]
            _write(self._file, values.reshape(-1).view(np.uint8).data, at.offset + start * at.row_bytes)

    def _begin(self, columns: Mapping[str, NDArray[Any]]) -> None:
        """Decide where it is kept, by the first piece of it."""
        row = sum(values.nbytes // len(values) for values in columns.values())
        if row * self._n * self._n_drives > MOST_BYTES:
            self._file = tempfile.TemporaryFile()  # noqa: SIM115 -- lives as long as what is mapped from it

    def judged(self) -> list[Judged]:
        """What is judged under each drive; a column that a piece of it did not tell is None."""
        if self._file is not None:
            self._file.truncate(self._end)  # also where a last piece did not tell a column
            for place, at in self._places.items():
                self._arrays[place] = _mapped(self._file, at)
            self._file.close()  # a mapping has a handle of its own
            self._file = None
        found = []
        for drive in range(self._n_drives):
            told = [name for name in NAMES if (drive, name) not in self._untold]
            columns: dict[str, Any] = dict.fromkeys(NAMES) | {name: self._arrays[drive, name] for name in told}
            found.append(Judged(**columns))
        return found


def _write(file: IO[bytes], content: memoryview, offset: int) -> None:
    while len(content):
        done = os.pwrite(file.fileno(), content, offset)
        content, offset = content[done:], offset + done


def _mapped(file: IO[bytes], at: _Place) -> NDArray[Any]:
    whole = mmap.mmap(file.fileno(), at.row_bytes * at.shape[0], access=mmap.ACCESS_READ, offset=at.offset)
    return np.frombuffer(whole, at.dtype).reshape(at.shape)


def put_aside(*arrays: NDArray[Any] | None) -> None:
    """Take arrays that lie in a file out of memory, until they are looked at again; others stay as they are."""
    for array in arrays:
        base: Any = array
        while isinstance(base, np.ndarray):
            base = base.base
        base = getattr(base, "obj", base)  # a memoryview's own
        if isinstance(base, mmap.mmap) and hasattr(mmap, "MADV_DONTNEED"):
            base.madvise(mmap.MADV_DONTNEED)


def put_judged_aside(judged: Judged) -> None:
    """`put_aside` of all that is judged."""
    put_aside(*(getattr(judged, name) for name in NAMES))
