"""Owns temperature: what stiffness, gap and travel of a switch become of it, and a lot spread over a range of it.

From tables of the user's own: E(T) and residual stress as a factor of the stiffness, bending and expansion as shifts of
gap and travel. Between entries a straight line.
"""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass as section

from softclose.allowed.types import SETTINGS
from softclose.population.population import index_uniforms
from softclose.waveform import FloatArray

if TYPE_CHECKING:
    from softclose.device.simulate import Responses


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


_STREAM = 7_300_000
"""Added to an ensemble's stream: temperatures are independent of switches and drives."""


def heated(settings: TemperatureSection, switches: FloatArray, celsius: FloatArray | float) -> FloatArray:
    """The switches at a temperature.

    Parameters
    ----------
    settings : TemperatureSection
        The tables.
    switches : (n, 4) or (n, 6) ndarray
        D, G [µm], K [N/m], M [µg] as the population gives them, and scales of drives, which do not change.
    celsius : (n,) ndarray or float
        Temperature of each, or of all [°C].

    Returns
    -------
    ndarray
        Of the same shape.
    """
    found = switches.copy()
    at = settings.celsius
    if settings.travel_um:
        found[:, 0] += np.interp(celsius, at, settings.travel_um)
    if settings.gap_um:
        found[:, 1] += np.interp(celsius, at, settings.gap_um)
    if settings.stiffness:
        found[:, 2] *= np.interp(celsius, at, settings.stiffness)
    return found


def spread(settings: TemperatureSection, n: int, *, seed: int, start: int = 0, stream: int = 0) -> FloatArray:
    """(n,) temperatures [°C] of switches `start` to `start + n`, uniform over the range, the same for every candidate.

    Row i depends on (seed, stream, start + i) and nothing else.
    """
    u = index_uniforms(n, seed=seed, start=start, stream=_STREAM + stream)[:, 0]
    return np.asarray(settings.low_C + (settings.high_C - settings.low_C) * u)


def worse(a: Responses, b: Responses) -> Responses:
    """Of each switch the response with the larger V, held only where both are and from the later instant on.

    What else is told of a switch (impacts, motion) is that of the response with the larger V; of equals the first.
    """
    va, vb = np.asarray(a.max_contact_speed), np.asarray(b.max_contact_speed)
    second = (vb > va) | (np.isnan(va) & ~np.isnan(vb))

    def chosen(of_a: Any, of_b: Any) -> Any:
        if of_a is None:
            return None
        first, other = np.asarray(of_a), np.asarray(of_b)
        return np.where(second.reshape(-1, *[1] * (first.ndim - 1)), other, first)

    found = {f.name: chosen(getattr(a, f.name), getattr(b, f.name)) for f in fields(a) if f.name != "times_us"}
    found |= {
        "closed": np.asarray(a.closed) & np.asarray(b.closed),
        "settling_us": np.maximum(a.settling_us, b.settling_us),
        "status": np.maximum(a.status, b.status),
        "times_us": a.times_us,
    }
    return type(a)(**found)
