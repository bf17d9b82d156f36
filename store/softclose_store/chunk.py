"""Owns what a worker writes: one chunk of one candidate, whole shards that no other task touches, its marker last."""

from __future__ import annotations

import os
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray
from zarr.abc.store import Store
from zarr.storage import StorePath as ZarrPath

from softclose_store import digests, faults
from softclose_store.errors import LayoutError
from softclose_store.files import StorePath, normalised, open_files, read_key, run_here
from softclose_store.layout import MARKER, ArraySpec, Layout
from softclose_store.pipeline import PIPELINE
from softclose_store.root import read_root

_opening = threading.Lock()
"""Guards the process-wide zarr setting that is changed while arrays are opened."""


@dataclass(frozen=True, slots=True)
class ChunkWriter:
    """The arrays of one store, open at full capacity for whole-shard writes."""

    files: Store
    """Where they are."""
    layout: Layout
    """Their sizes."""
    arrays: dict[str, zarr.AsyncArray[Any]]
    """The arrays that workers write, the markers included."""
    key: tuple[Any, ...]
    """Changes when another store takes the place of this one."""

    def write(
        self, i_candidate: int, i_chunk: int, arrays: Mapping[str, NDArray[Any]], proposal_digest: int
    ) -> NDArray[np.uint64]:
        """Write one chunk, then its marker, which is returned."""
        layout = self.layout
        if not 0 <= i_candidate < layout.n_candidates or not 0 <= i_chunk < layout.n_chunks:
            raise LayoutError(
                f"candidate {i_candidate}, chunk {i_chunk} is outside the store's {layout.n_candidates} candidates of "
                f"{layout.n_chunks} chunks"
            )
        rows = check_rows(layout, i_chunk, arrays)
        marker = marker_of(rows, i_candidate, i_chunk, proposal_digest)
        run_here(self._write(i_candidate, i_chunk, rows, marker), self.files)
        return marker

    async def _write(self, i: int, i_chunk: int, rows: Mapping[str, NDArray[Any]], marker: NDArray[np.uint64]) -> None:
        extent = self.layout.rows(i_chunk, self.layout.n_switches)
        for spec in self.layout.switch_arrays:
            values = rows[spec.name]
            if len(values) < extent.stop - extent.start:  # the candidate uses part of the ensemble: a whole shard still
                whole = spec.empty((extent.stop - extent.start, *values.shape[1:]))
                whole[: len(values)] = values
                values = whole
            rest = (slice(None),) * (values.ndim - 1)
            await self.arrays[spec.name].setitem((slice(i, i + 1), extent, *rest), values[np.newaxis])
        faults.point("after-chunk")
        faults.point("before-marker")
        where = (slice(i, i + 1), slice(i_chunk, i_chunk + 1), slice(None))
        await self.arrays[MARKER.name].setitem(where, marker[np.newaxis, np.newaxis])
        faults.point("after-marker")


def marker_of(
    rows: Mapping[str, NDArray[Any]], i_candidate: int, i_chunk: int, proposal_digest: int
) -> NDArray[np.uint64]:
    """The marker of a chunk: its proposal's digest, then one digest per array, in the layout's order."""
    found = [digests.chunk_digest(name, i_candidate, i_chunk, proposal_digest, rows[name]) for name in rows]
    return np.array([proposal_digest, *found], dtype=np.uint64)


def check_rows(layout: Layout, i_chunk: int, arrays: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """The arrays as the schema has them: in its order, C-contiguous, of its types; raises LayoutError."""
    specs = {spec.name: spec for spec in layout.switch_arrays}
    missing, unknown = sorted(set(specs) - set(arrays)), sorted(set(arrays) - set(specs))
    if missing or unknown:
        raise LayoutError(f"a chunk needs the arrays {', '.join(specs)}; missing: {missing}, unknown: {unknown}")
    extent = layout.rows(i_chunk, layout.n_switches)
    most = extent.stop - extent.start
    n = len(arrays["status"])
    rows = {}
    for name, spec in specs.items():
        values = np.asarray(arrays[name])
        allowed = (n, *layout.shape(spec)[2:])
        if values.shape != allowed or not 0 < n <= most:
            raise LayoutError(
                f"{name} of chunk {i_chunk} has shape {values.shape}; it must be {allowed}, with 1 to {most} switches"
            )
        rows[name] = _cast(spec, values)
    return rows


def _cast(spec: ArraySpec, values: NDArray[Any]) -> NDArray[Any]:
    if not np.can_cast(values.dtype, spec.dtype, "same_kind"):
        raise LayoutError(f"{spec.name} is of type {values.dtype}; it must be {np.dtype(spec.dtype)}")
    return np.ascontiguousarray(values, dtype=spec.dtype)


def open_arrays(files: Store, names: tuple[str, ...]) -> dict[str, zarr.AsyncArray[Any]]:
    """Open arrays at full capacity, for writing whole chunks, those full of fill values included."""
    with _opening, zarr.config.set({"array.write_empty_chunks": True, "codec_pipeline.path": PIPELINE}):

        async def opened() -> dict[str, zarr.AsyncArray[Any]]:
            return {name: await zarr.AsyncArray.open(zarr_path(files, name), zarr_format=3) for name in names}

        return run_here(opened(), files)


def zarr_path(files: Store, name: str) -> ZarrPath:
    """The place of an array in a store."""
    return ZarrPath(files, name)


_writers: dict[str, ChunkWriter] = {}


def open_writer(path: StorePath) -> ChunkWriter:
    """The writer of a store, kept open for this process; opened again where another store has taken the path."""
    where = normalised(path)
    writer = _writers.get(where)
    if writer is not None and writer.key == _identity(writer.files, where):
        return writer
    plain = open_files(path, read_only=True)
    root = read_root(plain, where)
    files = open_files(path, read_only=False, durable=bool(root.attributes["durable"]), blind=True)
    layout = read_layout(plain, where)
    names = (*(spec.name for spec in layout.switch_arrays), MARKER.name)
    writer = ChunkWriter(files, layout, open_arrays(files, names), _identity(files, where))
    _writers[where] = writer
    return writer


def forget_writer(path: StorePath) -> None:
    """Open the store afresh at the next chunk: after a repair of its metadata."""
    _writers.pop(normalised(path), None)


def _identity(files: Store, where: str) -> tuple[Any, ...]:
    """Changes when the store at a path is replaced by another: it is read before every chunk, so it must be cheap."""
    try:
        found = os.stat(os.path.join(where, MARKER.name, "zarr.json"))
    except OSError:
        return (os.getpid(), read_key(files, f"{MARKER.name}/zarr.json"))
    return os.getpid(), found.st_ino, found.st_mtime_ns


def read_layout(files: Store, where: str) -> Layout:
    """The layout of a store."""
    root = read_root(files, where)
    times = np.empty(0)
    if root.attributes["layout"]["n_times"]:
        times = read_array(files, "time")
    return Layout.from_dict(root.attributes["layout"], times)


def read_array(files: Store, name: str, selection: Any = Ellipsis) -> NDArray[Any]:
    """Read part of an array at full capacity, committed or not."""

    async def read() -> Any:
        array = await zarr.AsyncArray.open(zarr_path(files, name), zarr_format=3)
        return await array.getitem(selection)

    return np.asarray(run_here(read(), files))


def write_chunk(
    path: StorePath, i_candidate: int, i_chunk: int, arrays: Mapping[str, NDArray[Any]], proposal_digest: int
) -> NDArray[np.uint64]:
    """Store one chunk: every per-switch array of the layout, (n, …) each, then its marker, which is returned.

    Safe to run again, anywhere, any number of times: it writes whole shards that no other chunk touches.
    Raises LayoutError for arrays that do not fit, OSError where the disk is full.
    """
    return open_writer(path).write(i_candidate, i_chunk, arrays, proposal_digest)


def read_switches(path: StorePath) -> NDArray[np.float64]:
    """The whole ensemble: (n_switches, 4) float64, columns D [µm], G [µm], K [N/m], M [µg]."""
    files = open_files(path, read_only=True)
    read_root(files, normalised(path))
    return np.column_stack([read_array(files, name) for name in ("D", "G", "K", "M")])
