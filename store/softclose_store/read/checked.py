"""Owns reading committed data: a block is compared with its marker, and this with its records, before it is handed out.

Each is compared once for as long as a store is open, and the last ones stay decoded: a block holds many candidates, and
whoever reads one of them mostly reads the next one too.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softclose_store.disk.loop import run_here
from softclose_store.disk.names import chunk_key
from softclose_store.errors import DamageError
from softclose_store.read.arrays import UNREADABLE, open_arrays
from softclose_store.read.blocks import BlockReader, markers_digest
from softclose_store.read.described import DescribedFiles
from softclose_store.read.table import MARKERS, RecordTable
from softclose_store.schema.digests import BlockDigest
from softclose_store.schema.hierarchy import MARKER
from softclose_store.schema.layout import Layout

KEPT_BYTES = 64_000_000
"""Decoded blocks that are kept."""

BlockRow = tuple[int, NDArray[np.uint64]]
"""Of a row of blocks: the digest of its proposals, and its markers, (n_blocks, n_markers)."""


class CheckedBlocks:
    """The blocks of committed candidates; raises DamageError for one that is not what was written."""

    def __init__(self, files: DescribedFiles, layout: Layout, table: Callable[[], RecordTable]) -> None:
        """table: the records of all committed candidates, checked."""
        self._files = files
        self._layout = layout
        self._table = table
        self._reader = BlockReader(files, layout)
        self._rows: dict[tuple[str, int], BlockRow] = {}
        self._checked: set[tuple[str, str, int, int]] = set()
        self._kept: OrderedDict[tuple[str, str, int, int], NDArray[Any]] = OrderedDict()

    def n_columns(self, stage: str, i: int) -> int:
        """How many blocks of a row are in use."""
        return len(self._row(stage, i)[1])

    def check(self, stage: str, name: str, i: int, j: int) -> None:
        """Compare one array of a block with its marker, where that has not been done."""
        if name == MARKER.name:
            self._row(stage, i)
        elif (stage, name, i, j) not in self._checked:
            self._read(stage, name, i, j)

    def take(self, stage: str, name: str, local: int, rows: NDArray[np.intp] | slice) -> NDArray[Any]:
        """Rows of one candidate of a stage, (switches, …), as an array of one's own."""
        sizes = self._layout.stage(stage)
        i, k = divmod(local, sizes.block_candidates)
        if isinstance(rows, slice):
            first, last = rows.start, rows.stop
        else:
            first, last = (int(rows.min()), int(rows.max()) + 1) if rows.size else (0, 0)
        columns = range(first // sizes.block_switches, -(-last // sizes.block_switches)) or range(1)
        if self._is_cut(stage):
            for j in columns:
                self.check(stage, name, i, j)
            array = open_arrays(self._files, [f"{stage}/{name}"])[f"{stage}/{name}"]
            if isinstance(rows, slice):
                return np.asarray(run_here(array.getitem((local, rows)), self._files))
            return np.asarray(run_here(array.oindex.getitem((local, rows)), self._files))
        parts = [self._read(stage, name, i, j)[k] for j in columns]
        whole = parts[0] if len(parts) == 1 else np.concatenate(parts)
        at = columns.start * sizes.block_switches
        if isinstance(rows, slice):
            found = whole[rows.start - at : rows.stop - at : rows.step]
            return found.copy() if len(parts) == 1 and sizes.block_candidates > 1 else found  # kept ones are ours
        return np.asarray(whole[rows - at])

    def _is_cut(self, stage: str) -> bool:
        """Whether the blocks of a stage are shards of several chunks."""
        sizes = self._layout.stage(stage)
        return sizes.inner != (sizes.block_candidates, sizes.block_switches)

    def _row(self, stage: str, i: int) -> BlockRow:
        """A row of blocks: its markers, which are those that its candidates' records were written for."""
        if (stage, i) not in self._rows:
            sizes, table = self._layout.stage(stage), self._table()
            proposals, n_switches = table.block_proposals(sizes, i)
            n_columns = sizes.blocks_of(n_switches)
            key = chunk_key(f"{stage}/{MARKER.name}", i, 0, 0)
            try:
                markers = self._reader.markers(stage, i, slice(0, n_columns))
            except UNREADABLE as e:
                raise self._damage(key, f"cannot be read ({e})", e) from e
            first, candidates = self._layout.first(stage), sizes.candidates(i)
            for k in range(first + candidates.start, first + candidates.stop):
                if markers_digest(markers, k) != int(table.digests[k, MARKERS]):
                    lost = [j for j in range(n_columns) if not markers[j].all()]
                    key = chunk_key(f"{stage}/{MARKER.name}", i, lost[0], 0) if lost else key
                    more = "" if lost or n_columns == 1 else f" (or another of the {n_columns} in its row)"
                    fate = "is missing" if lost else f"is not what was written{more}"
                    raise self._damage(key, f"{fate}: candidate {k} belongs to another marker")
            self._rows[stage, i] = proposals, markers
        return self._rows[stage, i]

    def _damage(self, key: str, what: str, e: Exception | None = None) -> DamageError:
        return e if isinstance(e, DamageError) else self._files.damage(key, what)

    def _read(self, stage: str, name: str, i: int, j: int) -> NDArray[Any]:
        """One array of a block, (candidates, switches, …); nothing of a block that is cut, which may be of any size."""
        place = (stage, name, i, j)
        if place in self._kept:
            self._kept.move_to_end(place)
            return self._kept[place]
        proposals, markers = self._row(stage, i)
        n_rest = len(self._layout.block_arrays[name][0])
        key = chunk_key(f"{stage}/{name}", i, j, *([0] * n_rest))
        shape = self._layout.stage(stage).block_shape(i, j) + self._layout.block_arrays[name][0]
        digest = BlockDigest(place, proposals, np.dtype(self._layout.block_arrays[name][1]), shape)
        values = np.empty(0)
        try:
            for values in self._pieces(stage, name, i, j):
                digest.add(values)
        except UNREADABLE as e:
            raise self._damage(key, f"cannot be read ({type(e).__name__}: {e})", e) from e
        if digest.value != int(markers[j, 1 + list(self._layout.block_arrays).index(name)]):
            raise self._damage(key, "is not what was written")
        self._checked.add(place)
        if self._is_cut(stage) or self._layout.stage(stage).block_candidates == 1:
            return values  # of which nothing is wanted again
        self._kept[place] = values
        while len(self._kept) > 1 and sum(kept.nbytes for kept in self._kept.values()) > KEPT_BYTES:
            self._kept.popitem(last=False)
        return values

    def _pieces(self, stage: str, name: str, i: int, j: int) -> list[NDArray[Any]] | Any:
        """A block in parts that follow one another in it: whole, or chunk by chunk where it is cut."""
        if not self._is_cut(stage):
            yield np.ascontiguousarray(self._reader.block(stage, name, i, j))
            return
        sizes = self._layout.stage(stage)
        candidates, switches = sizes.candidates(i), sizes.switches(j)
        array = open_arrays(self._files, [f"{stage}/{name}"])[f"{stage}/{name}"]
        n_candidates, n_switches = sizes.inner
        for k in range(candidates.start, candidates.stop, n_candidates):
            rows = slice(k, min(k + n_candidates, candidates.stop))
            for s in range(switches.start, switches.stop, n_switches):
                columns = slice(s, min(s + n_switches, switches.stop))
                yield np.ascontiguousarray(run_here(array.getitem((rows, columns)), self._files))
