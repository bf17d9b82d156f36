"""Owns how numbers are written: the decimal sign, what stands between thousands, and what is no number."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field

_SPACES = " \u00a0\u2009\u202f"
_MINUS = str.maketrans({"\u2212": "-"})


@dataclass(frozen=True, slots=True)
class Style:
    """One way of writing numbers."""

    decimal: str
    """`.` or `,`."""
    thousands: str = ""
    """Signs that may stand between groups of three digits; none where empty."""
    pattern: re.Pattern[str] = field(init=False)

    def __post_init__(self) -> None:
        whole = "[0-9]+"
        if self.thousands:
            whole = rf"(?:[1-9][0-9]{{0,2}}(?:[{re.escape(self.thousands)}][0-9]{{3}})+|[0-9]+)"
        d = re.escape(self.decimal)
        number = rf"[+\-\u2212]?(?:{whole}(?:{d}[0-9]*)?|{d}[0-9]+)(?:[eE][+\-\u2212]?[0-9]+)?"
        object.__setattr__(self, "pattern", re.compile(number))

    def value(self, text: str) -> float | None:
        """The number; None where it is none in this style, or not finite."""
        if self.pattern.fullmatch(text) is None:
            return None
        for sign in self.thousands:
            text = text.replace(sign, "")
        found = float(text.replace(self.decimal, ".").translate(_MINUS))
        return found if math.isfinite(found) else None

    def __str__(self) -> str:
        sign = {".": "decimal points", ",": "decimal commas"}[self.decimal]
        between = {"": "", ",": "commas", ".": "points", "'’": "apostrophes", _SPACES: "spaces"}[self.thousands]
        return f"{sign}, {between} between thousands" if between else sign


STYLES = (
    Style("."),
    Style(","),
    Style(".", ","),
    Style(",", "."),
    Style(".", "'’"),
    Style(",", "'’"),
    Style(".", _SPACES),
    Style(",", _SPACES),
)
"""Plain ones first: a thousands sign that occurs nowhere changes nothing."""


def is_number(text: str) -> bool:
    """Whether a field is a number in any style."""
    return any(style.pattern.fullmatch(text) for style in STYLES)
