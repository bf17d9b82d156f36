"""Owns the extension of a finished campaign: more stages at its end, everything before them untouched.

What the extended campaign will be is written down first, in a file of its own; then its new files, and its root last.
Whoever next opens for writing a store in which that file lies completes the extension. Until the root is replaced the
campaign is what it was, to every reader.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from zarr.abc.store import Store

from softclose_store.disk.files import StorePath, delete_key, look_at, normalised, open_files, write_key
from softclose_store.disk.lock import DriverLock
from softclose_store.errors import LayoutError, OtherAlgorithmError, OtherConfigurationError, StoreError
from softclose_store.read.arrays import described, layout_of, population_of, read_static
from softclose_store.read.metadata import age_problem, check_metadata
from softclose_store.read.table import RecordTable
from softclose_store.schema import digests
from softclose_store.schema.hierarchy import TABLES, build_hierarchy, constants_of, growing_arrays
from softclose_store.schema.layout import Layout
from softclose_store.schema.opening import decode_root, layout_without_times, read_root, write_root
from softclose_store.schema.root import BACKUP_KEY, EXTENSION_KEY, ROOT_KEY, RUNTIME_KEY, Root, runtime_text
from softclose_store.write.create import other_algorithm

MAY_CHANGE = "extensions"
"""The one entry of a configuration's section `campaign` that an extension changes."""


def extend_campaign(
    path: StorePath,
    *,
    layout: Layout,
    config: Mapping[str, Any],
    algorithm: str,
    note: Mapping[str, Any],
    break_lock: bool = False,
) -> None:
    """Add stages to a finished campaign. The replacement of the root is the extension; until then it is as it was.

    Parameters
    ----------
    path : str or Path
        Folder or URL of the store.
    layout : Layout
        That of the extended campaign, whose first stages are those of the store.
    config : mapping
        As at the creation, but for `campaign.extensions`.
    algorithm : str
        As at the creation.
    note : mapping
        Joins the runs in the group `runtime`, with the candidates and the fingerprint before.
    break_lock : bool
        Take the lock of a driver that is gone.

    Raises
    ------
    StoreError
        Where the campaign is not finished.
    OtherConfigurationError
        Where anything else would change.
    LayoutError
        Where a stage would.
    OtherAlgorithmError
        For another algorithm: it would not go on as it began.
    DamageError
        Where anything that the extension builds on is not what was written; nothing was changed.
    """
    where = normalised(path)
    lock = DriverLock(path)
    lock.acquire(break_lock=break_lock)
    try:
        files = open_files(path, read_only=False)
        complete_extension(files, where)
        root = read_root(files, where)
        plain = json.loads(digests.canonical_json(config))
        if plain == root.attributes["config"]:
            return  # it was cut off before, and is complete now
        read = described(files, root, where)
        old = layout_of(read, root)
        table = RecordTable(old)
        table.load(read, root.n_committed)
        table.check(read, root.n_committed)
        if what := age_problem(files, root, table.waves_beyond(read, root.n_committed)):
            raise read.damage(ROOT_KEY, what)
        _check(root, old, layout, plain, algorithm, where)
        check_metadata(read, root)
        extended = _extended(files, root, replace(layout, table_chunk=old.table_chunk), plain, dict(note), where)
        write_key(_durable(path, root), EXTENSION_KEY, extended.encode())
        complete_extension(files, where)
    finally:
        lock.release()


def finish_extension(path: StorePath, *, break_lock: bool = False) -> bool:
    """Complete an extension that was cut off.

    Parameters
    ----------
    path : str or Path
        Folder or URL of the store.
    break_lock : bool
        Take the lock of a driver that is gone.

    Returns
    -------
    bool
        Whether there was one.
    """
    files, where = open_files(path, read_only=True), normalised(path)
    if pending_extension(files, read_root(files, where), where) is None:
        return False
    lock = DriverLock(path)
    lock.acquire(break_lock=break_lock)
    try:
        complete_extension(open_files(path, read_only=False), where)
    finally:
        lock.release()
    return True


def _durable(path: StorePath, root: Root) -> Store:
    return open_files(path, read_only=False, durable=bool(root.attributes["durable"]))


def pending_extension(files: Store, root: Root, where: str) -> Root | None:
    """What a campaign will be whose extension was cut off; None where none was, or its file says no such thing."""
    content = look_at(files, EXTENSION_KEY)
    if content is None:
        return None
    try:
        extended = decode_root(content, where)
        if extended.fingerprint != root.fingerprint:  # the same: nothing but this file is left to be removed
            old, new = (layout_without_times(r.attributes["layout"]) for r in (root, extended))
            _check(root, old, new, extended.attributes["config"], extended.algorithm, where)
    except StoreError:
        return None
    return extended if extended.n_committed == root.n_committed or extended.fingerprint == root.fingerprint else None


def complete_extension(files: Store, where: str) -> None:
    """Do what is left of an extension that was cut off; nothing where none was. The caller holds the lock."""
    if look_at(files, EXTENSION_KEY) is None:
        return
    root = read_root(files, where)
    extended = pending_extension(files, root, where)
    if extended is None:  # `verify` says what lies there instead
        return
    if extended.fingerprint != root.fingerprint:
        durable = open_files(where, read_only=False, durable=bool(root.attributes["durable"]))
        contents = _contents(files, root, extended, where)
        growing = growing_arrays(layout_without_times(extended.attributes["layout"]))
        tables = {f"{name}/zarr.json" for name in (*TABLES, *growing)}
        new = [
            key
            for key in contents
            if key in tables or key.rpartition("/")[0] in growing or key.rpartition("/")[0] not in root.metadata
        ]
        for key in sorted(new, key=lambda key: (key in tables, key)):
            if key not in (ROOT_KEY, BACKUP_KEY, RUNTIME_KEY) and look_at(files, key) != contents[key]:
                write_key(durable, key, contents[key])
        write_key(durable, BACKUP_KEY, extended.created().encode())
        write_key(durable, RUNTIME_KEY, runtime_text(extended))
        write_root(durable, extended.listing(root.listed))
    delete_key(files, EXTENSION_KEY)


def _extended(
    files: Store, root: Root, layout: Layout, config: dict[str, Any], note: dict[str, Any], where: str
) -> Root:
    """The root of the extended campaign, with as many candidates as there are."""
    read = described(files, root, where)
    created = build_hierarchy(
        layout,
        config=config,
        fingerprint=digests.fingerprint_of(config),
        algorithm=root.algorithm,
        population=population_of(read, root),
        constants=constants_of(root),
        runtime=root.created().metadata["runtime"]["attributes"],
        durable=bool(root.attributes["durable"]),
    )
    growing = growing_arrays(layout)
    for name, expected in root.attributes["static_digests"].items():
        if not name.endswith("/time"):  # which every stage has: `layout_of` read one of them
            read_static(read, root, name)
        if name in growing:
            continue
        if json.loads(created[ROOT_KEY])["attributes"]["static_digests"].get(name) != expected:
            raise LayoutError(f"{name} of {where} would change; an extension keeps it")
    extended = Root(json.loads(created[ROOT_KEY]))
    extended = extended.committed(root.n_committed, root.n_waves, root.attributes["hyperparameters"])
    note |= {"extended_from_candidates": root.n_committed, "extended_from_fingerprint": root.fingerprint}
    return extended.with_runtime(root.metadata["runtime"]["attributes"]).noted(note)


def _contents(files: Store, root: Root, extended: Root, where: str) -> dict[str, bytes]:
    """Every file that the creation of the extended campaign would have written: key -> bytes."""
    read = described(files, root, where)
    attributes = extended.attributes
    layout = Layout.from_dict(attributes["layout"], layout_of(read, root).times_us)
    return build_hierarchy(
        layout,
        config=attributes["config"],
        fingerprint=extended.fingerprint,
        algorithm=extended.algorithm,
        population=population_of(read, root),
        constants=constants_of(root),
        runtime=extended.created().metadata["runtime"]["attributes"],
        durable=bool(attributes["durable"]),
    )


def _check(root: Root, old: Layout, new: Layout, config: Mapping[str, Any], algorithm: str, where: str) -> None:
    if root.n_committed < old.n_candidates:
        raise StoreError(
            f"{where} holds {root.n_committed} of {old.n_candidates} candidates: it can be extended once it is "
            f"finished; continue it with `softclose resume {where}`"
        )
    if root.algorithm != algorithm:
        raise OtherAlgorithmError(other_algorithm(where, root.algorithm, algorithm))
    before, after = ({**c, "campaign": {**c["campaign"], MAY_CHANGE: []}} for c in (root.attributes["config"], config))
    if digests.canonical_json(before) != digests.canonical_json(after):
        raise OtherConfigurationError(f"{where} holds a campaign of another configuration; an extension keeps it")
    kept = replace(new, stages=new.stages[: len(old.stages)], table_chunk=old.table_chunk)
    if kept.to_dict() != old.to_dict() or len(new.stages) <= len(old.stages):
        raise LayoutError(f"the stages of {where} are {old.to_dict()}; an extension adds one, and changes none of them")
