"""Owns repair: damaged files are written again from what produces them, and proved equal to what was there.

What can be computed again: the root (from its copy and everything that remains), array metadata and population (from
the configuration), blocks, proposals and records (pure functions), derived groups. Timings are lost. What
does not belong to the store is moved out of it. The science comes in as callbacks: this package knows none.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import accumulate, groupby
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from zarr.abc.store import Store

from softclose_store.check.committed import remains
from softclose_store.check.report import BlockOf, Report
from softclose_store.check.restore import RepairStore
from softclose_store.check.strays import clear_the_way, set_aside
from softclose_store.check.verify import block_keys, read_backup, verify
from softclose_store.disk.files import (
    StorePath,
    delete_key,
    list_keys,
    look_at,
    normalised,
    open_files,
    write_key,
)
from softclose_store.disk.lock import LOCK_KEY, DriverLock
from softclose_store.disk.names import checked_member, is_partial
from softclose_store.errors import DamageError, StoreError
from softclose_store.listing import PLAIN_GROUP, list_groups_again
from softclose_store.parts import unfinished_parts
from softclose_store.read.arrays import UNREADABLE, described, read_array
from softclose_store.read.described import DescribedFiles, never
from softclose_store.read.result_groups import group_problems, metadata_of
from softclose_store.schema import digests
from softclose_store.schema.documents import RuntimeDocument, checked
from softclose_store.schema.group_metadata import OWN, GroupMetadata, decode
from softclose_store.schema.hierarchy import (
    HYPERPARAMETER,
    HYPERPARAMETER_UNIT,
    build_hierarchy,
    constants_of,
    metadata_digest,
    population_columns,
)
from softclose_store.schema.layout import Layout
from softclose_store.schema.opening import decode_root, write_root
from softclose_store.schema.root import BACKUP_KEY, ROOT_KEY, RUNTIME_KEY, Root, runtime_text
from softclose_store.schema.texts import read_json
from softclose_store.write.block import check_block, forget_writer, marker_of, write_block
from softclose_store.write.driver import DriverStore
from softclose_store.write.extend import complete_extension


@dataclass(frozen=True, slots=True, kw_only=True)
class Recompute:
    """How to compute again what a store holds."""

    population: Callable[[Mapping[str, Any]], Mapping[str, ArrayLike]]
    """Configuration -> the columns D, G, E, T, K, M."""
    times_us: Callable[[Mapping[str, Any]], ArrayLike]
    """Configuration -> the time grid [µs]."""
    waves: Callable[[Mapping[str, Any]], Sequence[int]]
    """Configuration -> the sizes of all waves of the campaign, in order."""
    proposals: Callable[[DriverStore, int, int], Sequence[Mapping[str, Any]]]
    """(store, first candidate, size) of a wave -> its proposals, from the records before it: waveform, n_switches,
    origin, note, surrogate."""
    block: Callable[[DriverStore, str, int, int], Mapping[str, NDArray[Any]]]
    """The arrays of (stage, i_block, j_block), from the proposals of its candidates."""
    record: Callable[[DriverStore, int], Mapping[str, Any]]
    """The result of a candidate, from its blocks."""
    group: Callable[[str, str, Mapping[str, Any] | None], str] | None = None
    """(path, name, attributes) of a derived group that is damaged: writes it again (`write_group`, replace).

    Returns why it cannot, and what to do, "" where it did. attributes: what was said of the result; None where nothing
    says it any more."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RepairReport:
    """What a repair did."""

    proved: tuple[str, ...]
    """Written again and equal, by digest, to what was there; or moved aside."""
    unproved: tuple[str, ...]
    """Written again, but nothing intact is left to compare it with; or lost (timings)."""
    failed: tuple[str, ...]
    """What could not be written again, why, and what to do."""
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
    failed: list[str] = field(default_factory=list)

    def add(self, what: str, proved: bool) -> None:
        (self.proved if proved else self.unproved).append(what)


def repair(path: StorePath, recompute: Recompute, *, break_lock: bool = False) -> RepairReport:
    """Write everything that is damaged again, prove it equal, and remove what a kill left behind.

    Files that belong to nothing are moved into `<store>.strays`, beside the store.

    Parameters
    ----------
    path : str or Path
        Folder or URL of the store.
    recompute : Recompute
        How what it holds is computed again.
    break_lock : bool
        Take the lock of a driver that is gone.

    Returns
    -------
    RepairReport

    Raises
    ------
    LockedError
        While a driver works on the store.
    DamageError
        Where what was computed is not what was stored (another processor or library version: the damaged bytes stay as
        they are).
    """
    report = verify(path)
    listed = _listed(path)
    log = _Log()
    _clear(path, [LOCK_KEY], log)  # what lies there is no lock, and where it leads nothing may be written
    lock = DriverLock(path)
    lock.acquire(break_lock=break_lock)
    try:
        _set_strays_aside(path, report, log)
        frame = bool({p.kind for p in report.problems} & {"root", "schema", "static"})
        if frame:
            _repair_frame(path, recompute, report, log)
        if report.extension:
            complete_extension(open_files(path, read_only=False), normalised(path))
            log.add(f"an extension to {report.extension} candidates, which was cut off, is complete", proved=True)
    finally:
        lock.release()
    forget_writer(path)
    if frame or report.extension:
        report = verify(path)  # again: what a damaged frame hid shows now
        _set_strays_aside(path, report, log)
    if not report.ok:
        with RepairStore(path, break_lock=break_lock) as store:
            _repair_waves(store, recompute, report, log)
            _remove_pending(store, report, log)
    _repair_groups(path, recompute, report, listed, log)
    remove_orphans(path)
    list_groups_again(path)
    return RepairReport(
        proved=tuple(log.proved), unproved=tuple(log.unproved), failed=tuple(log.failed), after=verify(path)
    )


def _set_strays_aside(path: StorePath, report: Report, log: _Log) -> None:
    files = open_files(path, read_only=False)
    strays = [p.key for p in report.problems if p.kind == "unknown" and p.key in set(list_keys(files))]
    for key, place in zip(strays, set_aside(path, strays), strict=True):
        log.add(f"{key} does not belong to the store; it is now {place}", proved=True)


def _clear(path: StorePath, keys: Sequence[str], log: _Log) -> None:
    for place in clear_the_way(path, keys):
        log.add(f"what was no file is now {place}", proved=True)


def remove_orphans(path: StorePath) -> list[str]:
    """Delete the temporary files that a kill left behind; returns their keys. For stores that nobody is writing."""
    files = open_files(path, read_only=False)
    keys = list_keys(files)
    orphans = [*(key for key in keys if is_partial(key)), *unfinished_parts(keys)]
    for key in orphans:
        delete_key(files, key)
    return orphans


def _repair_frame(path: StorePath, recompute: Recompute, report: Report, log: _Log) -> None:
    """Root, its copy, runtime, array metadata and static arrays."""
    where = normalised(path)
    files = open_files(path, read_only=False)
    root = _root(files, where)
    source = root or read_backup(files, where)
    if any(p.key == ROOT_KEY for p in report.problems):  # it can be read, and is of an earlier time
        root = None
    if source is None:
        raise DamageError(f"{where}: the root and its copy are both damaged; nothing says any more what this store is")
    attributes = source.attributes
    config = attributes["config"]
    layout = Layout.from_dict(attributes["layout"], np.asarray(recompute.times_us(config), dtype=float))
    built = build_hierarchy(
        layout,
        config=config,
        fingerprint=source.fingerprint,
        algorithm=source.algorithm,
        population=population_columns(layout, recompute.population(config)),
        constants=constants_of(source),
        runtime=_runtime(source),
        durable=bool(attributes["durable"]),
    )
    fresh = decode_root(built[ROOT_KEY], where)
    for name, expected in attributes["static_digests"].items():
        if fresh.attributes["static_digests"].get(name) != expected:
            raise DamageError(f"{where}: {name} computed again from the configuration is not what was stored")
    read = described(files, source, where, never)
    same_metadata = metadata_digest(built) == attributes["metadata_digest"]
    for key, content in built.items():
        if key in (ROOT_KEY, BACKUP_KEY, RUNTIME_KEY) or look_at(files, key) == content:
            continue
        is_metadata = key.endswith("/zarr.json")
        if is_metadata and not same_metadata:
            raise DamageError(f"{where}: this version of zarr writes other metadata than the store's; use the same one")
        if is_metadata or not _static_is_intact(read, key, attributes["static_digests"]):
            _clear(path, [key], log)
            write_key(files, key, content)
            log.add(f"{key} written again", proved=True)
    _clear(path, [ROOT_KEY, RUNTIME_KEY, BACKUP_KEY], log)
    if root is None:
        root = _rebuild_root(files, source, layout, recompute, where, log)
    if look_at(files, RUNTIME_KEY) != runtime_text(root):
        write_key(files, RUNTIME_KEY, runtime_text(root))
        log.add(f"{RUNTIME_KEY} written again", proved=True)
    if look_at(files, BACKUP_KEY) != root.created().encode():
        write_key(files, BACKUP_KEY, root.created().encode())
        log.add(f"{BACKUP_KEY} written again", proved=True)


def _rebuild_root(files: Store, source: Root, layout: Layout, recompute: Recompute, where: str, log: _Log) -> Root:
    """The root with as many waves committed as everything that remains says: whole waves only."""
    found = remains(described(files, source, where, never), layout, frozenset(list_keys(files)))
    ends = list(accumulate(recompute.waves(source.attributes["config"])))
    n_waves = sum(1 for end in ends if end <= found.n)
    if n_waves < len(ends) and found.n > (ends[n_waves - 1] if n_waves else 0):
        n_waves += 1  # a wave's first records were written after its blocks, so the wave can be completed
    n = ends[n_waves - 1] if n_waves else 0
    root = source.committed(n, n_waves, found.hyperparameters)
    runtime = _runtime_on_disk(files, source)
    root = root.with_runtime(runtime or _runtime(source))
    write_root(files, root)
    if runtime is None:
        log.add("who ran the campaign after its creation is lost", proved=False)
    elif runtime != _runtime(source):
        log.add(f"who ran the campaign is taken from {RUNTIME_KEY}", proved=False)
    what = f"{ROOT_KEY} rebuilt with {n} committed candidates"
    if not found.certain:
        what += ": the most that any table says; a resume takes up whatever blocks there are beyond"
    log.add(what, proved=found.certain)
    return root


def _runtime(root: Root) -> dict[str, Any]:
    attributes: dict[str, Any] = root.metadata["runtime"]["attributes"]
    return attributes


def _runtime_on_disk(files: Store, source: Root) -> dict[str, Any] | None:
    """What the group `runtime` says, where it is that of this campaign: it says of the creation what the copy says."""
    try:
        attributes = read_json(look_at(files, RUNTIME_KEY) or b"")["attributes"]
        checked(RuntimeDocument, attributes)
        created = {name: value for name, value in attributes.items() if name != "runs"}
    except (ValueError, KeyError, TypeError, AttributeError):
        return None
    return attributes if created == _runtime(source.created()) else None


def _static_is_intact(files: DescribedFiles, key: str, expected: Mapping[str, str]) -> bool:
    name = key.rpartition("/")[0]
    if name in (HYPERPARAMETER, HYPERPARAMETER_UNIT):
        return True  # it grows: the driver writes it again from the root
    try:
        return look_at(files.inner, key) is not None and digests.array_sha256(read_array(files, name)) == expected[name]
    except UNREADABLE:
        return False


def _repair_waves(store: RepairStore, recompute: Recompute, report: Report, log: _Log) -> None:
    """Proposals, blocks and records, in order of the waves: each needs those before it."""
    kinds: dict[int, set[str]] = {}
    for problem in report.problems:
        if problem.candidate is not None:
            kinds.setdefault(problem.candidate, set()).add(problem.kind)
    blocks = set(report.damaged_blocks)
    start = 0
    for size in recompute.waves(store.config):
        if start >= store.n_committed:
            break
        candidates = range(start, start + size)
        stage, local = store.layout.stage_of(start)
        rows = range(local // stage.block_candidates, -(-(local + size) // stage.block_candidates))
        own = {block for block in blocks if block[0] == stage.name and block[1] in rows}
        proposals = [i for i in candidates if "proposal" in kinds.get(i, ())]
        lost_names = store.lost_names()
        again = recompute.proposals(store, start, size) if proposals or lost_names else ()
        for row in again if lost_names else ():
            store.learn_names(row)
        if proposals:
            for i in proposals:
                _repair_proposal(store, i, again[i - start], log)
            own |= _not_stored(store, stage.name, start, size)
        _repair_blocks(store, recompute, sorted(own), log)
        for i in candidates:
            if kinds.get(i, set()) & {"record", "proposal"}:
                _repair_record(store, recompute, i, log)
            if "timings" in kinds.get(i, ()):
                store.restore_timings(i)
                log.add(f"timings of candidate {i} are lost", proved=False)
        start += size
    names = [p.key for p in report.problems if p.kind == "static"]  # those that only grow: the frame has no others left
    if kinds or names:
        _clear(store.path, store.restored_keys(), log)
        store.write_restored()
    for key in names:
        log.add(f"{key} written again", proved=True)


def _repair_proposal(store: RepairStore, i: int, row: Mapping[str, Any], log: _Log) -> None:
    stored = store.stored_digests(i)["proposal"]
    found, same = store.restore_proposal(i, row)
    if stored not in (0, found) and not same:  # the same: its digest is another candidate's
        raise _differs(f"the proposal of candidate {i}")
    log.add(f"proposal of candidate {i} computed again", proved=found == stored or (same and stored != 0))


def _not_stored(store: RepairStore, stage: str, start: int, size: int) -> set[BlockOf]:
    """Blocks of a wave that are not stored under its proposals, now that these are whole again."""
    blocks = store.wave_blocks(start, size)
    expected = [store.proposals_digest(stage, i) for i, _ in blocks]
    done = store.blocks_done(stage, blocks, expected)
    return {(stage, i, j) for (i, j), is_done in zip(blocks, done, strict=True) if not is_done}


def _repair_blocks(store: RepairStore, recompute: Recompute, blocks: Sequence[BlockOf], log: _Log) -> None:
    """Nothing on the disk changes until what was computed is known to be what was stored, where anything tells."""
    for (stage, i), row in groupby(blocks, key=lambda block: block[:2]):
        columns = [j for _, _, j in row]
        markers: dict[int, NDArray[np.uint64]] = {}
        arrays: Mapping[str, NDArray[Any]] = {}
        for j in columns:
            arrays = recompute.block(store, stage, i, j)
            values, n_switches = check_block(store.layout, stage, i, j, arrays)
            markers[j] = marker_of(stage, i, j, values, n_switches, store.proposals_digest(stage, i))
        told = store.told_by_records(stage, i, markers)
        for j in columns:
            before = store.markers(stage, [(i, j)])[i, j]
            same = bool(np.array_equal(markers[j], before))
            is_intact = before.all() and before[0] == markers[j][0]
            if told is False or (told is None and is_intact and not same):
                raise _differs(f"stage {stage}, block ({i}, {j})")
            log.add(f"stage {stage}, block ({i}, {j}) computed again", proved=bool(told) or same)
        for j in columns:  # all again but the last: a row of blocks may be larger than the memory
            again = arrays if j == columns[-1] else recompute.block(store, stage, i, j)
            _clear(store.path, list(block_keys(store.layout, stage, i, j)), log)
            write_block(store.path, stage, i, j, again, int(markers[j][0]))


def _repair_record(store: RepairStore, recompute: Recompute, i: int, log: _Log) -> None:
    stored = store.stored_digests(i)["record"]
    wave = _wave_of(recompute.waves(store.config), i)
    found, same = store.restore_record(i, recompute.record(store, i), wave)
    if stored not in (0, found) and not same:
        raise _differs(f"the record of candidate {i}")
    log.add(f"record of candidate {i} computed again", proved=found == stored or (same and stored != 0))


def _wave_of(sizes: Sequence[int], i: int) -> int:
    return next(wave for wave, end in enumerate(accumulate(sizes)) if i < end)


def _remove_pending(store: RepairStore, report: Report, log: _Log) -> None:
    """Damaged blocks of candidates that are not committed go: a resume computes them again."""
    files = open_files(store.path, read_only=False)
    for stage, i, j in sorted({p.block for p in report.problems if p.kind == "pending" and p.block is not None}):
        for key in reversed(list(block_keys(store.layout, stage, i, j))):
            delete_key(files, key)
        log.add(
            f"stage {stage}, block ({i}, {j}), not committed and damaged, removed: resuming computes it", proved=True
        )


def _root(files: Store, where: str) -> Root | None:
    """The root as it lies there; None where it cannot be read."""
    try:
        return decode_root(look_at(files, ROOT_KEY) or b"", where)
    except StoreError:
        return None


def _listed(path: StorePath) -> dict[str, dict[str, Any]]:
    """What the root lists of result groups before anything is repaired: what is lost is not listed afterwards."""
    root = _root(open_files(path, read_only=True), normalised(path))
    return {} if root is None else root.listed  # the copy of a root that is lost is from the creation: it lists none


def _repair_groups(
    path: StorePath, recompute: Recompute, report: Report, listed: Mapping[str, Mapping[str, Any]], log: _Log
) -> None:
    """Derived groups: metadata from the copy, then each is written again by whoever knows how.

    Of a group of which nothing is left the root still lists what was said of it, and its digest.
    """
    files = open_files(path, read_only=False)
    for problem in report.problems:
        if problem.kind == "group" and problem.key:
            _clear(path, [problem.key], log)
            write_key(files, problem.key, json.dumps(PLAIN_GROUP, indent=2).encode())
            log.add(f"{problem.key} written again", proved=True)
    for name in report.damaged_groups:
        keys = list_keys(files)
        metadata = metadata_of(files, name, keys)
        if metadata is None:
            attributes = dict(listed[name]["attributes"]) if name in listed else None
            before = None if attributes is None else attributes.pop(OWN, None)
            if recompute.group is not None and not recompute.group(normalised(path), name, attributes):
                again = decode(look_at(files, f"{name}/zarr.json"), name)
                is_same = again is not None and again.digest == before
                log.add(f"group {name}, of whose metadata nothing was left, computed again", proved=is_same)
                continue
            left = any(key.startswith(f"{name}/") for key in keys)
            log.failed.append(
                f"group {name}: its own metadata and their copy are lost, so nothing says what it holds: "
                + (f"delete {normalised(path)}/{name} and make it again" if left else "make it again")
            )
            continue
        _clear(path, metadata.keys, log)
        _restore_group_metadata(files, metadata, log)
        if not group_problems(files, name, metadata):
            continue
        reason = "nobody knows how to compute it again"
        if recompute.group is not None:
            reason = recompute.group(normalised(path), name, metadata.attributes)
        if reason:
            log.failed.append(f"group {name}: {reason}")
            continue
        again = metadata_of(files, name, keys)
        log.add(f"group {name} computed again", proved=again is not None and again.files == metadata.files)


def _restore_group_metadata(files: Store, metadata: GroupMetadata, log: _Log) -> None:
    """The group's own metadata and their copy, each from the other."""
    written = {f"{metadata.name}/zarr.json": metadata.encode()}
    if metadata.copy_member is not None:
        written[checked_member(metadata.name, metadata.copy_member)] = metadata.copy()
    for key, content in written.items():
        if look_at(files, key) != content:
            write_key(files, key, content)
            log.add(f"{key} written again", proved=True)


def _differs(what: str) -> DamageError:
    return DamageError(
        f"{what} computed again is not what was stored: repair it on the processor and with the versions that the "
        "group `runtime` names"
    )
