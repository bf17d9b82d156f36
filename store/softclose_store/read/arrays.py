"""Owns opening a store's arrays at full capacity: what writers, verification and the driver read, committed or not."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray
from zarr.abc.store import Store
from zarr.storage import StorePath as ZarrPath

from softclose_store.disk.files import StorePath, normalised, open_files
from softclose_store.disk.loop import run_here
from softclose_store.errors import StoreError
from softclose_store.schema.layout import Layout
from softclose_store.schema.root import Root, read_root

UNREADABLE = (
    *(ValueError, RuntimeError, OSError, KeyError, IndexError, TypeError, EOFError, AttributeError),
    MemoryError,
)
"""What zarr and its codecs raise on damaged bytes."""

_opening = threading.Lock()
"""Guards the process-wide zarr setting that is changed while arrays are opened."""


def open_arrays(files: Store, names: Iterable[str]) -> dict[str, zarr.AsyncArray[Any]]:
    """Open arrays at full capacity, for whole chunks, those full of fill values included."""
    wanted = tuple(names)
    with _opening, zarr.config.set({"array.write_empty_chunks": True}):

        async def opened() -> dict[str, zarr.AsyncArray[Any]]:
            return {name: await zarr.AsyncArray.open(ZarrPath(files, name), zarr_format=3) for name in wanted}

        return run_here(opened(), files)


def read_array(files: Store, name: str, shape: Sequence[int] | None = None) -> NDArray[Any]:
    """Read a whole array. shape: what it must have; with the metadata of another it could be of any size."""

    async def read() -> Any:
        array = await zarr.AsyncArray.open(ZarrPath(files, name), zarr_format=3)
        if shape is not None and array.shape != tuple(shape):
            raise ValueError(f"{name} has shape {array.shape}; it must be {tuple(shape)}")
        return await array.getitem(Ellipsis)

    return np.asarray(run_here(read(), files))


def layout_of(files: Store, root: Root) -> Layout:
    """The layout of a store. Every stage has its copy of the time grid: the first that can be read counts."""
    data = root.attributes["layout"]
    if not data["n_times"]:
        return Layout.from_dict(data, np.empty(0))
    problem: Exception | None = None
    for stage in data["stages"]:
        try:
            return Layout.from_dict(data, read_array(files, f"{stage['name']}/time", [data["n_times"]]))
        except UNREADABLE as e:
            problem = e
    raise StoreError(f"the time grid cannot be read ({problem}): run `softclose verify --repair`")


LOT = ("D", "G", "K", "M", "voltage_scale", "time_scale")
"""What a simulation takes of each switch: its own parameters, then the scales of its drive."""


def read_switches(path: StorePath) -> NDArray[np.float64]:
    """The whole ensemble: (n_switches, 6) float64, columns D [µm], G [µm], K [N/m], M [µg], and the voltage and time
    scale of its drive: 1 where one waveform drives all."""
    files = open_files(path, read_only=True)
    read_root(files, normalised(path))
    return switches_of(files)


def switches_of(files: Store) -> NDArray[np.float64]:
    """The whole ensemble of the store whose files are given."""
    return np.column_stack([read_array(files, name) for name in LOT])
