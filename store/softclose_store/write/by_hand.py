"""Owns writing what a person changes of a campaign, and what becomes of a change that was cut off."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from zarr.abc.store import Store

from softclose_store.disk.files import delete_key, list_keys, look_at, open_files, write_key
from softclose_store.groups import GroupArray
from softclose_store.listing import listed_anew
from softclose_store.read.by_hand import ChangeKind
from softclose_store.read.result_groups import group_problems, metadata_of
from softclose_store.schema.fields import PARAMETERS
from softclose_store.schema.group_metadata import BY_HAND
from softclose_store.schema.layout import Layout
from softclose_store.schema.root import Root


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """What is said of a change."""

    kind: ChangeKind
    """correction, withdrawal or waveform."""
    from_wave: int
    """First wave whose proposals see it."""
    reason: str
    """Why."""
    unix_s: float
    """When [s since 1970]."""

    def to_json(self) -> dict[str, Any]:
        """Attributes of its group."""
        return asdict(self)


def readings_arrays(
    layout: Layout, record: NDArray[np.float64], response: NDArray[np.float64]
) -> dict[str, GroupArray]:
    """The arrays of changed readings, with the names of their columns."""
    fields = [
        name for field in layout.results for name in [field.name] * (len(layout.limits_cm_s) if field.per_limit else 1)
    ]
    return {
        "field": GroupArray(dims=("field",), values=np.array(fields), long_name="columns of record"),
        "quantity": GroupArray(
            dims=("quantity",), values=np.array([q.name for q in layout.quantities]), long_name="columns of response"
        ),
        "record": GroupArray(
            dims=("field",), values=np.ascontiguousarray(record), unit="see field", long_name="what counts"
        ),
        "response": GroupArray(
            dims=("switch", "quantity"),
            values=np.ascontiguousarray(response, dtype=np.float64),
            unit="see quantity",
            long_name="the readings that count",
        ),
    }


def waveform_arrays(rows: NDArray[np.float64]) -> dict[str, GroupArray]:
    """The arrays of a waveform that was chosen by hand."""
    return {
        "parameter": GroupArray(
            dims=("parameter",), values=np.array(list(PARAMETERS)), long_name="columns of waveform"
        ),
        "waveform": GroupArray(
            dims=("pulse", "parameter"),
            values=np.ascontiguousarray(rows, dtype=np.float64),
            unit="see parameter",
            long_name="the waveform that was applied",
        ),
    }


def settled(files: Store, where: str, root: Root) -> Root:
    """The root after a change that was cut off is complete, where all of it is there, or gone. The lock is held.

    Left as it is, a repair would complete it later, when waves have been proposed without it.
    """
    if look_at(files, f"{BY_HAND}/zarr.json") is None:
        return root
    keys = [key for key in list_keys(files) if key.startswith(f"{BY_HAND}/") and key.count("/") > 1]
    for name in sorted({"/".join(key.split("/")[:2]) for key in keys}):
        own = f"{name}/zarr.json"
        if own in keys or name in root.listed:
            continue
        metadata = metadata_of(files, name, keys)
        durable = open_files(where, read_only=False, durable=bool(root.attributes["durable"]))
        if metadata is not None and len(group_problems(files, name, metadata)) == 1:  # that its own file is not there
            write_key(durable, own, metadata.encode())
        else:
            for key in [key for key in keys if key.startswith(f"{name}/")]:
                delete_key(files, key)
    return listed_anew(files, root)
