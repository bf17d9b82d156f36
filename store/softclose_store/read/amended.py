"""Owns what xarray sees of a campaign of which something was changed by hand: what counts, not what was first told."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from softclose_store.read.by_hand import CHOSEN, Changed
from softclose_store.read.table import ORIGIN, RecordTable

if TYPE_CHECKING:
    import xarray as xr


def amended_tables(dataset: xr.Dataset, table: RecordTable, n: int) -> xr.Dataset:
    """The tables of candidates with the n rows of an amended table in place of those on the disk."""
    found = dataset.copy()
    for name in ("records", "words", "engine"):
        values = dataset[name].to_numpy().copy()
        if name == "engine":
            values[:n][table.words[:n, ORIGIN] == CHOSEN] = CHOSEN
        else:
            values[:n] = getattr(table, name)[:n]
        found[name] = dataset[name].copy(data=values)
    return found


def amended_stage(dataset: xr.Dataset, changes: Mapping[int, Changed]) -> xr.Dataset:
    """A stage with the readings that count in place of those first told; changes: by candidate."""
    own = [(k, changes[int(i)]) for k, i in enumerate(dataset["candidate"].to_numpy()) if int(i) in changes]
    if not own:
        return dataset
    response = np.array(dataset["response"])
    for k, change in own:
        assert change.response is not None
        response[k, : len(change.response)] = change.response
    return dataset.assign(response=dataset["response"].copy(data=response))
