"""Owns `[model]`: which device model, and what it is told."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, JsonValue
from pydantic.dataclasses import dataclass

from softclose.allowed.types import (
    MAX_HORIZON_US,
    SETTINGS,
    NotNegative,
)
from softclose.switch.losses import Losses


@dataclass(frozen=True, slots=True, kw_only=True, config=SETTINGS)
class ModelSection:
    """The device model: Eqs. 1-2 unless another one is named."""

    name: Annotated[str, Field(min_length=1)] = "single-mode"
    """single-mode, reduced-order (with `modes`), or an installed entry point of group softclose.models."""
    horizon_us: Annotated[float, Field(gt=0, le=MAX_HORIZON_US)] = 250.0
    """End of the simulated time [µs]."""
    restitution: Annotated[float, Field(gt=0, le=1)] = 0.5
    """Coefficient of restitution η, in (0, 1]."""
    plate_area_um2: NotNegative = 0.0
    """Plate area a [µm²]; 0: the area that the population was fitted with, else 16,700."""
    options: dict[str, JsonValue] = Field(default_factory=dict)
    """Settings of an installed model's own (`[model.options]`), which it checks itself; what it takes for granted is
    written out."""
    modes: str = ""
    """reduced-order: the TOML file of its modes; `softclose run` writes it into the store."""
    quality_factor: Annotated[float, Field(ge=0, le=1e9)] = 0.0
    """single-mode: Q of the plate's own damping; 0: none."""
    film_viscosity_uPa_s: Annotated[float, Field(ge=0, le=1e6)] = 0.0
    """Viscosity of the film of gas that is squeezed out of the gap [µPa s]; 0: no film. Air has 18."""
    film_length_um: Annotated[float, Field(ge=0, le=1e6)] = 0.0
    """Longer side of the film [µm]; 0: that of a square of the plate's area."""
    film_width_um: Annotated[float, Field(ge=0, le=1e6)] = 0.0
    """Shorter side of the film [µm]; 0: that of a square of the plate's area."""
    film_count: Annotated[float, Field(gt=0, le=1e6)] = 1.0
    """Films of that size, the fingers of a comb for instance; of a beam that bends, about 0.25 (fixed at one end) or
    0.40 (at both) over 1 - 0.63 width / length."""
    film_mean_free_path_um: Annotated[float, Field(ge=0, le=1e6)] = 0.0
    """Mean free path of the gas at 101.325 kPa [µm], which lets a thin film slip; 0: none. Air has 0.065."""
    film_pressure_kPa: Annotated[float, Field(gt=0, le=1e6)] = 101.325
    """Ambient pressure [kPa]."""
    adhesion_uN: Annotated[float, Field(ge=0, le=1e9)] = 0.0
    """Force with which a closed contact sticks [µN]: a release has to overcome it."""

    def build_losses(self) -> Losses:
        """Damping, film and adhesion."""
        return Losses(
            quality_factor=self.quality_factor,
            film_viscosity_uPa_s=self.film_viscosity_uPa_s,
            film_length_um=self.film_length_um,
            film_width_um=self.film_width_um,
            film_count=self.film_count,
            film_mean_free_path_um=self.film_mean_free_path_um,
            film_pressure_kPa=self.film_pressure_kPa,
            adhesion_uN=self.adhesion_uN,
        )
