"""Owns arrays of a result group that are written a part at a time, by any process: trajectories do not fit into memory.

A part is one chunk and belongs to one writer. Parts come first, and nothing reads them; `write_group` puts the group's
metadata after them, with the digest of each, and from then on the group is there, as a whole.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import zarr
from numpy.typing import ArrayLike
from zarr.abc.buffer import Buffer
from zarr.codecs import Crc32cCodec
from zarr.storage import MemoryStore

from softclose_store import faults
from softclose_store.disk.files import StorePath, open_files, write_key
from softclose_store.disk.names import is_safe
from softclose_store.errors import StoreError
from softclose_store.schema import digests
from softclose_store.schema.group_metadata import COPY_NAME
from softclose_store.schema.hierarchy import fast_codec

TRAJECTORIES = "trajectories"
"""Groups that have parts lie in this one: parts of a group that is not there (yet) are known by it."""

_PART_KEY = re.compile(rf"({TRAJECTORIES}(?:/[a-z0-9][a-z0-9_.-]*)+)/([a-z][a-z0-9_]*)/c(?:/\d+)+")


@dataclass(frozen=True, slots=True, kw_only=True)
class PartedArray:
    """An array that is written a chunk at a time; NaN where no part is."""

    dims: tuple[str, ...]
    """Dimension names."""
    chunk: tuple[int, ...]
    """Sizes of a part; the last ones along a dimension may be smaller."""
    unit: str = "1"
    """Unit."""
    long_name: str = ""
    """What it is, in words."""
    dtype: str = "f4"
    """numpy type, of floats."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Parts:
    """An array whose parts are written."""

    array: PartedArray
    """What it is."""
    shape: tuple[int, ...]
    """Its sizes, now that they are known."""
    files: Mapping[str, str] = field(default_factory=dict)
    """sha256 of each part, as `write_part` returned them."""


def options(array: PartedArray, shape: tuple[int, ...]) -> dict[str, Any]:
    """How zarr is asked for the array."""
    return {
        "shape": shape,
        "chunks": array.chunk,
        "dtype": array.dtype,
        "dimension_names": array.dims,
        "config": {"write_empty_chunks": True},
        "fill_value": np.nan,
        "compressors": [fast_codec(), Crc32cCodec()],
        "attributes": {"units": array.unit, "long_name": array.long_name},
    }


def write_part(
    path: StorePath, group: str, name: str, array: PartedArray, index: tuple[int, ...], values: ArrayLike, *,
    durable: bool = False,
) -> dict[str, str]:  # fmt: skip
    """Write one chunk of an array of a group that is not there yet.

    Safe to run again, anywhere: it replaces one file, which no other part has.

    Parameters
    ----------
    path : str or Path
        Folder or URL of the store.
    group : str
        Such as `trajectories/release-3`.
    name : str
        The array's.
    array : PartedArray
        What it is.
    index : tuple of int
        Of the chunk, along each dimension.
    values : array-like
        Of the chunk's sizes, or smaller at the end of a dimension.
    durable : bool
        Flushed to the disk, as the store's root says of the store.

    Returns
    -------
    dict of str to str
        The file, from the group's folder, and its sha256.

    Raises
    ------
    StoreError
        For a group of another place, or values that do not fit.
    """
    member = f"{name}/c/{'/'.join(map(str, index))}"
    if _PART_KEY.fullmatch(f"{group}/{member}") is None:
        raise StoreError(f"{group}/{member} is no part of a group in {TRAJECTORIES}")
    given = np.asarray(values, dtype=array.dtype)
    fits = given.ndim == len(array.chunk) == len(index)
    if not fits or any(n > most for n, most in zip(given.shape, array.chunk, strict=True)):
        raise StoreError(f"{member} of {group} has shape {given.shape}; a part has {array.chunk} at most")
    content = _encoded(array, given)
    faults.point("inside-part")
    write_key(open_files(path, read_only=False, durable=durable), f"{group}/{member}", content)
    return {member: digests.sha256(content)}


def _encoded(array: PartedArray, values: Any) -> bytes:
    """The bytes of a chunk: those of an array of one."""
    buffers: dict[str, Buffer] = {}
    one = zarr.create_array(MemoryStore(buffers), **options(array, array.chunk))
    one[tuple(slice(n) for n in values.shape)] = values
    (content,) = [buffer.to_bytes() for key, buffer in buffers.items() if key != "zarr.json"]
    return content


def unfinished_parts(keys: Collection[str]) -> list[str]:
    """Parts of groups of which nothing else is there: they are being written, or their writer was killed.

    keys: every key of the store. Nothing reads such parts.
    """
    known = {key.rpartition("/")[0] for key in keys if key.endswith(("/zarr.json", f"/{COPY_NAME}"))}
    found = []
    for key in keys:
        match = _PART_KEY.fullmatch(key)
        if match is not None and is_safe(key) and not {match[1], f"{match[1]}/{match[2]}"} & known:
            found.append(key)
    return found
