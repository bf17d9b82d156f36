"""Owns reading a table of what was measured of one waveform: one device a line, always in the same order."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softclose.datafiles import TableError
from softclose.datafiles.errors import Unfit
from softclose.datafiles.headings import Columns, Heading, NeededColumn
from softclose.datafiles.reading import read_table
from softclose_workflows.errors import BenchError

NAMES = ("speed_cm_s", "closed", "status")
"""Columns that a table of readings may have; the first has to be there."""
_YES_OR_NO = {"true": True, "yes": True, "1": True, "closed": True, "false": False, "no": False, "0": False}
_YES_OR_NO["open"] = False
_NOTHING = ("", "nan", "na", "n/a", "-", "missing")


@dataclass(frozen=True, slots=True, kw_only=True)
class Readings:
    """What `Bench.tell` takes."""

    speeds_cm_s: np.ma.MaskedArray[Any, Any]
    """(n,) NaN where there is none, masked where nothing was read."""
    closed: NDArray[np.bool_] | None
    """(n,) whether each was closed; None where the table has no such column."""
    status: NDArray[np.int8] | None
    """(n,) None where the table has no such column."""


def read_readings(path: str) -> Readings:
    """Read a table with a column `speed_cm_s`, and `closed` (yes or no) and `status` where there are such.

    A device whose speed and `closed` are both empty was not read. Raises BenchError, naming the line.
    """
    try:
        table = read_table(path, _chosen)
    except TableError as e:
        raise BenchError(str(e)) from e
    n = len(table.lines)
    words = {name: [word.strip().casefold() for word in column] for name, column in table.texts.items()}
    speeds = table.numbers[NAMES[0]]
    closed, missing = None, np.zeros(n, dtype=np.bool_)
    if "closed" in words:
        missing = np.array([word in _NOTHING for word in words["closed"]])
        closed = np.zeros(n, dtype=np.bool_)
        for i, (word, line) in enumerate(zip(words["closed"], table.lines, strict=True)):
            if missing[i] and not math.isnan(speeds[i]):
                raise BenchError(f"{path}, line {line}: a speed, and not whether it closed; write yes or no")
            if not missing[i]:
                if word not in _YES_OR_NO:
                    raise BenchError(f"{path}, line {line}: closed is {word!r}; write yes or no, or nothing")
                closed[i] = _YES_OR_NO[word]
    status = None
    if "status" in words:
        status = np.array([_status(w, f"{path}, line {k}") for w, k in zip(words["status"], table.lines, strict=True)])
    return Readings(speeds_cm_s=np.ma.array(speeds, mask=missing), closed=closed, status=status)


def _chosen(heading: Heading) -> Columns:
    places = {name.strip().casefold(): i for i, name in enumerate(heading.names)}
    if NAMES[0] not in places:
        has = ", ".join(map(repr, filter(None, heading.names))) or "nothing"
        raise Unfit(f"no column 'speed_cm_s': the heading has {has}", line=heading.line or 1, fitted=0.0)
    return Columns(
        numbers={NAMES[0]: NeededColumn(index=places[NAMES[0]])},
        texts={name: places[name] for name in NAMES[1:] if name in places},
        gappy=frozenset(NAMES[:1]),
    )


def _status(word: str, where: str) -> int:
    if word in _NOTHING:
        return 0
    try:
        return int(word)
    except ValueError as e:
        raise BenchError(f"{where}: status is {word!r}; write a whole number from 0 to 126") from e
