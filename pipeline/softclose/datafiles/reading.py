"""Owns the search for the one way of reading that fits a whole file: separator, decimal sign, heading, rows.

Each way is tried on all rows. Nothing is scored: a way that fails at one row is out, and where two remain that give
other numbers, the file is refused with both. So half a table is never read, and no guess becomes a voltage.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from softclose.arrays import FloatArray
from softclose.datafiles.decoding import Decoded, decoded
from softclose.datafiles.errors import TableError, Unfit
from softclose.datafiles.headings import (
    Choose,
    Columns,
    FileLine,
    Heading,
    NeededColumn,
    axis_units,
    candidates,
    lowered,
)
from softclose.datafiles.numerals import STYLES, Style, is_number

_SPLIT: dict[str, Callable[[str], list[str]]] = {"spaces": str.split, "wide spaces": re.compile(r" {2,}").split}
"""Spaces hide an empty field: so every row must have as many fields as the heading, and none a tab."""
_SIGNS = {";": "semicolons", "\t": "tabs", ",": "commas", "|": "bars"}
_COMMENT = re.compile(r"^\s*(?:#|%|//)+")
_END = re.compile(r"\W*(?:eof|end|ende|end of (?:file|data|record))\W*", re.IGNORECASE)
_SEP = re.compile(r'^"?sep=(.)"?[;,\t ]*$', re.IGNORECASE)
_MISSING = re.compile(r"[+-]?(?:∞|inf(?:inity)?|nan|n/?a|#?n/?a|null|none|-+|\?+|\*+|ovl?|overflow|overrange)?", re.I)
_NOTHING = re.compile(r"(?:nan|n/?a|-+)?", re.I)
"""A field of a column that may have gaps, where it has one."""
_BLANK = " \t\u00a0\u2009\u202f\x1a"
"""Around fields; the last one is what DOS ends a file with."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """What was needed of a file."""

    path: str
    numbers: dict[str, FloatArray]
    """(n,) each, in the units that were asked for."""
    texts: dict[str, tuple[str, ...]]
    """(n,) words each; empty where a row has none."""
    lines: tuple[int, ...]
    """(n,) where each row stands in the file, from 1."""
    heading: Heading
    said: str
    """How the file was read: `UTF-16, tabs, decimal points, heading in line 1`."""
    notes: tuple[str, ...] = ()
    """What the user should hear."""


Doubt = Callable[[Table], str | None]
"""Why the numbers of a table cannot be what they are taken for; None where they can."""


def read_table(path: str | Path, choose: Choose, *, plausible: Doubt = lambda table: None) -> Table:
    """Read a table that somebody brings.

    Parameters
    ----------
    path : str or Path
        The file.
    choose : Choose
        The columns that are needed under a heading; raises Unfit where there are none such.
    plausible : Doubt
        Decides between ways of reading that all fit and give other numbers: not between one and none.

    Returns
    -------
    Table

    Raises
    ------
    TableError
        Naming the line at which the way that fits best fails, or both ways where two fit.
    """
    text = decoded(path)
    found: list[Table] = []
    failures: list[Unfit] = []
    for separator, rows, commented in _separated(text, str(path)):
        for heading in candidates(rows, commented, axis_units(text.lines), exact=separator in _SPLIT):
            try:
                columns = choose(heading)
                found += _styled(str(path), text, separator, rows[heading.first :], rows, heading, columns)
            except Unfit as e:
                failures.append(e)
    different = _different(found)
    if len(different) > 1:
        different = [table for table in different if plausible(table) is None] or different
    if len(different) > 1:
        a, b = different[0], different[1]
        row, name = next(
            (i, name)
            for name in a.numbers
            for i in range(max(len(a.lines), len(b.lines)))
            if _at(a, name, i) != _at(b, name, i)
        )
        line = (a if row < len(a.lines) else b).lines[row]
        raise TableError(
            f"{path} can be read in two ways. Line {line}: {name} is {_at(a, name, row)} by {a.said}, "
            f"{_at(b, name, row)} by {b.said}. Write decimal points, and nothing between thousands"
        )
    if different:
        return different[0]
    if not failures:
        raise TableError(f"{path} has no table: no line has two fields or more")
    raise TableError(max(failures, key=lambda e: e.fitted).said(str(path)))


def _separated(text: Decoded, path: str) -> Iterator[tuple[str, list[FileLine], list[FileLine]]]:
    """The file's rows by every separator that it may have: those in plain lines, and those behind comment signs."""
    lines = list(enumerate(text.lines, start=1))
    sep = _SEP.match(text.lines[0]) if text.lines else None
    filled = [(n, line) for n, line in lines[1 if sep else 0 :] if line.strip(_BLANK)]
    marks = [_COMMENT.match(line) for _, line in filled]
    plain = [row for row, mark in zip(filled, marks, strict=True) if mark is None]
    behind = [(n, line[mark.end() :].strip()) for (n, line), mark in zip(filled, marks, strict=True) if mark]
    while plain and _END.fullmatch(plain[-1][1]):
        plain.pop()
    whole = "\n".join(line for _, line in plain)
    for sign in _SIGNS:
        if sep[1] == sign if sep else sign in whole:
            yield _SIGNS[sign], _by_sign(plain, sign, path), _by_sign(behind, sign, path)
    if sep is None:
        for name, split in _SPLIT.items():
            yield name, _split(plain, split), _split(behind, split)


def _by_sign(lines: Sequence[tuple[int, str]], sign: str, path: str) -> list[FileLine]:
    reader = csv.reader((line for _, line in lines), delimiter=sign, skipinitialspace=True)
    rows: list[FileLine] = []
    try:
        for fields in reader:
            if reader.line_num != len(rows) + 1:
                raise TableError(f"{path}, line {lines[len(rows)][0]}: a quotation mark is not closed in its line")
            rows.append((lines[len(rows)][0], tuple(f.strip(_BLANK) for f in fields)))
    except csv.Error as e:
        raise TableError(f"{path}, line {lines[len(rows)][0]}: {e}") from e
    return [row for row in rows if any(row[1])]


def _split(lines: Sequence[tuple[int, str]], split: Callable[[str], list[str]]) -> list[FileLine]:
    rows = [
        (n, tuple(f.strip('"') for f in ([line] if "\t" in line else split(line.strip(_BLANK))))) for n, line in lines
    ]
    return [row for row in rows if any(row[1])]


def _styled(
    path: str,
    text: Decoded,
    separator: str,
    below: Sequence[FileLine],
    rows: Sequence[FileLine],
    heading: Heading,
    columns: Columns,
) -> list[Table]:
    """The table by every way of writing numbers that fits it. Raises Unfit where none does."""
    rows_of_it = _checked(below, heading, columns, separator)
    _check_above(rows, heading, rows_of_it[0][1])
    texts = {name: [fields[c.index] for _, fields in rows_of_it] for name, c in columns.numbers.items()}
    signs = set("".join(map("".join, texts.values())))
    found: list[Table] = []
    failures: list[tuple[int, int, str]] = []
    for style in STYLES:
        if style.thousands and signs.isdisjoint(style.thousands):
            continue
        values: dict[str, FloatArray] = {}
        failure: tuple[int, int, str] | None = None
        for name, column in columns.numbers.items():
            values[name], failed = _numbers(texts[name], column, style, name in columns.gappy)
            if failed is not None:
                failure = min(failure or (failed, column.index, name), (failed, column.index, name))
        if failure is not None:
            failures.append(failure)
            continue
        where = "no heading" if heading.line is None else f"heading in line {heading.line}"
        found.append(
            Table(
                path=path,
                numbers=values,
                texts={n: tuple(f[i] if i < len(f) else "" for _, f in rows_of_it) for n, i in columns.texts.items()},
                lines=tuple(n for n, _ in rows_of_it),
                heading=heading,
                said=f"{text.encoding.upper()}, {separator}, {style}, {where}",
                notes=columns.notes,
            )
        )
    if not found:
        raise _no_number(rows_of_it, failures)
    return found


def _checked(below: Sequence[FileLine], heading: Heading, columns: Columns, separator: str) -> list[FileLine]:
    """The rows under a heading, without repetitions of it. Raises Unfit where one has more fields than names."""
    last = max(c.index for c in columns.numbers.values())
    rows: list[FileLine] = []
    for line, fields in below:
        if heading.repeats and lowered(fields) in heading.repeats:
            continue
        surplus = len(fields) > heading.n_columns and any(fields[heading.n_columns :])
        if surplus or (len(fields) != heading.n_columns and (separator in _SPLIT or heading.line is None)):
            names = "the other lines have" if heading.line is None else f"the heading in line {heading.line} names"
            raise Unfit(
                f"{len(fields)} fields, but {names} {heading.n_columns} columns; numbers with a decimal comma need "
                "semicolons or tabs between the columns, in the heading too",
                line=line,
                fitted=2.0 + len(rows),
            )
        unnamed = next((i for i, f in enumerate(fields) if f and heading.names and not heading.names[i]), None)
        if unnamed is not None and not (unnamed == 0 and fields[0] in (str(len(rows)), str(len(rows) + 1))):
            raise Unfit(
                f"{fields[unnamed]!r} stands in a column that has no name in line {heading.line}",
                line=line,
                fitted=2.0 + len(rows),
            )
        rows.append((line, fields if len(fields) > last else (*fields, *[""] * (last + 1 - len(fields)))))
    if not rows:
        raise Unfit("nothing stands below the heading", line=heading.line, fitted=1.5)
    return rows


def _numbers(texts: Sequence[str], column: NeededColumn, style: Style, is_gappy: bool) -> tuple[FloatArray, int | None]:
    """A column in the unit that is wanted, and the index of the first field that is no number."""
    values = np.empty(len(texts))
    for i, text in enumerate(texts):
        value = math.nan if is_gappy and _NOTHING.fullmatch(text) else style.value(text)
        if value is None:
            return values, i
        values[i] = value
    return values * column.factor + column.offset, None


def _no_number(rows: Sequence[FileLine], failures: Sequence[tuple[int, int, str]]) -> Unfit:
    """What to say where no way of writing numbers fits: of the field that no style reads, or of two that contradict."""
    farthest = max(failures)
    line, fields = rows[farthest[0]]
    field = fields[farthest[1]]
    if not any(style.value(field) is not None for style in STYLES):
        why = ": nothing was measured there, or the channel was overdriven" if _MISSING.fullmatch(field) else ""
        return Unfit(
            f"{farthest[2]} is {field!r}{why}; it must be a number such as 3.7 or 3,7",
            line=line,
            fitted=2.0 + farthest[0],
        )
    first = min(failures)
    other_line, other_fields = rows[first[0]]
    return Unfit(
        f"numbers are written in two ways: {other_fields[first[1]]!r} in line {other_line} and {field!r} in line {line}"
        "; use one decimal sign in the whole file, and nothing between thousands",
        line=line,
        fitted=2.0 + farthest[0],
    )


def _check_above(rows: Sequence[FileLine], heading: Heading, sample: Sequence[str]) -> None:
    """Raise Unfit where a row above the heading looks like one below it: a heading in the middle hides samples."""
    numeric = [i for i, field in enumerate(sample) if is_number(field)]
    for line, fields in rows[: heading.first]:
        alike = bool(numeric) and all(i < len(fields) and is_number(fields[i]) for i in numeric)
        if (alike and line != heading.line) or (line < (heading.line or 0) and lowered(fields) in heading.repeats):
            raise Unfit(
                f"this looks like a row of the table, but stands above its heading in line {heading.line}",
                line=line,
                fitted=2.0,
            )


def _different(tables: Sequence[Table]) -> list[Table]:
    """Of tables that hold the same numbers, the first."""
    kept: list[Table] = []
    for table in tables:
        if not any(_same(table, other) for other in kept):
            kept.append(table)
    return kept


def _same(a: Table, b: Table) -> bool:
    return a.numbers.keys() == b.numbers.keys() and all(
        np.array_equal(a.numbers[n], b.numbers[n], equal_nan=True) for n in a.numbers
    )


def _at(table: Table, name: str, row: int) -> str:
    return f"{table.numbers[name][row]:.12g}" if name in table.numbers and row < len(table.lines) else "nothing"
