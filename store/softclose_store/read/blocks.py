"""Owns the comparison of stored blocks with their markers."""

from __future__ import annotations

from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray
from zarr.abc.store import Store

from softclose_store.disk.loop import run_here
from softclose_store.read.arrays import UNREADABLE, open_arrays
from softclose_store.schema.digests import block_digest, keyed_digest
from softclose_store.schema.hierarchy import MARKER
from softclose_store.schema.layout import Layout


class BlockReader:
    """The blocks of one store as they are on the disk, committed or not."""

    def __init__(self, files: Store, layout: Layout) -> None:
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
            array = self._array(f"{stage}/{MARKER.name}")
            return np.asarray(run_here(array.getitem((i, j)), self._files))
        except UNREADABLE:
            return np.zeros(len(self._layout.marker_names), dtype=np.uint64)

    def problems(self, stage: str, i: int, j: int, proposals_digest: int | None = None) -> list[str]:
        """What is wrong with one block: a sentence per array that is not what its marker says; [] where all is well.

        proposals_digest: what its candidates should be; None takes the marker's word.
        """
        marker = self.marker(stage, i, j)
        if not marker.any():
            return ["it has no marker that can be read"]
        proposals = int(marker[0])
        if proposals_digest is not None and proposals != proposals_digest:
            return ["its marker belongs to other proposals"]
        problems = []
        for name, expected in zip(self._layout.block_arrays, marker[1:-1], strict=True):
            try:
                values = np.ascontiguousarray(self.block(stage, name, i, j))
            except UNREADABLE as e:
                problems.append(f"{name} cannot be read: {e}")
                continue
            if block_digest(stage, name, i, j, proposals, values) != int(expected):
                problems.append(f"{name} is not what was written")
        return problems


def markers_digest(markers: NDArray[np.uint64], i_candidate: int) -> int:
    """Digest of the markers of a candidate's blocks, (n_blocks, n_markers): ties its record to its data."""
    return keyed_digest(
        f"markers|{i_candidate}|{markers.shape}", [np.ascontiguousarray(markers, dtype="<u8").tobytes()]
    )
