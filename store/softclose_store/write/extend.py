"""Owns the extension of a finished campaign: more stages at its end, everything before them untouched."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from softclose_store.disk.files import StorePath, list_keys, normalised, open_files, read_key, write_key
from softclose_store.disk.lock import DriverLock
from softclose_store.errors import LayoutError, OtherAlgorithmError, OtherConfigurationError, StoreError
from softclose_store.read.arrays import layout_of, read_array
from softclose_store.schema import digests
from softclose_store.schema.fields import POPULATION
from softclose_store.schema.hierarchy import TABLES, build_hierarchy
from softclose_store.schema.layout import Layout
from softclose_store.schema.root import BACKUP_KEY, ROOT_KEY, RUNTIME_KEY, Root, read_root, runtime_text, write_root
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
    """
    where = normalised(path)
    files = open_files(path, read_only=False, durable=bool(_root(path).attributes["durable"]))
    lock = DriverLock(path)
    lock.acquire(break_lock=break_lock)
    try:
        root = _root(path)
        old = layout_of(files, root)
        _check(root, old, layout, config, algorithm, where)
        plain = json.loads(digests.canonical_json(config))
        contents = build_hierarchy(
            replace(layout, table_chunk=old.table_chunk),
            config=plain,
            fingerprint=digests.fingerprint_of(plain),
            algorithm=algorithm,
            population={name: read_array(files, name) for name in POPULATION},
            runtime=root.created().metadata["runtime"]["attributes"],
            durable=bool(root.attributes["durable"]),
        )
        _write(files, root, contents, dict(note))
    finally:
        lock.release()


def _root(path: StorePath) -> Root:
    return read_root(open_files(path, read_only=True), normalised(path))


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


def _write(files: Any, root: Root, contents: Mapping[str, bytes], note: dict[str, Any]) -> None:
    """New files first, then the sizes of the tables, last the root."""
    there = set(list_keys(files))
    tables = {f"{name}/zarr.json" for name in TABLES}
    for key in sorted(contents, key=lambda key: (key in tables, key)):
        if key not in there or (key in tables and read_key(files, key) != contents[key]):
            write_key(files, key, contents[key])
    extended = Root(json.loads(contents[ROOT_KEY]))
    write_key(files, BACKUP_KEY, extended.encode())
    hyperparameters = root.attributes["hyperparameters"]
    extended = extended.committed(root.n_committed, root.n_waves, hyperparameters)
    note |= {"extended_from_candidates": root.n_committed, "extended_from_fingerprint": root.fingerprint}
    extended = extended.with_runtime(root.metadata["runtime"]["attributes"]).noted(note)
    write_key(files, RUNTIME_KEY, runtime_text(extended))
    write_root(files, extended)
