"""Owns the tables of candidates in memory: loading them, their digests, and their columns by name."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray

from softclose_store.disk.files import LocalFiles
from softclose_store.disk.loop import run_here
from softclose_store.disk.names import chunk_key
from softclose_store.errors import DamageError
from softclose_store.read.arrays import UNREADABLE, open_arrays
from softclose_store.read.by_hand import CHOSEN, Changed
from softclose_store.read.described import DescribedFiles
from softclose_store.schema.digests import keyed_digest, proposals_digest
from softclose_store.schema.fields import (
    DIGESTS,
    N_SURROGATE,
    PARAMETERS,
    SURROGATE_PREFIX,
    WALL,
    WORDS,
    Field,
)
from softclose_store.schema.hierarchy import TABLES
from softclose_store.schema.layout import CANDIDATES, Layout, StageLayout

ORIGIN, NOTE, FAILURE = range(len(WORDS))
"""Columns of `words`."""
PROPOSAL, MARKERS, RECORD = range(len(DIGESTS))
"""Columns of `digests`."""
DIGESTS_TABLE = f"{CANDIDATES}/digests"
"""The table that a commit writes last."""
WALL_TABLE = f"{CANDIDATES}/wall_times"
N_WALL = len(WALL) - 1
"""Timings proper: the last column is their check."""


class RecordTable:
    """All per-candidate values of a store: `n` rows of each table, what was never written full of fill values."""

    def __init__(self, layout: Layout, n: int = 0) -> None:
        self.layout = layout
        fields = layout.fields
        self._at = {field.name: k for k, field in enumerate(fields)}
        self.empty_record: NDArray[np.float64] = np.array([field.fill for field in fields])
        """A row of `records` of which nothing is known."""
        self.records: NDArray[np.float64] = np.empty((0, len(fields)))
        self.words: NDArray[Any] = np.empty((0, len(WORDS)), dtype=np.dtypes.StringDType())
        self.surrogate: NDArray[np.float64] = np.empty((0, N_SURROGATE))
        self.digests: NDArray[np.uint64] = np.empty((0, len(DIGESTS)), dtype=np.uint64)
        self.wall_times: NDArray[np.float64] = np.empty((0, len(WALL)))
        self.damaged: set[tuple[str, int]] = set()
        """(table, chunk of candidates) that could not be read."""
        self.reserve(n)

    def reserve(self, n: int) -> None:
        """Have rows for the first n candidates at least: whole chunks, and ever more at once."""
        have = len(self.records)
        if n <= have:
            return
        step = self.layout.table_chunk
        more = min(-(-max(n, 2 * have) // step) * step, self.layout.n_candidates) - have
        for spec in TABLES.values():
            values: NDArray[Any] = getattr(self, spec.name)
            fill = {"T": "", "u": 0}.get(values.dtype.kind, np.nan)
            setattr(
                self, spec.name, np.concatenate([values, np.full((more, values.shape[1]), fill, dtype=values.dtype)])
            )

    def rows(self, i_chunk: int) -> slice:
        """Candidates of one chunk."""
        step = self.layout.table_chunk
        return slice(i_chunk * step, min((i_chunk + 1) * step, self.layout.n_candidates))

    def load(self, files: DescribedFiles, n: int, *, tolerate_damage: bool = False) -> None:
        """Read the first n rows of every table; raises DamageError. What cannot be read stays empty if tolerated."""
        if n == 0:
            return
        if not tolerate_damage and isinstance(files.inner, LocalFiles):
            for i_chunk in range(self.chunks_of(n)):  # before anything is allocated for them
                key = chunk_key(DIGESTS_TABLE, i_chunk, 0)
                if files.inner.below.size(key) is None:
                    raise files.damage(key, "is missing")
        self.reserve(n)
        for name, array in open_arrays(files, TABLES).items():
            self._load_table(files, name, array, n, tolerate_damage)

    def _load_table(
        self, files: DescribedFiles, name: str, array: zarr.AsyncArray[Any], n: int, tolerate_damage: bool
    ) -> None:
        values: NDArray[Any] = getattr(self, TABLES[name].name)

        def read(rows: slice) -> None:
            values[rows] = run_here(array.getitem((rows, slice(None))), files)

        try:
            read(slice(0, n))
            return
        except UNREADABLE:
            pass  # one of the chunks cannot be read: find out which
        for i_chunk in range(self.chunks_of(n)):
            rows = self.rows(i_chunk)
            rows = slice(rows.start, min(rows.stop, n))
            try:
                read(rows)
            except UNREADABLE as e:
                if not tolerate_damage:
                    if isinstance(e, DamageError):
                        raise
                    key = chunk_key(name, i_chunk, 0)
                    what = f"with candidates {rows.start} to {rows.stop - 1} cannot be read ({type(e).__name__}: {e})"
                    raise files.damage(key, what) from e
                self.damaged.add((name, i_chunk))

    def check(self, files: DescribedFiles, n: int) -> None:
        """Compare the first n rows with their digests; raises DamageError."""
        digests = self.digests[:n]
        for i, (proposal, _, record) in enumerate(digests.tolist()):
            if proposal != self.proposal_digest(i) or record != self.record_digest(i):
                *rest, last = (
                    chunk_key(name, i // self.layout.table_chunk, 0) for name in TABLES if name != WALL_TABLE
                )
                raise files.damage(
                    f"{', '.join(rest)} or {last}", f"is not what was written: the record of candidate {i} is damaged"
                )
            if self.wall_times[i, N_WALL] != self.wall_check(i):
                key = chunk_key(WALL_TABLE, i // self.layout.table_chunk, 0)
                raise files.damage(key, f"is not what was written: the timings of candidate {i} are damaged")

    def waves_beyond(self, files: DescribedFiles, n: int) -> int:
        """Waves that the rows behind the first n know of, as far as their chunk goes; 0 where nothing is written there.

        A commit writes its rows before the root, so one wave more than the root says is no damage. Two are.
        """
        i_chunk = n // self.layout.table_chunk
        if n >= self.layout.n_candidates:
            return 0
        rows = slice(n, self.rows(i_chunk).stop)
        arrays = open_arrays(files, TABLES)
        beyond = RecordTable(self.layout, rows.stop)
        try:
            beyond.digests[rows] = run_here(arrays[DIGESTS_TABLE].getitem((rows, slice(None))), files)
            written = [i for i in range(rows.start, rows.stop) if beyond.digests[i, RECORD]]
            if not written:
                return 0
            for name in ("records", "words"):
                array = arrays[f"{CANDIDATES}/{name}"]
                getattr(beyond, name)[rows] = run_here(array.getitem((rows, slice(None))), files)
        except UNREADABLE:  # nothing of these rows is committed: they may be in any state
            return 0
        whole = [i for i in written if int(beyond.digests[i, RECORD]) == beyond.record_digest(i)]
        return max((int(beyond.number(i, "wave")) + 1 for i in whole), default=0)

    def chunks_of(self, n: int) -> int:
        """Chunks that hold the first n candidates."""
        return -(-n // self.layout.table_chunk)

    def proposal_digest(self, i: int) -> int:
        """Digest of candidate i's proposal as it is in memory."""
        parts = (
            self.records[i, : self.layout.n_proposal_fields].tobytes(),
            self.surrogate[i].tobytes(),
            str(self.words[i, ORIGIN]).encode(),
            str(self.words[i, NOTE]).encode(),
        )
        return keyed_digest(f"proposal|{i}", parts)

    def record_digest(self, i: int) -> int:
        """Digest of candidate i's result, tied to its proposal and its blocks."""
        parts = (
            self.digests[i, :RECORD].tobytes(),
            self.records[i, self.layout.n_proposal_fields :].tobytes(),
            str(self.words[i, FAILURE]).encode(),
        )
        return keyed_digest(f"record|{i}", parts)

    def wall_check(self, i: int) -> float:
        """Check of candidate i's timings: a float holds 53 bits of a digest exactly."""
        return float(keyed_digest(f"wall|{i}", (self.wall_times[i, :N_WALL].tobytes(),)) >> 11)

    def waveform(self, i: int) -> NDArray[np.float64]:
        """Pulses of candidate i: (n_pulse, 4)."""
        rows = self.records[i, : self.layout.n_pulses * len(PARAMETERS)].reshape(-1, len(PARAMETERS))
        return rows[~np.isnan(rows).all(axis=1)].copy()

    def design(self, i: int) -> NDArray[np.float64]:
        """Nominal values of candidate i, in the layout's order: (n_design,), NaN for the population's own."""
        at = self.layout.n_pulses * len(PARAMETERS)
        return self.records[i, at : at + len(self.layout.designs)].copy()

    def number(self, i: int, name: str) -> float:
        """One number of candidate i."""
        return float(self.records[i, self._at[name]])

    def n_switches(self, i: int) -> int:
        """Switches of candidate i; 0 where its proposal is damaged beyond a sensible number."""
        value = self.number(i, "n_switches")
        stage, _ = self.layout.stage_of(i)
        return int(value) if value.is_integer() and 0 < value <= stage.n_switches else 0

    def n_hyperparameters(self) -> int:
        """Columns of `surrogate` that are in use."""
        used = np.flatnonzero(~np.isnan(self.surrogate).all(axis=0)) if len(self.surrogate) else np.empty(0, dtype=int)
        return int(used[-1]) + 1 if used.size else 0

    def block_proposals(self, stage: StageLayout, i_block: int) -> tuple[int, int]:
        """Digest of the proposals of one row of blocks, and their number of switches (0: damaged)."""
        first = self.layout.first(stage.name)
        candidates = stage.candidates(i_block)
        indices = range(first + candidates.start, first + candidates.stop)
        n_switches = self.n_switches(indices[0])
        designs = [self.design(i) for i in indices] if self.layout.designs else None
        return proposals_digest([self.waveform(i) for i in indices], n_switches, indices[0], designs), n_switches

    def amended(self, changes: Sequence[Changed]) -> RecordTable:
        """The same rows with what was changed by hand in its place; what was not changed is shared."""
        if not changes:
            return self
        found = copy(self)
        found.records, found.words = self.records.copy(), self.words.copy()
        at = self.layout.n_proposal_fields + 1
        for change in changes:
            i = change.candidate
            if i >= len(found.records):  # told, and not committed yet
                continue
            if change.record is not None:
                found.records[i, at:] = change.record
                found.words[i, FAILURE] = change.failure
            before = str(found.words[i, NOTE])
            found.words[i, NOTE] = f"{before}; {change.note}" if before else change.note
        return found

    def columns(self, n: int, hyperparameters: list[str]) -> dict[str, NDArray[Any]]:
        """Every value of the first n candidates by name, (n, …) each, copies."""
        layout, records = self.layout, self.records[:n]
        at = layout.n_pulses * len(PARAMETERS)
        columns: dict[str, NDArray[Any]] = {
            "waveform": records[:, :at].reshape(n, layout.n_pulses, len(PARAMETERS)).copy(),
            **{
                field.name: _typed(field.type, records[:, at + k])
                for k, field in enumerate(layout.fields[at:])
                if at + k < layout.n_proposal_fields
            },
            "stage": layout.of_stages("name")[:n],
            "engine": np.where(self.words[:n, ORIGIN] == CHOSEN, CHOSEN, layout.of_stages("engine")[:n]),
            "origin": self.words[:n, ORIGIN].copy(),
            "note": self.words[:n, NOTE].copy(),
            "wave": _typed("int", records[:, layout.n_proposal_fields]),
        }
        at = layout.n_proposal_fields + 1
        for field in layout.results:
            width = len(layout.limits_cm_s) if field.per_limit else 1
            values = _typed(field.type, records[:, at : at + width])
            columns[field.name] = values if field.per_limit else values[:, 0].copy()
            at += width
        columns["failure"] = self.words[:n, FAILURE].copy()
        for k, field in enumerate(WALL[:N_WALL]):
            columns[field.name] = self.wall_times[:n, k].copy()
        for k, name in enumerate(hyperparameters):
            columns[f"{SURROGATE_PREFIX}{name}"] = self.surrogate[:n, k].copy()
        return columns


def _typed(kind: str, values: NDArray[np.float64]) -> NDArray[Any]:
    if kind == "float":
        return values.copy()
    whole = np.where(np.isnan(values), Field(name="", type="int").fill if kind == "int" else 0.0, values)
    return whole.astype(np.int32 if kind == "int" else np.bool_)


def result_of(change: Changed, layout: Layout) -> dict[str, NDArray[Any]]:
    """Every value of a changed result by name.

    Parameters
    ----------
    change : Changed
        Of readings.
    layout : Layout
        The store's.

    Returns
    -------
    dict
        (1, …) each; what is no result stays undefined.
    """
    table = RecordTable(layout, 1)
    assert change.record is not None
    table.records[0, layout.n_proposal_fields + 1 :] = change.record
    table.words[0, FAILURE] = change.failure
    return table.columns(1, [])
