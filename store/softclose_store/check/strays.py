"""Owns setting aside what does not belong to a store: it moves into `<store>.strays` beside it, none is deleted."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Sequence

from softclose_store.disk.files import (
    StorePath,
    check_inside,
    delete_key,
    local_path,
    normalised,
    open_files,
    read_key,
    write_key,
)


def strays_of(path: StorePath) -> str:
    """Where the strays of a store are moved to."""
    return f"{normalised(path)}.strays"


def set_aside(path: StorePath, keys: Sequence[str]) -> list[str]:
    """Move files that do not belong to a store out of it, links as links; returns where they are now."""
    local = local_path(path)
    files = open_files(path, read_only=False)
    moved = []
    for key in keys:
        check_inside(files, key)
        if local is None:
            target = open_files(strays_of(path), read_only=False)
            write_key(target, key, read_key(files, key) or b"")
            delete_key(files, key)
            moved.append(f"{strays_of(path)}/{key}")
            continue
        source = os.path.join(normalised(path), key)
        wanted = place = os.path.join(strays_of(path), key)
        n = 0
        while os.path.lexists(place):  # a stray of the same name was moved before
            n += 1
            place = f"{wanted}.{n}"
        os.makedirs(os.path.dirname(place), exist_ok=True)
        os.rename(source, place)
        moved.append(place)
        with contextlib.suppress(OSError):  # not empty: it is somebody's
            os.removedirs(os.path.dirname(source))
    return moved
