"""Owns what Eqs. 1-2 leave out: damping of the plate, the film of gas under it, adhesion of a closed contact."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from softclose.arrays import FloatArray

LEAST_Q = 1e-3
"""Smallest Q: below it a switch creeps as the film or the dashpot lets it, and its mass means nothing."""
SLIP, SLIP_EXPONENT = 9.638, 1.159
"""Veijola and others, Sensors and Actuators A 48 (1995): a gas whose mean free path is Kn of the film's thickness flows
as one of 1 + 9.638 Kn^1.159 times less viscosity, from the continuum to free molecules within 5 %."""
_BY_SWITCH = ("quality_factor", "film_viscosity_uPa_s", "adhesion_uN")
"""Losses of which each switch may have its own."""


class LossesError(ValueError):
    """Damping, film or adhesion out of range."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Losses:
    """All zero: Eqs. 1-2 as they are. Q, viscosity and adhesion may be arrays (n,), one entry a switch."""

    quality_factor: float | FloatArray = 0.0
    """Q of the plate's own damping, b = sqrt(K M) / Q; 0: none."""
    film_viscosity_uPa_s: float | FloatArray = 0.0
    """Viscosity of the gas [µPa s]; 0: no film."""
    film_length_um: float = 0.0
    """Longer side of the film [µm]; 0: that of a square of the plate's area."""
    film_width_um: float = 0.0
    """Shorter side of the film [µm]; 0: that of a square of the plate's area."""
    film_count: float = 1.0
    """Films of that size: the fingers of a comb, the fields between holes. Of a beam that bends, 0.25 (fixed at one
    end) or 0.40 (at both) over `shape_factor`: the integral of its squared mode, in the place of a plate's motion."""
    film_mean_free_path_um: float = 0.0
    """Mean free path of the gas at 101.325 kPa [µm]; 0: a continuum, which a film thinner than some 5 µm is not."""
    film_pressure_kPa: float = 101.325
    """Ambient pressure [kPa]: the mean free path is in inverse proportion."""
    adhesion_uN: float | FloatArray = 0.0
    """Force with which a closed contact sticks [µN]."""

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            value = getattr(self, name)
            if isinstance(value, np.ndarray) and name in _BY_SWITCH:
                wrong = _wrong_row(value)
                if wrong:
                    raise LossesError(f"{name}{wrong}")
            elif isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value < math.inf:
                raise LossesError(f"{name} is {value!r}; it must be a number, 0 or more")
        q = np.ravel(self.quality_factor)
        if ((q > 0.0) & (q < LEAST_Q)).any():
            raise LossesError(
                f"quality_factor is {q[q > 0.0].min():g}; it must be 0 (no damping) or {LEAST_Q:g} and more"
            )
        for name in ("film_count", "film_pressure_kPa"):
            if not getattr(self, name) > 0.0:
                raise LossesError(f"{name} is {getattr(self, name)!r}; it must be above 0")
        if (self.film_length_um == 0.0) != (self.film_width_um == 0.0):
            raise LossesError("give both film_length_um and film_width_um, or neither for a square")

    @property
    def moving(self) -> bool:
        """Whether a switch that moves loses anything: damping or film."""
        return bool(np.any(self.quality_factor) or np.any(self.film_viscosity_uPa_s))

    @property
    def none(self) -> bool:
        """Whether the switch loses nothing but at its impacts."""
        return not (self.moving or np.any(self.adhesion_uN))

    @property
    def damping_ratio(self) -> float | FloatArray:
        """1/Q; 0 where there is no damping."""
        q = np.asarray(self.quality_factor, dtype=np.float64)
        inverse = np.divide(1.0, q, out=np.zeros_like(q), where=q > 0.0)
        return inverse if inverse.ndim else float(inverse)

    def check_rows(self, n: int) -> None:
        """Raise LossesError where an array has not one entry for each of n switches."""
        for name in _BY_SWITCH:
            shape = np.shape(getattr(self, name))
            if shape not in ((), (n,)):
                raise LossesError(f"{name} has shape {shape}; it must be a number or ({n},), one entry a switch")

    def film(self, plate_area_um2: float) -> float | FloatArray:
        """Force of the film times the cube of its thickness over the speed [mN µm³ per µm/µs].

        Reynolds' equation for an incompressible film under a rectangular plate that moves square to it, first order in
        the speed: F = mu L W³ beta(W / L) v / h³ (Bao and Yang, Sensors and Actuators A 136, 2007, eqs. 22-23). The
        thickness h is the gap that is left, G - x.
        """
        side = math.sqrt(plate_area_um2)
        sides = self.film_length_um or side, self.film_width_um or side
        length, width = max(sides), min(sides)
        return 1e-9 * self.film_count * self.film_viscosity_uPa_s * length * width**3 * shape_factor(width / length)

    @property
    def slips(self) -> bool:
        """Whether the film's gas slips: then the force falls short of `film` by a factor of the thickness."""
        return bool(np.any(self.film_viscosity_uPa_s)) and self.film_mean_free_path_um > 0.0

    @property
    def free_path_um(self) -> float:
        """Mean free path at the ambient pressure [µm]."""
        return self.film_mean_free_path_um * 101.325 / self.film_pressure_kPa

    def damping_at_rest(self, switches: FloatArray, plate_area_um2: float) -> FloatArray:
        """1/Q of small motions about rest: the plate's own damping and the film's.

        Parameters
        ----------
        switches : (n, 4) ndarray of float64
            Columns D, G [µm], K [N/m], M [µg].
        plate_area_um2 : float
            Plate area [µm²].

        Returns
        -------
        (n,) ndarray of float64
            1/Q + c / (G³ sqrt(K M)), c that of `film`, less where the gas slips.
        """
        gap = switches[:, 1]
        film = self.film(plate_area_um2) / gap**3 / (1.0 + SLIP * (self.free_path_um / gap) ** SLIP_EXPONENT)
        return np.asarray(self.damping_ratio + film / np.sqrt(1e-3 * switches[:, 2] * switches[:, 3]))


def _wrong_row(values: np.ndarray[Any, Any]) -> str:
    """What is wrong with the entries of one value a switch; nothing where they can be used."""
    if values.ndim != 1 or values.dtype.kind not in "fiu":
        return f" is an array of shape {values.shape} and type {values.dtype}; it must be numbers, one entry a switch"
    bad = np.flatnonzero(~((values >= 0.0) & (values < math.inf)))
    return f" of switch {bad[0] + 1} is {values[bad[0]]!r}; it must be a number, 0 or more" if bad.size else ""


def shape_factor(ratio: float) -> float:
    """beta(W / L) of a rectangular film, from 0.42 of a square to 1 of a long strip; ratio: (0, 1]."""
    odd = np.arange(1.0, 200.0, 2.0)
    return float(1.0 - 192.0 / math.pi**5 * ratio * (np.tanh(0.5 * math.pi * odd / ratio) / odd**5).sum())
