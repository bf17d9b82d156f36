"""Owns how many candidates a store holds whose root is lost: found from everything that remains."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from zarr.abc.store import Store

from softclose_store.disk.names import chunk_key
from softclose_store.read.arrays import UNREADABLE, read_array
from softclose_store.read.table import ORIGIN, RECORD, Table
from softclose_store.schema.fields import N_SURROGATE
from softclose_store.schema.hierarchy import HYPERPARAMETER, MARKER
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


def remains(files: Store, layout: Layout, keys: Collection[str], where: str) -> Remains:
    """Count the candidates of a store without its root."""
    table = Table(layout, layout.n_candidates)
    table.load(files, layout.n_candidates, where, tolerate_damage=True)
    written = table.digests[:, RECORD] != 0
    n = int(written.argmin()) if not written.all() else layout.n_candidates
    names = _hyperparameters(files)
    n_waves = 0
    if n and int(table.digests[n - 1, RECORD]) == table.record_digest(n - 1):
        n_waves = int(table.number(n - 1, "wave")) + 1
    i_chunk = n // layout.table_chunk
    trusted = n == layout.n_candidates or (
        chunk_key("digests", i_chunk, 0) in keys and ("digests", i_chunk) not in table.damaged
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


def _hyperparameters(files: Store) -> tuple[str, ...]:
    try:
        return tuple(str(name) for name in read_array(files, HYPERPARAMETER, [N_SURROGATE]) if name)
    except UNREADABLE:
        return ()
