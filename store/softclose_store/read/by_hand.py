"""Owns reading what a person has changed of a campaign: readings corrected or withdrawn, waveforms chosen by hand.

Each change is a result group of its own, `by-hand/000000` and on; nothing that is committed is written again. What
counts of a candidate is its record with the last change of its readings in its place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from softclose_store.disk.files import StorePath, look_at, normalised, open_files
from softclose_store.errors import DamageError
from softclose_store.read.result_groups import ResultGroup, read_group
from softclose_store.schema.fields import PARAMETERS
from softclose_store.schema.group_metadata import BY_HAND
from softclose_store.schema.layout import Layout
from softclose_store.schema.root import Root

CHOSEN = "by-hand"
"""Origin of a candidate whose waveform a person chose; it stands as its engine too."""

ChangeKind = Literal["correction", "withdrawal", "waveform"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Changed:
    """One change."""

    number: int
    """Its place among the changes, from 0."""
    kind: ChangeKind
    """correction, withdrawal: of the readings of a candidate; waveform: applied in the place of a proposal."""
    candidate: int
    """Which candidate it is of."""
    from_wave: int
    """First wave whose proposals see it."""
    reason: str
    """Why, in the words of whoever changed it."""
    unix_s: float
    """When [s since 1970]."""
    failure: str = ""
    """Why the candidate counts as failed, where it does."""
    record: NDArray[np.float64] | None = None
    """(n,) its result, as the table of records holds one; None for a waveform."""
    response: NDArray[np.float64] | None = None
    """(n_switches, n_quantities) its readings; None for a waveform."""
    waveform: NDArray[np.float64] | None = None
    """(n_pulse, 4) start, rise, peak [µs], volts; None for readings."""

    @property
    def note(self) -> str:
        """For the note of the candidate."""
        done = {"correction": "readings corrected", "withdrawal": "readings withdrawn", "waveform": "chosen by hand"}
        return f"{done[self.kind]}: {self.reason}" if self.reason else done[self.kind]


def name_of(number: int) -> str:
    """The group of a change."""
    return f"{BY_HAND}/{number:06d}"


def n_result(layout: Layout) -> int:
    """Numbers in a result, as the table of records holds one: all behind the wave."""
    return len(layout.fields) - layout.n_proposal_fields - 1


def read_by_hand(path: StorePath, root: Root, layout: Layout) -> tuple[Changed, ...]:
    """Every change of a store, in order. Raises DamageError where one is damaged, or is listed and not there."""
    files = open_files(path, read_only=True)
    found: list[Changed] = []
    while look_at(files, f"{name_of(len(found))}/zarr.json") is not None:
        name = name_of(len(found))
        found.append(_decoded(read_group(path, name), len(found), layout, f"group {name} of {normalised(path)}"))
    lost = sorted(name for name in root.listed if name.startswith(f"{BY_HAND}/") and name.count("/") == 1)[len(found) :]
    if lost:
        raise DamageError(
            f"group {lost[0]} of {normalised(path)} is listed in the root, and not there: it says what was changed by "
            "hand, and nothing computes it again; restore it from a copy"
        )
    return tuple(found)


def _decoded(group: ResultGroup, number: int, layout: Layout, where: str) -> Changed:
    said, arrays = group.attributes, group.arrays
    try:
        kind, candidate, wave = said["kind"], said["candidate"], said["from_wave"]
        if kind not in ("correction", "withdrawal", "waveform"):
            raise ValueError(f"its kind is {kind!r}")
        if not (isinstance(candidate, int) and candidate >= 0 and isinstance(wave, int)):
            raise ValueError(f"it is of candidate {candidate!r}, from wave {wave!r} on")
        change: dict[str, Any] = {
            "number": number,
            "kind": kind,
            "candidate": candidate,
            "from_wave": wave,
            "reason": str(said["reason"]),
            "unix_s": float(said["unix_s"]),
        }
        if kind == "waveform":
            return Changed(**change, waveform=_shaped(arrays["waveform"], (None, len(PARAMETERS))))
        return Changed(
            **change,
            failure=str(said["failure"]),
            record=_shaped(arrays["record"], (n_result(layout),)),
            response=_shaped(arrays["response"], (None, len(layout.quantities))),
        )
    except (KeyError, TypeError, ValueError) as e:
        raise DamageError(f"{where} says no change that was made by hand: {e}") from e


def _shaped(values: NDArray[Any], shape: tuple[int | None, ...]) -> NDArray[np.float64]:
    fits = values.ndim == len(shape) and all(n in (None, m) for n, m in zip(shape, values.shape, strict=True))
    if not fits or values.dtype != np.float64:
        raise ValueError(f"an array has shape {values.shape} and type {values.dtype}")
    return values


def latest_readings(changes: Sequence[Changed]) -> dict[int, Changed]:
    """The last change of the readings of each candidate that has one."""
    return {change.candidate: change for change in changes if change.record is not None}
