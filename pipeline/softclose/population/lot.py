"""Owns a lot: a table of switches with named columns, each of which has a unit and a meaning.

Nothing asks for its width or for the place of a column: what a condition adds, it names.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from softclose.arrays import FloatArray

DEVICE_COLUMNS = ("D", "G", "K", "M")
"""What a device model is given of each switch."""


class LotError(ValueError):
    """A table that is no lot, or that lacks a column."""


@dataclass(frozen=True, slots=True)
class Column:
    """What a column of a lot holds."""

    name: str
    """Such as `gain`."""
    unit: str
    """Such as µm; "1" for a pure number."""
    long_name: str
    """What it is, in words."""


COLUMNS: dict[str, Column] = {
    c.name: c
    for c in (
        Column("D", "µm", "travel to contact"),
        Column("G", "µm", "electrostatic gap"),
        Column("E", "GPa", "Young's modulus"),
        Column("T", "µm", "thickness"),
        Column("f", "kHz", "first resonance"),
        Column("U_pi", "V", "pull-in voltage"),
        Column("K", "N/m", "stiffness"),
        Column("M", "µg", "effective mass"),
        Column("measured_pull_in", "V", "pull-in voltage as it was measured"),
        Column("measured_resonance", "kHz", "resonance as it was measured"),
        Column("threshold", "V", "lowest step at which the switch touched, as its actuations bracket it"),
        Column("contact_time", "µs", "mean of its timed contacts"),
        Column("voltage_scale", "1", "scale of the volts of its command"),
        Column("time_scale", "1", "scale of the times of its command"),
        Column("gain", "1", "gain of its drive over the nominal one"),
        Column("clock", "1", "period of its generator's clock over the nominal one"),
        Column("celsius", "°C", "its temperature"),
        Column("replicate", "1", "which of the independent scramblings of the ensemble it is of"),
        Column("force_error", "1", "relative error of the model's electrostatic force"),
        Column("time_error", "1", "relative error of the model's times"),
    )
}
"""Every column that a lot may have, by name."""


class Lot:
    """n switches, each column a (n,) array of float64. It never changes: what adds to it makes another one."""

    __slots__ = ("_columns", "_n", "plate_area_um2")

    def __init__(self, columns: Mapping[str, ArrayLike], *, plate_area_um2: float | None = None) -> None:
        found: dict[str, FloatArray] = {}
        for name, values in columns.items():
            if name not in COLUMNS:
                raise LotError(f"{name!r} is no column of a lot; known are {', '.join(COLUMNS)}")
            column = np.asarray(values, dtype=np.float64)
            if column.ndim != 1:
                raise LotError(f"column {name} has shape {column.shape}; it must be (n,), one value a switch")
            found[name] = column
        missing = [name for name in DEVICE_COLUMNS if name not in found]
        if missing:
            raise LotError(f"the lot has no column {missing[0]}; it needs {', '.join(DEVICE_COLUMNS)}")
        sizes = {len(column) for column in found.values()}
        if len(sizes) > 1:
            shown = ", ".join(f"{name}: {len(column)}" for name, column in found.items())
            raise LotError(f"the columns of the lot differ in length ({shown}); each has one value a switch")
        self._columns, self._n = found, sizes.pop()
        self.plate_area_um2 = plate_area_um2
        """Plate area that the population was told with [µm²]; None where it has none of its own."""

    @classmethod
    def of(cls, switches: Lot | ArrayLike) -> Lot:
        """A lot as it is, or one of (n, 4) D, G [µm], K [N/m], M [µg]."""
        if isinstance(switches, Lot):
            return switches
        table = np.asarray(switches, dtype=np.float64)
        if table.ndim != 2 or table.shape[1] != len(DEVICE_COLUMNS):
            raise LotError(
                f"switches have shape {table.shape}; give a Lot, or (n, 4): D [µm], G [µm], K [N/m], M [µg] of each"
            )
        own = getattr(switches, "plate_area_um2", None)
        return cls(dict(zip(DEVICE_COLUMNS, table.T, strict=True)), plate_area_um2=own)

    @classmethod
    def joined(cls, parts: Sequence[Lot]) -> Lot:
        """Several lots with the same columns, one after the other."""
        columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
        return cls(columns, plate_area_um2=parts[0].plate_area_um2)

    def __len__(self) -> int:
        return self._n

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __contains__(self, name: object) -> bool:
        return name in self._columns

    def __getitem__(self, name: str) -> FloatArray:
        if name not in self._columns:
            raise LotError(
                f"the lot has no column {name} ({COLUMNS[name].long_name if name in COLUMNS else 'unknown'}), only "
                f"{', '.join(self._columns)}: draw it with the conditions that it is simulated under (softclose.draw)"
            )
        return self._columns[name]

    def __repr__(self) -> str:
        return f"Lot({self._n} switches: {', '.join(self._columns)})"

    @property
    def switches(self) -> FloatArray:
        """(n, 4) D, G [µm], K [N/m], M [µg]: what a device model is given."""
        return np.stack([self._columns[name] for name in DEVICE_COLUMNS], axis=1)

    def get(self, name: str, default: float) -> FloatArray:
        """Values of a column, or the same number for every switch where the lot has none of that name.

        Parameters
        ----------
        name : str
            The column.
        default : float
            What stands in for it.

        Returns
        -------
        (n,) ndarray of float64
        """
        return self._columns[name] if name in self._columns else np.full(self._n, default)

    def rows(self, which: Any) -> Lot:
        """The switches at a slice, mask or array of indices."""
        return self._with({name: column[which] for name, column in self._columns.items()})

    def with_columns(self, **columns: ArrayLike) -> Lot:
        """The same switches with columns added or replaced."""
        return self._with({**self._columns, **columns})

    def without(self, names: Iterable[str]) -> Lot:
        """The same switches without some columns."""
        left = {*names}
        return self._with({name: column for name, column in self._columns.items() if name not in left})

    def _with(self, columns: Mapping[str, ArrayLike]) -> Lot:
        return Lot(columns, plate_area_um2=self.plate_area_um2)
