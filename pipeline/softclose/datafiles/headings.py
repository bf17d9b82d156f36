"""Owns headings: where the samples may begin, what stands above them, and what a reader needs of them."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from softclose.datafiles.errors import TableError
from softclose.datafiles.numerals import Style, is_number
from softclose.datafiles.units import known_unit, name_and_unit

FileLine = tuple[int, tuple[str, ...]]
"""The number of a line in its file, and its fields."""

FARTHEST = 300
"""Headings are looked for in so many lines."""

_COUNTS = frozenset({"sequence", "sample", "samples", "index", "count", "point", "points", "nr", "no", "number", "#"})
"""What a row of units says of a column that counts."""
_UNIT_LINE = re.compile(
    r"^\W*(?P<axis>horizontal|time|x|vertical|voltage|amplitude|y)(?:[ _-]?axis)?[ _-]?units?"
    r"\W*[,:;=\t ]\s*(?P<rest>.*)$",
    re.IGNORECASE,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Heading:
    """A row of names, with what belongs to it."""

    line: int | None
    """Where it stands; None where the file has no heading."""
    names: tuple[str, ...]
    """As they are written; empty where the file has no heading."""
    units: tuple[str | None, ...]
    """Units known here, from the names or from the row of units below them."""
    n_columns: int
    first: int
    """Index of the first row below it."""
    repeats: frozenset[tuple[str, ...]] = frozenset()
    """The names and the row of units in lower case: loggers repeat them on every page."""
    numeric: tuple[int, ...] = ()
    """Without a heading: columns that hold a number in every row."""
    filled: tuple[int, ...] = ()
    """Without a heading: columns that hold anything in any row."""
    constants: Mapping[str, float] = field(default_factory=dict)
    """Numbers in the row of units, by their column's name in lower case: an oscilloscope's Start and Increment."""
    counts: frozenset[int] = frozenset()
    """Columns of which the row of units says that they count."""
    axes: Mapping[str, tuple[int, str]] = field(default_factory=dict)
    """`horizontal` and `vertical` -> line and unit that a line above the heading gives, where it gives one."""

    def name(self, column: int) -> str:
        """For messages: the heading of a column, or its place."""
        return repr(self.names[column]) if column < len(self.names) and self.names[column] else f"column {column + 1}"


@dataclass(frozen=True, slots=True, kw_only=True)
class NeededColumn:
    """A column that is needed."""

    index: int
    factor: float = 1.0
    """Its numbers are multiplied by it: from the file's unit to the one that is wanted."""
    offset: float = 0.0
    """Added afterwards."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Columns:
    """What a reader takes of a table."""

    numbers: Mapping[str, NeededColumn]
    """By the reader's own names; every row must have a number there, but for those that are `gappy`."""
    texts: Mapping[str, int] = field(default_factory=dict)
    """Columns of words; a row may lack them."""
    notes: tuple[str, ...] = ()
    """What the user should hear of the choice."""
    gappy: frozenset[str] = frozenset()
    """Names of numbers of which a row may lack one: NaN."""


Choose = Callable[[Heading], Columns]
"""Says which columns are needed under a heading; raises Unfit where they are not there."""


def candidates(
    rows: Sequence[FileLine], commented: Sequence[FileLine], axes: Mapping[str, tuple[int, str]], *, exact: bool = False
) -> Iterator[Heading]:
    """Every row that may be the heading of what follows, first that of a file without one.

    commented: rows that stand in lines beginning with # or the like, without that sign; exact: a row of units must have
    as many fields as the heading.
    """
    if rows and sum(is_number(f) for f in rows[0][1]) >= 2:
        yield _without(rows, axes)
    for i, row in enumerate(rows[:FARTHEST]):
        if _UNIT_LINE.match(row[1][0] + ","):
            continue  # `Horizontal Units,s` names no columns
        units = _units_below(rows, i)
        if units is not None and not (exact and len(units) != len(row[1])):
            yield _heading(row, i + 2, units, axes)
        if _mostly_words(row[1]):
            yield _heading(row, i + 1, None, axes)
    for line, fields in commented:
        below = next((i for i, row in enumerate(rows) if row[0] > line), None)
        between = any(line < other < rows[below][0] for other, _ in commented) if below is not None else True
        if not between and below is not None and _mostly_words(fields):
            yield _heading((line, fields), below, None, axes)


def lowered(fields: Sequence[str]) -> tuple[str, ...]:
    """The fields that are not empty, in lower case."""
    return tuple(f.casefold() for f in fields if f)


def axis_units(lines: Sequence[str]) -> dict[str, tuple[int, str]]:
    """Units of lines such as `Horizontal Units,s` and `Vertical Units,CH1:V`; none where channels differ."""
    found: dict[str, tuple[int, str]] = {}
    for number, line in enumerate(lines[:FARTHEST], start=1):
        match = _UNIT_LINE.match(line)
        if match is None:
            continue
        axis = "horizontal" if match["axis"].lower() in ("horizontal", "time", "x") else "vertical"
        said = []
        for part in re.split(r"[,;\t]", match["rest"]):
            word = part.strip(" \"'")
            if not word or is_number(word):
                break
            said.append(known_unit(word.rpartition(":")[2]))
        if said and said[0] is not None and len(set(said)) == 1:
            found.setdefault(axis, (number, said[0]))
    return found


def parsed_columns(text: str | None, allowed: Sequence[str]) -> dict[str, str]:
    """`G_um=gap,D_um=travel` -> theirs by ours. Raises TableError, also for a name that is not allowed."""
    found: dict[str, str] = {}
    for part in (text or "").split(","):
        if not part.strip():
            continue
        ours, sign, theirs = part.partition("=")
        ours, theirs = ours.strip(), theirs.strip()
        if not sign or not ours or not theirs:
            raise TableError(f"--columns {part.strip()!r} is not of the form {allowed[0]}=NAME, NAME as in the file")
        if ours not in allowed:
            raise TableError(f"--columns names {ours!r}; known are {', '.join(allowed)}")
        if ours in found:
            raise TableError(f"--columns names {ours} twice")
        found[ours] = theirs
    return found


def _without(rows: Sequence[FileLine], axes: Mapping[str, tuple[int, str]]) -> Heading:
    width = max(len(fields) for _, fields in rows)
    numeric = tuple(
        column
        for column in range(width)
        if all(column < len(fields) and is_number(fields[column]) for _, fields in rows)
    )
    filled = tuple(
        column for column in range(width) if any(column < len(fields) and fields[column] for _, fields in rows)
    )
    return Heading(line=None, names=(), units=(), n_columns=width, first=0, numeric=numeric, filled=filled, axes=axes)


def _heading(row: FileLine, first: int, below: Sequence[str] | None, axes: Mapping[str, tuple[int, str]]) -> Heading:
    line, fields = row
    n = max(len(fields), len(below or ()))
    names = (*fields, *[""] * (n - len(fields)))
    own = [name_and_unit(name)[1] for name in names]
    under = [*(below or ()), *[""] * n][:n]
    units = [_bare_unit(text) or unit for text, unit in zip(under, own, strict=True)]
    constants = {
        name.casefold(): value
        for name, text in zip(names, under, strict=True)
        if name and (value := Style(".").value(text)) is not None
    }
    counts = frozenset(i for i, text in enumerate(under) if text.casefold() in _COUNTS)
    return Heading(
        line=line,
        names=names,
        units=tuple(units),
        n_columns=n,
        first=first,
        repeats=frozenset(lowered(each) for each in (fields, below or ()) if any(each)),
        constants=constants,
        counts=counts,
        axes={axis: found for axis, found in axes.items() if found[0] < line},
    )


def _mostly_words(fields: Sequence[str]) -> bool:
    filled = [f for f in fields if f]
    return len(filled) >= 2 and 2 * sum(map(is_number, filled)) < len(filled)


def _units_below(rows: Sequence[FileLine], i: int) -> tuple[str, ...] | None:
    """The row of units under row i; None where the next row is none."""
    if i + 1 >= len(rows) or sum(bool(f) for f in rows[i][1]) < 2:
        return None
    names, fields = rows[i][1], rows[i + 1][1]
    if len(names) != len(fields) and len(_trimmed(names)) != len(_trimmed(fields)):
        return None  # some other line of the preamble
    kinds = [_bare_unit(f) is not None for f in fields if f]
    others = [f.casefold() in _COUNTS or is_number(f) or f in ("-", "()", "[]", "(-)", "[-]") for f in fields if f]
    if not any(kinds) or not all(a or b for a, b in zip(kinds, others, strict=True)):
        return None
    return fields


def _trimmed(fields: Sequence[str]) -> Sequence[str]:
    """Without empty fields at its end."""
    return fields[: max((i + 1 for i, field in enumerate(fields) if field), default=0)]


def _bare_unit(text: str) -> str | None:
    """The unit of `s`, `(µs)` or `[V]`, which says nothing else."""
    name, unit = name_and_unit(text)
    return unit if not name else None
