"""Owns what a worker writes: one block of one stage, whole chunks that no other task touches, its marker last."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray
from zarr.abc.store import Store

from softclose_store import faults
from softclose_store.disk.files import LocalFiles, StorePath, normalised, open_files, read_key
from softclose_store.disk.loop import run_here
from softclose_store.disk.names import OWN_FOLDER
from softclose_store.errors import LayoutError
from softclose_store.read.arrays import described, layout_of, open_arrays
from softclose_store.read.described import DescribedFiles, never
from softclose_store.schema.digests import assessed_digest, block_digest
from softclose_store.schema.fields import RESPONSE_QUANTITIES
from softclose_store.schema.hierarchy import MARKER, stage_specs
from softclose_store.schema.layout import Layout
from softclose_store.schema.opening import read_root

_PROBE = f"{OWN_FOLDER}/zarr.json"
"""Written once by the creation: another store at the path has another file here."""


@dataclass(frozen=True, slots=True)
class BlockWriter:
    """The arrays of one store, open at full capacity for whole-chunk writes."""

    files: DescribedFiles
    """Where they are."""
    layout: Layout
    """Their sizes."""
    arrays: dict[str, zarr.AsyncArray[Any]]
    """The arrays that workers write, the markers included, by their names from the root."""
    key: tuple[Any, ...]
    """Changes when another store takes the place of this one."""

    def write(
        self, stage: str, i_block: int, j_block: int, arrays: Mapping[str, NDArray[Any]], proposals_digest: int
    ) -> NDArray[np.uint64]:
        """Write one block, then its marker, which is returned."""
        values, n_switches = check_block(self.layout, stage, i_block, j_block, arrays)
        marker = marker_of(stage, i_block, j_block, values, n_switches, proposals_digest)
        run_here(self._write(stage, i_block, j_block, values, marker), self.files)
        return marker

    async def _write(
        self, stage: str, i: int, j: int, values: Mapping[str, NDArray[Any]], marker: NDArray[np.uint64]
    ) -> None:
        sizes = self.layout.stage(stage)
        where = (sizes.candidates(i), sizes.switches(j))
        for name, block in values.items():
            await self.arrays[f"{stage}/{name}"].setitem((*where, *(slice(None),) * (block.ndim - 2)), block)
        faults.point("before-marker")
        at = (slice(i, i + 1), slice(j, j + 1), slice(None))
        await self.arrays[f"{stage}/{MARKER.name}"].setitem(at, marker[np.newaxis, np.newaxis])
        faults.point("after-marker")


def marker_of(
    stage: str, i_block: int, j_block: int, values: Mapping[str, NDArray[Any]], n_switches: int, proposals_digest: int
) -> NDArray[np.uint64]:
    """The marker of a block: its proposals' digest, one digest per array, and that of what is assessed of it.

    values: as `check_block` returns them; n_switches: switches of the block that were simulated.
    """
    found = [block_digest(stage, name, i_block, j_block, proposals_digest, block) for name, block in values.items()]
    assessed = assessed_digest(
        stage, i_block, j_block, proposals_digest, *assessed_of(values["response"][:, :n_switches])
    )
    return np.array([proposals_digest, *found, assessed], dtype=np.uint64)


def assessed_of(
    response: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.int8], NDArray[np.float64], NDArray[np.float64]]:
    """What an assessment takes of responses (…, n_quantities): speed, closed, status, settling, what is asked."""
    status = np.where(np.isnan(response[..., 7]), -1, response[..., 7]).astype(np.int8)
    asked = response[..., len(RESPONSE_QUANTITIES) :].copy()
    return response[..., 0].copy(), response[..., 6] > 0, status, response[..., 2].copy(), asked


def check_block(
    layout: Layout, stage: str, i_block: int, j_block: int, arrays: Mapping[str, NDArray[Any]]
) -> tuple[dict[str, NDArray[Any]], int]:
    """The arrays as the schema has them: whole blocks, in its order, C-contiguous, of its types; raises LayoutError.

    Also returns how many switches were given: what is missing to a whole block is NaN.
    """
    expected = layout.block_arrays
    missing, unknown = sorted(set(expected) - set(arrays)), sorted(set(arrays) - set(expected))
    if missing or unknown:
        raise LayoutError(f"a block needs the arrays {', '.join(expected)}; missing: {missing}, unknown: {unknown}")
    n_candidates, most = layout.stage(stage).block_shape(i_block, j_block)
    given = np.shape(arrays["response"])
    n_switches = given[1] if len(given) == 3 else 0
    values = {}
    for name, (rest, dtype) in expected.items():
        block = np.asarray(arrays[name])
        allowed = (n_candidates, n_switches, *rest)
        if block.shape != allowed or not 0 < n_switches <= most:
            raise LayoutError(
                f"{name} of block ({i_block}, {j_block}) of stage {stage} has shape {block.shape}; it must be "
                f"{(n_candidates, most, *rest)}, where the number of switches may be smaller"
            )
        if not np.can_cast(block.dtype, dtype, "same_kind"):
            raise LayoutError(f"{name} is of type {block.dtype}; it must be {np.dtype(dtype)}")
        if n_switches < most:
            whole = np.full((n_candidates, most, *rest), np.nan, dtype=dtype)
            whole[:, :n_switches] = block
            block = whole
        values[name] = np.ascontiguousarray(block, dtype=dtype)
    return values, n_switches


_writers: dict[str, BlockWriter] = {}


def open_writer(path: StorePath) -> BlockWriter:
    """The writer of a store, kept open for this process; opened again where another store has taken the path."""
    where = normalised(path)
    writer = _writers.get(where)
    if writer is not None and writer.key == _identity(writer.files.inner):
        return writer
    plain = open_files(path, read_only=True)
    root = read_root(plain, where)
    layout = layout_of(described(plain, root, where), root)
    blind = open_files(path, read_only=False, durable=bool(root.attributes["durable"]), blind=True)
    files = described(blind, root, where, never)
    names = [f"{stage.name}/{spec.name}" for stage in layout.stages for spec in stage_specs(layout)]
    writer = BlockWriter(files, layout, open_arrays(files, names), _identity(blind))
    _writers[where] = writer
    return writer


def writing_s(path: StorePath) -> float:
    """Seconds that this process has waited for the disk, or the service, while it wrote blocks of a store."""
    writer = _writers.get(normalised(path))
    return 0.0 if writer is None else writer.files.writing_s


def forget_writer(path: StorePath) -> None:
    """Open the store afresh at the next block: after a repair of its metadata."""
    _writers.pop(normalised(path), None)


def _identity(files: Store) -> tuple[Any, ...]:
    """Changes when the store at a path is replaced by another: it is read before every block, so it must be cheap."""
    if isinstance(files, LocalFiles):
        return os.getpid(), files.below.identity(_PROBE)
    return os.getpid(), read_key(files, _PROBE)


def write_block(
    path: StorePath,
    stage: str,
    i_block: int,
    j_block: int,
    arrays: Mapping[str, NDArray[Any]],
    proposals_digest: int,
) -> NDArray[np.uint64]:
    """Store one block: every array of the layout's blocks, then its marker.

    Safe to run again, anywhere, any number of times: it writes whole chunks that no other block touches.

    Parameters
    ----------
    path : str or Path
        Folder or URL of the store.
    stage : str
        Stage of the block.
    i_block, j_block : int
        Its row and column.
    arrays : mapping of str to (candidates, switches, …) ndarray
        `response` (…, 8), `impact` (…, max_impacts, 2), `x` and `v` (…, n_times). Fewer switches than the block has
        mean that the wave uses no more. Rows of a failed candidate are NaN.
    proposals_digest : int
        Digest of what its candidates are simulated with.

    Returns
    -------
    (n_markers,) ndarray of uint64
        The marker.

    Raises
    ------
    LayoutError
        For arrays that do not fit.
    OSError
        Where the disk is full.
    """
    return open_writer(path).write(stage, i_block, j_block, arrays, proposals_digest)
