"""Owns what Eqs. 1-2 leave out: damping of the plate, the film of gas under it, adhesion of a closed contact."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np


class LossesError(ValueError):
    """Damping, film or adhesion out of range."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Losses:
    """All zero: Eqs. 1-2 as they are."""

    quality_factor: float = 0.0
    """Q of the plate's own damping, b = sqrt(K M) / Q; 0: none."""
    film_viscosity_uPa_s: float = 0.0
    """Viscosity of the gas [µPa s]; 0: no film."""
    film_length_um: float = 0.0
    """Longer side of the film [µm]; 0: that of a square of the plate's area."""
    film_width_um: float = 0.0
    """Shorter side of the film [µm]; 0: that of a square of the plate's area."""
    adhesion_uN: float = 0.0
    """Force with which a closed contact sticks [µN]."""

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value < math.inf:
                raise LossesError(f"{name} is {value!r}; it must be a number, 0 or more")
        if self.quality_factor and self.quality_factor < 0.1:
            raise LossesError(f"quality_factor is {self.quality_factor:g}; it must be 0 (no damping) or 0.1 and more")
        if (self.film_length_um == 0.0) != (self.film_width_um == 0.0):
            raise LossesError("give both film_length_um and film_width_um, or neither for a square")

    @property
    def none(self) -> bool:
        """Whether the switch loses nothing but at its impacts."""
        return self.quality_factor == self.film_viscosity_uPa_s == self.adhesion_uN == 0.0

    def film(self, plate_area_um2: float) -> float:
        """Force of the film times the cube of its thickness over the speed [mN µm³ per µm/µs].

        Reynolds' equation for an incompressible film under a rectangular plate that moves square to it, first order in
        the speed: F = mu L W³ beta(W / L) v / h³ (Bao and Yang, Sensors and Actuators A 136, 2007, eqs. 22-23). The
        thickness h is the gap that is left, G - x.
        """
        side = math.sqrt(plate_area_um2)
        sides = self.film_length_um or side, self.film_width_um or side
        length, width = max(sides), min(sides)
        return 1e-9 * self.film_viscosity_uPa_s * length * width**3 * shape_factor(width / length)


def shape_factor(ratio: float) -> float:
    """beta(W / L) of a rectangular film, from 0.42 of a square to 1 of a long strip; ratio: (0, 1]."""
    odd = np.arange(1.0, 200.0, 2.0)
    return float(1.0 - 192.0 / math.pi**5 * ratio * (np.tanh(0.5 * math.pi * odd / ratio) / odd**5).sum())
