"""Owns how the rows of a wave enter the tables: checked, typed, with their digests, and whole chunks on the disk."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence, Set
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray

from softclose_store import faults
from softclose_store.disk.loop import run_here
from softclose_store.errors import RecordError
from softclose_store.read.described import DescribedFiles
from softclose_store.read.table import MARKERS, N_WALL, PROPOSAL, RECORD, RecordTable
from softclose_store.schema.fields import (
    N_SURROGATE,
    N_SWITCHES,
    PARAMETERS,
    PROPOSALS,
    RESULTS,
    WALL,
    WORDS,
    Field,
    unit_in,
)
from softclose_store.schema.hierarchy import HYPERPARAMETER, HYPERPARAMETER_UNIT, TABLES
from softclose_store.schema.layout import Layout

Arrays = Mapping[str, zarr.AsyncArray[Any]]

PROPOSED = frozenset(("waveform", "design", "origin", "note", "surrogate", *(field.name for field in PROPOSALS)))
"""What a proposal says."""
ASSESSED = frozenset(("failure", *(field.name for field in RESULTS)))
"""What an assessment says."""
TIMED = frozenset(field.name for field in WALL[:N_WALL])
"""What the clock says."""


def check_names(row: Mapping[str, Any], allowed: Set[str]) -> None:
    """Raise RecordError for a name that a row may not have."""
    for name in row.keys() - allowed:
        near = difflib.get_close_matches(name, sorted(allowed), n=1)
        hint = f"; did you mean {near[0]}?" if near else f"; known are {', '.join(sorted(allowed))}"
        raise RecordError(f"a row has no field {name!r}{hint}")


def set_proposal(table: RecordTable, i: int, row: Mapping[str, Any], hyperparameters: list[str]) -> int:
    """Set the proposal of candidate i, in memory; returns its digest. New names join `hyperparameters`."""
    layout = table.layout
    check_waveform(layout, row)
    record = table.records[i]
    record[: layout.n_proposal_fields] = np.nan
    waveform = np.atleast_2d(np.asarray(row["waveform"], dtype=np.float64))
    record[: waveform.size] = waveform.reshape(-1)
    at = layout.n_pulses * len(PARAMETERS)
    record[at : at + len(layout.designs)] = design_of(layout, row)
    for k, field in enumerate(PROPOSALS, at + len(layout.designs)):
        value = row.get(field.name)
        record[k] = field.fill if value is None else _number(field, value)
    _set_words(table, i, row, "proposal")
    values = np.full(N_SURROGATE, np.nan)
    for name, value in dict(row.get("surrogate") or {}).items():
        if name not in hyperparameters:
            if not isinstance(name, str) or not name or "\0" in name or len(hyperparameters) == N_SURROGATE:
                raise RecordError(
                    f"the surrogate's {name!r} cannot be stored; a campaign has up to {N_SURROGATE} quantities of "
                    "surrogates, all named"
                )
            hyperparameters.append(name)
        values[hyperparameters.index(name)] = float(value)
    table.surrogate[i] = values
    table.digests[i, PROPOSAL] = digest = table.proposal_digest(i)
    return digest


def n_switches_of(row: Mapping[str, Any]) -> int:
    """Switches of a row's candidate; raises RecordError for what is no whole number."""
    return int(_number(N_SWITCHES, row["n_switches"]))


def design_of(layout: Layout, row: Mapping[str, Any]) -> NDArray[np.float64]:
    """Nominal values of a row, in the layout's order: (n_design,), NaN for what it does not say. Raises RecordError."""
    said = dict(row.get("design") or {})
    values = np.array([float(said.pop(column.name, np.nan)) for column in layout.designs])
    if said:
        raise RecordError(
            f"the design says {', '.join(map(str, said))}; candidates of this campaign may have "
            f"{', '.join(column.name for column in layout.designs) or 'no design'} of their own"
        )
    return values


def check_waveform(layout: Layout, row: Mapping[str, Any]) -> None:
    """Raise RecordError unless a row has a proposal that the layout can hold."""
    missing = [name for name in ("waveform", "n_switches", "origin") if name not in row]
    if missing:
        raise RecordError(f"a proposal needs waveform, n_switches and origin; {', '.join(missing)} is missing")
    shape = np.shape(row["waveform"])
    if len(shape) != 2 or shape[1] != len(PARAMETERS) or not 0 < shape[0] <= layout.n_pulses:
        raise RecordError(f"the waveform has shape {shape}; it must be (1 to {layout.n_pulses} pulses, 4)")
    design_of(layout, row)


def set_result(table: RecordTable, i: int, row: Mapping[str, Any], wave: int, markers: int) -> int:
    """Set the result of candidate i, in memory; returns its digest. markers: digest of its blocks' markers."""
    layout = table.layout
    at = layout.n_proposal_fields
    record = table.records[i]
    record[at:] = table.empty_record[at:]
    record[at] = wave
    at += 1
    n_limits = len(layout.limits_cm_s)
    for field in layout.results:
        width = n_limits if field.per_limit else 1
        value = row.get(field.name)
        if value is not None:
            record[at : at + width] = _numbers(field, value, n_limits) if field.per_limit else _number(field, value)
        at += width
    _set_words(table, i, row, "result")
    table.digests[i, MARKERS] = markers
    table.digests[i, RECORD] = digest = table.record_digest(i)
    return digest


def set_timings(table: RecordTable, i: int, row: Mapping[str, Any]) -> None:
    """Set the timings of candidate i, in memory."""
    for k, field in enumerate(WALL[:N_WALL]):
        value = row.get(field.name)
        table.wall_times[i, k] = np.nan if value is None else _number(field, value)
    table.wall_times[i, N_WALL] = table.wall_check(i)


def _set_words(table: RecordTable, i: int, row: Mapping[str, Any], part: str) -> None:
    for k, field in enumerate(WORDS):
        if field.part == part:
            text = row.get(field.name) or ""
            if not isinstance(text, str):
                raise RecordError(f"{field.name} is {text!r}; it must be text")
            table.words[i, k] = text


def _number(field: Field, value: Any) -> float:
    if field.type == "float" and type(value) is float:  # most of them: a wave has thousands
        return value
    try:
        if isinstance(value, str) or np.ndim(value) != 0:
            raise TypeError
        number = float(value)
        if field.type != "float" and not (number.is_integer() and (field.type == "int" or number in (0.0, 1.0))):
            raise TypeError
    except (TypeError, ValueError, OverflowError) as e:
        raise RecordError(f"{field.name} is {value!r}; it must be one number of type {field.type}") from e
    return number


def _numbers(field: Field, value: Any, n: int) -> NDArray[np.float64]:
    try:
        numbers = np.asarray(value, dtype=np.float64)
        if numbers.shape != (n,):
            raise TypeError
    except (TypeError, ValueError) as e:
        raise RecordError(f"{field.name} is {value!r}; it must be of shape ({n},), a number for each limit") from e
    return numbers


def write_rows(
    table: RecordTable, files: DescribedFiles, arrays: Mapping[str, zarr.AsyncArray[Any]], start: int, stop: int
) -> None:
    """Write the chunks that hold candidates start … stop - 1 of every table.

    The digests go last, and of two chunks the later goes first: a first candidate of a wave that has its digest says
    that the whole wave is written.
    """
    step = table.layout.table_chunk
    chunks = [table.rows(i_chunk) for i_chunk in reversed(range(start // step, (stop - 1) // step + 1))]

    async def write() -> None:
        for name, spec in TABLES.items():
            values: NDArray[Any] = getattr(table, spec.name)
            for rows in chunks:
                faults.point("inside-record")
                await arrays[name].setitem((rows, slice(None)), values[rows])

    run_here(write(), files)


def write_hyperparameters(
    arrays: Mapping[str, zarr.AsyncArray[Any]], files: DescribedFiles, names: Sequence[str]
) -> None:
    """Write the names of the surrogate's columns, and their units."""
    for key, texts in ((HYPERPARAMETER_UNIT, [unit_in(name) for name in names]), (HYPERPARAMETER, list(names))):
        padded = np.array([*texts, *[""] * (N_SURROGATE - len(names))], dtype=np.dtypes.StringDType())
        run_here(arrays[key].setitem(slice(None), padded), files)
