"""Owns repair: damaged files are written again from what produces them, and proved equal to what was there.

What can be computed again: the root (from its copy and the records), array metadata and population (from the
configuration), chunks, proposals and records (pure functions, DESIGN §2). Timings are lost. The science comes in as
callbacks: this package knows none.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softclose_store import digests
from softclose_store.chunk import check_rows, forget_writer, marker_of, read_array, write_chunk
from softclose_store.create import build_hierarchy, metadata_digest, population_columns
from softclose_store.driver import DriverStore
from softclose_store.errors import DamageError, StoreError
from softclose_store.files import (
    PARTIAL,
    StorePath,
    delete_key,
    list_keys,
    normalised,
    open_files,
    read_key,
    write_key,
)
from softclose_store.layout import Layout
from softclose_store.lock import DriverLock
from softclose_store.root import BACKUP_KEY, ROOT_KEY, RUNTIME_KEY, Root, decode_root, runtime_text, write_root
from softclose_store.table import CandidateTable
from softclose_store.verify import Report, chunk_keys, read_backup, verify


@dataclass(frozen=True, slots=True, kw_only=True)
class Recompute:
    """How to compute again what a store holds."""

    population: Callable[[Mapping[str, Any]], Mapping[str, ArrayLike]]
    """Configuration -> the columns D, G, E, T, K, M."""
    times_us: Callable[[Mapping[str, Any]], ArrayLike]
    """Configuration -> the time grid [µs]."""
    proposal: Callable[[DriverStore, int], Mapping[str, Any]]
    """The proposal of a candidate, from the records before it."""
    chunk: Callable[[DriverStore, int, int], Mapping[str, NDArray[Any]]]
    """The arrays of (candidate, chunk), from the candidate's proposal."""
    record: Callable[[DriverStore, int], Mapping[str, Any]]
    """The record of a candidate, from its chunks."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RepairReport:
    """What a repair did."""

    proved: tuple[str, ...]
    """Written again and equal, by digest, to what was there."""
    unproved: tuple[str, ...]
    """Written again, but nothing intact is left to compare it with; or lost (timings)."""
    after: Report
    """What `verify` finds now."""

    @property
    def ok(self) -> bool:
        """True where the store is whole again."""
        return self.after.ok


@dataclass(slots=True)
class _Log:
    proved: list[str] = field(default_factory=list)
    unproved: list[str] = field(default_factory=list)

    def add(self, what: str, proved: bool) -> None:
        (self.proved if proved else self.unproved).append(what)


def repair(path: StorePath, recompute: Recompute, *, break_lock: bool = False) -> RepairReport:
    """Write everything that is damaged again, prove it equal, and remove what a kill left behind.

    Raises LockedError while a driver works on the store, DamageError where what was computed is not what was stored
    (another processor or library version: the damaged bytes stay as they are).
    """
    report = verify(path)
    log = _Log()
    files = open_files(path, read_only=False)
    lock = DriverLock(path)
    lock.acquire(break_lock=break_lock)
    try:
        for problem in report.problems:
            if problem.kind == "unknown":
                key = problem.what.partition(" ")[0]
                delete_key(files, key)
                log.add(f"{key} removed", proved=True)
        kinds = {p.kind for p in report.problems}
        if "root" in kinds or kinds & {"schema", "static"}:
            _repair_frame(path, recompute, log)
    finally:
        lock.release()
    forget_writer(path)
    with DriverStore(path, tolerate_damage=True, break_lock=break_lock) as store:
        _repair_candidates(store, recompute, verify(path), log)
    remove_orphans(path)
    return RepairReport(proved=tuple(log.proved), unproved=tuple(log.unproved), after=verify(path))


def remove_orphans(path: StorePath) -> list[str]:
    """Delete the temporary files that a kill left behind; returns their keys. For stores that nobody is writing."""
    files = open_files(path, read_only=False)
    orphans = [key for key in list_keys(files) if key.endswith(PARTIAL)]
    for key in orphans:
        delete_key(files, key)
    return orphans


def _repair_frame(path: StorePath, recompute: Recompute, log: _Log) -> None:
    """Root, its copy, runtime, array metadata and static arrays."""
    where = normalised(path)
    files = open_files(path, read_only=False)
    try:
        root: Root | None = decode_root(read_key(files, ROOT_KEY) or b"", where)
    except StoreError:
        root = None
    source = root or read_backup(files, where)
    if source is None:
        raise DamageError(f"{where}: the root and its copy are both damaged; nothing says any more what this store is")
    attributes = source.attributes
    layout = Layout.from_dict(attributes["layout"], np.asarray(recompute.times_us(attributes["config"]), dtype=float))
    columns = population_columns(recompute.population(attributes["config"]), layout.n_switches)
    built = build_hierarchy(
        layout, attributes["config"], source.fingerprint, columns, _runtime(source), bool(attributes["durable"])
    )
    fresh = decode_root(built[ROOT_KEY], where)
    for name, expected in attributes["static_digests"].items():
        if fresh.attributes["static_digests"][name] != expected:
            raise DamageError(f"{where}: {name} computed again from the configuration is not what was stored")
    same_metadata = metadata_digest(built) == attributes["metadata_digest"]
    for key, content in built.items():
        if key in (ROOT_KEY, BACKUP_KEY, RUNTIME_KEY) or read_key(files, key) == content:
            continue
        is_metadata = key.endswith("/zarr.json")
        if is_metadata and not same_metadata:
            raise DamageError(f"{where}: this version of zarr writes other metadata than the store's; use the same one")
        if is_metadata or not _static_is_intact(files, key, attributes["static_digests"]):
            write_key(files, key, content)
            log.add(f"{key} written again", proved=True)
    if root is None:
        table = CandidateTable(layout, files)
        table.load(layout.n_candidates, tolerate_damage=True)
        n = 0
        while n < layout.n_candidates and 0 != int(table.columns["record_digest"][n]) == table.record_digest(n):
            n += 1
        root = source.committed(n)
        root.metadata["runtime"]["attributes"] = _runtime_on_disk(files) or _runtime(source)
        write_root(files, root)
        log.add(f"{ROOT_KEY} rebuilt with {n} committed candidates", proved=True)
    if read_key(files, RUNTIME_KEY) != runtime_text(root):
        write_key(files, RUNTIME_KEY, runtime_text(root))
        log.add(f"{RUNTIME_KEY} written again", proved=True)
    backup = read_backup(files, where)
    if backup is None:
        write_key(files, BACKUP_KEY, root.committed(0).encode())
        log.add(f"{BACKUP_KEY} written again", proved=True)


def _runtime(root: Root) -> dict[str, Any]:
    attributes: dict[str, Any] = root.metadata["runtime"]["attributes"]
    return attributes


def _runtime_on_disk(files: Any) -> dict[str, Any] | None:
    try:
        attributes = json.loads(read_key(files, RUNTIME_KEY) or b"")["attributes"]
    except (ValueError, KeyError, TypeError):
        return None
    return attributes if isinstance(attributes, dict) else None


def _static_is_intact(files: Any, key: str, expected: Mapping[str, str]) -> bool:
    name = key.partition("/")[0]
    try:
        return read_key(files, key) is not None and digests.array_sha256(read_array(files, name)) == expected[name]
    except (ValueError, RuntimeError, OSError, KeyError):
        return False


def _repair_candidates(store: DriverStore, recompute: Recompute, report: Report, log: _Log) -> None:
    """Proposals, chunks and records, in order of the candidates: each needs those before it."""
    kinds: dict[int, set[str]] = {}
    for problem in report.problems:
        if problem.candidate is not None and problem.kind != "pending":
            kinds.setdefault(problem.candidate, set()).add(problem.kind)
    for i, damage in sorted(kinds.items()):
        chunks = {chunk for j, chunk in report.damaged_chunks if j == i}
        if "proposal" in damage:
            _repair_proposal(store, recompute, i, log)
            chunks |= {chunk for chunk, done in enumerate(store.chunks_done(i)) if not done}
        _repair_chunks(store, recompute, i, sorted(chunks), log)
        if damage & {"record", "proposal"}:
            _repair_record(store, recompute, i, log)
        if "timings" in damage:
            store.restore_timings(i, {})
            log.add(f"timings of candidate {i} are lost", proved=False)
    store.write_restored()


def _repair_proposal(store: DriverStore, recompute: Recompute, i: int, log: _Log) -> None:
    stored = store.proposal_digest(i)
    found = store.restore_proposal(i, recompute.proposal(store, i))
    carried = {int(digest) for digest in store.markers(i)[:, 0]} - {0}
    proved = found == stored or found in carried
    if not proved and (stored or carried):
        raise _differs(f"the proposal of candidate {i}")
    log.add(f"proposal of candidate {i} computed again", proved)


def _repair_chunks(store: DriverStore, recompute: Recompute, i: int, chunks: list[int], log: _Log) -> None:
    """Nothing on the disk changes until the new marker equals the old one, where that is intact."""
    proved = {}
    digest = store.proposal_digest(i)
    files = open_files(store.path, read_only=False)
    for chunk in chunks:
        before = store.markers(i)[chunk]
        arrays = recompute.chunk(store, i, chunk)
        found = marker_of(check_rows(store.layout, chunk, arrays), i, chunk, digest)
        proved[chunk] = bool(np.array_equal(found, before))
        if before.all() and int(before[0]) == digest and not proved[chunk]:
            raise _differs(f"candidate {i}, chunk {chunk}")
        for key in chunk_keys(store.layout, i, chunk):
            delete_key(files, key)
        write_chunk(store.path, i, chunk, arrays, digest)
    whole = bool(chunks) and store.markers_match(i)
    for chunk in chunks:
        log.add(f"candidate {i}, chunk {chunk} computed again", proved[chunk] or whole)


def _repair_record(store: DriverStore, recompute: Recompute, i: int, log: _Log) -> None:
    stored = store.record_digest(i)
    found = store.restore_record(i, recompute.record(store, i))
    if stored not in (0, found):
        raise _differs(f"the record of candidate {i}")
    log.add(f"record of candidate {i} computed again", proved=found == stored)


def _differs(what: str) -> DamageError:
    return DamageError(
        f"{what} computed again is not what was stored: repair it on the processor and with the versions that the "
        "group `runtime` names"
    )
