"""Owns readings of dynamics: what was measured on a device that moves, from tables that people bring.

The columns of a table say what it holds: closing times against voltage, static figures, or a motion.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from softclose.arrays import FloatArray
from softclose.population.measurements import Devices, MeasurementError, read_devices

ReadingKind = Literal["pull-in", "pull-out", "resonance", "quality factor", "closing", "second contact"]

STATIC: dict[str, ReadingKind] = {
    "pull_in_V": "pull-in",
    "pull_out_V": "pull-out",
    "resonance_kHz": "resonance",
    "quality_factor": "quality factor",
}
"""Column -> what it is."""
UNITS: dict[ReadingKind, str] = {
    "pull-in": "V",
    "pull-out": "V",
    "resonance": "kHz",
    "quality factor": "",
    "closing": "µs",
    "second contact": "µs",
}
"""What each is given in."""
ERRORS: dict[str, float] = {
    "pull-in": 0.01,
    "pull-out": 0.01,
    "resonance": 0.005,
    "quality factor": 0.05,
    "closing": 0.02,
    "second contact": 0.02,
    "motion": 0.02,
}
"""Relative error of each kind of reading where nobody says another: its weight. Of a motion, of its largest travel."""
MOST_SAMPLES = 400
"""Samples of a motion that are fitted: neighbours of a vibrometer's record tell the same."""

_WANTED = (
    ("time_us", "voltage_V", "x_um"),
    ("time_us", "x_um"),
    ("voltage_V", "closing_time_us", "second_contact_us"),
    ("voltage_V", "closing_time_us"),
    *(chosen for n in range(len(STATIC), 0, -1) for chosen in itertools.combinations(STATIC, n)),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """One number that was measured."""

    kind: ReadingKind
    """What it is."""
    value: float
    """In the unit of its kind."""
    device: str = ""
    """On which device; "": on the only one."""
    volts: float = 0.0
    """Step that closed it [V]; of closing times and second contacts."""
    error: float = 0.0
    """Relative error; 0: that of its kind."""

    @property
    def weighed(self) -> float:
        """Relative error that it is weighed by."""
        return self.error or ERRORS[self.kind]

    @property
    def name(self) -> str:
        """For tables: `closing at 20 V`."""
        return f"{self.kind} at {self.volts:g} V" if self.volts else self.kind


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion:
    """A record of x(t)."""

    times_us: FloatArray
    """(n,) instants, rising [µs]."""
    x_um: FloatArray
    """(n,) travel [µm]."""
    volts: FloatArray | None = None
    """(n,) the drive from rest on [V]; None: it rings down freely, with small swings about its rest."""
    device: str = ""
    """On which device."""
    error: float = ERRORS["motion"]
    """Error of x over the largest travel of the record."""

    def __post_init__(self) -> None:
        t = self.times_us
        if t.size < 8 or not (np.diff(t) > 0.0).all():
            raise MeasurementError(f"a motion has {t.size} samples; give 8 or more, at instants that rise")
        if not np.ptp(self.x_um) > 0.0:
            raise MeasurementError("a motion stands still: there is nothing to fit")

    @property
    def kept(self) -> slice:
        """The samples that are fitted."""
        return slice(None, None, -(-self.times_us.size // MOST_SAMPLES))


@dataclass(frozen=True, slots=True, kw_only=True)
class Dynamics:
    """Everything that was measured."""

    readings: tuple[Reading, ...]
    """Single numbers."""
    motions: tuple[Motion, ...] = ()
    """Records."""
    said: tuple[str, ...] = ()
    """How each file was read."""

    @property
    def devices(self) -> tuple[str, ...]:
        """Names, in the order in which they come; ("",) of one device without a name."""
        return tuple(dict.fromkeys([*(r.device for r in self.readings), *(m.device for m in self.motions)]))

    @property
    def n(self) -> int:
        """Residuals of a fit."""
        return len(self.readings) + sum(len(m.times_us[m.kept]) for m in self.motions)

    def of(self, device: str) -> Dynamics:
        """What was measured on one device."""
        return Dynamics(
            readings=tuple(r for r in self.readings if r.device == device),
            motions=tuple(m for m in self.motions if m.device == device),
        )

    def weighed(self, errors: Mapping[str, float]) -> Dynamics:
        """With other relative errors, by kind. Raises MeasurementError for a kind or an error that is none."""
        for kind, error in errors.items():
            if kind not in ERRORS:
                raise MeasurementError(f"no reading is called {kind!r}; known are {', '.join(ERRORS)}")
            if not 0.0 < error < 10.0:
                raise MeasurementError(f"the relative error of {kind} is {error:g}; it must be above 0 and below 10")
        return replace(
            self,
            readings=tuple(replace(r, error=errors.get(r.kind, r.error)) for r in self.readings),
            motions=tuple(replace(m, error=errors.get("motion", m.error)) for m in self.motions),
        )


def read_dynamics(paths: Iterable[str | Path], *, columns: Mapping[str, str] | None = None) -> Dynamics:
    """Read tables of any of: closing times, static figures, motions.

    Parameters
    ----------
    paths : iterable of str or Path
        Each file has the columns `voltage_V` and `closing_time_us` (and `second_contact_us`); or any of `pull_in_V`,
        `pull_out_V`, `resonance_kHz` and `quality_factor`; or `time_us` and `x_um`, with `voltage_V` where it was
        driven. A column `device` tells devices apart; a motion is one device's.
    columns : mapping, optional
        Which column is which, where the heading calls it otherwise.

    Returns
    -------
    Dynamics

    Raises
    ------
    MeasurementError
        Naming file and line.
    """
    readings: list[Reading] = []
    motions: list[Motion] = []
    said: list[str] = []
    for path in paths:
        found = read_devices(path, *_WANTED, columns=columns)
        said.append(found.said)
        try:
            if "time_us" in found.values:
                motions.append(_motion(found))
            else:
                readings += _readings(found)
        except MeasurementError as e:
            raise MeasurementError(f"{path}: {e}") from e
    return Dynamics(readings=tuple(readings), motions=tuple(motions), said=tuple(said))


def _readings(found: Devices) -> list[Reading]:
    names = [name if _named(name) else "" for name in found.names]
    v = found.values
    if "closing_time_us" not in v:
        return [
            Reading(kind=STATIC[column], value=float(value), device=name)
            for column, values in v.items()
            for name, value in zip(names, values, strict=True)
        ]
    kinds: dict[str, ReadingKind] = {"closing_time_us": "closing", "second_contact_us": "second contact"}
    for first, second in zip(v["closing_time_us"], v.get("second_contact_us", v["closing_time_us"] + 1), strict=True):
        if not second > first:
            raise MeasurementError(f"a second contact at {second:g} µs is not after the first, at {first:g} µs")
    return [
        Reading(kind=kind, value=float(value), device=name, volts=abs(float(volts)))
        for column, kind in kinds.items()
        if column in v
        for name, value, volts in zip(names, v[column], v["voltage_V"], strict=True)
    ]


def _motion(found: Devices) -> Motion:
    names = {name if _named(name) else "" for name in found.names}
    if len(names) > 1:
        raise MeasurementError(f"a motion of {len(names)} devices; give each its own file")
    v = found.values
    return Motion(times_us=v["time_us"], x_um=v["x_um"], volts=v.get("voltage_V"), device=names.pop())


def _named(name: str) -> bool:
    """Whether a device has a name: without one its line stands there."""
    return not name.startswith("line ")
