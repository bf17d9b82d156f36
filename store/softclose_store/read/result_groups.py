"""Owns reading result groups: whole and as they were written, or not at all.

A group lists its files; that list comes out of the store, so each name in it is checked before anything is touched
under it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from numpy.typing import NDArray
from zarr.abc.buffer import Buffer
from zarr.abc.store import Store
from zarr.buffer import cpu
from zarr.storage import MemoryStore

from softclose_store.disk.files import StorePath, list_keys, look_at, normalised, open_files
from softclose_store.disk.names import checked_member, is_safe
from softclose_store.errors import DamageError, StoreError, StoreMissingError
from softclose_store.read.arrays import UNREADABLE, read_whole
from softclose_store.read.described import DescribedFiles
from softclose_store.schema import digests
from softclose_store.schema.documents import GroupArrayDocument, checked
from softclose_store.schema.group_metadata import COPY_NAME, GroupMetadata, decode, decode_copy
from softclose_store.schema.texts import read_json

_NAME = re.compile(r"[a-z][a-z0-9_-]*(/[a-z0-9][a-z0-9_.-]*)*")


@dataclass(frozen=True, slots=True, kw_only=True)
class ResultGroup:
    """A result group as read back."""

    arrays: dict[str, NDArray[Any]]
    """The arrays, by name."""
    attributes: dict[str, Any] = field(default_factory=dict)
    """The group's attributes."""


def check_name(name: str) -> None:
    """Raise StoreError unless a result group may have this name."""
    if not isinstance(name, str) or not _NAME.fullmatch(name) or not is_safe(name):
        raise StoreError(f"the group is called {name!r}; a name is made of a-z, 0-9, - and _, with / between levels")


def read_group(path: StorePath, name: str) -> ResultGroup:
    """Read a result group.

    Parameters
    ----------
    path : str or Path
        Folder or URL of the store.
    name : str
        Such as `certification/3`.

    Returns
    -------
    ResultGroup

    Raises
    ------
    StoreMissingError
        Where it is not.
    DamageError
        Where it is not what was written.
    """
    check_name(name)
    where = normalised(path)
    files = open_files(path, read_only=True)
    metadata = _own_metadata(files, where, name)
    contents: dict[str, bytes] = {}
    problems = group_problems(files, name, metadata, contents)
    if problems or metadata is None:
        raise _damage(name, where, "; ".join(problems))
    try:
        arrays = _decoded(name, where, contents)
    except UNREADABLE as e:
        raise _damage(name, where, str(e)) from e
    return ResultGroup(arrays=arrays, attributes=metadata.attributes)


def _damage(name: str, where: str, what: str) -> DamageError:
    return DamageError(f"group {name} of {where} is damaged: {what}: run `softclose verify {where} --repair`")


def _is_there(files: Store, name: str) -> bool:
    """Whether anything is left of a group."""
    return any(key.startswith(f"{name}/") for key in list_keys(files))


MOST_RATIO, SLACK_BYTES = 1_000, 64_000_000
"""A group decodes to at most so many times its bytes, and some more: zeros compress a thousandfold, bombs better."""


def _decoded(name: str, where: str, contents: dict[str, bytes]) -> dict[str, NDArray[Any]]:
    """The arrays of a group from its files, whose digests are right; raises ValueError for what is no array of one."""
    documents = {key: content for key, content in contents.items() if key.endswith("/zarr.json")}
    chunks = {key: content for key, content in contents.items() if key not in documents}
    models = {}
    for key, content in documents.items():
        array = key.removesuffix("/zarr.json")
        try:
            models[array] = model = checked(GroupArrayDocument, read_json(content))
        except ValueError as e:
            raise ValueError(f"{key}: {e}") from e
        n = sum(1 for chunk in chunks if chunk == f"{array}/c" or chunk.startswith(f"{array}/c/"))
        if n != model.n_chunks:
            raise ValueError(f"{key} says {model.n_chunks} files of values, and there are {n}")
    decoded = sum(model.n_chunks * model.chunk_bytes for model in models.values())
    if decoded > SLACK_BYTES + MOST_RATIO * sum(map(len, contents.values())):
        raise ValueError(f"its files say that they hold {decoded:,} bytes, which cannot be")
    buffers: dict[str, Buffer] = {key: cpu.Buffer.from_bytes(content) for key, content in chunks.items()}
    files = DescribedFiles(MemoryStore(buffers), documents, where, lambda array, chunk: True)
    return {array.rpartition("/")[2]: read_whole(files, array) for array in models}


def group_attributes(path: StorePath, name: str) -> dict[str, Any] | None:
    """The attributes of a result group, also where arrays of it are damaged.

    Parameters
    ----------
    path : str or Path
        Folder or URL of the store.
    name : str
        Such as `certification/3`.

    Returns
    -------
    dict or None
        None where its own metadata is damaged.

    Raises
    ------
    StoreMissingError
        Where there is no such group.
    """
    metadata = _own_metadata(open_files(path, read_only=True), normalised(path), name)
    return None if metadata is None else metadata.attributes


def _own_metadata(files: Store, where: str, name: str) -> GroupMetadata | None:
    """A group's own metadata; None where they are damaged. Raises StoreMissingError where there is no such group."""
    metadata = decode(look_at(files, f"{name}/zarr.json"), name)
    if metadata is None and not _is_there(files, name):
        raise StoreMissingError(f"{where} has no group {name}")
    return metadata


def group_problems(
    files: Store, name: str, metadata: GroupMetadata | None, contents: dict[str, bytes] | None = None
) -> list[str]:
    """What is wrong with a result group: one sentence per file that is not what was written.

    contents: is filled with its files, key -> bytes, those that are right.
    """
    problems = []
    if decode(look_at(files, f"{name}/zarr.json"), name) is None:
        problems.append(f"{name}/zarr.json is lost or not what was written")
    for member, expected in ({} if metadata is None else metadata.files).items():
        try:
            key = checked_member(name, member)
        except StoreError as e:
            problems.append(str(e))
            continue
        content = look_at(files, key)
        if content is None or digests.sha256(content) != expected:
            problems.append(f"{key} is {'missing, or no file' if content is None else 'not what was written'}")
        elif contents is not None and not member.endswith(f"/{COPY_NAME}"):
            contents[key] = content
    return problems


def metadata_of(files: Store, name: str, keys: Sequence[str]) -> GroupMetadata | None:
    """The metadata of a result group, from its own file or from the copy; None where both are lost.

    keys: every key of the store.
    """
    own = decode(look_at(files, f"{name}/zarr.json"), name)
    if own is not None:
        return own
    for key in keys:
        member = key.removeprefix(f"{name}/")
        if key != member and member.count("/") == 1 and member.endswith(f"/{COPY_NAME}"):
            copy = decode_copy(look_at(files, key), name, member)
            if copy is not None and copy.copy_member == member:
                return copy
    return None
