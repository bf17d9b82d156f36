"""Owns the driver's side of a store: proposals, records and commits, under the one-driver lock."""

from __future__ import annotations

import time
from collections.abc import Mapping
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from softclose_store import faults
from softclose_store.chunk import read_array, read_layout
from softclose_store.errors import DamageError, OtherConfigurationError, RecordError
from softclose_store.files import StorePath, normalised, open_files
from softclose_store.groups import append_run
from softclose_store.integrity import ChunkReader, markers_digest
from softclose_store.layout import CANDIDATE_ARRAYS, PROPOSAL_FIELDS, RECORD_FIELDS, WALL_FIELDS, Layout
from softclose_store.lock import DriverLock
from softclose_store.root import Root, read_root, write_root
from softclose_store.table import CandidateTable, proposal_fields

TAIL_BYTES = 64_000_000
"""Decoded bytes of the last committed candidates that every opening checks: about 0.1 s."""


class DriverStore:
    """One campaign's store, open for its one driver. A context manager that holds the lock.

    Raises LockedError, StoreMissingError, SchemaError, OtherConfigurationError (where `expected_fingerprint` differs)
    and DamageError. `tolerate_damage` opens a damaged store for its repair.
    """

    def __init__(
        self,
        path: StorePath,
        *,
        expected_fingerprint: str | None = None,
        break_lock: bool = False,
        tolerate_damage: bool = False,
    ) -> None:
        self.path = normalised(path)
        self._plain = open_files(path, read_only=True)
        root = read_root(self._plain, self.path)
        if expected_fingerprint is not None and root.fingerprint != expected_fingerprint:
            raise OtherConfigurationError(
                f"{self.path} holds campaign {root.fingerprint[:12]}, not {expected_fingerprint[:12]}: its "
                "configuration is another one; give another path"
            )
        self._lock = DriverLock(path)
        self._lock.acquire(break_lock=break_lock)
        try:
            self._root: Root = read_root(self._plain, self.path)  # another driver may have committed meanwhile
            self.layout: Layout = read_layout(self._plain, self.path)
            self._files = open_files(path, read_only=False, durable=self.durable, blind=False)
            self._chunks = ChunkReader(self._plain, self.layout)
            self._table = CandidateTable(self.layout, self._files)
            self._table.load(self.n_committed, tolerate_damage=tolerate_damage)
            if not tolerate_damage:
                self._check_committed()
        except BaseException:
            self._lock.release()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Release the lock."""
        self._lock.release()

    @property
    def config(self) -> dict[str, Any]:
        """The campaign's configuration."""
        config: dict[str, Any] = self._root.attributes["config"]
        return config

    @property
    def fingerprint(self) -> str:
        """Identity of the campaign."""
        return self._root.fingerprint

    @property
    def durable(self) -> bool:
        """True where every file is synced to the disk before the commit that relies on it."""
        return bool(self._root.attributes["durable"])

    @property
    def n_committed(self) -> int:
        """Number of committed candidates: always the first ones."""
        return self._root.n_committed

    @property
    def population(self) -> NDArray[np.float64]:
        """(n_switches, 4) float64: D [µm], G [µm], K [N/m], M [µg]."""
        return np.column_stack([read_array(self._plain, name) for name in ("D", "G", "K", "M")])

    def records(self) -> dict[str, NDArray[Any]]:
        """Every per-candidate array of the committed candidates, by name: (n_committed, …) each, copies."""
        n = self.n_committed
        return {s.name: self._table.columns[s.name][:n].copy() for s in CANDIDATE_ARRAYS}

    def proposal(self, i: int) -> dict[str, Any] | None:
        """The stored proposal of candidate i: waveform (n_pulse, 4), n_switches, origin, note, surrogate; or None.

        One that was being written when its driver died does not match its digest, and counts as absent.
        """
        stored = self.proposal_digest(i)
        if stored == 0 or stored != self._table.proposal_digest(i):
            return None
        return self._table.row(i, PROPOSAL_FIELDS)

    def proposal_digest(self, i: int) -> int:
        """Digest of the stored proposal of candidate i, which its chunks carry; 0 where there is none."""
        self._check_index(i)
        return int(self._table.columns["proposal_digest"][i])

    def propose(self, i: int, record: Mapping[str, Any]) -> None:
        """Store the proposal of candidate i, before any chunk of it is computed."""
        self._check_index(i)
        if i < self.n_committed:
            raise RecordError(f"candidate {i} is committed; its proposal cannot change")
        self._lock.check()
        faults.point("before-proposal")
        self._write_proposal(i, record)
        faults.point("after-proposal")

    def _write_proposal(self, i: int, record: Mapping[str, Any]) -> None:
        self.restore_proposal(i, record)
        self._table.write(i, [s.name for s in PROPOSAL_FIELDS])
        self._table.write(i, ["proposal_digest"])

    def chunks_done(self, i: int, *, check: bool = True) -> tuple[bool, ...]:
        """For each chunk of candidate i: whether it is stored under its present proposal.

        With `check` the data of every marked chunk is read and compared: after a loss of power a marker may have
        reached the disk and its data not.
        """
        digest, n = self._expected(i)
        markers = self._chunks.markers(i, self.layout.chunks_of(n))
        done = (markers[:, 0] == np.uint64(digest)) & (markers != 0).all(axis=1)
        if check:
            for i_chunk in np.flatnonzero(done):
                done[i_chunk] = not self._chunks.problems(i, int(i_chunk), n, digest)
        return tuple(bool(d) for d in done)

    def read_switch_metrics(self, i: int) -> dict[str, NDArray[Any]]:
        """The scalar per-switch arrays of candidate i, (n_switches(i),) each, by name; all chunks must be there."""
        _, n = self._expected(i)
        if not all(self.chunks_done(i, check=False)):
            raise RecordError(f"candidate {i} has chunks that are not stored yet; compute them first")
        scalars = [s for s in self.layout.switch_arrays if len(s.dims) == 2]
        return {s.name: self._chunks.rows(s.name, i, n) for s in scalars}

    def _expected(self, i: int) -> tuple[int, int]:
        """(proposal digest, number of switches) of candidate i."""
        digest = self.proposal_digest(i)
        if digest == 0:
            raise RecordError(f"candidate {i} has no proposal yet; store one first")
        return digest, int(self._table.columns["n_switches"][i])

    def commit(self, i: int, record: Mapping[str, Any]) -> None:
        """Write the record of candidate i, then make it part of the campaign: the root's replacement is the commit.

        record: fields of roles `record` and `wall` of the layout, by name; what is left out stays undefined.
        Raises RecordError unless i is the next candidate, all its chunks are stored, or the record says `failed`.
        """
        self._check_index(i)
        if i != self.n_committed:
            raise RecordError(f"candidate {i} cannot be committed now; the next one is {self.n_committed}")
        if self.proposal(i) is None:
            raise RecordError(f"candidate {i} has no proposal; store it before its record")
        if not record.get("failed", False) and not all(self.chunks_done(i, check=False)):
            raise RecordError(f"candidate {i} has chunks that are not stored; compute them, or record it as failed")
        self._lock.check()
        faults.point("before-record")
        self._write_record(i, record)
        faults.point("after-record")
        faults.point("before-commit")
        root = self._root.committed(i + 1)
        write_root(self._files, root)
        self._root = root
        faults.point("after-commit")

    def _write_record(self, i: int, record: Mapping[str, Any]) -> None:
        wall = {s.name: record[s.name] for s in WALL_FIELDS if s.name in record}
        wall.setdefault("wall_committed_unix_s", time.time())
        table = self._table
        self.restore_record(i, {name: value for name, value in record.items() if name not in wall})
        self.restore_timings(i, wall)
        table.write(i, [s.name for s in (*RECORD_FIELDS, *WALL_FIELDS)])
        table.write(i, ["markers_digest", "record_digest", "wall_record_digest"])

    def markers_digest(self, i: int) -> int:
        """Digest of the markers of candidate i's chunks as they are on the disk: ties its record to its data."""
        digest, n = self._expected(i)
        return markers_digest(self._chunks.markers(i, self.layout.chunks_of(n)), i, digest)

    def restore_proposal(self, i: int, record: Mapping[str, Any]) -> int:
        """Set the proposal of candidate i in memory only; returns its digest. For `propose` and for repairs."""
        self._table.set_fields(i, PROPOSAL_FIELDS, proposal_fields(self.layout, record))
        self._table.columns["proposal_digest"][i] = digest = self._table.proposal_digest(i)
        return digest

    def restore_record(self, i: int, record: Mapping[str, Any]) -> int:
        """Set the record of candidate i in memory only; returns its digest. For `commit` and for repairs."""
        self._table.set_fields(i, RECORD_FIELDS, record)
        self._table.columns["markers_digest"][i] = self.markers_digest(i)
        self._table.columns["record_digest"][i] = digest = self._table.record_digest(i)
        return digest

    def restore_timings(self, i: int, timings: Mapping[str, Any]) -> None:
        """Set the timings of candidate i in memory only."""
        self._table.set_fields(i, WALL_FIELDS, timings)
        self._table.columns["wall_record_digest"][i] = self._table.wall_digest(i)

    def write_restored(self) -> None:
        """Write all per-candidate arrays of the committed candidates: the last step of a repair."""
        self._lock.check()
        for i in range(0, self.n_committed, self.layout.record_chunk):
            self._table.write(i, [s.name for s in CANDIDATE_ARRAYS])

    def record_digest(self, i: int) -> int:
        """Digest of the stored record of candidate i; 0 where there is none."""
        return int(self._table.columns["record_digest"][i])

    def markers(self, i: int) -> NDArray[np.uint64]:
        """Markers of candidate i's chunks: (n_chunks, n_arrays + 1), the proposal's digest first; 0: not written."""
        _, n = self._expected(i)
        return self._chunks.markers(i, self.layout.chunks_of(n))

    def markers_match(self, i: int) -> bool:
        """True where candidate i's markers are those that its record was written for."""
        return self.markers_digest(i) == int(self._table.columns["markers_digest"][i])

    def note_run(self, runtime: Mapping[str, Any]) -> None:
        """Add who runs the campaign now, and where, to the group `runtime` (not part of the campaign's identity)."""
        self._root = append_run(self._files, self._root, runtime)

    def _check_index(self, i: int) -> None:
        if not 0 <= i < self.layout.n_candidates:
            raise RecordError(f"candidate {i} is outside the budget of {self.layout.n_candidates} candidates")

    def _check_committed(self) -> None:
        """Compare all committed records with their digests, and the data of the last candidates with its markers."""
        table, n = self._table, self.n_committed
        for i in range(n):
            if table.columns["proposal_digest"][i] != table.proposal_digest(i) or table.columns["record_digest"][
                i
            ] != table.record_digest(i):
                raise DamageError(
                    f"the record of candidate {i} in {self.path} is damaged: run `softclose verify --repair`"
                )
        row_bytes = sum(
            int(np.prod(self.layout.shape(s)[2:])) * np.dtype(s.dtype).itemsize for s in self.layout.switch_arrays
        )
        budget = TAIL_BYTES
        for i in range(n - 1, max(n - 3, -1), -1):
            if table.columns["failed"][i]:
                continue
            digest, n_switches = self._expected(i)
            for i_chunk in range(self.layout.chunks_of(n_switches)):
                budget -= row_bytes * self.layout.chunk_switches
                if budget < 0:
                    return
                problems = self._chunks.problems(i, i_chunk, n_switches, digest)
                if problems:
                    raise DamageError(
                        f"candidate {i}, chunk {i_chunk} in {self.path} is damaged ({problems[0]}): "
                        "run `softclose verify --repair`"
                    )
