"""Owns the reading of a drive that somebody recorded, simulated or drew, from a table of instants and voltages."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from softclose.arrays import FloatArray
from softclose.datafiles import Columns, Heading, NeededColumn, Table, TableError, Unfit, read_table
from softclose.datafiles.units import FACTORS, TIME, VOLTAGE, has_other_unit, kind_of, name_and_unit
from softclose.waveform.pulses import WaveformError
from softclose.waveform.trace import Trace

TIME_UNITS = ("s", "ms", "us", "ns")
VOLT_UNITS = ("V", "mV", "kV", "uV")
COLUMNS = (
    "time",
    *(f"time_{unit}" for unit in TIME_UNITS),
    "volts",
    *(f"volts_{unit}" for unit in VOLT_UNITS),
)
"""What `--columns` may name: a column of the file, and its unit where the file does not say it."""

SHORTEST_US = 1.0
"""A record of less is in another unit than it says: no switch moves within it."""
LONGEST_US = 1e6
"""So is one of more."""
WIDEST_US = 50.0
"""And one of `MANY` samples that are farther apart: a handful of them may be a drive that somebody drew."""
MANY = 20

_TIMES = re.compile(
    r"t|times?|zeit|temps|tiempo|tempo|tid|tijd|x[ _-]?(?:axis|achse|values?)|time ?stamp|seconds?", re.IGNORECASE
)
_COUNTS = re.compile(
    r"#|n|nr\.?|no\.?|num(?:ber)?|i|k|x|id|idx|index|samples?(?:[ _]?(?:nr|no|number|index|count))?|sequence|count|"
    r"points?|row|line|zeile|record|punkt|messpunkt",
    re.IGNORECASE,
)
_SPICE = re.compile(r"v\([^()]+\)", re.IGNORECASE)


_OURS = {TIME: "time", VOLTAGE: "volts"}


class _Asked(NamedTuple):
    """What the user says of the columns."""

    columns: Mapping[str, str]
    time_unit: str | None
    volt_unit: str | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Record:
    """A drive that was read, and how."""

    trace: Trace
    """What is applied from 0 on."""
    table: Table
    """Its file: `time` [µs] and `volts` [V] as they stand there."""
    notes: tuple[str, ...]
    """What the user should hear: how the file was read, what was averaged."""


def read_trace(
    path: str | Path,
    *,
    columns: Mapping[str, str] | None = None,
    time_unit: str | None = None,
    volt_unit: str | None = None,
    shift_us: float = 0.0,
    scale: float = 1.0,
) -> Trace:
    """A drive from a table of instants and voltages.

    Parameters
    ----------
    path, columns, time_unit, volt_unit, shift_us, scale
        See `softclose.waveform.recorded.read_record`, as for the errors.

    Returns
    -------
    Trace
    """
    return read_record(
        path, columns=columns, time_unit=time_unit, volt_unit=volt_unit, shift_us=shift_us, scale=scale
    ).trace


def read_record(
    path: str | Path,
    *,
    columns: Mapping[str, str] | None = None,
    time_unit: str | None = None,
    volt_unit: str | None = None,
    shift_us: float = 0.0,
    scale: float = 1.0,
) -> Record:
    """A drive from a table that an oscilloscope, a simulator, a logger or a spreadsheet wrote.

    Parameters
    ----------
    path : str or Path
        Text in any usual encoding, with commas, semicolons, tabs or spaces between columns, decimal points or commas;
        lines that begin with # are comments. The heading stands above the samples and tells columns and units.
    columns : mapping, optional
        Which column is which, where the heading does not tell: `{"time_us": "t1", "volts_mV": "CH2"}`.
    time_unit, volt_unit : str, optional
        Where neither heading nor preamble says it: `s`, `ms`, `us`, `ns`; `V`, `mV`, `kV`, `uV`.
    shift_us : float
        Added to the instants [µs]; what comes before 0 then is left out.
    scale : float
        Voltages are multiplied by it: of a probe, of a monitor output, of an amplifier whose input was recorded.

    Returns
    -------
    Record

    Raises
    ------
    WaveformError
        Naming file and line, for whatever is not certain: a unit that is not said, two channels, clipped samples, two
        ways of reading that give other numbers.
    """
    for unit, allowed, what in ((time_unit, TIME_UNITS, "time"), (volt_unit, VOLT_UNITS, "voltage")):
        if unit is not None and unit not in allowed:
            raise WaveformError(f"the unit of {what} is {unit!r}; it must be one of {', '.join(allowed)}")
    for name in columns or {}:
        if name not in COLUMNS:
            raise WaveformError(f"no column of a drive is called {name!r}; known are {', '.join(COLUMNS)}")
    if not (np.isfinite(scale) and scale != 0.0 and np.isfinite(shift_us)):
        raise WaveformError(f"scale is {scale:g} and shift {shift_us:g} µs; both must be finite, the scale not 0")
    asked = _Asked(dict(columns or {}), time_unit, volt_unit)
    try:
        table = read_table(path, lambda heading: _chosen(heading, asked), plausible=_not_ascending)
    except TableError as e:
        raise WaveformError(str(e)) from e
    t, u = table.numbers["time"], table.numbers["volts"]
    notes = [*table.notes]
    lines = np.array(table.lines)
    if _is_pairs(t):
        notes.append(
            f"each of the {t.size // 2} instants has two samples, the lowest and the highest: their mean is used"
        )
        t, u, lines = t[::2], 0.5 * (u[::2] + u[1::2]), lines[::2]
    _check_instants(path, t, lines)
    try:
        trace = Trace(t + shift_us, u * scale)
    except WaveformError as e:
        raise WaveformError(f"{path}, line {lines[0]}: {e}") from e
    low, high = sorted((float(u.min()) * scale + 0.0, float(u.max()) * scale + 0.0))  # nobody reads -0 V
    scaled = f" (scaled by {scale:g})" if scale != 1.0 else ""
    notes.insert(
        0, f"{table.said}; {t.size:,} samples from {t[0]:g} to {t[-1]:g} µs, {low:.6g} to {high:.6g} V{scaled}"
    )
    return Record(trace=trace, table=table, notes=tuple(notes))


def _check_instants(path: str | Path, t: FloatArray, lines: FloatArray) -> None:
    """Raise WaveformError where instants do not ascend, or span what no record of a switch does."""
    back = np.flatnonzero(np.diff(t) <= 0.0)
    if back.size:
        k = int(back[0]) + 1
        raise WaveformError(
            f"{path}, line {lines[k]}: the sample is at {t[k]:g} µs, not after the one before it at {t[k - 1]:g} µs; "
            "times must ascend: sort the file, and remove repeated samples (a step takes two samples a little apart)"
        )
    span, usual = (float(t[-1] - t[0]), float(np.median(np.diff(t)))) if t.size > 1 else (math.nan, math.nan)
    another = "are the instants in another unit? Correct the heading, or say it: --columns time_s=NAME"
    if span < SHORTEST_US:
        raise WaveformError(f"{path}: the samples span {span:g} µs, in which no switch moves; {another}")
    if span > LONGEST_US or (t.size >= MANY and usual > WIDEST_US):
        raise WaveformError(
            f"{path}: the samples span {span:g} µs and are {usual:g} µs apart, but a switch closes within some tens of "
            f"µs; {another}"
        )


def _is_pairs(t: FloatArray) -> bool:
    """Whether every instant stands there twice, one after the other: a minimum and a maximum."""
    return t.size >= 4 and t.size % 2 == 0 and bool((t[::2] == t[1::2]).all()) and bool((np.diff(t[::2]) > 0.0).all())


def _not_ascending(table: Table) -> str | None:
    t = table.numbers["time"]
    return None if (np.diff(t) > 0.0).all() or _is_pairs(t) else "times do not ascend"


def _chosen(heading: Heading, asked: _Asked) -> Columns:
    """The columns of instants and voltages under a heading. Raises Unfit."""
    if heading.line is None:
        return _unheaded(heading, asked)
    time, time_unit = _named(heading, asked, "time")
    volts, volt_unit = _named(heading, asked, "volts")
    if time is None:
        time, counted = _time_column(heading)
    else:
        counted = False
    if volts is None:
        volts = _volts_column(heading, time)
    spice = heading.names[time].strip() == "time" and bool(_SPICE.fullmatch(heading.names[volts]))
    time_unit = time_unit or _unit(heading, time, TIME, "horizontal", asked.time_unit, "s" if spice else None)
    if not counted:
        of_time = NeededColumn(index=time, factor=FACTORS[time_unit][1])
    else:
        start, step = (heading.constants[key] * FACTORS[time_unit][1] for key in ("start", "increment"))
        of_time = NeededColumn(index=time, factor=step, offset=start)
    volt_unit = volt_unit or _unit(heading, volts, VOLTAGE, "vertical", asked.volt_unit, "V" if spice else None)
    of_volts = NeededColumn(index=volts, factor=FACTORS[volt_unit][1])
    note = f"instants [{time_unit}] from {heading.name(time)}, voltages [{volt_unit}] from {heading.name(volts)}"
    return Columns(numbers={"time": of_time, "volts": of_volts}, notes=(note,))


def _unheaded(heading: Heading, asked: _Asked) -> Columns:
    """Two columns of numbers and nothing else: or beside them an oscilloscope's settings, which give the units."""
    if len(heading.numeric) != 2:
        raise Unfit(
            f"the file has no heading, and {len(heading.numeric)} columns of numbers; add one such as time_us,volts_V",
            line=1,
            fitted=0.6,
        )
    time, volts = heading.numeric
    if heading.filled != heading.numeric and not {"horizontal", "vertical"} <= heading.axes.keys():
        raise Unfit("the file has no heading, and not every field is a number", line=1, fitted=0.5)
    time_unit = _unit(heading, time, TIME, "horizontal", asked.time_unit, None)
    volt_unit = _unit(heading, volts, VOLTAGE, "vertical", asked.volt_unit, None)
    return Columns(
        numbers={
            "time": NeededColumn(index=time, factor=FACTORS[time_unit][1]),
            "volts": NeededColumn(index=volts, factor=FACTORS[volt_unit][1]),
        },
        notes=(f"no heading: instants [{time_unit}] from column {time + 1}, voltages [{volt_unit}] from {volts + 1}",),
    )


def _named(heading: Heading, asked: _Asked, what: str) -> tuple[int | None, str | None]:
    """The column that the user names, and the unit in its name. Raises Unfit where it is not there."""
    ours = [name for name in asked.columns if name.partition("_")[0] == what]
    if not ours:
        return None, None
    if len(ours) > 1:
        raise Unfit(f"--columns names {what} twice: {', '.join(ours)}", fitted=1.0)
    theirs = asked.columns[ours[0]].casefold()
    places = [
        i
        for i, name in enumerate(heading.names)
        if name and theirs in (name.casefold(), name_and_unit(name)[0].casefold())
    ]
    if len(places) != 1:
        raise Unfit(
            f"{len(places) or 'no'} columns are called {asked.columns[ours[0]]!r}; the heading has "
            f"{', '.join(map(repr, filter(None, heading.names)))}",
            line=heading.line,
            fitted=0.3,
        )
    return places[0], ours[0].partition("_")[2] or None


def _time_column(heading: Heading) -> tuple[int, bool]:
    """The column of instants, and whether it counts samples, of which start and increment are said. Raises Unfit."""
    named = range(len(heading.names))
    by_unit = [i for i in named if kind_of(heading.units[i]) == TIME]
    by_name = [i for i in named if heading.names[i] and _TIMES.fullmatch(name_and_unit(heading.names[i])[0])]
    found = by_unit or [i for i in by_name if heading.units[i] is None]
    if len(found) == 1 and found[0] not in heading.counts:
        return found[0], False
    if len(found) > 1:
        raise Unfit(
            f"{' and '.join(map(heading.name, found))} may both be the instants; say which one: "
            f"--columns time={heading.names[found[0]]}",
            line=heading.line,
            fitted=0.9,
        )
    counts = [i for i in named if i in heading.counts or _COUNTS.fullmatch(heading.names[i])]
    if counts and {"start", "increment"} <= heading.constants.keys():
        return counts[0], True
    if counts and any(kind_of(unit) == VOLTAGE for unit in heading.units):
        raise Unfit(
            f"{heading.name(counts[0])} counts samples, and no column has instants; add one, or say which column has "
            "them: --columns time_s=NAME",
            line=heading.line,
            fitted=0.8,
        )
    raise Unfit(
        "no heading above the samples names a column of instants; write one such as time_us,volts_V, or say which "
        "columns are which: --columns time_s=NAME,volts_V=NAME",
        line=heading.line,
        fitted=0.2 if any(kind_of(unit) == VOLTAGE for unit in heading.units) else 0.0,
    )


def _volts_column(heading: Heading, time: int) -> int:
    """The column of voltages. Raises Unfit where none is, or several may be."""
    named = [i for i in range(len(heading.names)) if i != time and heading.names[i]]
    named += [i for i in range(len(heading.names)) if i not in named and i != time and heading.units[i]]
    found = [i for i in named if kind_of(heading.units[i]) == VOLTAGE]
    if not found:
        found = [i for i in named if _SPICE.fullmatch(heading.names[i])]
    if not found:
        found = [
            i
            for i in named
            if heading.units[i] is None
            and i not in heading.counts
            and heading.names[i].casefold() not in heading.constants
            and not _COUNTS.fullmatch(heading.names[i])
            and not _TIMES.fullmatch(heading.names[i])
            and not has_other_unit(heading.names[i])
        ]
    if len(found) == 1:
        return found[0]
    if found:
        raise Unfit(
            f"{', '.join(map(heading.name, found))} may each be the drive; say which one: "
            f"--columns volts={heading.names[found[0]]}",
            line=heading.line,
            fitted=0.9,
        )
    raise Unfit("no column has voltages; name it: --columns volts_V=NAME", line=heading.line, fitted=0.4)


def _unit(heading: Heading, column: int, kind: str, axis: str, asked: str | None, convention: str | None) -> str:
    """The unit of a column: the heading's, a preamble's or the user's, which must not contradict each other.

    Raises Unfit where nobody says it.
    """
    own = heading.units[column] if column < len(heading.units) else None
    above = heading.axes.get(axis)
    said = [(f"line {heading.line}", own)] if kind_of(own) == kind else []
    said += [(f"line {above[0]}", above[1])] if above is not None and kind_of(above[1]) == kind else []
    if len({unit for _, unit in said}) > 1:
        raise Unfit(
            f"the unit of {heading.name(column)} is {said[0][1]} by {said[0][0]} and {said[1][1]} by {said[1][0]}; "
            "correct one of them",
            line=heading.line,
            fitted=1.0,
        )
    if said and said[0][1]:
        if asked is not None and asked != said[0][1]:
            raise Unfit(
                f"the unit of {heading.name(column)} is {said[0][1]} by {said[0][0]}, not {asked}; correct the file, "
                f"or say it of that column: --columns {_OURS[kind]}_{asked}={_shown(heading, column)}",
                line=heading.line,
                fitted=1.0,
            )
        return said[0][1]
    if above is not None and kind_of(above[1]) is not None:
        raise Unfit(f"the {axis} unit is {above[1]}, which is none of {kind}", line=above[0], fitted=1.0)
    unit = asked or convention
    if unit is None:
        option, units = ("--time-unit", TIME_UNITS) if kind == TIME else ("--volt-unit", VOLT_UNITS)
        raise Unfit(
            f"nothing says the unit of the {'instants' if kind == TIME else 'voltages'} ({heading.name(column)}); "
            f"write it in the heading ({_OURS[kind]}_{units[0]}), or give {option} ({', '.join(units)})",
            line=heading.line or 1,
            fitted=1.0,
        )
    return unit


def _shown(heading: Heading, column: int) -> str:
    return heading.names[column] if column < len(heading.names) else "NAME"
