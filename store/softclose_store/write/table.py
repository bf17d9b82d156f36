"""Owns the per-candidate arrays in memory: records in and out, and whole-chunk writes of them.

The driver is their only writer and holds them all, so a commit writes the last chunk of each array afresh and merges
with nothing on the disk.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray
from zarr.abc.store import Store

from softclose_store import digests, faults
from softclose_store.chunk import open_arrays
from softclose_store.errors import DamageError, RecordError
from softclose_store.files import run_here
from softclose_store.layout import (
    CANDIDATE_ARRAYS,
    PROPOSAL_FIELDS,
    RECORD_FIELDS,
    WALL_FIELDS,
    ArraySpec,
    Layout,
)

SPECS = {spec.name: spec for spec in CANDIDATE_ARRAYS}


class CandidateTable:
    """All per-candidate arrays of one store, at full capacity."""

    def __init__(self, layout: Layout, files: Store) -> None:
        self.layout = layout
        self._files = files
        self.columns: dict[str, NDArray[Any]] = {s.name: s.empty(layout.shape(s)) for s in CANDIDATE_ARRAYS}
        self.damaged: set[tuple[str, int]] = set()
        """(array, chunk of candidates) that could not be read."""
        self._arrays: dict[str, zarr.AsyncArray[Any]] = {}

    def load(self, n: int, *, tolerate_damage: bool = False) -> None:
        """Read the chunks that hold the first n candidates, and the next chunk; raises DamageError."""
        wanted = range(min(n // self.layout.record_chunk + 2, self.layout.n_record_chunks))
        self._arrays = open_arrays(self._files, tuple(SPECS))

        async def read() -> None:
            for name, array in self._arrays.items():
                for i_chunk in wanted:
                    rows = self._rows(i_chunk)
                    try:
                        self.columns[name][rows] = await array.getitem((rows, *(slice(None),) * (array.ndim - 1)))
                    except (ValueError, RuntimeError, OSError, KeyError, IndexError) as e:
                        if not tolerate_damage:
                            raise DamageError(
                                f"records of candidates {rows.start} to {rows.stop - 1} are damaged in {name} "
                                f"({type(e).__name__}: {e}): run `softclose verify --repair`"
                            ) from e
                        self.damaged.add((name, i_chunk))

        run_here(read(), self._files)

    def _rows(self, i_chunk: int) -> slice:
        step = self.layout.record_chunk
        return slice(i_chunk * step, min((i_chunk + 1) * step, self.layout.n_candidates))

    def set_fields(self, i: int, fields: Iterable[ArraySpec], record: Mapping[str, Any]) -> None:
        """Set the given fields of candidate i; what the record leaves out becomes the fill value."""
        allowed = {spec.name: spec for spec in fields}
        unknown = [name for name in record if name not in allowed]
        if unknown:
            near = difflib.get_close_matches(unknown[0], allowed, n=1)
            hint = f"; did you mean {near[0]}?" if near else f"; known are {', '.join(allowed)}"
            raise RecordError(f"a record has no field {unknown[0]!r}{hint}")
        values = {name: _value(spec, record.get(name), self.layout) for name, spec in allowed.items()}
        for name, value in values.items():
            self.columns[name][i] = value

    def write(self, i: int, names: Iterable[str]) -> None:
        """Write the chunk that holds candidate i of each named array."""
        rows = self._rows(i // self.layout.record_chunk)

        async def write() -> None:
            for name in names:
                faults.point("inside-record")
                column = self.columns[name]
                await self._arrays[name].setitem((rows, *(slice(None),) * (column.ndim - 1)), column[rows])

        run_here(write(), self._files)

    def proposal_digest(self, i: int) -> int:
        """Digest of candidate i's proposal as it is in memory."""
        return digests.fields_digest(f"proposal|{i}", ((s.name, self._plain(s, i)) for s in PROPOSAL_FIELDS))

    def record_digest(self, i: int) -> int:
        """Digest of candidate i's record, tied to its proposal and its chunks."""
        key = f"record|{i}|{int(self.columns['proposal_digest'][i])}|{int(self.columns['markers_digest'][i])}"
        return digests.fields_digest(key, ((s.name, self._plain(s, i)) for s in RECORD_FIELDS))

    def wall_digest(self, i: int) -> int:
        """Digest of candidate i's timings."""
        return digests.fields_digest(f"wall|{i}", ((s.name, self._plain(s, i)) for s in WALL_FIELDS))

    def _plain(self, spec: ArraySpec, i: int) -> Any:
        value = self.columns[spec.name][i]
        return str(value) if spec.dtype == "str" and len(spec.dims) == 1 else value

    def row(self, i: int, fields: Iterable[ArraySpec]) -> dict[str, Any]:
        """The given fields of candidate i as plain values; the surrogate's as a dictionary."""
        row: dict[str, Any] = {}
        for spec in fields:
            value = self.columns[spec.name][i]
            if spec.dtype == "str" and value.__class__ is not np.ndarray:
                value = str(value)
            elif len(spec.dims) == 1:
                value = value.item()
            row[spec.name] = value
        if "surrogate" in row:
            names = [str(name) for name in row.pop("surrogate_name")]
            row["surrogate"] = {n: float(v) for n, v in zip(names, row["surrogate"], strict=True) if n}
        if "waveform" in row:
            waveform = row["waveform"]
            row["waveform"] = waveform[~np.isnan(waveform).all(axis=1)].copy()
        return row


def proposal_fields(layout: Layout, record: Mapping[str, Any]) -> dict[str, Any]:
    """A proposal as the arrays hold it: waveform padded with NaN, the surrogate's dictionary as names and values."""
    missing = [name for name in ("waveform", "n_switches", "origin") if name not in record]
    if missing:
        raise RecordError(f"a proposal needs waveform, n_switches and origin; {', '.join(missing)} is missing")
    fields = dict(record)
    waveform = np.atleast_2d(np.asarray(fields["waveform"], dtype=np.float64))
    if waveform.ndim != 2 or waveform.shape[1] != 4 or not 0 < len(waveform) <= layout.n_pulses:
        raise RecordError(f"the waveform has shape {waveform.shape}; it must be (1 to {layout.n_pulses} pulses, 4)")
    fields["waveform"] = np.full((layout.n_pulses, 4), np.nan)
    fields["waveform"][: len(waveform)] = waveform
    n_switches = fields["n_switches"]
    if not 0 < n_switches <= layout.n_switches:
        raise RecordError(f"n_switches is {n_switches}; the store holds 1 to {layout.n_switches} switches a candidate")
    surrogate = dict(fields.get("surrogate") or {})
    room = layout.sizes["hyperparameter"]
    if len(surrogate) > room or "" in surrogate:
        raise RecordError(f"the surrogate has {len(surrogate)} quantities; the store holds up to {room}, all named")
    fields["surrogate"] = [*surrogate.values(), *[np.nan] * (room - len(surrogate))]
    fields["surrogate_name"] = [*surrogate, *[""] * (room - len(surrogate))]
    return fields


def _value(spec: ArraySpec, value: Any, layout: Layout) -> Any:
    """A field as its array holds it; raises RecordError for a wrong shape or type."""
    shape = layout.shape(spec)[1:]
    if value is None:
        return spec.empty(shape)[()]
    if spec.dtype == "str":
        if not shape and not isinstance(value, str):
            raise RecordError(f"{spec.name} is {value!r}; it must be text")
        return value if not shape else np.array(value, dtype=np.dtypes.StringDType())
    try:
        array = np.asarray(value)
        if array.shape != shape or not np.can_cast(array.dtype, spec.dtype, "same_kind"):
            raise TypeError
        return array.astype(spec.dtype)
    except (TypeError, ValueError, OverflowError) as e:
        raise RecordError(f"{spec.name} is {value!r}; it must be of type {spec.dtype} and shape {shape}") from e
