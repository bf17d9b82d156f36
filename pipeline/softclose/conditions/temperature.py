"""Owns temperature: what stiffness, gap and travel of a switch become of it, and a lot spread over a range of it.

From tables of the user's own: E(T) and residual stress as a factor of the stiffness, bending and expansion as shifts of
gap and travel. Between entries a straight line.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from pydantic import Field, model_validator
from pydantic.dataclasses import dataclass as section

from softclose.allowed.types import SETTINGS
from softclose.arrays import FloatArray
from softclose.conditions.protocol import Case, Condition, Coordinate, Surroundings, Uniforms
from softclose.conditions.streams import Stream
from softclose.population import Population
from softclose.population.lot import Lot


@section(frozen=True, slots=True, kw_only=True, config=SETTINGS)
class TemperatureSection:
    """A range of temperature over which the waveform has to hold; without tables, none matters."""

    low_C: Annotated[float, Field(ge=-273.15, le=2000)] = 20.0
    """Lowest temperature of the range [°C]: every switch of an ensemble has one of its own."""
    high_C: Annotated[float, Field(ge=-273.15, le=2000)] = 20.0
    """Highest temperature [°C]."""
    celsius: tuple[Annotated[float, Field(ge=-273.15, le=2000)], ...] = ()
    """Temperatures of the tables [°C], rising; the population is that at which the factor is 1 and the shifts are 0."""
    stiffness: tuple[Annotated[float, Field(gt=0, le=100)], ...] = ()
    """Stiffness there over that of the population: E(T) and residual stress."""
    gap_um: tuple[Annotated[float, Field(ge=-1e3, le=1e3)], ...] = ()
    """What the gap G is wider there [µm]."""
    travel_um: tuple[Annotated[float, Field(ge=-1e3, le=1e3)], ...] = ()
    """What the travel D is longer there [µm]."""
    worst_of: Annotated[int, Field(ge=0, le=64, strict=True)] = 0
    """Each switch is simulated at so many temperatures, evenly from low_C to high_C, and counts at its worst: its
    largest V, closed only where it closes at all of them. 0: at one temperature of its own, uniform over the range."""

    @property
    def spreads(self) -> bool:
        """Whether each switch has a temperature of its own."""
        return bool(self.celsius) and not self.worst_of

    @property
    def tried(self) -> tuple[float, ...]:
        """Temperatures at which every switch is simulated [°C]; (): at its own alone."""
        n = self.worst_of
        return tuple(self.low_C + (self.high_C - self.low_C) * k / (n - 1) for k in range(n))

    @model_validator(mode="after")
    def _check(self) -> Self:
        tables = {"stiffness": self.stiffness, "gap_um": self.gap_um, "travel_um": self.travel_um}
        if not self.low_C <= self.high_C:
            raise ValueError(f"temperature.low_C is {self.low_C:g} and high_C {self.high_C:g}; it must not be reversed")
        if not self.celsius:
            if any(tables.values()) or self.low_C != self.high_C or self.worst_of:
                raise ValueError("temperature.celsius is missing: give the temperatures of the tables")
            return self
        if self.worst_of and (self.worst_of == 1 or self.low_C == self.high_C):
            raise ValueError(
                f"temperature.worst_of is {self.worst_of} from {self.low_C:g} to {self.high_C:g} °C; it must be 0, or "
                "at least 2 with low_C below high_C"
            )
        if len(self.celsius) < 2 or list(self.celsius) != sorted(set(self.celsius)):
            raise ValueError("temperature.celsius must list two or more temperatures, rising")
        for name, values in tables.items():
            if values and len(values) != len(self.celsius):
                raise ValueError(
                    f"temperature.{name} has {len(values)} entries, temperature.celsius {len(self.celsius)}: give as "
                    "many"
                )
        if not (self.celsius[0] <= self.low_C and self.high_C <= self.celsius[-1]):
            raise ValueError(
                f"the range of {self.low_C:g} to {self.high_C:g} °C leaves the tables, which end at "
                f"{self.celsius[0]:g} and {self.celsius[-1]:g} °C: extend them"
            )
        return self

    def check_lot(self, lot: Population) -> None:
        """Raise ValueError where a switch of the lot would be closed by the tables alone."""
        for i, celsius in enumerate(self.celsius):
            shift = self.travel_um[i] if self.travel_um else 0.0
            longest, shortest = lot.D.upper + shift, lot.D.lower + shift
            narrowest = lot.G.lower + (self.gap_um[i] if self.gap_um else 0.0)
            if not 0.0 < shortest <= longest < narrowest:
                raise ValueError(
                    f"at {celsius:g} °C travels are {shortest:g} to {longest:g} µm and gaps go down to {narrowest:g} "
                    "µm; every switch needs 0 < D < G: check temperature.travel_um and gap_um"
                )


def heated(settings: TemperatureSection, lot: Lot, celsius: FloatArray | float) -> Lot:
    """A lot at a temperature.

    Parameters
    ----------
    settings : TemperatureSection
        The tables.
    lot : Lot
        Switches as the population gives them; what was measured on them stays as it was.
    celsius : (n,) ndarray or float
        Temperature of each, or of all [°C].

    Returns
    -------
    Lot
        With the column `celsius`.
    """
    at = settings.celsius
    found = {"celsius": np.broadcast_to(np.asarray(celsius, dtype=np.float64), (len(lot),))}
    if settings.travel_um:
        found["D"] = lot["D"] + np.interp(celsius, at, settings.travel_um)
    if settings.gap_um:
        found["G"] = lot["G"] + np.interp(celsius, at, settings.gap_um)
    if settings.stiffness:
        found["K"] = lot["K"] * np.interp(celsius, at, settings.stiffness)
    return lot.with_columns(**found)


@dataclass(frozen=True, slots=True)
class Temperature(Condition):
    """Each switch at a temperature of its own, or at its worst of several."""

    section: ClassVar[str] = "temperature"
    settings: TemperatureSection

    @classmethod
    def of(cls, settings: Any, around: Surroundings) -> Self | None:
        """None without tables."""
        return cls(settings) if settings.celsius else None

    @classmethod
    def assumed(cls, t: TemperatureSection) -> list[str]:
        """What it rests on."""
        if not t.celsius:
            return []
        span = f"from {t.low_C:g} to {t.high_C:g} °C"
        if t.worst_of:
            return [f"Each switch counts at the worst of {t.worst_of} temperatures {span}."]
        return [f"Each switch has a temperature of its own {span}."]

    @property
    def coordinates(self) -> tuple[Coordinate, ...]:  # type: ignore[override]
        """One for the temperature of each switch."""
        if not self.settings.spreads:
            return ()
        return (Coordinate(name="temperature", stream=Stream.TEMPERATURE, parts=("temperature",)),)

    @property
    def columns(self) -> tuple[str, ...]:  # type: ignore[override]
        """The temperature of each switch, where it has one of its own."""
        return ("celsius",) if self.settings.spreads else ()

    def lot(self, lot: Lot, u: Uniforms) -> Lot:
        """Heated, uniformly over the range; the same temperatures for every candidate."""
        s = self.settings
        if not s.spreads:
            return lot
        return heated(s, lot, s.low_C + (s.high_C - s.low_C) * u["temperature"][:, 0])

    def cases(self) -> tuple[Case, ...]:
        """The temperatures at which every switch is simulated."""
        return tuple(
            Case(
                name=f"{celsius:g} °C",
                at=(("celsius", celsius),),
                change=partial(heated, self.settings, celsius=celsius),
            )
            for celsius in self.settings.tried
        )
