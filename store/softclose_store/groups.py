"""Owns groups beside the campaign's own arrays: who ran it (`runtime`), and named results such as a certification.

A result group is built in memory and copied with its own zarr.json last, so it is there as a whole or not at all. It is
not in the root's consolidated metadata, which belongs to the driver: open it by its own path.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import zarr
from numpy.typing import ArrayLike, NDArray
from zarr.abc.buffer import Buffer
from zarr.abc.store import Store
from zarr.codecs import BloscCodec, Crc32cCodec
from zarr.storage import MemoryStore

from softclose_store import digests
from softclose_store.errors import DamageError, StoreError, StoreExistsError, StoreMissingError
from softclose_store.files import StorePath, list_keys, normalised, open_files, read_key, write_key
from softclose_store.root import Root, read_root, write_root

RUNTIME_KEY = "runtime/zarr.json"
_NAME = re.compile(r"[a-z][a-z0-9_-]*(/[a-z0-9][a-z0-9_.-]*)*")


def append_run(files: Store, root: Root, runtime: Mapping[str, Any]) -> Root:
    """Add one run to the attribute `runs` of the group `runtime`; returns the new root."""
    root = root.committed(root.n_committed)
    document = root.metadata["runtime"]
    attributes = document["attributes"]
    attributes["runs"] = [*attributes.get("runs", []), json.loads(digests.canonical_json(runtime))]
    own = {name: value for name, value in document.items() if name != "consolidated_metadata"}
    write_key(files, RUNTIME_KEY, json.dumps(own, indent=1, sort_keys=True).encode())
    write_root(files, root)
    return root


@dataclass(frozen=True, slots=True, kw_only=True)
class GroupArray:
    """One array of a result group."""

    dims: tuple[str, ...]
    """Dimension names."""
    values: ArrayLike
    """The values: numbers, booleans or text."""
    unit: str = "1"
    """Unit."""
    long_name: str = ""
    """What it is, in words."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ResultGroup:
    """A result group as read back."""

    arrays: dict[str, NDArray[Any]]
    """The arrays, by name."""
    attributes: dict[str, Any] = field(default_factory=dict)
    """The group's attributes."""


def write_group(
    path: StorePath, name: str, arrays: Mapping[str, GroupArray], attributes: Mapping[str, Any], *, replace: bool = False
) -> None:
    """Add a result group `name` (such as `certification/3`) to the store at `path`. It appears as a whole, or not at all.

    Needs no lock: it touches nothing of the campaign. Raises StoreExistsError unless `replace`.
    """
    if not _NAME.fullmatch(name):
        raise StoreError(f"the group is called {name!r}; a name is made of a-z, 0-9, - and _, with / between levels")
    where = normalised(path)
    root = read_root(open_files(path, read_only=True), where)
    if name.partition("/")[0] in root.metadata:
        raise StoreError(f"the group {name!r} would fall into the campaign's own {name.partition('/')[0]!r}; use another name")
    files = open_files(path, read_only=False, durable=bool(root.attributes["durable"]))
    last = f"{name}/zarr.json"
    if not replace and read_key(files, last) is not None:
        raise StoreExistsError(f"{where} has a group {name} already; give it another name")
    contents = _build(name, arrays, attributes)
    parents = {f"{'/'.join(parts[:n])}/zarr.json" for parts in [name.split("/")] for n in range(1, len(parts))}
    for key in sorted(contents, key=lambda key: (key == last, key not in parents, key)):
        if key in parents and read_key(files, key) is not None:
            continue
        if key != "zarr.json":
            write_key(files, key, contents[key])


def _build(name: str, arrays: Mapping[str, GroupArray], attributes: Mapping[str, Any]) -> dict[str, bytes]:
    buffers: dict[str, Buffer] = {}
    group = zarr.create_group(MemoryStore(buffers))
    result = group.create_group(name)
    found = {}
    for key, array in arrays.items():
        values = np.asarray(array.values)
        if values.dtype.kind in "OTUS":
            values = values.astype(np.dtypes.StringDType())
        elif values.dtype.kind not in "biuf":
            raise StoreError(f"array {key} of group {name} is of type {values.dtype}; it must be numbers or text")
        found[key] = digests.array_sha256(values)
        is_text = values.dtype.kind == "T"
        stored = result.create_array(
            key, shape=values.shape, chunks=tuple(max(1, min(n, 65_536)) for n in values.shape),
            dtype="str" if is_text else values.dtype, dimension_names=array.dims,
            fill_value="" if is_text else np.zeros((), values.dtype)[()],
            compressors=[Crc32cCodec()] if is_text or values.ndim == 0
            else [BloscCodec(cname="zstd", clevel=3, shuffle="shuffle"), Crc32cCodec()],
            attributes={"units": array.unit, "long_name": array.long_name},
        )  # fmt: skip
        stored[...] = values
    result.update_attributes({**json.loads(digests.canonical_json(attributes)), "softclose_digests": found})
    return {key: value.to_bytes() for key, value in buffers.items()}


def read_group(path: StorePath, name: str) -> ResultGroup:
    """Read a result group; raises StoreMissingError where it is not, DamageError where it is not what was written."""
    where = normalised(path)
    files = open_files(path, read_only=True)
    if read_key(files, f"{name}/zarr.json") is None:
        raise StoreMissingError(f"{where} has no group {name}")
    try:
        group = zarr.open_group(files, path=name, mode="r", use_consolidated=False)
        attributes = dict(group.attrs)
        found = attributes.pop("softclose_digests")
        arrays = {key: np.asarray(group[key][...]) for key in found}  # type: ignore[index]
    except (ValueError, RuntimeError, OSError, KeyError, TypeError) as e:
        raise DamageError(f"group {name} of {where} cannot be read: {e}") from e
    for key, values in arrays.items():
        if digests.array_sha256(values) != found[key]:  # type: ignore[index, call-overload]
            raise DamageError(f"array {key} of group {name} in {where} is not what was written")
    return ResultGroup(arrays=arrays, attributes=attributes)


def list_groups(path: StorePath, prefix: str = "") -> list[str]:
    """Names of the result groups whose name starts with `prefix`, sorted."""
    files = open_files(path, read_only=True)
    names = []
    for key in list_keys(files):
        name, _, last = key.rpartition("/")
        if last != "zarr.json" or not name.startswith(prefix):
            continue
        document = json.loads(read_key(files, key) or b"{}")
        if "softclose_digests" in document.get("attributes", {}):
            names.append(name)
    return names
