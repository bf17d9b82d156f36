"""Owns the comparison of stored chunks with their markers."""

from __future__ import annotations

from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray
from zarr.abc.store import Store

from softclose_store import digests
from softclose_store.chunk import f_path
from softclose_store.files import run_here
from softclose_store.layout import MARKER, Layout

UNREADABLE = (ValueError, RuntimeError, OSError, KeyError, IndexError, TypeError, EOFError)
"""What zarr and its codecs raise on damaged bytes."""


def read_markers(files: Store, layout: Layout, i: int) -> NDArray[np.uint64]:
    """Markers of candidate i at full capacity: (n_chunks, n_arrays + 1); a row that cannot be read is 0."""

    async def read() -> NDArray[np.uint64]:
        array: Any = await zarr.AsyncArray.open(f_path(files, MARKER.name), zarr_format=3)
        rows = np.zeros((layout.n_chunks, len(layout.marker_names)), dtype=np.uint64)
        for i_chunk in range(layout.n_chunks):
            try:
                rows[i_chunk] = await array.getitem((i, i_chunk))
            except UNREADABLE:
                continue
        return rows

    return run_here(read(), files)


def chunk_problems(files: Store, layout: Layout, i: int, i_chunk: int, n_switches: int, proposal_digest: int) -> list[str]:
    """What is wrong with one chunk: one sentence per array that is not what its marker says; [] where all is well."""
    rows = layout.rows(i_chunk, n_switches)

    async def check() -> list[str]:
        problems = []
        array: Any = await zarr.AsyncArray.open(f_path(files, MARKER.name), zarr_format=3)
        try:
            marker = np.asarray(await array.getitem((i, i_chunk)))
        except UNREADABLE as e:
            return [f"its marker cannot be read: {e}"]
        if not marker.any():
            return ["it has no marker"]
        if int(marker[0]) != proposal_digest:
            return ["its marker belongs to another proposal"]
        for spec, expected in zip(layout.switch_arrays, marker[1:], strict=True):
            array = await zarr.AsyncArray.open(f_path(files, spec.name), zarr_format=3)
            rest = (slice(None),) * (len(spec.dims) - 2)
            try:
                values = np.ascontiguousarray(await array.getitem((i, rows, *rest)))
            except UNREADABLE as e:
                problems.append(f"{spec.name} cannot be read: {e}")
                continue
            if digests.chunk_digest(spec.name, i, i_chunk, proposal_digest, values) != int(expected):
                problems.append(f"{spec.name} is not what was written")
        return problems

    return run_here(check(), files)
