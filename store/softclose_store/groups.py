"""Owns writing groups beside the campaign's own arrays: named results such as a certification.

A result group is written with its own zarr.json last, so it is there as a whole or not at all; then the root lists it
(`listing.py`). Its values are encoded a block at a time: they may be more than fits into memory.
"""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, Protocol, runtime_checkable

import numpy as np
import zarr
from numpy.typing import ArrayLike, NDArray
from zarr.abc.buffer import Buffer
from zarr.abc.store import Store
from zarr.api.asynchronous import create_array, create_group
from zarr.codecs import BloscCodec, Crc32cCodec
from zarr.storage import MemoryStore
from zarr.storage import StorePath as ZarrPath

from softclose_store import faults
from softclose_store.disk.files import (
    StorePath,
    delete_key,
    list_keys,
    look_at,
    normalised,
    open_files,
    read_key,
    write_key,
)
from softclose_store.disk.loop import run_here
from softclose_store.disk.names import is_safe, ways
from softclose_store.errors import DamageError, StoreError, StoreExistsError
from softclose_store.listing import list_groups_again
from softclose_store.parts import Parts, options
from softclose_store.read.result_groups import check_name, metadata_of
from softclose_store.schema import digests
from softclose_store.schema.group_metadata import COPY_NAME, FILES, NAME, OWN, GroupMetadata
from softclose_store.schema.opening import read_root

MOST_CHUNK = 65_536
"""Values along any dimension of a chunk, at most."""

TOGETHER_BYTES = 16_000_000
"""Values that are encoded together, about: their chunks on several threads, and no more of them in memory at once."""

ALONE_BYTES = 1_000_000
"""Values that this thread encodes sooner than it would hand them to others, about."""


@runtime_checkable
class Blocks(Protocol):
    """Values that are put together only where they are read."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Sizes."""
        ...

    @property
    def dtype(self) -> np.dtype[Any]:
        """Type: of numbers or booleans."""
        ...

    def block(self, where: tuple[slice, ...]) -> NDArray[Any]:
        """The values there; each is asked for once."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class GroupArray:
    """One array of a result group."""

    dims: tuple[str, ...]
    """Dimension names."""
    values: ArrayLike | Blocks
    """The values: numbers, booleans or text."""
    unit: str = "1"
    """Unit."""
    long_name: str = ""
    """What it is, in words."""


def write_group(
    path: StorePath,
    name: str,
    arrays: Mapping[str, GroupArray],
    attributes: Mapping[str, Any],
    *,
    parts: Mapping[str, Parts] | None = None,
    replace: bool = False,
) -> None:
    """Add a result group to a store, as a whole or not at all.

    Works beside a run, too: it touches nothing of the campaign. Where a driver holds the store, it lists the group in
    the root when it is done; until then `xarray.open_datatree` does not show it, and its own path does.

    Parameters
    ----------
    path : str or Path
        Folder or URL of the store.
    name : str
        Such as `certification/3`.
    arrays : mapping of str to GroupArray
        What it holds.
    attributes : mapping
        Plain JSON values.
    parts : mapping of str to Parts, optional
        Further arrays, whose parts are written already.
    replace : bool
        Put it in the place of one of this name.

    Raises
    ------
    StoreExistsError
        Where there is one, unless `replace`.
    DamageError
        Where the group to be replaced lists files that are none of its own.
    StoreError
        Where a link leads out of the store.
    """
    check_name(name)
    where = normalised(path)
    root = read_root(open_files(path, read_only=True), where)
    if root.is_own(name):
        raise StoreError(f"the group {name!r} would fall into one of the campaign's own; use another name")
    parts = parts or {}
    for key in (*arrays, *parts):
        if not is_safe(key) or "/" in key:
            raise StoreError(f"array {key!r} of group {name} cannot be stored; a name is made of letters, digits and _")
    files = open_files(path, read_only=False, durable=bool(root.attributes["durable"]))
    last = f"{name}/zarr.json"
    if not replace and read_key(files, last) is not None:
        raise StoreExistsError(f"{where} has a group {name} already; give it another name")
    building = _created(name, arrays, parts)
    documents = building.documents()
    documents.pop("zarr.json")
    own = documents.pop(last)
    parents = parents_of(name)
    known = metadata_of(files, name, list_keys(files)) if replace else None
    old = [] if known is None else known.keys
    if replace:  # readers of the list would take the arrays that come for those that were
        list_groups_again(path, but=name)
    written = {f"{name}/{member}": digest for array in parts.values() for member, digest in array.files.items()}

    def put(key: str, content: bytes) -> None:
        faults.point("inside-group")
        write_key(files, key, content)
        written[key] = digests.sha256(content)

    # The metadata last, the copy before them: at every instant one of the two says what the group is, the old one or
    # the new, and from that a repair makes it whole. Nothing goes before its replacement is there.
    for key in parents:
        faults.point("inside-group")
        if read_key(files, key) is None:
            write_key(files, key, documents[key])
    for array in sorted({*arrays, *parts}):
        if array in arrays:
            for key, content in building.chunks(array, name):
                put(key, content)
        put(f"{name}/{array}/zarr.json", documents[f"{name}/{array}/zarr.json"])
    metadata = _metadata(name, own, attributes, {key.removeprefix(f"{name}/"): d for key, d in written.items()})
    if arrays:
        member = f"{min(arrays)}/{COPY_NAME}"
        metadata = metadata.with_copy(member)
        put(f"{name}/{member}", metadata.copy())
    put(last, metadata.encode())
    for key in old:
        if key not in written:
            delete_key(files, key)
    list_groups_again(path)


def parents_of(name: str) -> list[str]:
    """Keys of the metadata of the plain groups that a result group lies in."""
    return [f"{parent}/zarr.json" for parent in ways(name)[:-1]]


def _created(name: str, arrays: Mapping[str, GroupArray], parts: Mapping[str, Parts]) -> _Building:
    """A group of that name in memory, its arrays without values."""
    building = _Building({})

    async def create() -> None:
        result = await (await create_group(store=building.memory)).create_group(name)
        for key, part in parts.items():
            await result.create_array(key, **options(part.array, part.shape))

    run_here(create(), building.memory)
    for key, array in arrays.items():
        values: NDArray[Any] | Blocks = array.values if isinstance(array.values, Blocks) else np.asarray(array.values)
        if isinstance(values, np.ndarray) and values.dtype.kind in "OTUS":
            values = values.astype(np.dtypes.StringDType())
        elif values.dtype.kind not in "biuf":
            raise StoreError(f"array {key} of group {name} is of type {values.dtype}; it must be numbers or text")
        building.values[key] = values
        like, document = _array_like(values.shape, values.dtype, tuple(array.dims), array.unit, array.long_name)
        building.buffers[f"{name}/{key}/zarr.json"] = document
        at = ZarrPath(building.memory, f"{name}/{key}")
        building.encoders[key] = zarr.AsyncArray(like.metadata, at, like.config)
    return building


@lru_cache(maxsize=2048)
def _array_like(
    shape: tuple[int, ...], dtype: np.dtype[Any], dims: tuple[str, ...], unit: str, long_name: str
) -> tuple[zarr.AsyncArray[Any], Buffer]:
    """An array in memory with its metadata, which are those of every array that is described so, whatever its name.

    Zarr takes a millisecond for one, and a certificate has more than a hundred, many of them alike.
    """
    buffers: dict[str, Buffer] = {}
    memory, is_text = MemoryStore(buffers), dtype.kind == "T"
    how: dict[str, Any] = {
        "shape": shape,
        "chunks": tuple(max(1, min(n, MOST_CHUNK)) for n in shape),
        "dtype": "str" if is_text else dtype,
        "dimension_names": dims,
        # A chunk of nothing but the fill value is written too: what is there must not depend on the values.
        "config": {"write_empty_chunks": True},
        "fill_value": "" if is_text else np.zeros((), dtype)[()],
        "compressors": [Crc32cCodec()]
        if is_text or not shape
        else [BloscCodec(cname="zstd", clevel=3, shuffle="shuffle"), Crc32cCodec()],
        "attributes": {"units": unit, "long_name": long_name},
    }
    made = run_here(create_array(memory, **how), memory)
    return made, buffers["zarr.json"]


@dataclass(slots=True)
class _Building:
    """A group on its way into a store: its metadata in memory, its values encoded as they are asked for."""

    buffers: dict[str, Buffer]
    """Of the group in memory, by key."""
    values: dict[str, NDArray[Any] | Blocks] = field(default_factory=dict)
    encoders: dict[str, zarr.AsyncArray[Any]] = field(default_factory=dict)
    """The arrays that encode them."""

    @property
    def memory(self) -> MemoryStore:
        """Where zarr finds it."""
        return MemoryStore(self.buffers)

    def documents(self) -> dict[str, bytes]:
        """Keys and bytes of the metadata."""
        return {key: value.to_bytes() for key, value in self.buffers.items() if key.endswith("zarr.json")}

    def chunks(self, key: str, prefix: str) -> Iterator[tuple[str, bytes]]:
        """Keys and bytes of the chunks of an array, a block of them in memory at a time."""
        values, encoder = self.values[key], self.encoders[key]
        for where in _blocks(encoder, values.dtype.itemsize):
            block = values[where] if isinstance(values, np.ndarray) else values.block(where)
            if block.nbytes > ALONE_BYTES:
                zarr.Array(encoder)[where] = block
            else:
                run_here(encoder.setitem(where, block), self.memory)
            for chunk in sorted(k for k in self.buffers if k.startswith(f"{prefix}/{key}/c")):
                yield chunk, self.buffers.pop(chunk).to_bytes()


def _blocks(array: zarr.AsyncArray[Any], item_bytes: int) -> Iterator[tuple[slice, ...]]:
    """Whole chunks of an array, as many along its last axis as are encoded together."""
    if not array.ndim:
        yield ()
        return
    each = item_bytes * math.prod(array.chunks)
    steps = [*array.chunks[:-1], array.chunks[-1] * max(TOGETHER_BYTES // each, 1)]
    starts = (range(0, n, step) for n, step in zip(array.shape, steps, strict=True))
    for corner in itertools.product(*starts):
        yield tuple(slice(i, min(i + step, n)) for i, step, n in zip(corner, steps, array.shape, strict=True))


def _metadata(name: str, document: bytes, attributes: Mapping[str, Any], files: Mapping[str, str]) -> GroupMetadata:
    """The metadata of a group with its attributes and the digests of its files."""
    whole = json.loads(document)
    whole["attributes"] = json.loads(digests.canonical_json(attributes)) | {NAME: name, FILES: dict(files)}
    return GroupMetadata(name, whole)


def list_groups(path: StorePath, prefix: str = "") -> list[str]:
    """Names of the result groups, sorted; damaged ones too.

    Parameters
    ----------
    path : str or Path
        Folder or URL of the store.
    prefix : str
        Only those whose name starts with it.

    Raises
    ------
    DamageError
        Where the root lists one of them that is not there: what lies in it, certificates for instance, would count.
    """
    where, files = normalised(path), open_files(path, read_only=True)
    root = read_root(files, where)  # before the look at what is there: a group is written first, and listed then
    found = [name for name in result_groups(files, list_keys(files)) if name.startswith(prefix)]
    listed = {name for name, entry in root.listed.items() if OWN in entry["attributes"] and name.startswith(prefix)}
    for name in sorted(listed.difference(found)):
        raise DamageError(
            f"group {name} of {where} is listed in the root, and not there: run `softclose verify {where} --repair`"
        )
    return found


def result_groups(files: Store, keys: Sequence[str]) -> dict[str, GroupMetadata | None]:
    """The result groups among the files of a store, by name; None where neither metadata nor copy can be read.

    keys: every key of the store.
    """
    found: dict[str, GroupMetadata | None] = {}
    damaged = []
    for key in keys:
        folder, _, last = key.rpartition("/")
        name = folder if last == "zarr.json" else folder.rpartition("/")[0] if last == COPY_NAME else ""
        if not name or not is_safe(name) or name in found:
            continue
        content = look_at(files, key) or b""
        if last == "zarr.json" and FILES.encode() not in content:
            continue
        metadata = metadata_of(files, name, keys)
        if metadata is not None:
            found[name] = metadata
        elif last == "zarr.json" and NAME.encode() not in content:
            damaged.append(name)  # 0.1 wrote neither name nor copy
    for name in damaged:
        if not any(name == known or name.startswith(f"{known}/") for known in found):
            found[name] = None
    return dict(sorted(found.items()))
