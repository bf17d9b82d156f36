"""Owns the comparison of stored blocks with their markers."""

from __future__ import annotations

from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray

from softclose_store.disk.loop import run_here
from softclose_store.disk.names import chunk_key
from softclose_store.read.arrays import UNREADABLE, open_arrays
from softclose_store.read.described import DescribedFiles
from softclose_store.schema.digests import block_digest, keyed_digest
from softclose_store.schema.hierarchy import MARKER
from softclose_store.schema.layout import Layout


class BlockReader:
    """The blocks of one store as they are on the disk, committed or not."""

    def __init__(self, files: DescribedFiles, layout: Layout) -> None:
        self._files = files
        self._layout = layout
        self._arrays: dict[str, zarr.AsyncArray[Any]] = {}

    def _array(self, name: str) -> zarr.AsyncArray[Any]:
        if name not in self._arrays:
            self._arrays |= open_arrays(self._files, [name])
        return self._arrays[name]

    def block(self, stage: str, name: str, i: int, j: int) -> NDArray[Any]:
        """One array of a block: (candidates, switches, …)."""
        sizes = self._layout.stage(stage)
        array = self._array(f"{stage}/{name}")
        selection = (sizes.candidates(i), sizes.switches(j), *(slice(None),) * (array.ndim - 2))
        return np.asarray(run_here(array.getitem(selection), self._files))

    def marker(self, stage: str, i: int, j: int) -> NDArray[np.uint64]:
        """Marker of a block; 0 throughout where there is none, or none that can be read."""
        try:
            return self.markers(stage, i, j)
        except UNREADABLE:
            return np.zeros(len(self._layout.marker_names), dtype=np.uint64)

    def markers(self, stage: str, i: int, j: int | slice) -> NDArray[np.uint64]:
        """Markers of one block, or of several in a row of blocks: (…, n_markers); 0 where there is none."""
        array = self._array(f"{stage}/{MARKER.name}")
        return np.asarray(run_here(array.getitem((i, j)), self._files))

    def problems(self, stage: str, i: int, j: int, proposals_digest: int | None = None) -> list[str]:
        """What is wrong with one block: a sentence per file that is not what its marker says; [] where all is well.

        proposals_digest: what its candidates should be; None takes the marker's word.
        """
        marker = self.marker(stage, i, j)
        if not marker.any():
            return [f"{self._key(stage, MARKER.name, i, j)} is missing, or no marker"]
        proposals = int(marker[0])
        if proposals_digest is not None and proposals != proposals_digest:
            return [f"{self._key(stage, MARKER.name, i, j)} belongs to other proposals"]
        problems = []
        for name, expected in zip(self._layout.block_arrays, marker[1:-1], strict=True):
            try:
                values = np.ascontiguousarray(self.block(stage, name, i, j))
            except UNREADABLE as e:
                problems.append(f"{self._key(stage, name, i, j)} cannot be read: {e}")
                continue
            if block_digest(stage, name, i, j, proposals, values) != int(expected):
                problems.append(f"{self._key(stage, name, i, j)} is not what was written")
        return problems

    def _key(self, stage: str, name: str, i: int, j: int) -> str:
        n_rest = 1 if name == MARKER.name else len(self._layout.block_arrays[name][0])
        return chunk_key(f"{stage}/{name}", i, j, *([0] * n_rest))


def markers_digest(markers: NDArray[np.uint64], i_candidate: int) -> int:
    """Digest of the markers of a candidate's blocks, (n_blocks, n_markers): ties its record to its data."""
    return keyed_digest(
        f"markers|{i_candidate}|{markers.shape}", [np.ascontiguousarray(markers, dtype="<u8").tobytes()]
    )
