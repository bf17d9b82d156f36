"""Owns the comparison of stored chunks with their markers."""

from __future__ import annotations

from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray
from zarr.abc.store import Store

from softclose_store import digests
from softclose_store.chunk import zarr_path
from softclose_store.files import run_here
from softclose_store.layout import MARKER, Layout

UNREADABLE = (ValueError, RuntimeError, OSError, KeyError, IndexError, TypeError, EOFError, AttributeError)
"""What zarr and its codecs raise on damaged bytes."""


class ChunkReader:
    """The chunks of one store as they are on the disk, committed or not."""

    def __init__(self, files: Store, layout: Layout) -> None:
        self._files = files
        self._layout = layout
        self._arrays: dict[str, Any] = {}

    async def _array(self, name: str) -> Any:
        if name not in self._arrays:
            self._arrays[name] = await zarr.AsyncArray.open(zarr_path(self._files, name), zarr_format=3)
        return self._arrays[name]

    def rows(self, name: str, i: int, n: int) -> NDArray[Any]:
        """The first n rows of candidate i's part of an array."""

        async def read() -> Any:
            return await (await self._array(name)).getitem((i, slice(0, n)))

        return np.asarray(run_here(read(), self._files))

    def markers(self, i: int, n_chunks: int) -> NDArray[np.uint64]:
        """Markers of candidate i's first chunks: (n_chunks, n_arrays + 1); a row that cannot be read is 0."""

        async def read() -> NDArray[np.uint64]:
            rows = np.zeros((n_chunks, len(self._layout.marker_names)), dtype=np.uint64)
            for i_chunk in range(n_chunks):
                try:
                    rows[i_chunk] = await (await self._array(MARKER.name)).getitem((i, i_chunk))
                except UNREADABLE:
                    continue
            return rows

        return run_here(read(), self._files)

    def problems(self, i: int, i_chunk: int, n_switches: int, proposal_digest: int) -> list[str]:
        """What is wrong with one chunk: a sentence per array that is not what its marker says; [] where all is well.

        Reads the whole shard, the part beyond n_switches too: there, too, nothing may be damaged.
        """
        layout = self._layout
        rows = layout.rows(i_chunk, n_switches)
        extent = layout.rows(i_chunk, layout.n_switches)

        async def check() -> list[str]:
            problems = []
            try:
                marker = np.asarray(await (await self._array(MARKER.name)).getitem((i, i_chunk)))
            except UNREADABLE as e:
                return [f"its marker cannot be read: {e}"]
            if not marker.any():
                return ["it has no marker"]
            if int(marker[0]) != proposal_digest:
                return ["its marker belongs to another proposal"]
            for spec, expected in zip(layout.switch_arrays, marker[1:], strict=True):
                rest = (slice(None),) * (len(spec.dims) - 2)
                try:
                    shard = await (await self._array(spec.name)).getitem((i, extent, *rest))
                except UNREADABLE as e:
                    problems.append(f"{spec.name} cannot be read: {e}")
                    continue
                values = np.ascontiguousarray(shard[: rows.stop - rows.start])
                if digests.chunk_digest(spec.name, i, i_chunk, proposal_digest, values) != int(expected):
                    problems.append(f"{spec.name} is not what was written")
            return problems

        return run_here(check(), self._files)


def markers_digest(markers: NDArray[np.uint64], i: int, proposal_digest: int) -> int:
    """Digest of the markers of candidate i: (n_chunks, n_arrays + 1)."""
    return digests.fields_digest(f"markers|{i}|{proposal_digest}", [("markers", markers)])
