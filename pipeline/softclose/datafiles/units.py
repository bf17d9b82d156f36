"""Owns units in headings: `Time (ms)`, `t [µs]`, `U/V`, `C1 in V`, `gap_um`, and of which kind each is."""

from __future__ import annotations

import re
from collections.abc import Mapping

TIME = "time"
VOLTAGE = "voltage"
LENGTH = "length"
FREQUENCY = "frequency"
STIFFNESS = "stiffness"


_SPELT: Mapping[str, Mapping[str, tuple[float, tuple[str, ...]]]] = {
    TIME: {
        "s": (1e6, ("s", "sec", "secs", "second", "seconds", "sekunde", "sekunden", "seconde", "secondes")),
        "ms": (1e3, ("ms", "msec", "millisecond", "milliseconds", "millisekunden", "millisecondes")),
        "us": (1.0, ("us", "usec", "microsecond", "microseconds", "mikrosekunden", "microsecondes")),
        "ns": (1e-3, ("ns", "nsec", "nanosecond", "nanoseconds", "nanosekunden", "nanosecondes")),
        "ps": (1e-6, ("ps", "psec", "picosecond", "picoseconds")),
    },
    VOLTAGE: {
        "V": (1.0, ("v", "volt", "volts")),
        "mV": (1e-3, ("mv", "millivolt", "millivolts")),
        "kV": (1e3, ("kv", "kilovolt", "kilovolts")),
        "uV": (1e-6, ("uv", "microvolt", "microvolts")),
    },
    LENGTH: {
        "m": (1e6, ("m", "metre", "metres", "meter", "meters")),
        "mm": (1e3, ("mm", "millimetre", "millimetres", "millimeter", "millimeters")),
        "um": (1.0, ("um", "micron", "microns", "micrometre", "micrometres", "micrometer", "micrometers")),
        "nm": (1e-3, ("nm", "nanometre", "nanometres", "nanometer", "nanometers")),
        "pm": (1e-6, ("pm", "picometre", "picometer")),
    },
    FREQUENCY: {
        "Hz": (1e-3, ("hz", "hertz")),
        "kHz": (1.0, ("khz", "kilohertz")),
        "MHz": (1e3, ("mhz", "megahertz")),
    },
    STIFFNESS: {
        "N/m": (1.0, ("n/m", "n_per_m", "nm-1")),
        "mN/m": (1e-3, ("mn/m", "mn_per_m")),
        "kN/m": (1e3, ("kn/m", "kn_per_m")),
        "N/mm": (1e3, ("n/mm", "n_per_mm")),
    },
}
FACTORS: Mapping[str, tuple[str, float]] = {
    unit: (kind, factor) for kind, units in _SPELT.items() for unit, (factor, _) in units.items()
}
"""Unit -> its kind, and what it is in µs, V, µm, kHz or N/m."""
_KNOWN = {word: unit for units in _SPELT.values() for unit, (_, words) in units.items() for word in words}
# Upper case may be another prefix: MV are no mV, MHZ are MHz. Instruments that shout TIME(MS) mean ms.
_SHOUTED = {"MV": None, "MM": None, "NM": None, "PM": None, "MHZ": "MHz", "mHz": None, "mhz": "MHz"}
LONGEST = 200
"""A longer heading is not searched for a unit: expressions take the square of its length."""
_OTHER = re.compile(r"(?:[mukMG]?(?:A|Amps?|W|Ohm|Ω|C|F|H|dB|dBm|%|°C|K|bar|g|Pa)|dB[mVu]*|deg|m/s|um/us)")
"""Units of quantities that no table here has: a column that has one is neither time nor volts."""

_WRITTEN = (
    re.compile(r"^(?P<name>.*?)\s*[\(\[\{<]\s*(?P<unit>[^\(\)\[\]{}<>]+?)\s*[\)\]\}>]$"),
    re.compile(r"^(?P<name>.*?)\s+in\s+(?P<unit>\S+)$", re.IGNORECASE),
    re.compile(r"^(?P<name>)in\s+(?P<unit>\S+)$", re.IGNORECASE),
    re.compile(r"^(?P<name>.+?)\s*/\s*(?P<unit>\S+)$"),
    re.compile(r"^(?P<name>.+?)_(?P<unit>[^_\s]+_per_[^_\s]+)$", re.IGNORECASE),
    re.compile(r"^(?P<name>.+)[\s_,:;-]\s*(?P<unit>[^\s_,:;-]+)$"),
)


def known_unit(text: str) -> str | None:
    """`ms` of `ms`, `MS`, `msec` or `milliseconds`; None where it is no unit known here."""
    word = text.strip().strip(".").replace("µ", "u").replace("μ", "u")
    if word in FACTORS:
        return word
    if word in _SHOUTED:
        return _SHOUTED[word]
    return _KNOWN.get(word.casefold().replace("μ", "u"))


def name_and_unit(heading: str) -> tuple[str, str | None]:
    """The name and the unit of a heading; the whole heading and None where it tells no unit known here."""
    heading = heading.strip()
    if len(heading) > LONGEST:
        return heading, None
    unit = known_unit(heading)
    if unit is not None:
        return "", unit
    for form in _WRITTEN:
        found = form.match(heading)
        unit = known_unit(found["unit"]) if found else None
        if found and unit is not None:
            return found["name"].strip(), unit
    return heading, None


def kind_of(unit: str | None) -> str | None:
    """`time`, `voltage`, `length`, …"""
    return None if unit is None else FACTORS[unit][0]


def has_other_unit(heading: str) -> bool:
    """Whether a heading tells a unit that is none of those above: amperes, decibels, degrees."""
    for form in _WRITTEN[:4] if len(heading) <= LONGEST else ():
        found = form.match(heading.strip())
        if found and _OTHER.fullmatch(found["unit"].replace("µ", "u").replace("μ", "u")):
            return True
    return False
