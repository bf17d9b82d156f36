"""Owns the keys of a store: how chunks are called, and which keys may be touched at all.

A key that comes out of a store is data: it is checked before anything is read, written or deleted under it.
"""

from __future__ import annotations

import re

from softclose_store.errors import DamageError

CHUNK_KEY_SEPARATOR = "."
"""Between the indices in a chunk's key: `c.3.0.0`. With zarr's `c/3/0/0` every chunk makes up to three folders an
array, which cost more than its small files."""

OWN_FOLDER = "candidates/digests"
"""Where files lie that are no array's. Zarr looks for members in groups only, and warns of files that it does not know
there; this is the folder of an array."""

PARTIAL = ".partial"
"""Suffix of a file that is being written; a kill leaves it behind, and nothing reads it."""

_PARTIAL = re.compile(r"\.[0-9a-f]{32}\.partial$")
_PART = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*")
_IN_ARRAY = re.compile(r"zarr\.json|group\.json|c(\.\d+)*|c(/\d+)*")


def chunk_key(name: str, *indices: int) -> str:
    """Key of one chunk (one file) of an array."""
    return f"{name}/{CHUNK_KEY_SEPARATOR.join(['c', *map(str, indices)])}"


def ways(key: str) -> list[str]:
    """The folders on the way to a key, then the key."""
    parts = key.split("/")
    return ["/".join(parts[:n]) for n in range(1, len(parts) + 1)]


def is_chunk_key(key: str) -> bool:
    """True for the key of a chunk, false for metadata."""
    return key.rpartition("/")[2].startswith(f"c{CHUNK_KEY_SEPARATOR}")


def is_partial(key: str) -> bool:
    """True for a file that a killed writer left behind; one that is merely called so is somebody's."""
    return _PARTIAL.search(key) is not None


def is_safe(key: str) -> bool:
    """True where a key stays inside the store: relative, of plain names, without `..`."""
    return all(_PART.fullmatch(part) and ".." not in part for part in key.split("/"))


def checked_member(group: str, member: str) -> str:
    """Key of a file of a result group: `<array>/zarr.json`, a chunk, or the copy; else DamageError."""
    array, _, rest = member.partition("/")
    if not is_safe(member) or not array or not _IN_ARRAY.fullmatch(rest):
        raise DamageError(
            f"the group {group} lists {member!r} among its files, which is no file of an array of it: the group is "
            "damaged, or somebody made it up; nothing was touched"
        )
    return f"{group}/{member}"
