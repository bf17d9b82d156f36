"""Owns setting aside what does not belong to a store: it moves into `<store>.strays` beside it, none is deleted."""

from __future__ import annotations

import os
from collections.abc import Sequence

from softclose_store.disk.below import Below
from softclose_store.disk.files import (
    LocalFiles,
    StorePath,
    delete_key,
    normalised,
    open_files,
    read_key,
    write_key,
)
from softclose_store.disk.names import ways
from softclose_store.errors import StoreError


def strays_of(path: StorePath) -> str:
    """Where the strays of a store are moved to."""
    return f"{normalised(path)}.strays"


def set_aside(path: StorePath, keys: Sequence[str]) -> list[str]:
    """Move files that do not belong to a store out of it, links as links; returns where they are now."""
    files = open_files(path, read_only=False)
    if isinstance(files, LocalFiles):
        return [_move(files.below, strays_of(path), key) for key in keys]
    moved = []
    for key in keys:
        target = open_files(strays_of(path), read_only=False)
        write_key(target, key, read_key(files, key) or b"")
        delete_key(files, key)
        moved.append(f"{strays_of(path)}/{key}")
    return moved


def _move(below: Below, strays: str, key: str) -> str:
    if os.path.islink(strays):
        raise StoreError(f"{strays} is a link, and what does not belong to the store would be moved there; remove it")
    os.makedirs(strays, exist_ok=True)
    place, n = key, 0
    while not below.move(key, Below(strays), place):  # a stray of the same name was moved before
        n += 1
        place = f"{key}.{n}"
    return f"{strays}/{place}"


def clear_the_way(path: StorePath, keys: Sequence[str]) -> list[str]:
    """Move aside whatever lies at keys that files are to be written to and is no file, a folder for instance.

    Parameters
    ----------
    path : str or Path
        Folder or URL of the store.
    keys : sequence of str
        Of files.

    Returns
    -------
    list of str
        Where that is now.
    """
    files = open_files(path, read_only=False)
    if not isinstance(files, LocalFiles):
        return []
    found: dict[str, None] = {}
    for key in keys:
        for at in ways(key):
            kind = files.below.kind(at)
            if kind not in ("", "a file" if at == key else "a folder"):
                found[at] = None
            if kind != "a folder":
                break
    return set_aside(path, list(found))
