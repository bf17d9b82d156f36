"""Owns how an object of ours looks at a prompt and in a notebook: a heading and a few lines, never its arrays."""

from __future__ import annotations

import html
import math
from collections.abc import Sequence

from softclose.digits import digits_of

Lines = Sequence[tuple[str, str]]
"""(name, value) of each line."""


def as_text(title: str, lines: Lines) -> str:
    """A heading, then one line each, names aligned."""
    width = max((len(name) for name, _ in lines), default=0)
    return "\n".join([title, *(f"  {name:<{width}}  {value}" for name, value in lines)])


def as_table(title: str, lines: Lines) -> str:
    """The same as an HTML table; every text is escaped."""
    rows = "".join(f"<tr><th>{html.escape(name)}</th><td>{html.escape(value)}</td></tr>" for name, value in lines)
    return f"<table><caption>{html.escape(title)}</caption><tbody>{rows}</tbody></table>"


def ranged(value: float, lower: float, upper: float, unit: str) -> str:
    """`17.90 cm/s (17.56–18.31)`; a dash where it is not defined, no ends where no interval holds."""
    if math.isnan(value):
        return "–"
    digits = digits_of(value, lower, upper)
    ends = "" if math.isnan(lower) or math.isnan(upper) else f" ({lower:.{digits}f}–{upper:.{digits}f})"
    return f"{value:.{digits}f} {unit}{ends}".replace("inf", "∞")
