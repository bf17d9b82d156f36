"""Owns tables of device measurements: gap, travel, and what tells stiffness and mass, checked for units and sense."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from softclose.arrays import FloatArray
from softclose.datafiles import Columns, Heading, NeededColumn, Table, TableError, Unfit, read_table
from softclose.datafiles.units import FACTORS, kind_of, name_and_unit
from softclose.naming import nearest
from softclose.population.population import Population, switches_from_parameters
from softclose.switch.plate import A1, pull_in_voltage

COLUMNS = ("G_um", "D_um", "T_um", "pull_in_V")
"""Columns of a plate's measurements; others are ignored, but for an optional `device`."""
LAWFUL: dict[tuple[str, str], tuple[str, str]] = {
    ("E", "T"): ("T_um", "pull_in_V"),
    ("U_pi", "f"): ("pull_in_V", "resonance_kHz"),
    ("K", "f"): ("K_N_per_m", "resonance_kHz"),
}
"""Law of a lot -> what has to be measured beside gap and travel; the first that a file has is fitted."""
MIN_DEVICES = 8
"""Fewer devices than this fix no distribution: the bounds would be guesses."""

_RANGE = {
    "G_um": (0.5, 20.0),
    "D_um": (0.1, 20.0),
    "T_um": (0.5, 20.0),
    "pull_in_V": (1.0, 1000.0),
    "resonance_kHz": (0.1, 10_000.0),
    "K_N_per_m": (1e-3, 1e6),
    "threshold_V": (1.0, 1000.0),
    "contact_time_us": (0.1, 1e5),
    "pull_out_V": (0.1, 1000.0),
    "quality_factor": (1e-3, 1e9),
    "voltage_V": (-1000.0, 1000.0),
    "closing_time_us": (1e-3, 1e6),
    "second_contact_us": (1e-3, 1e6),
    "time_us": (0.0, 1e7),
    "x_um": (-1e3, 1e3),
}
NAMES = (*_RANGE, "device")
"""Quantities that tables of devices have, as `--columns` names them."""
_UNITS = {"um": "µm", "V": "V", "kHz": "kHz", "m": "N/m", "us": "µs", "factor": ""}
_SLIPS = {
    "µm": ((1e6, "metres"), (1e3, "millimetres"), (1e-3, "nanometres")),
    "V": ((1e3, "kV"), (1e-3, "mV")),
    "kHz": ((1e-3, "Hz"), (1e3, "MHz")),
    "N/m": ((1e-3, "mN/m"), (1e3, "kN/m")),
    "µs": ((1e6, "seconds"), (1e3, "ms"), (1e-3, "ns")),
    "": (),
}
_FARTHEST = 5.0
"""A value beyond so many times the median of its column, or below that part of it, is a slip of the decimal sign."""
_REPEATABLE = 0.5
"""Devices of one name are one device where its values scatter by less than this part of the lot's spread."""


class MeasurementError(ValueError):
    """Measurements that are missing, malformed, in another unit or impossible."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Measurements:
    """What was measured on n devices."""

    device: tuple[str, ...]
    """Names; the line of the file where there is no column `device`."""
    G_um: FloatArray
    """(n,) electrostatic gap [µm]."""
    D_um: FloatArray
    """(n,) travel [µm]."""
    T_um: FloatArray | None = None
    """(n,) plate thickness [µm]; with it, E and T are fitted."""
    pull_in_V: FloatArray | None = None
    """(n,) quasi-static pull-in voltage [V]."""
    resonance_kHz: FloatArray | None = None
    """(n,) first resonance [kHz]; without T, it tells the mass."""
    K_N_per_m: FloatArray | None = None
    """(n,) stiffness [N/m]."""
    notes: tuple[str, ...] = ()
    """What the user should hear of them: devices that were measured twice, coarse values, columns in other units."""
    said: str = ""
    """How the file was read."""

    @property
    def law(self) -> tuple[str, str]:
        """The two variables beside D and G that these measurements tell. Raises MeasurementError where none."""
        for law, columns in LAWFUL.items():
            if all(getattr(self, c) is not None for c in columns):
                return law
        raise MeasurementError(_needed("these measurements"))


class Devices(NamedTuple):
    """Some columns of a table with one device a line."""

    names: tuple[str, ...]
    """(n,) of the devices; the line of the file where none is given."""
    values: dict[str, FloatArray]
    """(n,) each."""
    places: tuple[str, ...]
    """(n,) `lot7.csv, line 3`."""
    notes: tuple[str, ...]
    """What the user should hear: columns in other units, or by other names."""
    said: str
    """How the file was read."""


def read_measurements(path: str | Path, *, columns: Mapping[str, str] | None = None) -> Measurements:
    """Read a table of gap, travel and one pair of `LAWFUL`, one device a line; see `read_devices`.

    A device that stands in several lines was measured several times: it counts once, with the mean of its values.

    Parameters
    ----------
    path : str or Path
        The table.
    columns : mapping, optional
        The table's own name of a column for each of ours that is called otherwise there.

    Returns
    -------
    Measurements

    Raises
    ------
    MeasurementError
        For a table that cannot be read, or a value that is many times as large as the others.
    """
    found = read_devices(path, *[("G_um", "D_um", *pair) for pair in LAWFUL.values()], columns=columns)
    for name, column in found.values.items():
        usual = float(np.median(column))
        i = int(np.argmax(np.maximum(column / usual, usual / column)))
        if not usual / _FARTHEST <= column[i] <= usual * _FARTHEST:
            raise MeasurementError(
                f"{found.places[i]}: {name} is {column[i]:g}, and the median of the lot {usual:g}; devices of one lot "
                "do not differ so much. Has a decimal sign slipped? Correct the value, or leave the device out"
            )
    for i, where in enumerate(found.places):
        travel, gap = found.values["D_um"][i], found.values["G_um"][i]
        if travel >= gap:
            raise MeasurementError(
                f"{where}: D_um is {travel:g} and G_um {gap:g}; the travel must be less than the gap"
            )
    for thickness, where in zip(found.values.get("T_um", ()), found.places, strict=False):
        if thickness <= A1:
            raise MeasurementError(f"{where}: T_um is {thickness:g}; Eq. 4 has no stiffness at or below {A1} µm")
    names, values, notes = _once(found)
    if len(names) < MIN_DEVICES:
        raise MeasurementError(
            f"{path} has {len(names)} devices; at least {MIN_DEVICES} are needed to fit distributions"
        )
    return Measurements(device=names, notes=(*found.notes, *notes, *_coarse(values)), said=found.said, **values)


def _once(found: Devices) -> tuple[tuple[str, ...], dict[str, FloatArray], list[str]]:
    """Every device once, with the mean of its values. Raises MeasurementError where one name is several devices."""
    names = tuple(dict.fromkeys(found.names))
    if len(names) == len(found.names):
        return names, found.values, []
    place = {name: i for i, name in enumerate(names)}
    which = np.array([place[name] for name in found.names])
    counts = np.bincount(which)
    means: dict[str, FloatArray] = {}
    for quantity, values in found.values.items():
        means[quantity] = np.bincount(which, weights=values) / counts
        apart = values - means[quantity][which]
        scatter = math.sqrt(float(apart @ apart) / max(len(values) - len(names), 1))
        if scatter > _REPEATABLE * float(np.std(values)) and scatter > 0.0:
            i = int(np.argmax(np.abs(apart)))
            raise MeasurementError(
                f"{found.places[i]}: device {found.names[i]!r} stands in {counts[which[i]]} lines, and its {quantity} "
                "differs between them as much as between devices; give every device a name of its own"
            )
    several = int((counts > 1).sum())
    return names, means, [f"{several} of {len(names)} devices stand in several lines; each counts once, with its mean"]


def _coarse(values: Mapping[str, FloatArray]) -> list[str]:
    """A note for each quantity whose steps are not much finer than its spread."""
    notes = []
    for name, column in values.items():
        different = np.unique(np.round(column, 9))
        step = float(np.diff(different).min()) if different.size > 1 else 0.0
        if different.size < len(column) and step > 0.5 * float(np.std(column)) > 0.0:
            notes.append(
                f"{name} is given in steps of {step:.3g}, its standard deviation is {np.std(column):.3g}: rounding "
                "is a large part of the spread; give more digits"
            )
    return notes


def _needed(what: str) -> str:
    pairs = "; ".join(" and ".join(pair) for pair in LAWFUL.values())
    return f"{what} lack what tells stiffness and mass: beside G_um and D_um give one pair of {pairs}"


def read_devices(path: str | Path, *wanted: Sequence[str], columns: Mapping[str, str] | None = None) -> Devices:
    """Read some columns of a table with one device a line, in any encoding, with any separator and decimal sign.

    Parameters
    ----------
    path : str or Path
        The file.
    *wanted : sequence of str
        Sets of the quantities known here: the first one is read that the file has whole. Upper and lower case do not
        matter, and the unit may be another of its kind: `G_nm`, `g (nm)`. Other columns are ignored, but for `device`.
    columns : mapping, optional
        Which column is which, where the heading calls it otherwise: `{"G_um": "gap"}`.

    Returns
    -------
    Devices

    Raises
    ------
    MeasurementError
        Naming line and column.
    """
    theirs = dict(columns or {})
    for name in theirs:
        if name not in NAMES:
            raise MeasurementError(f"no quantity of a device is called {name!r}; known are {', '.join(NAMES)}")
    try:
        table = read_table(path, lambda heading: _chosen(heading, wanted, theirs), plausible=_out_of_range)
    except TableError as e:
        raise MeasurementError(str(e)) from e
    wrong = _out_of_range(table)
    if wrong is not None:
        raise MeasurementError(wrong)
    names = table.texts.get("device") or ("",) * len(table.lines)
    return Devices(
        names=tuple(name or f"line {line}" for name, line in zip(names, table.lines, strict=True)),
        values=table.numbers,
        places=tuple(f"{path}, line {line}" for line in table.lines),
        notes=table.notes,
        said=f"{Path(path).name}: {table.said}, {len(table.lines)} rows",
    )


def _chosen(heading: Heading, wanted: Sequence[Sequence[str]], theirs: Mapping[str, str]) -> Columns:
    """The columns of the first set that the heading has whole. Raises Unfit, of the set that it has most of."""
    if heading.line is None:
        raise Unfit(f"the file has no heading; above the devices write {','.join(wanted[0])}", line=1, fitted=0.1)
    failures: list[Unfit] = []
    for names in wanted:
        try:
            numbers = {name: _column(heading, name, names, theirs) for name in names}
        except Unfit as e:
            failures.append(e)
            continue
        device = theirs.get("device", "device").casefold()
        places = [i for i, name in enumerate(heading.names) if name.casefold() == device]
        texts = {"device": places[0]} if places else {}
        used = [
            f"{name} from {heading.name(c.index)}" for name, c in numbers.items() if c.factor != 1.0 or name in theirs
        ]
        return Columns(numbers=numbers, texts=texts, notes=tuple(used))
    raise max(failures, key=lambda e: e.fitted)


def _column(heading: Heading, name: str, names: Sequence[str], theirs: Mapping[str, str]) -> NeededColumn:
    quantity, unit = name_and_unit(name)
    kind = kind_of(unit)
    asked = theirs.get(name)
    found: list[int] = []
    for i, written in enumerate(heading.names):
        bare, _ = name_and_unit(written)
        if asked is not None:
            fits = asked.casefold() in (written.casefold(), bare.casefold())
        else:
            fits = _same(bare, quantity) and kind_of(heading.units[i]) == kind
        if written and fits:
            found.append(i)
    has = ", ".join(map(repr, filter(None, heading.names)))
    got = sum(any(_same(name_and_unit(w)[0], name_and_unit(n)[0]) for w in heading.names) for n in names) / len(names)
    if len(found) > 1:
        raise Unfit(f"{len(found)} columns {name!r}; keep one", line=heading.line, fitted=got)
    if not found:
        bare_ones = [w for w in heading.names if asked is None and w and _same(w, quantity)]
        close = bare_ones[0] if bare_ones else nearest(name, [w for w in heading.names if w not in names], cutoff=0.3)
        if asked is not None:
            hint = f"no column is called {asked!r}"
        else:
            hint = f"no column {name!r}" + (f"; is {close!r} meant? Then say --columns {name}={close}" if close else "")
        raise Unfit(
            f"{hint}. The heading has {has or 'nothing'}; needed: {', '.join(names)}", line=heading.line, fitted=got
        )
    own = heading.units[found[0]]
    if own is None or kind_of(own) != kind or unit is None:
        return NeededColumn(index=found[0])
    return NeededColumn(index=found[0], factor=FACTORS[own][1] / FACTORS[unit][1])


def _same(a: str, b: str) -> bool:
    """Whether two names are one but for case and what joins words: `Pull-in` is `pull_in`."""
    return "".join(filter(str.isalnum, a.casefold())) == "".join(filter(str.isalnum, b.casefold()))


def _out_of_range(table: Table) -> str | None:
    """The first value that its quantity cannot have, and the unit in which it could."""
    for i, line in enumerate(table.lines):
        for name, values in table.numbers.items():
            low, high = _RANGE[name]
            value = float(values[i])
            if not low <= value <= high:
                unit = _UNITS[name.rpartition("_")[2]]
                allowed = f"{low:g}–{high:g} {unit}".rstrip()
                slip = next((f": are these {other}?" for f, other in _SLIPS[unit] if low <= value * f <= high), "")
                return f"{table.path}, line {line}: {name} is {value:g}; expected {allowed}{slip}"
    return None


def write_synthetic(
    population: Population, path: str | Path, *, n: int, seed: int, plate_area_um2: float | None = None
) -> None:
    """Write measurements of n devices drawn from a population whose truth is known, without measurement error."""
    parameters = population.sample_parameters(n, seed=seed)
    u_pi = pull_in_voltage(switches_from_parameters(parameters), population.plate_area(plate_area_um2))
    with Path(path).open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["device", *COLUMNS])
        for i, ((d, g, _, t), u) in enumerate(zip(parameters, u_pi, strict=True), start=1):
            writer.writerow([f"S{i:03d}", f"{g:.5f}", f"{d:.5f}", f"{t:.5f}", f"{u:.5f}"])
