"""Owns the CSV of device measurements: gap, travel, and what tells stiffness and mass, checked for units and sense.

Spreadsheets of half the world write semicolons between columns and commas in numbers; both are read. What a comma
means is decided for the whole file, never guessed: it is a decimal sign only where it does not separate columns.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softclose.naming import nearest
from softclose.population.population import Population, switches_from_parameters
from softclose.switch.plate import A1, pull_in_voltage

FloatArray = NDArray[np.float64]

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
}
_SLIPS = {
    "µm": ((1e6, "metres"), (1e3, "millimetres"), (1e-3, "nanometres")),
    "V": ((1e3, "kV"), (1e-3, "mV")),
    "kHz": ((1e-3, "Hz"), (1e3, "MHz")),
    "N/m": ((1e-3, "mN/m"), (1e3, "kN/m")),
    "µs": ((1e6, "seconds"), (1e3, "ms"), (1e-3, "ns")),
}


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

    @property
    def law(self) -> tuple[str, str]:
        """The two variables beside D and G that these measurements tell. Raises MeasurementError where none."""
        for law, columns in LAWFUL.items():
            if all(getattr(self, c) is not None for c in columns):
                return law
        raise MeasurementError(_needed("these measurements"))


def read_measurements(path: str | Path) -> Measurements:
    """Read a CSV of gap, travel and one pair of `LAWFUL`, one device a line; see `read_devices`. MeasurementError."""
    header = columns_of(path)
    pairs = [pair for pair in LAWFUL.values() if set(pair) <= set(header)]
    if not pairs and "resonance_kHz" in header:
        raise MeasurementError(_needed(str(path)))
    columns = ("G_um", "D_um", *(pairs[0] if pairs else COLUMNS[2:]))
    devices, table, places = read_devices(path, columns)
    found = dict(zip(columns, table.T, strict=True))
    for travel, gap, where in zip(found["D_um"], found["G_um"], places, strict=True):
        if travel >= gap:
            raise MeasurementError(
                f"{where}: D_um is {travel:g} and G_um {gap:g}; the travel must be less than the gap"
            )
    for thickness, where in zip(found.get("T_um", ()), places, strict=False):
        if thickness <= A1:
            raise MeasurementError(f"{where}: T_um is {thickness:g}; Eq. 4 has no stiffness at or below {A1} µm")
    if len(table) < MIN_DEVICES:
        raise MeasurementError(
            f"{path} has {len(table)} devices; at least {MIN_DEVICES} are needed to fit distributions"
        )
    return Measurements(device=devices, **found)


def _needed(what: str) -> str:
    pairs = "; ".join(" and ".join(pair) for pair in LAWFUL.values())
    return f"{what} lack what tells stiffness and mass: beside G_um and D_um give one pair of {pairs}"


def read_devices(path: str | Path, columns: Sequence[str]) -> tuple[tuple[str, ...], FloatArray, tuple[str, ...]]:
    """Read some columns of a CSV, one device a line.

    Columns are separated by commas, semicolons or tabs, as the header shows; lines that begin with # are comments.

    Parameters
    ----------
    path : str or Path
        The file.
    columns : sequence of str
        Names of those that it must have, of the quantities known here; others are ignored, but for `device`.

    Returns
    -------
    tuple
        Names of the devices; their values, (n, columns) float64; where each is written.

    Raises
    ------
    MeasurementError
        Naming line and column.
    """
    reader, header = _opened(path)
    for name in columns:
        if name not in header:
            others = [h for h in header if h not in columns]
            close = nearest(name, others, cutoff=0.3)
            hint = f"; is {close!r} meant? Then rename it" if close else ""
            raise MeasurementError(
                f"{path} has no column {name!r}{hint}. It has {', '.join(map(repr, header)) or 'no header'}; "
                f"needed: {', '.join(columns)}"
            )
        if header.count(name) > 1:
            raise MeasurementError(f"{path} has {header.count(name)} columns {name!r}; keep one")
    devices: list[str] = []
    places: list[str] = []
    rows: list[list[float]] = []
    signs: dict[str, str] = {}
    for fields in reader:
        if not any(field.strip() for field in fields):
            continue
        where = f"{path}, line {reader.line_num}"
        if any(field.strip() for field in fields[len(header) :]):
            raise MeasurementError(
                f"{where}: {len(fields)} fields, but the header names {len(header)} columns; numbers with a decimal "
                "comma need semicolons or tabs between the columns, in the header too"
            )
        row = dict(zip(header, fields, strict=False))
        device = row.get("device", "").strip() or f"line {reader.line_num}"
        numbers = {name: row.get(name, "").strip() for name in columns}
        for sign in ",.":
            for field in numbers.values():
                if sign in field:
                    signs.setdefault(sign, f"line {reader.line_num}: {field}")
        if len(signs) == 2:
            raise MeasurementError(
                f"{path} has decimal commas ({signs[',']}) and decimal points ({signs['.']}); "
                "use one of them in the whole file, and nothing between thousands"
            )
        rows.append([_value(name, field.replace(",", ".", 1), where) for name, field in numbers.items()])
        devices.append(device)
        places.append(where)
    if not rows:
        raise MeasurementError(f"{path} has no devices below its header")
    return tuple(devices), np.array(rows), tuple(places)


def columns_of(path: str | Path) -> list[str]:
    """The header of a CSV. Raises MeasurementError."""
    return _opened(path)[1]


def _opened(path: str | Path) -> tuple[Any, list[str]]:
    """A reader of the lines below the header, and the header."""
    try:
        text = Path(path).read_text("utf-8-sig")  # spreadsheets like to write a byte-order mark
    except (OSError, UnicodeDecodeError) as e:
        raise MeasurementError(f"the measurements {path} cannot be read: {e}") from e
    lines = ["" if line.lstrip().startswith("#") else line for line in text.splitlines()]
    first = next((line for line in lines if line.strip()), "")
    separator = next((s for s in (";", "\t") if s in first), ",")
    reader = csv.reader(lines, delimiter=separator)
    return reader, [name.strip() for name in next((row for row in reader if row), [])]


def _value(name: str, field: str, where: str) -> float:
    try:
        value = float(field)
    except ValueError as e:
        raise MeasurementError(f"{where}: {name} is {field.strip()!r}; it must be a number such as 3.7 or 3,7") from e
    low, high = _RANGE[name]
    unit = {"V": "V", "kHz": "kHz", "um": "µm", "us": "µs", "m": "N/m"}[name.rpartition("_")[2]]
    if not low <= value <= high:
        slip = next((f": are these {other}?" for f, other in _SLIPS[unit] if low <= value * f <= high), "")
        got = f"{value:g}" if math.isfinite(value) else repr(field.strip())
        raise MeasurementError(f"{where}: {name} is {got}; expected {low:g}–{high:g} {unit}{slip}")
    return value


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
