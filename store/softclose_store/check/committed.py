"""Owns how many candidates a store holds whose root is lost: found from everything that remains."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softclose_store.disk.names import chunk_key
from softclose_store.read.arrays import UNREADABLE, read_array
from softclose_store.read.described import DescribedFiles
from softclose_store.read.table import DIGESTS_TABLE, ORIGIN, RECORD, RecordTable
from softclose_store.schema.hierarchy import HYPERPARAMETER, MARKER, TABLES
from softclose_store.schema.layout import Layout


@dataclass(frozen=True, slots=True, kw_only=True)
class Remains:
    """What the tables of a store say when its root does not."""

    n: int
    """Candidates whose records were written."""
    certain: bool
    """True where the digests, which are written last, say so; else it is the most that any table says."""
    n_waves: int
    """Waves of which the digests know a candidate; 0 where the digests are lost."""
    hyperparameters: tuple[str, ...]
    """Names of the surrogate's quantities."""


def most_rows(layout: Layout, keys: Collection[str]) -> int:
    """Candidates that the files of the tables have place for: what a root says beyond that nothing vouches for."""
    n = 0
    for key in keys:
        name, _, chunk = key.partition("/c.")
        i = chunk.removesuffix(".0")
        if name in TABLES and i.isdecimal() and len(i) < 10:
            n = max(n, (int(i) + 1) * layout.table_chunk)
    return min(n, layout.n_candidates)


def remains(files: DescribedFiles, layout: Layout, keys: Collection[str]) -> Remains:
    """Count the candidates of a store without its root. files: as if none had to be there."""
    table = RecordTable(layout)
    table.load(files, most_rows(layout, keys), tolerate_damage=True)
    written = table.digests[:, RECORD] != 0
    n = int(written.argmin()) if not written.all() else len(written)
    names = _hyperparameters(files)
    n_waves = 0
    if n and int(table.digests[n - 1, RECORD]) == table.record_digest(n - 1):
        n_waves = int(table.number(n - 1, "wave")) + 1
    i_chunk = n // layout.table_chunk
    trusted = n == layout.n_candidates or (
        chunk_key(DIGESTS_TABLE, i_chunk, 0) in keys and (DIGESTS_TABLE, i_chunk) not in table.damaged
    )
    if trusted:
        return Remains(n=n, certain=True, n_waves=n_waves, hyperparameters=names)
    said: tuple[NDArray[Any], ...] = (
        written,
        np.asarray(table.words[:, ORIGIN] != ""),
        np.asarray(np.isfinite(table.records).any(axis=1)),
        np.asarray(np.isfinite(table.wall_times).any(axis=1)),
    )
    n = max(_last(rows) for rows in said)
    # An empty store has no tables yet, and no blocks either: that is certain.
    nothing = n == 0 and not any(f"/{MARKER.name}/c." in key for key in keys)
    return Remains(n=n, certain=nothing, n_waves=n_waves, hyperparameters=names)


def _last(rows: NDArray[Any]) -> int:
    return int(np.flatnonzero(rows)[-1]) + 1 if rows.any() else 0


def _hyperparameters(files: DescribedFiles) -> tuple[str, ...]:
    try:
        return tuple(str(name) for name in read_array(files, HYPERPARAMETER) if name)
    except UNREADABLE:
        return ()
