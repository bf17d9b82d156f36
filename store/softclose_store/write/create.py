"""Owns the creation of a store: every array at full capacity, appearing at once or not at all."""

from __future__ import annotations

import errno
import json
import os
import shutil
import socket
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from numpy.typing import ArrayLike
from zarr.abc.store import Store

from softclose_store import faults
from softclose_store.disk.files import StorePath, local_path, normalised, open_files, sync_directory, write_key
from softclose_store.disk.processes import process_is_alive
from softclose_store.errors import (
    DamageError,
    LockedError,
    OtherAlgorithmError,
    OtherConfigurationError,
    StoreError,
    StoreExistsError,
    StoreMissingError,
)
from softclose_store.schema import digests
from softclose_store.schema.fields import Constant
from softclose_store.schema.hierarchy import build_hierarchy, population_columns
from softclose_store.schema.layout import Layout
from softclose_store.schema.opening import read_root
from softclose_store.schema.root import BACKUP_KEY, ROOT_KEY


def create_campaign(
    path: StorePath,
    *,
    layout: Layout,
    config: Mapping[str, Any],
    population: Mapping[str, ArrayLike] | Callable[[], Mapping[str, ArrayLike]],
    algorithm: str,
    constants: Mapping[str, Constant] | None = None,
    runtime: Mapping[str, Any] | None = None,
    fingerprint: str | None = None,
    durable: bool = False,
    exist_ok: bool = False,
) -> None:
    """Create the store of a campaign, with nothing committed. It appears at `path` at once or not at all.

    Parameters
    ----------
    path : str or Path
        Folder or URL.
    layout : Layout
        Stages, blocks and the time grid.
    config : mapping
        Plain JSON values; its sha256 (canonical JSON) is the campaign's fingerprint.
    population : mapping of str to (n_switches,) array-like of float64, or who makes it
        The layout's columns, such as D, G [µm], E [GPa], T [µm], K [N/m], M [µg]. Who makes them is asked only where
        there is no store yet.
    algorithm : str
        Version of the algorithms, the other half of the campaign's identity.
    constants : mapping of str to Constant, optional
        Numbers that every switch shares, for readers: attributes of the root.
    runtime : mapping, optional
        Who created it; no part of the identity.
    fingerprint : str, optional
        Compared with that of `config`.
    durable : bool
        Sync every file that is written.
    exist_ok : bool
        A store of this very campaign is left as it is.

    Raises
    ------
    StoreExistsError
        Where something is at `path`.
    OtherConfigurationError
        Where that is another campaign; names what differs.
    OtherAlgorithmError
        Where it is this campaign by another algorithm.
    LayoutError
        Where layout and population do not fit.
    OSError
        Where the folder cannot be written.
    """
    try:
        config = json.loads(digests.canonical_json(config))
    except (TypeError, ValueError) as e:
        raise StoreError(f"the configuration is not made of plain finite JSON values: {e}") from e
    identity = digests.fingerprint_of(config)
    if fingerprint is not None and fingerprint != identity:
        raise StoreError(f"the fingerprint given is {fingerprint}, but the configuration's is {identity}")
    if _same_campaign_exists(path, config, identity, algorithm, exist_ok=exist_ok):
        return
    columns = population_columns(layout, population() if callable(population) else population)
    target = local_path(path)
    hierarchy = build_hierarchy(
        layout,
        config=config,
        fingerprint=identity,
        algorithm=algorithm,
        population=columns,
        constants=dict(constants or {}),
        runtime=dict(runtime or {}),
        durable=durable,
    )
    if target is None:
        _write_all(open_files(path, read_only=False), hierarchy)
        return
    try:
        _appear(target.absolute(), hierarchy)
    except FileExistsError as e:  # another driver was faster, by less than it takes to write all this
        where = normalised(path)
        if not _same_campaign_exists(path, config, identity, algorithm, exist_ok=True):
            raise StoreError(f"cannot create a store at {where}: {e.strerror}, and gone again; try again") from e
        if not exist_ok:
            raise LockedError(
                f"another driver has just begun this very campaign at {where}; a store has one driver at a time: wait "
                f"for it (`softclose status {where}`), and `softclose resume {where}` goes on where it stops"
            ) from e


def _write_all(files: Store, hierarchy: Mapping[str, bytes]) -> None:
    """Write the root last but for its copy: a copy without a root means that a root was lost."""
    for key in sorted(hierarchy, key=lambda key: (key == BACKUP_KEY, key == ROOT_KEY, key)):
        if key == ROOT_KEY:
            faults.point("inside-creation")
        write_key(files, key, hierarchy[key])


def _appear(target: Path, hierarchy: Mapping[str, bytes]) -> None:
    """Write the hierarchy into a sibling of the target and rename it: there is never half a store at the target.

    Synced in any case: what a store is must not be lost, then everything else can be made again. Raises FileExistsError
    where something has appeared at the target meanwhile.
    """
    _remove_abandoned(target)
    sibling = target.with_name(f"{target.name}.creating-{socket.gethostname()}-{os.getpid()}")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.rmtree(sibling, ignore_errors=True)
        os.mkdir(sibling)
        files = open_files(sibling, read_only=False, durable=True)
        _write_all(files, hierarchy)
        os.rename(sibling, target)  # replaces an empty folder, refuses any other
        sync_directory(target.parent)
    except OSError as e:
        shutil.rmtree(sibling, ignore_errors=True)
        if e.errno in (errno.ENOTEMPTY, errno.EEXIST, errno.ENOTDIR) and os.path.lexists(target):
            raise FileExistsError(e.errno, e.strerror, str(target)) from e
        raise StoreError(
            f"cannot create a store at {target}: {e.strerror or e}; give a path in a folder that you can write to"
        ) from e


def _remove_abandoned(target: Path) -> None:
    """Remove what creations left behind whose process on this host is gone."""
    prefix = f"{target.name}.creating-{socket.gethostname()}-"
    if not target.parent.is_dir():
        return
    for sibling in target.parent.iterdir():
        pid = sibling.name.removeprefix(prefix)
        if sibling.name.startswith(prefix) and pid.isdigit() and not process_is_alive(int(pid)):
            shutil.rmtree(sibling, ignore_errors=True)


def _same_campaign_exists(
    path: StorePath, config: Mapping[str, Any], fingerprint: str, algorithm: str, *, exist_ok: bool
) -> bool:
    """True where this very campaign is there and that is welcome; False where nothing is there."""
    state = store_state(path)
    where = normalised(path)
    if state.kind in ("absent", "unfinished"):
        return False
    if state.kind == "foreign":
        raise StoreExistsError(f"{where} exists and is no Softclose store; give a path that does not exist yet")
    if state.kind == "damaged":
        raise DamageError(f"{where} holds a damaged store: {state.problem}")
    if state.fingerprint != fingerprint:
        changes = differences(state.config, config)
        raise OtherConfigurationError(
            f"{where} holds a campaign of another configuration; it differs in\n"
            + "\n".join(f"  {change}" for change in changes)
            + "\ngive another path, or undo these changes and resume it"
        )
    if state.algorithm != algorithm and not state.finished:
        raise OtherAlgorithmError(other_algorithm(where, state.algorithm, algorithm))
    if exist_ok:
        return True
    advice = "it is finished: read it" if state.finished else f"continue it with `softclose resume {where}`"
    done = f"{state.n_committed} of {state.budget} candidates"
    raise StoreExistsError(f"{where} holds this very campaign, {done}: {advice}")


@dataclass(frozen=True, slots=True, kw_only=True)
class StoreState:
    """What a path holds, found without opening it for work."""

    kind: Literal["absent", "unfinished", "campaign", "foreign", "damaged"]
    """absent: nothing, or an empty folder; unfinished: a creation that was interrupted; foreign: something else."""
    n_committed: int = 0
    """Committed candidates."""
    budget: int = 0
    """Candidates of the whole campaign."""
    fingerprint: str = ""
    """Identity of the campaign."""
    algorithm: str = ""
    """Version of the algorithms that it was begun with."""
    config: Mapping[str, Any]
    """Its configuration; empty where there is none."""
    problem: str = ""
    """What is wrong, where something is."""

    @property
    def finished(self) -> bool:
        """True where every candidate is committed."""
        return self.kind == "campaign" and self.n_committed == self.budget


def store_state(path: StorePath) -> StoreState:
    """Say what is at a path. Raises SchemaError for a store of a newer schema version."""
    where = normalised(path)
    local = local_path(path)
    if local is not None:
        if not local.exists():
            return StoreState(kind="absent", config={})
        if not local.is_dir():
            return StoreState(kind="foreign", config={}, problem="a file")
        if not any(local.iterdir()):
            return StoreState(kind="absent", config={})
    files = open_files(path, read_only=True)
    try:
        root = read_root(files, where)
    except DamageError as e:
        return StoreState(kind="damaged", config={}, problem=str(e))
    except StoreMissingError as e:
        if "unfinished" in str(e):
            return StoreState(kind="unfinished", config={}, problem=str(e))
        if local is None and "no campaign" in str(e):
            return StoreState(kind="absent", config={})
        return StoreState(kind="foreign", config={}, problem=str(e))
    attributes = root.attributes
    return StoreState(
        kind="campaign",
        n_committed=root.n_committed,
        budget=sum(int(stage["n_candidates"]) for stage in attributes["layout"]["stages"]),
        fingerprint=root.fingerprint,
        algorithm=root.algorithm,
        config=attributes["config"],
    )


def other_algorithm(where: str, stored: str, given: str) -> str:
    """Why a campaign is not continued by other algorithms than it was begun with."""
    return (
        f"{where} was begun with version {stored!r} of the algorithms, this program has {given!r}: what it would "
        "propose now does not follow from what is stored; finish it with the softclose that began it (group runtime), "
        "or run its configuration again into another path"
    )


def differences(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[str]:
    """Dotted keys in which two configurations differ: `campaign.seed: the store has 1, this configuration 2`."""
    changes = []
    flat_old, flat_new = _flat(old), _flat(new)
    for key in sorted(set(flat_old) | set(flat_new)):
        a, b = flat_old.get(key, "nothing"), flat_new.get(key, "nothing")
        if a != b:
            changes.append(f"{key}: the store has {a}, this configuration {b}")
    return changes


def _flat(data: Any, prefix: str = "") -> dict[str, str]:
    if isinstance(data, Mapping) and data:
        return {k: v for key, value in data.items() for k, v in _flat(value, f"{prefix}{key}.").items()}
    return {prefix.rstrip("."): json.dumps(data, sort_keys=True)}
