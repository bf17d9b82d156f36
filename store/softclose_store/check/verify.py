"""Owns the proof that a store is what was written: every file of it is accounted for, read and compared.

Damage is anything that differs from what was written. Left over is not damage: temporary files and unmarked chunks of
candidates that are not committed are what a kill leaves behind.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from zarr.abc.store import Store

from softclose_store import digests
from softclose_store.chunk import read_array
from softclose_store.create import metadata_digest
from softclose_store.errors import DamageError, StoreMissingError
from softclose_store.files import PARTIAL, StorePath, list_keys, normalised, open_files, read_key
from softclose_store.groups import group_keys, group_problems, result_groups
from softclose_store.integrity import UNREADABLE, ChunkReader, markers_digest
from softclose_store.layout import (
    CANDIDATE_ARRAYS,
    CHUNK_KEY_SEPARATOR,
    MARKER,
    ArraySpec,
    Layout,
    chunk_key,
    is_chunk_key,
)
from softclose_store.lock import LOCK_KEY
from softclose_store.root import BACKUP_KEY, ROOT_KEY, RUNTIME_KEY, Root, decode_root, read_root, runtime_text
from softclose_store.table import SPECS, CandidateTable

Kind = Literal["root", "schema", "static", "proposal", "record", "timings", "chunk", "pending", "group", "unknown"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """One thing that is not what was written."""

    kind: Kind
    """root: identity, layout or commit marker; schema: metadata of an array; static: population or coordinates;
    proposal, record, timings: per-candidate values; chunk: data of a committed candidate; pending: of one that is not
    committed yet (resuming computes it again); group: a result group; unknown: a file that does not belong here."""
    what: str
    """What is wrong, in words."""
    candidate: int | None = None
    """The candidate, where it is one's."""
    chunk: int | None = None
    """Its chunk, where it is one's."""

    def __str__(self) -> str:
        return f"{self.kind}: {self.what}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """What `verify` found."""

    path: str
    """The store."""
    n_committed: int
    """Committed candidates."""
    n_chunks: int
    """Chunks read and compared with their markers."""
    problems: tuple[Problem, ...]
    """All damage."""
    orphans: tuple[str, ...]
    """Temporary files that a kill left behind: harmless, `remove_orphans` deletes them."""

    @property
    def ok(self) -> bool:
        """True where nothing is damaged."""
        return not self.problems

    @property
    def damaged_chunks(self) -> list[tuple[int, int]]:
        """(candidate, chunk) to be computed again, in order."""
        return sorted(
            {
                (p.candidate, p.chunk)
                for p in self.problems
                if p.kind == "chunk" and p.candidate is not None and p.chunk is not None
            }
        )

    @property
    def damaged_records(self) -> list[int]:
        """Candidates whose proposal, record or timings are damaged, in order."""
        kinds = ("proposal", "record", "timings")
        return sorted({p.candidate for p in self.problems if p.kind in kinds and p.candidate is not None})


@dataclass(slots=True)
class _Check:
    files: Store
    where: str
    on_chunk: Callable[[int, int], None] | None
    keys: frozenset[str]
    problems: list[Problem] = field(default_factory=list)
    expected: set[str] = field(default_factory=set)
    n_chunks: int = 0

    def add(self, kind: Kind, what: str, candidate: int | None = None, chunk: int | None = None) -> None:
        self.problems.append(Problem(kind=kind, what=what, candidate=candidate, chunk=chunk))


def verify(path: StorePath, *, on_chunk: Callable[[int, int], None] | None = None) -> Report:
    """Read and compare everything in a store. on_chunk is told of each (candidate, chunk) checked.

    Raises StoreMissingError where there is no store, SchemaError for a newer schema; damage is reported, never raised.
    """
    where = normalised(path)
    files = open_files(path, read_only=True)
    keys = list_keys(files)
    check = _Check(files, where, on_chunk, frozenset(keys))
    root = _check_root(check)
    if root is not None:
        layout = _check_schema(check, root)
        if layout is not None:
            _check_candidates(check, root, layout)
        _check_files(check, keys, layout, root.n_committed)
    return Report(
        path=where,
        n_committed=0 if root is None else root.n_committed,
        n_chunks=check.n_chunks,
        problems=tuple(check.problems),
        orphans=tuple(key for key in keys if key.endswith(PARTIAL)),
    )


def _check_root(check: _Check) -> Root | None:
    """The root, or what is left of it; None where nothing is."""
    check.expected |= {ROOT_KEY, BACKUP_KEY, RUNTIME_KEY, LOCK_KEY}
    try:
        root = read_root(check.files, check.where)
    except (DamageError, StoreMissingError) as e:
        backup = read_backup(check.files, check.where)
        if backup is None:
            if isinstance(e, StoreMissingError):
                raise
            check.add("root", f"{e}; its copy is damaged too")
            return None
        check.add("root", str(e))
        return backup
    attributes = root.attributes
    if digests.fingerprint_of(attributes["config"]) != root.fingerprint:
        check.add("root", "the fingerprint is not that of the stored configuration")
    backup = read_backup(check.files, check.where)
    if backup is None or _identity(backup) != _identity(root):
        check.add("root", f"{BACKUP_KEY} is not what was written")
    if read_key(check.files, RUNTIME_KEY) != runtime_text(root):
        check.add("root", f"{RUNTIME_KEY} is not what was written")
    return root


def _identity(root: Root) -> dict[str, Any]:
    changing = ("n_committed", "root_digest")
    return {name: value for name, value in root.attributes.items() if name not in changing}


def read_backup(files: Store, where: str) -> Root | None:
    """The root as it was created; None where that copy is damaged too."""
    try:
        return decode_root(read_key(files, BACKUP_KEY) or b"", where)
    except (DamageError, StoreMissingError):
        return None


def _check_schema(check: _Check, root: Root) -> Layout | None:
    """Metadata of every array, then the static arrays; returns the layout, None where the data cannot be read by it."""
    names = [name for name, entry in root.metadata.items() if entry.get("node_type") == "array"]
    contents = {f"{name}/zarr.json": read_key(check.files, f"{name}/zarr.json") or b"" for name in names}
    check.expected |= set(contents)
    usable = True
    if metadata_digest(contents) != root.attributes["metadata_digest"]:
        before = len(check.problems)
        for name in names:
            if not _same_metadata(contents[f"{name}/zarr.json"], root.metadata[name]):
                check.add("schema", f"the metadata of {name} is not what was written")
                usable = False
        if len(check.problems) == before:
            check.add("schema", "the metadata of an array is not what was written")
    times = np.empty(0)
    for name, expected in root.attributes["static_digests"].items():
        parts = {chunk_key(name, i) for i in range(_n_chunks(root.metadata[name]))}
        check.expected |= parts
        if not parts <= check.keys:
            check.add("static", f"{name} has missing files")
            usable &= name != "time"
            continue
        try:
            values = read_array(check.files, name)
        except UNREADABLE as e:
            check.add("static", f"{name} cannot be read: {e}")
            usable &= name != "time"
            continue
        if digests.array_sha256(values) != expected:
            check.add("static", f"{name} is not what was written")
        if name == "time":
            times = values
    if not usable:
        return None
    n_times = int(root.attributes["layout"]["n_times"])
    return Layout.from_dict(root.attributes["layout"], times if times.size == n_times else np.arange(float(n_times)))


def _same_metadata(content: bytes, entry: dict[str, Any]) -> bool:
    """An array's own metadata against the root's copy, whose candidate length is the committed one."""
    try:
        own = json.loads(content)
    except ValueError:
        return False
    if not isinstance(own, dict) or not isinstance(own.get("shape"), list) or len(own["shape"]) != len(entry["shape"]):
        return False
    first = 1 if (entry.get("dimension_names") or [""])[0] == "candidate" else 0
    if own["shape"][first:] != entry["shape"][first:]:
        return False
    return {**own, "shape": 0} == {**entry, "shape": 0}


def _n_chunks(entry: dict[str, Any]) -> int:
    length: int = entry["shape"][0]
    step: int = entry["chunk_grid"]["configuration"]["chunk_shape"][0]
    return -(-length // step)


def _check_candidates(check: _Check, root: Root, layout: Layout) -> None:
    table = CandidateTable(layout, check.files)
    reader = ChunkReader(check.files, layout)
    table.load(root.n_committed, tolerate_damage=True)
    # A missing file reads as fill values, which can equal what was written: it is damage all the same.
    unusable = {(name, i_chunk, "cannot be read") for name, i_chunk in table.damaged}
    for spec in CANDIDATE_ARRAYS:
        for i_chunk in range(-(-root.n_committed // layout.record_chunk)):
            if record_key(spec, i_chunk) not in check.keys:
                unusable.add((spec.name, i_chunk, "is missing"))
    for name, i_chunk, fate in sorted(unusable):
        first = i_chunk * layout.record_chunk
        stop = min(first + layout.record_chunk, root.n_committed)
        if first >= root.n_committed:
            check.add("pending", f"{name} of candidates from {first} on {fate}")
        for i in range(first, stop):
            check.add(_record_kind(name), f"{name} of candidate {i} {fate}", i)
    for i in range(root.n_committed):
        _check_candidate(check, table, reader, layout, i)
    for i in range(root.n_committed, layout.n_candidates):
        digest = int(table.columns["proposal_digest"][i])
        if digest == 0 or digest != table.proposal_digest(i):
            break
        n_switches = int(table.columns["n_switches"][i])
        markers = reader.markers(i, layout.chunks_of(n_switches))
        for i_chunk in range(layout.chunks_of(n_switches)):
            if markers[i_chunk, 0] == np.uint64(digest):
                _check_chunk(check, reader, i, i_chunk, n_switches, digest, "pending")


def record_key(spec: ArraySpec, i_chunk: int) -> str:
    """Key of one chunk of a per-candidate array."""
    return chunk_key(spec.name, i_chunk, *([0] * (len(spec.dims) - 1)))


def _record_kind(name: str) -> Kind:
    spec = SPECS[name]
    if spec.role == "proposal" or name == "proposal_digest":
        return "proposal"
    return "timings" if spec.role == "wall" or name == "wall_record_digest" else "record"


def _check_candidate(check: _Check, table: CandidateTable, reader: ChunkReader, layout: Layout, i: int) -> None:
    columns = table.columns
    proposed = int(columns["proposal_digest"][i])
    if proposed != table.proposal_digest(i):
        check.add("proposal", f"the proposal of candidate {i} is not what was written", i)
    if int(columns["record_digest"][i]) != table.record_digest(i):
        check.add("record", f"the record of candidate {i} is not what was written", i)
    if int(columns["wall_record_digest"][i]) != table.wall_digest(i):
        check.add("timings", f"the timings of candidate {i} are not what was written", i)
    n_switches = int(columns["n_switches"][i])
    if not 0 < n_switches <= layout.n_switches:
        return  # its proposal is damaged: nothing says which data it should have
    n_chunks = layout.chunks_of(n_switches)
    markers = reader.markers(i, n_chunks)
    failed = bool(columns["failed"][i])
    for i_chunk in range(n_chunks):
        check.expected |= set(chunk_keys(layout, i, i_chunk))
        if failed and not markers[i_chunk].any():
            continue
        for key in chunk_keys(layout, i, i_chunk):
            if key not in check.keys:
                check.add("chunk", f"{key} is missing", i, i_chunk)
        _check_chunk(check, reader, i, i_chunk, n_switches, proposed, "chunk")
    if markers_digest(markers, i, proposed) != int(columns["markers_digest"][i]):
        blamed = any(p.candidate == i and p.kind in ("chunk", "proposal", "record") for p in check.problems)
        if not blamed:
            check.add("chunk", f"the markers of candidate {i} are not those of its record", i, 0)
            for i_chunk in range(1, n_chunks):
                check.add("chunk", f"the markers of candidate {i} are not those of its record", i, i_chunk)


def _check_chunk(
    check: _Check, reader: ChunkReader, i: int, i_chunk: int, n_switches: int, digest: int, kind: Kind
) -> None:
    check.n_chunks += 1
    for problem in reader.problems(i, i_chunk, n_switches, digest):
        check.add(kind, f"candidate {i}, chunk {i_chunk}: {problem}", i, i_chunk)
    if check.on_chunk is not None:
        check.on_chunk(i, i_chunk)


def chunk_keys(layout: Layout, i: int, i_chunk: int) -> Iterator[str]:
    """Keys of all files of one chunk, its marker last."""
    for spec in (*layout.switch_arrays, MARKER):
        yield chunk_key(spec.name, i, i_chunk, *([0] * (len(spec.dims) - 2)))


def _check_files(check: _Check, keys: list[str], layout: Layout | None, n_committed: int) -> None:
    """Every file must belong to something."""
    for name in result_groups(check.files):
        check.expected |= set(group_keys(check.files, name))
        for problem in group_problems(check.files, name):
            check.add("group", problem)
        parts = name.split("/")
        for n in range(1, len(parts)):
            key = f"{'/'.join(parts[:n])}/zarr.json"
            check.expected.add(key)
            if not _is_plain_group(read_key(check.files, key)):
                check.add("group", f"{key} is not what was written")
    if layout is None:
        return  # without a schema nothing says what belongs here
    for spec in CANDIDATE_ARRAYS:
        check.expected |= {record_key(spec, i_chunk) for i_chunk in range(layout.n_record_chunks)}
    pending = {s.name for s in (*layout.switch_arrays, MARKER)}
    for key in keys:
        if key in check.expected or key.endswith(PARTIAL):
            continue
        name, _, last = key.partition("/")
        i = last.removeprefix(f"c{CHUNK_KEY_SEPARATOR}").partition(CHUNK_KEY_SEPARATOR)[0]
        if name in pending and is_chunk_key(key) and i.isdigit() and n_committed <= int(i) < layout.n_candidates:
            continue
        check.add("unknown", f"{key} does not belong to this store")


def _is_plain_group(content: bytes | None) -> bool:
    try:
        document = json.loads(content or b"")
    except ValueError:
        return False
    return bool(document == {"attributes": {}, "zarr_format": 3, "node_type": "group"})
