"""Owns finding damage: everything in a store is read and compared, and every file must belong to something."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from zarr.abc.store import Store

from softclose_store.check.committed import most_rows, remains
from softclose_store.check.report import BlockOf, Damage, ProblemKind, Report
from softclose_store.disk.files import LocalFiles, StorePath, list_keys, look_at, normalised, open_files
from softclose_store.disk.lock import LOCK_KEY
from softclose_store.disk.names import CHUNK_KEY_SEPARATOR, chunk_key, is_partial, is_safe, ways
from softclose_store.errors import DamageError, NotPlainError, StoreError, StoreMissingError
from softclose_store.groups import parents_of, result_groups
from softclose_store.listing import PLAIN_GROUP, listing_problems
from softclose_store.parts import unfinished_parts
from softclose_store.read.arrays import UNREADABLE, chunk_keys, described, read_array
from softclose_store.read.blocks import BlockReader, markers_digest
from softclose_store.read.described import DescribedFiles, never
from softclose_store.read.metadata import is_as_created
from softclose_store.read.result_groups import group_problems
from softclose_store.read.table import MARKERS, N_WALL, PROPOSAL, RECORD, RecordTable
from softclose_store.schema import digests
from softclose_store.schema.fields import N_SURROGATE, unit_in
from softclose_store.schema.hierarchy import (
    HYPERPARAMETER,
    HYPERPARAMETER_UNIT,
    MARKER,
    TABLES,
    metadata_digest,
    schema_of,
    stage_specs,
)
from softclose_store.schema.layout import Layout, StageLayout
from softclose_store.schema.opening import decode_root, layout_without_times, read_root
from softclose_store.schema.root import BACKUP_KEY, EXTENSION_KEY, ROOT_KEY, RUNTIME_KEY, Root, runtime_text
from softclose_store.schema.texts import read_json
from softclose_store.write.extend import pending_extension

OnBlock = Callable[[str, int, int], None]


@dataclass(slots=True)
class _Check:
    files: Store
    where: str
    on_block: OnBlock | None
    keys: frozenset[str]
    problems: list[Damage] = field(default_factory=list)
    expected: set[str] = field(default_factory=set)
    n_blocks: int = 0
    extension: Root | None = None
    extended: Mapping[str, bytes] = field(default_factory=dict)
    """Metadata of an extension that was cut off."""

    def add(
        self,
        kind: ProblemKind,
        what: str,
        *,
        key: str = "",
        candidate: int | None = None,
        block: BlockOf | None = None,
        group: str = "",
    ) -> None:
        self.problems.append(Damage(kind=kind, what=what, key=key, candidate=candidate, block=block, group=group))


def verify(path: StorePath, *, on_block: OnBlock | None = None) -> Report:
    """Read and compare everything in a store; damage is reported, never raised.

    Parameters
    ----------
    path : str or Path
        Folder or URL of the store.
    on_block : callable, optional
        Told of each (stage, i_block, j_block) checked.

    Returns
    -------
    Report

    Raises
    ------
    StoreMissingError
        Where there is no store.
    SchemaError
        For another schema.
    """
    where = normalised(path)
    files = open_files(path, read_only=True)
    keys = list_keys(files)
    check = _Check(files, where, on_block, frozenset(keys))
    root = _check_root(check)
    n_committed = 0
    unlisted: list[str] = []
    if root is not None:
        _expect_extension(check, root)
        read = described(files, root, where, never)
        layout = _check_schema(check, read, root)
        n_committed = _check_number(check, read, layout, root)
        _check_hyperparameters(check, read, root)
        _check_candidates(check, read, n_committed, layout, len(root.attributes["hyperparameters"]))
        _check_groups(check, root.metadata, _displaced(check, root.listed))
        wrong, unlisted = listing_problems(files, root)
        damaged = {problem.group for problem in check.problems}
        for name in sorted(wrong.keys() - damaged):
            check.add("listing", wrong[name])
        _check_files(check, keys, layout, n_committed)
    return Report(
        path=where,
        n_committed=n_committed,
        n_blocks=check.n_blocks,
        problems=tuple(check.problems),
        orphans=tuple(sorted({*(key for key in keys if is_partial(key)), *unfinished_parts(keys)})),
        extension=0
        if check.extension is None
        else layout_without_times(check.extension.attributes["layout"]).n_candidates,
        unlisted=tuple(unlisted),
    )


def _budget(root: Root) -> int:
    return layout_without_times(root.attributes["layout"]).n_candidates


MOST_LOST = 100_000
"""Committed candidates of which no table has a file. Of more, a root says what nothing vouches for."""


def _check_number(check: _Check, read: DescribedFiles, layout: Layout, root: Root) -> int:
    """How many candidates are committed: what the root says, where that can be."""
    found = remains(read, layout, check.keys)
    if "root" in {p.kind for p in check.problems} and not _reads(check.files, check.where):
        return found.n
    if found.n_waves > root.n_waves + 1 or (
        found.n_waves and is_as_created(check.files, root)
    ):  # one more is what a run leaves that was killed before its commit
        what = f"it says {root.n_waves} waves, the records say {found.n_waves}: it is of an earlier time"
        check.add("root", what, key=ROOT_KEY)
    most = most_rows(layout, check.keys)
    if root.n_committed > most + MOST_LOST:
        what = f"it says {root.n_committed} candidates, and the tables have files for {most}"
        check.add("root", what, key=ROOT_KEY)
        return found.n
    return root.n_committed


def _expect_extension(check: _Check, root: Root) -> None:
    """An extension that was cut off is no damage: whoever opens the store for writing completes it."""
    extension = pending_extension(check.files, root, check.where)
    if extension is None:
        return
    check.expected.add(EXTENSION_KEY)
    if extension.fingerprint == root.fingerprint:
        return
    check.extension = extension
    check.extended = schema_of(layout_without_times(extension.attributes["layout"]))
    check.expected |= {key for key in check.extended if key.endswith("/zarr.json")}
    for key in sorted(check.keys):
        name = key.rpartition("/")[0]
        if name not in root.metadata and f"{name}/zarr.json" in check.extended:
            check.expected.add(key)


def _reads(files: Store, where: str) -> bool:
    try:
        read_root(files, where)
    except (DamageError, StoreMissingError):
        return False
    return True


def _check_root(check: _Check) -> Root | None:
    """The root, or what is left of it; None where nothing is."""
    check.expected |= {ROOT_KEY, BACKUP_KEY, RUNTIME_KEY, LOCK_KEY}
    if isinstance(check.files, LocalFiles):
        with contextlib.suppress(NotPlainError):  # something else than a folder above it is found by its own key
            if check.files.below.kind(LOCK_KEY) not in ("", "a file"):
                check.expected.remove(LOCK_KEY)
    try:
        root = read_root(check.files, check.where)
    except (DamageError, StoreMissingError) as e:
        backup = read_backup(check.files, check.where)
        if backup is None:
            if isinstance(e, StoreMissingError):
                raise
            check.add("root", f"{e}; its copy is damaged too", key=ROOT_KEY)
            return None
        check.add("root", str(e), key=ROOT_KEY)
        return backup
    if digests.fingerprint_of(root.attributes["config"]) != root.fingerprint:
        check.add("root", "the fingerprint is not that of the stored configuration", key=ROOT_KEY)
    extended = pending_extension(check.files, root, check.where)
    backup_text, runtime = look_at(check.files, BACKUP_KEY), look_at(check.files, RUNTIME_KEY)
    if backup_text != root.created().encode() and (extended is None or backup_text != extended.created().encode()):
        check.add("root", f"{BACKUP_KEY} is not what was written", key=BACKUP_KEY)
    if not _tells_the_runs(runtime, root) and (extended is None or runtime != runtime_text(extended)):
        check.add("root", f"{RUNTIME_KEY} is not what was written", key=RUNTIME_KEY)
    return root


def _tells_the_runs(content: bytes | None, root: Root) -> bool:
    """Whether the group `runtime` says what the root says.

    A run that was killed as it began may be one ahead, and one that was killed as it ended may say more of itself.
    """
    if content == runtime_text(root):
        return True
    try:
        last = read_json(content or b"")["attributes"]["runs"][-1]
    except (ValueError, KeyError, TypeError, IndexError):
        return False
    return isinstance(last, dict) and content in (runtime_text(root.noted(last)), runtime_text(root.amended(last)))


def read_backup(files: Store, where: str) -> Root | None:
    """The root as it was created; None where that copy is damaged too."""
    try:
        return decode_root(look_at(files, BACKUP_KEY) or b"", where)
    except (DamageError, StoreMissingError):
        return None


def _check_schema(check: _Check, read: DescribedFiles, root: Root) -> Layout:
    """Metadata of every array, then the static arrays; the layout."""
    layout = layout_without_times(root.attributes["layout"])
    _check_metadata(check, read, root)
    for name, expected in root.attributes["static_digests"].items():
        if f"{name}/zarr.json" not in read.documents:
            check.add("root", f"it names {name!r}, which is no array of its layout", key=ROOT_KEY)
            continue
        parts = set(chunk_keys(read, name))
        check.expected |= parts
        for key in sorted(parts - check.keys):
            check.add("static", f"{key} is missing", key=key)
        if not parts <= check.keys:
            continue
        try:
            values = read_array(read, name)
        except UNREADABLE as e:
            check.add("static", f"{name} cannot be read: {e}", key=chunk_key(name, 0))
            continue
        if digests.array_sha256(values) != expected:
            check.add("static", f"{name} is not what was written", key=chunk_key(name, 0))
    return layout


def _check_metadata(check: _Check, read: DescribedFiles, root: Root) -> None:
    keys = sorted(key for key in read.documents if key.endswith("/zarr.json") and key != RUNTIME_KEY)
    contents = {key: look_at(check.files, key) or b"" for key in keys}
    check.expected |= set(contents)
    if metadata_digest(contents) == root.attributes["metadata_digest"]:
        return
    for key in _different(contents, read.documents):
        if contents[key] != check.extended.get(key, b"-"):
            check.add("schema", f"{key} is not what was written", key=key)


def _different(contents: Mapping[str, bytes], documents: Mapping[str, bytes]) -> list[str]:
    """Keys of metadata that are not the schema's; all of them where none is told apart."""
    return [key for key in contents if not _same(contents[key], documents[key])] or list(contents)


def _same(content: bytes, expected: bytes) -> bool:
    try:
        return bool(read_json(content) == read_json(expected))
    except ValueError:
        return False


def _check_hyperparameters(check: _Check, read: DescribedFiles, root: Root) -> None:
    names = list(root.attributes["hyperparameters"])
    for array, texts in ((HYPERPARAMETER, names), (HYPERPARAMETER_UNIT, [unit_in(name) for name in names])):
        key = chunk_key(array, 0)
        check.expected.add(key)
        try:
            found = [str(text) for text in read_array(read, array)] if key in check.keys else []
        except UNREADABLE:
            found = []
        # A commit that was killed has written the names that it would have added.
        if len(found) != N_SURROGATE or found[: len(texts)] != texts:
            check.add("static", f"{key} is not what was written", key=key)


def _check_candidates(check: _Check, read: DescribedFiles, n: int, layout: Layout, n_names: int) -> None:
    table = RecordTable(layout)
    table.load(read, n, tolerate_damage=True)
    if table.n_hyperparameters() > n_names and not any(p.kind == "root" for p in check.problems):
        check.add("static", "the names of the surrogate's quantities are lost", key=chunk_key(HYPERPARAMETER, 0))
    # A missing file reads as fill values, which can equal what was written: it is damage all the same.
    for name in TABLES:
        for i_chunk in range(table.chunks_of(n)):
            key = chunk_key(name, i_chunk, 0)
            missing = key not in check.keys
            if missing or (name, i_chunk) in table.damaged:
                fate = "is missing" if missing else "cannot be read"
                rows = table.rows(i_chunk)
                for i in range(rows.start, min(rows.stop, n)):
                    _add_lost(check, name, f"{key}, with candidate {i}, {fate}", key, i)
    for i in range(n):
        _check_record(check, table, i)
    reader = BlockReader(read, layout)
    for stage in layout.stages:
        n_stage = layout.committed_of(stage, n)
        for i in range(-(-n_stage // stage.block_candidates)):
            _check_row_of_blocks(check, table, reader, stage, i)
        _check_pending(check, reader, layout, stage, n_stage)


def _add_lost(check: _Check, table: str, what: str, key: str, i: int) -> None:
    kinds: dict[str, tuple[ProblemKind, ...]] = {"surrogate": ("proposal",), "wall_times": ("timings",)}
    for kind in kinds.get(TABLES[table].name, ("proposal", "record")):
        check.add(kind, what, key=key, candidate=i)


def _check_record(check: _Check, table: RecordTable, i: int) -> None:
    if int(table.digests[i, PROPOSAL]) != table.proposal_digest(i):
        check.add("proposal", f"the proposal of candidate {i} is not what was written", candidate=i)
    if int(table.digests[i, RECORD]) != table.record_digest(i):
        check.add("record", f"the record of candidate {i} is not what was written", candidate=i)
    if table.wall_times[i, N_WALL] != table.wall_check(i):
        check.add("timings", f"the timings of candidate {i} are not what was written", candidate=i)


def _check_row_of_blocks(check: _Check, table: RecordTable, reader: BlockReader, stage: StageLayout, i: int) -> None:
    """All blocks of some committed candidates against their markers, and these against the records."""
    first = table.layout.first(stage.name)
    candidates = range(first + stage.candidates(i).start, first + stage.candidates(i).stop)
    damaged = {p.candidate for p in check.problems if p.kind in ("proposal", "record")}
    intact = [k for k in candidates if k not in damaged]
    # A damaged proposal does not say what the blocks should be of: their markers are believed, and compared with the
    # records of the others. Where none is intact, not even their number is known: those that are there are checked.
    proposals, n_switches = table.block_proposals(stage, i)
    trusted = len(intact) == len(candidates)
    if not trusted:
        n_switches = max((table.n_switches(k) for k in intact), default=0)
    columns = [
        j
        for j in range(stage.n_block_switches)
        if (
            j < stage.blocks_of(n_switches)
            if n_switches
            else check.keys & set(block_keys(table.layout, stage.name, i, j))
        )
    ]
    before = len(check.problems)
    for j in columns:
        block = (stage.name, i, j)
        keys = list(block_keys(table.layout, *block))
        check.expected |= set(keys)
        for key in keys:
            if key not in check.keys:
                check.add("block", f"{key} is missing", key=key, block=block)
        _check_block(check, reader, block, proposals if trusted else None, "block")
    if not intact or not columns:
        return
    markers = np.stack([reader.marker(stage.name, i, j) for j in columns])
    foreign = next((k for k in intact if markers_digest(markers, k) != int(table.digests[k, MARKERS])), None)
    if foreign is None or not markers.all():
        return
    # Where data differ from their marker, that one is foreign; where none do, any of the row's may be.
    differing = sorted({p.block[2] for p in check.problems[before:] if p.block is not None})
    told = []
    for j in differing or columns:
        key = list(block_keys(table.layout, stage.name, i, j))[-1]
        what = f"{key}, the marker of block ({i}, {j}), is not that of candidate {foreign}'s record"
        told.append(Damage(kind="block", what=what, key=key, block=(stage.name, i, j)))
    check.problems[before:before] = told


def _check_block(check: _Check, reader: BlockReader, block: BlockOf, proposals: int | None, kind: ProblemKind) -> None:
    check.n_blocks += 1
    stage, i, j = block
    for problem in reader.problems(stage, i, j, proposals):
        check.add(kind, f"stage {stage}, block ({i}, {j}): {problem}", block=block)
    if check.on_block is not None:
        check.on_block(stage, i, j)


def _check_pending(check: _Check, reader: BlockReader, layout: Layout, stage: StageLayout, n_stage: int) -> None:
    """Blocks that are marked and not committed: a run that was killed goes on from them."""
    prefix = f"{stage.name}/{MARKER.name}/"
    for key in sorted(check.keys):
        i, j = _indices(key)[:2] if key.startswith(prefix) else (-1, -1)
        inside = n_stage <= i * stage.block_candidates < stage.n_candidates and 0 <= j < stage.n_block_switches
        if inside and key == chunk_key(prefix.rstrip("/"), i, j, 0):
            _check_block(check, reader, (stage.name, i, j), None, "pending")


def _indices(key: str) -> list[int]:
    """Indices in the key of a chunk, -1 for what is no number."""
    parts = key.rpartition("/")[2].split(CHUNK_KEY_SEPARATOR)[1:]
    indices = [int(part) if part.isascii() and part.isdigit() and str(int(part)) == part else -1 for part in parts]
    return indices if len(indices) >= 2 else [-1, -1]


def block_keys(layout: Layout, stage: str, i: int, j: int) -> Iterator[str]:
    """Keys of all files of one block, its marker last."""
    for spec in stage_specs(layout):
        yield chunk_key(f"{stage}/{spec.name}", i, j, *([0] * (len(spec.dims) - 2)))


def _displaced(check: _Check, listed: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Result groups that the root lists, in whose place, or in that of a folder above them, something else lies."""
    groups = {name.rpartition("/")[0] for name, entry in listed.items() if entry.get("node_type") == "array"}
    return sorted(name for name in groups if is_safe(name) and any(place in check.keys for place in ways(name)))


def _check_groups(check: _Check, own_names: Collection[str], displaced: Sequence[str]) -> None:
    """Result groups, those included whose own metadata is lost: its copy, or their arrays, say that they were there.

    displaced: those of which not even a folder is left.
    """
    for name in displaced:
        check.add("group", f"something else lies in the place of {name}", group=name)
    found = result_groups(check.files, sorted(check.keys))
    for name, metadata in found.items():
        check.expected.add(f"{name}/zarr.json")
        if metadata is not None:
            with contextlib.suppress(StoreError):  # its foreign names are among its problems
                check.expected |= set(metadata.keys)
        for problem in group_problems(check.files, name, metadata):
            check.add("group", problem, group=name)
    lost = [name for name in _lost_groups(check, own_names) if not any(_is_within(name, known) for known in found)]
    for name in lost:
        check.expected |= {key for key in check.keys if key.startswith(f"{name}/") and not is_partial(key)}
        check.add("group", f"{name}/zarr.json is lost or not what was written, and so is its copy", group=name)
    for key in sorted({key for name in (*found, *lost) for key in parents_of(name)}):
        check.expected.add(key)
        if not _is_plain_group(look_at(check.files, key)):
            check.add("group", f"{key} is not what was written", key=key)


def _is_within(name: str, group: str) -> bool:
    return name == group or name.startswith(f"{group}/")


def _lost_groups(check: _Check, own_names: Collection[str]) -> list[str]:
    """Groups of which nothing is left but arrays. What an extension began that was cut off is none: it is a stray."""
    own = {name.partition("/")[0] for name in own_names}
    own |= {key.partition("/")[0] for key in check.keys if key.endswith(f"/{MARKER.name}/zarr.json")}
    names = set()
    for key in check.keys:
        array = key.removesuffix("/zarr.json")
        name = array.rpartition("/")[0]
        if array != key and name and key.partition("/")[0] not in own and _node_type(check, key) == "array":
            names.add(name)
    return sorted(name for name in names if is_safe(name))


def _node_type(check: _Check, key: str) -> str:
    try:
        return str(read_json(look_at(check.files, key) or b"").get("node_type"))
    except (ValueError, AttributeError):
        return ""


def _check_files(check: _Check, keys: list[str], layout: Layout, n: int) -> None:
    """Every file must belong to something."""
    check.expected |= {chunk_key(name, i, 0) for name in TABLES for i in range(layout.n_table_chunks)}
    check.expected |= set(unfinished_parts(keys))
    for key in keys:
        if key in check.expected or is_partial(key) or _may_be_pending(layout, key, n) or _holds_nothing(check, key):
            continue
        shown = key if key.isprintable() else ascii(key)  # a terminal would take a control character for an instruction
        check.add("unknown", f"{shown} does not belong to this store", key=key)


def _holds_nothing(check: _Check, key: str) -> bool:
    """True for the group of groups that were all deleted."""
    name, _, last = key.partition("/")
    return last == "zarr.json" and is_safe(name) and _is_plain_group(look_at(check.files, key))


def _may_be_pending(layout: Layout, key: str, n: int) -> bool:
    """True for a chunk of a block of candidates that are not committed yet."""
    parts = key.split("/")
    if len(parts) != 3 or parts[0] not in {stage.name for stage in layout.stages}:
        return False
    stage = layout.stage(parts[0])
    i, j = _indices(key)[:2]
    inside = layout.committed_of(stage, n) <= i * stage.block_candidates < stage.n_candidates
    return inside and 0 <= j < stage.n_block_switches and key in set(block_keys(layout, stage.name, i, j))


def _is_plain_group(content: bytes | None) -> bool:
    try:
        document = read_json(content or b"")
    except ValueError:
        return False
    return bool(document == PLAIN_GROUP)
