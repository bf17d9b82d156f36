"""Owns how quantities are named, written and coloured wherever a person looks: reports, figures, comparisons."""

from __future__ import annotations

import math

from softclose.digits import LEAST, digits_of, least_digits
from softclose.evaluate.quantities import Quantity
from softclose.propose.inputs import SWING
from softclose.propose.origins import Group
from softclose.waveform import coordinates

PALETTE: dict[str, dict[str, str]] = {
    "light": {
        "paper": "#ffffff",
        "card": "#f6f7f9",
        "ink": "#1b1f24",
        "muted": "#57606a",
        "line": "#d0d7de",
        "grid": "#e6e9ed",
        "best": "#0a67a6",
        "deterministic": "#c14a00",
        "unshaped": "#626a73",
        "open": "#a3347a",
        "extra": "#00795a",
        "warn": "#7a4b00",
        "warnpaper": "#fff6dd",
    },
    "dark": {
        "paper": "#12161b",
        "card": "#1b2128",
        "ink": "#e8ecf0",
        "muted": "#a5afba",
        "line": "#3a434d",
        "grid": "#2a323b",
        "best": "#5bb4ee",
        "deterministic": "#f58a4b",
        "unshaped": "#a9b3bd",
        "open": "#ee93cd",
        "extra": "#3fc79d",
        "warn": "#f2cc72",
        "warnpaper": "#33290f",
    },
}
"""Roles rather than colours. The four data colours keep apart under protanopia, deuteranopia and in grey (they differ
in lightness, and every use adds a dash, a marker or a label); each has a contrast of at least 4.5 to its paper."""

SERIES = ("best", "deterministic", "extra", "open", "unshaped")
"""Colours of compared campaigns, in order."""

PARAMETERS: dict[str, tuple[str, str]] = {
    "D": ("travel D", "µm"),
    "G": ("gap G", "µm"),
    "E": ("modulus E", "GPa"),
    "T": ("thickness T", "µm"),
    "K": ("stiffness K", "N/m"),
    "M": ("effective mass M", "µg"),
}

ORIGIN_GROUPS: dict[Group, tuple[str, str]] = {
    "start": ("circle-open", "unshaped"),
    "around the best": ("circle", "best"),
    "everywhere": ("diamond", "extra"),
    "descents": ("triangle-up", "open"),
    "finish": ("star", "deterministic"),
    "fallback": ("x", "unshaped"),
    "other": ("square-open", "open"),
}
"""Marker and colour of each group of candidates in a convergence."""


def coordinate_label(name: str, *, unit: bool = True) -> str:
    """`volts2` -> `pulse 2 voltage (V)`, `x_last` -> `position at the last pulse`; what nobody knows stays as it is."""
    return coordinates.label_of(name, unit=unit) or SWING.get(name, name)


def number(value: float, digits: int = 1) -> str:
    """Fixed digits, 0 without a sign; a dash where there is no number, ∞ where there is no bound."""
    if math.isnan(value):
        return "–"
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    return f"{value:z.{digits}f}".replace("-", "−")


def count(n: int) -> str:
    """`100,000`: how many there are of something."""
    return f"{n:,}"


def signed(value: float, digits: int = 1) -> str:
    """A difference: `+0.26`, `−22.05`; a dash where there is none."""
    return "–" if math.isnan(value) else f"{value:+z.{digits}f}".replace("-", "−").replace("inf", "∞")


def interval(lower: float, upper: float, digits: int = 1) -> str:
    """`17.2–18.9`, or `−0.3 to 0.2` where an end is negative; empty where either end is undefined."""
    if math.isnan(lower) or math.isnan(upper):
        return ""
    low, high = number(lower, digits), number(upper, digits)
    return f"{low}{' to ' if '−' in low + high else '–'}{high}"


def percent(value: float, digits: int = 1) -> str:
    """A probability in per cent, with a narrow no-break space before the sign."""
    return "–" if math.isnan(value) else f"{number(100.0 * value, digits)}\u202f%"


def in_percent(value: float, digits: int = 0) -> str:
    """The same for a terminal, with a space as one types it: `95 %`, `7.15 %`."""
    return percent(value, digits).replace("\u202f", " ")


def percent_interval(lower: float, upper: float, digits: int = 1) -> str:
    """`3.1–4.8 %`; ends are clipped to what a probability can be."""
    if math.isnan(lower) or math.isnan(upper):
        return ""
    return f"{interval(100.0 * max(lower, 0.0), 100.0 * min(upper, 1.0), digits)}\u202f%"


def estimated(value: float, lower: float, upper: float, unit: str = "", least: int = LEAST) -> tuple[str, str]:
    """`("13.57 cm/s", "13.54–13.61")`: a figure and its interval, both with the same digits (`softclose.digits`)."""
    digits = digits_of(value, lower, upper, least)
    text = number(value, digits)
    return f"{text} {unit}" if unit and text != "–" else text, interval(lower, upper, digits)


def estimated_share(value: float, lower: float, upper: float) -> tuple[str, str]:
    """`("3.48\u202f%", "3.37–3.60\u202f%")`: the same of a probability, in per cent."""
    digits = digits_of(100.0 * value, 100.0 * lower, 100.0 * upper)
    return percent(value, digits), percent_interval(lower, upper, digits)


def estimated_quantity(q: Quantity, value: float, lower: float = math.nan, upper: float = math.nan) -> tuple[str, str]:
    """The same of a quantity, in its unit: shares in per cent, `exact` in the place of the interval of a drive's."""
    if q.is_share:
        return estimated_share(value, lower, upper)
    text, bounds = estimated(value, lower, upper, q.unit.removeprefix("1"), least_digits(q.unit))
    return text, "exact" if q.per == "drive" else bounds


def estimated_difference(value: float, lower: float, upper: float, unit: str = "") -> tuple[str, str]:
    """`("−26.41 cm/s", "−26.49 to −26.32")`: the same of a difference, every number with its sign."""
    digits = digits_of(value, lower, upper)
    text = signed(value, digits)
    known = not (math.isnan(lower) or math.isnan(upper))
    ends = f"{signed(lower, digits)} to {signed(upper, digits)}" if known else ""
    return f"{text} {unit}" if unit and text != "–" else text, ends


def pulse_lines(rows: list[tuple[float, float, float, float]]) -> list[dict[str, str]]:
    """Cells of the table of pulses."""
    return [
        {
            "start": number(start, 2),
            "rise": "ideal step" if rise == 0.0 else number(rise, 2),
            "top": "holds" if math.isinf(peak) else number(peak, 2),
            "volts": number(volts, 2),
        }
        for start, rise, peak, volts in rows
    ]
