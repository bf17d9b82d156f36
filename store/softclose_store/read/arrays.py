"""Owns opening a store's arrays at full capacity, by the schema's metadata, and reading those that never change.

What never changes (population, coordinates) has its digests in the root: what is read of it is compared with them.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray
from zarr.abc.store import Store
from zarr.storage import StorePath as ZarrPath

from softclose_store.disk.files import LocalFiles, StorePath, normalised, open_files
from softclose_store.disk.loop import run_here
from softclose_store.disk.names import chunk_key
from softclose_store.errors import DamageError
from softclose_store.read.described import DescribedFiles, Needed
from softclose_store.schema.digests import array_sha256
from softclose_store.schema.hierarchy import MARKER, TABLES, schema_of
from softclose_store.schema.layout import POPULATION, Layout
from softclose_store.schema.opening import layout_without_times, read_root
from softclose_store.schema.root import ROOT_KEY, RUNTIME_KEY, Root, runtime_text
from softclose_store.schema.texts import read_json

UNREADABLE = (
    *(ValueError, RuntimeError, OSError, KeyError, IndexError, TypeError, EOFError, AttributeError),
    MemoryError,
)
"""What zarr and its codecs raise on damaged bytes."""

_opening = threading.Lock()
"""Guards the process-wide zarr setting that is changed while arrays are opened."""


def described(files: Store, root: Root, where: str, needed: Needed | None = None) -> DescribedFiles:
    """The files of a store behind the metadata of its schema, and its root as it was read.

    Parameters
    ----------
    files : Store
        Where they are.
    root : Root
        As `read_root` checked it.
    where : str
        The store, for messages.
    needed : callable, optional
        Which chunks have to be there; by default the static ones, the tables' of committed candidates, and those of
        whatever block is asked for.
    """
    layout = layout_without_times(root.attributes["layout"])
    documents = schema_of(layout) | {ROOT_KEY: root.encode(), RUNTIME_KEY: runtime_text(root)}
    n = root.n_committed

    def committed(name: str, chunk: str) -> bool:
        if name in TABLES:
            return int(chunk.split(".")[1]) * layout.table_chunk < n
        return name.rpartition("/")[2] != MARKER.name

    return DescribedFiles(files, documents, where, needed or committed)


def open_arrays(files: Store, names: Iterable[str]) -> dict[str, zarr.AsyncArray[Any]]:
    """Open arrays at full capacity, for whole chunks, those full of fill values included."""
    wanted = tuple(names)
    with _opening, zarr.config.set({"array.write_empty_chunks": True}):

        async def opened() -> dict[str, zarr.AsyncArray[Any]]:
            return {name: await zarr.AsyncArray.open(ZarrPath(files, name), zarr_format=3) for name in wanted}

        return run_here(opened(), files)


def read_array(files: DescribedFiles, name: str) -> NDArray[Any]:
    """Read a whole array. Its first dimension's chunks have to be there before anything is allocated for them."""
    if isinstance(files.inner, LocalFiles):
        for key in chunk_keys(files, name):
            if files.inner.below.size(key) is None and files.needed(name, key.rpartition("/")[2]):
                raise files.damage(key, "is missing")
    return read_whole(files, name)


def read_whole(files: DescribedFiles, name: str) -> NDArray[Any]:
    """Read a whole array."""

    async def read() -> Any:
        array = await zarr.AsyncArray.open(ZarrPath(files, name), zarr_format=3)
        return await array.getitem(Ellipsis)

    return np.asarray(run_here(read(), files))


def chunk_keys(files: DescribedFiles, name: str) -> list[str]:
    """Keys of the chunks along the first dimension that an array has by the schema."""
    document = read_json(files.documents[f"{name}/zarr.json"])
    step = document["chunk_grid"]["configuration"]["chunk_shape"][0]
    return [chunk_key(name, i) for i in range(-(-document["shape"][0] // step))]


def read_static(files: DescribedFiles, root: Root, name: str) -> NDArray[Any]:
    """An array that the creation wrote once and for all. Raises DamageError where it is not what was written."""
    try:
        values = read_array(files, name)
    except DamageError:
        raise
    except UNREADABLE as e:
        raise files.damage(chunk_key(name, 0), f"cannot be read ({type(e).__name__}: {e})") from e
    if array_sha256(values) != root.attributes["static_digests"].get(name):
        raise files.damage(chunk_key(name, 0), "is not what was written")
    return values


def layout_of(files: DescribedFiles, root: Root) -> Layout:
    """The layout of a store. Every stage has its copy of the time grid: the first that is as it was written counts."""
    data = root.attributes["layout"]
    if not data["n_times"]:
        return Layout.from_dict(data, np.empty(0))
    problem: DamageError | None = None
    for stage in data["stages"]:
        try:
            return Layout.from_dict(data, read_static(files, root, f"{stage['name']}/time"))
        except DamageError as e:
            problem = problem or e
    assert problem is not None
    raise problem


def read_population(path: StorePath) -> dict[str, NDArray[np.float64]]:
    """The whole ensemble: every column of the population, (n_switches,) float64, by its name. Raises DamageError."""
    files, where = open_files(path, read_only=True), normalised(path)
    root = read_root(files, where)
    read = described(files, root, where)
    return population_of(read, root)


def population_of(files: DescribedFiles, root: Root) -> dict[str, NDArray[np.float64]]:
    """The whole ensemble of the store whose files are given. Raises DamageError."""
    names = [name for name, *_ in root.attributes["layout"]["columns"]]
    return {name: read_static(files, root, f"{POPULATION}/{name}") for name in names}
