"""Owns the protocol of a condition: what stands between a lot and its drive, each ignorant of the others.

The way of a switch is the same everywhere: its coordinates are drawn, the population makes a lot of them, each
condition adds to the lot, then each adds to the drives, and the device simulates the lot in every case.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self

from softclose.arrays import FloatArray
from softclose.conditions.streams import Stream
from softclose.device.device import Device
from softclose.device.drives import Delivery, Drives
from softclose.population import Population
from softclose.population.lot import Lot

Uniforms = Mapping[str, FloatArray]
"""Name of a coordinate -> (n, size) uniform numbers in [0, 1)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Coordinate:
    """Uniform numbers that a condition needs of each switch."""

    name: str
    """What `Uniforms` calls it."""
    stream: Stream
    """Where they are drawn."""
    parts: tuple[str, ...]
    """What each of them is, for people: one to four."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Surroundings:
    """What a condition may know of the campaign that it is part of."""

    population: Population
    """The lot as it is believed to be."""
    device: Device
    """What simulates it."""
    max_volts: float
    """Limit of every drive [V]."""
    min_rise_us: float
    """Fastest rise of every drive [µs]."""
    delivery: Delivery | None = None
    """What stands between every generator and its switch, errors from one to the next aside."""


class Condition:
    """One condition. What it does not say changes nothing: it overrides the parts that it has."""

    section: ClassVar[str]
    """Its section of the configuration."""
    coordinates: tuple[Coordinate, ...] = ()
    """What it draws of each switch."""
    columns: tuple[str, ...] = ()
    """The columns that it adds to a lot, in their order: known before any lot is, which may take simulations."""
    tailored: ClassVar[bool] = False
    """Whether it makes a drive for each switch on purpose: reference designs, which are for everybody, go without."""

    @classmethod
    def of(cls, settings: Any, around: Surroundings) -> Self | None:
        """The condition that a section of the configuration stands for; None where it stands for none."""
        raise NotImplementedError

    @classmethod
    def assumed(cls, settings: Any) -> list[str]:
        """What a reader of the figures has to believe of it, in sentences; its section as it is, also without it."""
        return []

    def lot(self, lot: Lot, u: Uniforms) -> Lot:
        """What it makes of a lot; row i depends on row i alone."""
        return lot

    def drives(self, drives: Drives, lot: Lot) -> Drives:
        """What it makes of a lot's drives."""
        return drives

    def cases(self) -> tuple[Case, ...]:
        """The cases in which each switch is simulated; (): as it is."""
        return ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One of several in which each switch of a lot is simulated; it counts at its worst."""

    name: str
    """Such as `-40 °C`."""
    at: tuple[tuple[str, float], ...]
    """What tells it apart from the condition's other cases: columns of a lot (`softclose.population.lot.COLUMNS`), the
    same in all of them, and their values in this one."""
    change: Any
    """Lot -> the lot in that case."""

    def of(self, lot: Lot) -> Lot:
        """The lot in this case."""
        changed: Lot = self.change(lot)
        return changed
