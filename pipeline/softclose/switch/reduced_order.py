"""Owns reduced-order models: a switch of several modes, read from TOML, and its simulation for every switch of a lot.

What a finite-element code exports: modal masses, frequencies, quality factors, the participation of each mode at the
contact and at the electrode, the capacitance over the travel. Mode 1 is the one whose stiffness and mass the population
gives: a switch scales the masses and stiffnesses of all modes alike, so that its modes keep their ratio in frequency
where its thickness and modulus change all of them. A table of capacitance scales with the gap as plates do,
C(x; G) = (G0 / G) C0(x G0 / G).
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, Field
from pydantic.dataclasses import dataclass

from softclose.allowed.refusal import Said
from softclose.allowed.tables import TABLE, Number, checked, refuses_with
from softclose.arrays import FloatArray
from softclose.switch.losses import LEAST_Q
from softclose.tables import at_home, read_tables

MAX_MODES = 32
"""Modes at most: the fastest decides the step."""


RINGING = 0.1
"""What an edge may leave of a step's ringing."""


class ReducedOrderError(ValueError):
    """A reduced-order model that cannot be used."""


def _damped(quality_factor: float) -> float:
    if 0.0 < quality_factor < LEAST_Q:
        raise ReducedOrderError(
            f"quality_factor is {quality_factor:g}; it must be 0 (no damping) or from {LEAST_Q:g} to 1e+09"
        )
    return quality_factor


Numbers = Annotated[tuple[Number, ...], Said("a list of finite numbers")]
Quality = Annotated[
    Number,
    Field(ge=0, le=1e9),
    AfterValidator(_damped),
    Said(f"0 (no damping) or from {LEAST_Q:g} to 1e+09"),
]
Participation = Annotated[Number, Field(ge=-1e6, le=1e6)]


@refuses_with(ReducedOrderError)
@dataclass(frozen=True, slots=True, kw_only=True, config=TABLE)
class Mode:
    """One mode, in any normalisation of its shape."""

    frequency_kHz: Annotated[Number, Field(ge=1e-3, le=1e6)]
    """Natural frequency [kHz]."""
    mass_ug: Annotated[Number, Field(ge=1e-9, le=1e12)] = 1.0
    """Modal mass [µg], of the shape whose values are `contact` and `electrode`."""
    quality_factor: Quality = 0.0
    """Q; 0: no damping."""
    contact: Participation = 1.0
    """Displacement of the contact per unit of the mode's coordinate, towards closing."""
    electrode: Participation = 1.0
    """Mean displacement of the electrode per unit of the mode's coordinate, towards closing."""
    cubic_per_um2: Annotated[Number, Field(ge=0, le=1e6)] = 0.0
    """Stretching, as of a beam fixed at both ends: the mode's force is k (q + cubic q³) [1/µm²]."""


@refuses_with(ReducedOrderError)
@dataclass(frozen=True, slots=True, kw_only=True, config=TABLE)
class Capacitance:
    """Capacitance over the displacement of the electrode, of the nominal device."""

    gap_um: Annotated[Number, Field(ge=1e-3, le=1e6)]
    """Gap of that device [µm]: other gaps are scaled from it."""
    polynomial_fF: Numbers = ()
    """Coefficients of 1, x, x², ... [fF, fF/µm, ...]."""
    valid_um: Numbers = ()
    """Displacements from and to which the polynomial holds [µm]; (): from rest to 0.999 of the gap."""
    travel_um: Numbers = ()
    """Displacements of a table [µm], rising; a cubic spline joins them."""
    capacitance_fF: Numbers = ()
    """Capacitances there [fF]."""

    def __post_init__(self) -> None:
        if bool(self.polynomial_fF) == bool(self.travel_um or self.capacitance_fF):
            raise ReducedOrderError("give either polynomial_fF, or travel_um and capacitance_fF")
        if self.polynomial_fF and len(self.polynomial_fF) < 2:
            raise ReducedOrderError("polynomial_fF has one coefficient; a force takes two or more")
        if not self.polynomial_fF:
            if len(self.travel_um) != len(self.capacitance_fF) or len(self.travel_um) < 4:
                raise ReducedOrderError(
                    f"travel_um has {len(self.travel_um)} entries and capacitance_fF {len(self.capacitance_fF)}; give "
                    "as many of both, 4 or more"
                )
            if not (np.diff(self.travel_um) > 0.0).all():
                raise ReducedOrderError("travel_um must rise from entry to entry")
            if not self.travel_um[0] <= 0.0 < self.travel_um[-1] < self.gap_um:
                raise ReducedOrderError(
                    f"travel_um runs from {self.travel_um[0]:g} to {self.travel_um[-1]:g} µm; it must begin at rest "
                    f"(0) or before, and end within the gap of {self.gap_um:g} µm"
                )
        if self.valid_um and not self.polynomial_fF:
            raise ReducedOrderError("valid_um belongs to polynomial_fF; a table holds from first to last entry")
        if self.valid_um and not (len(self.valid_um) == 2 and self.valid_um[0] <= 0.0 < self.valid_um[1] < self.gap_um):
            raise ReducedOrderError(
                f"valid_um is {list(self.valid_um)}; it must be two displacements, from rest (0) or before to within "
                f"the gap of {self.gap_um:g} µm"
            )
        far = 0.5 * self.gap_um if self.polynomial_fF and not self.valid_um else self.slope()[0][-1]
        if not (self.slope_at(np.linspace(0.0, far, 200)[:-1]) > 0.0).all():
            raise ReducedOrderError(
                "the capacitance falls somewhere between rest and contact, so that a voltage would open the "
                "switch: check the sign of the travel, and noise of the table"
            )

    def slope(self) -> tuple[FloatArray, FloatArray]:
        """dC/dx as a piecewise polynomial: knots (k + 1,) [µm], coefficients (degree + 1, k), highest power first.

        Each cell's is about its lower knot; one cell's alone about 0. It may be asked between the first and the last
        knot: a switch whose electrode leaves them ends with the status LEFT_TABLE.
        """
        if self.polynomial_fF:
            derivative = [j * c for j, c in enumerate(self.polynomial_fF)][1:]
            return np.array(self.valid_um or (0.0, 0.999 * self.gap_um)), np.array(derivative[::-1])[:, None]
        from scipy.interpolate import CubicSpline

        spline = CubicSpline(self.travel_um, self.capacitance_fF).derivative()
        return np.asarray(spline.x), np.ascontiguousarray(spline.c)

    def slope_at(self, x: FloatArray) -> FloatArray:
        """dC/dx [fF/µm] at displacements x [µm] of the nominal device, any shape; NaN where it may not be asked."""
        knots, slopes = self.slope()
        cell = np.clip(np.searchsorted(knots, x, side="right") - 1, 0, slopes.shape[1] - 1)
        s = x if self.polynomial_fF else x - knots[cell]
        value = np.zeros(np.shape(x))
        for row in slopes:
            value = value * s + row[cell]
        return np.where((x >= knots[0]) & (x <= knots[-1]), value, math.nan)


@refuses_with(ReducedOrderError)
@dataclass(frozen=True, slots=True, kw_only=True, config=TABLE)
class Dielectric:
    """A layer on the counter-electrode: the field crosses it, the plate does not. The population's gap is the air's."""

    thickness_um: Annotated[Number, Field(ge=1e-4, le=1e3)]
    """Thickness [µm]."""
    permittivity: Annotated[Number, Field(ge=1, le=1e4)]
    """Relative permittivity."""

    @property
    def gap_um(self) -> float:
        """The gap of air that takes as much voltage [µm]."""
        return self.thickness_um / self.permittivity


@refuses_with(ReducedOrderError)
@dataclass(frozen=True, slots=True, kw_only=True, config=TABLE)
class CompliantContact:
    """Hunt and Crossley's contact, and a dashpot: force d^exponent (1 + loss d') + dashpot d' at the depth d, never
    pulling. An exponent of 1 with a dashpot alone is the linear contact."""

    force_at_1_um_uN: Annotated[Number, Field(ge=1, le=1e12)]
    """Force of a contact that is pressed in by 1 µm, slowly [µN]; of a linear spring its stiffness in N/m."""
    exponent: Annotated[Number, Field(ge=1, le=3)] = 1.5
    """1: a spring; 1.5: Hertz."""
    loss_us_per_um: Annotated[Number, Field(ge=0, le=1e3)] = 0.0
    """Hunt and Crossley's damping [µs/µm]; about 1.5 (1 - e) / v for restitution e at the speed v."""
    dashpot_uN_s_per_m: Annotated[Number, Field(ge=0, le=1e12)] = 0.0
    """Dashpot [µN s/m]: 2 zeta sqrt(stiffness x mass) for the damping ratio zeta."""


@refuses_with(ReducedOrderError)
@dataclass(frozen=True, slots=True, kw_only=True, config=TABLE)
class ReducedOrder:
    """A switch of several modes."""

    mode: tuple[Mode, ...] = ()
    """The modes, from one to 32, that of the population's K and M first."""
    name: str = "reduced-order model"
    """What reports call it."""
    capacitance: Capacitance | None = None
    """None: parallel plates of the campaign's area."""
    dielectric: Dielectric | None = None
    """None: bare metal."""
    contact: CompliantContact | None = None
    """None: a rigid contact with the campaign's restitution."""

    def __post_init__(self) -> None:
        if not 1 <= len(self.mode) <= MAX_MODES:
            raise ReducedOrderError(f"{len(self.mode)} modes; give from 1 to {MAX_MODES}, each as [[mode]]")
        first = self.mode[0]
        if first.contact <= 0.0 or first.electrode <= 0.0:
            raise ReducedOrderError(
                f"mode 1 moves the contact by {first.contact:g} and the electrode by {first.electrode:g}; both must be "
                "above 0: list the mode that closes the switch first, with the sign that closes it"
            )
        if self.dielectric is not None and self.capacitance is not None:
            raise ReducedOrderError("[dielectric] has no place beside [capacitance], which says what it does")

    def ratios(self) -> FloatArray:
        """(n_modes, 6): mass and (k/m) as parts of mode 1's, 1/Q, participation of contact and of electrode, cubic
        stiffness over stiffness [1/µm²], where mode 1 moves the contact by 1."""
        unit = self.mode[0].contact
        first = self.mode[0]
        reference = first.mass_ug / unit**2
        rows = []
        for number, m in enumerate(self.mode):
            scale = unit if number == 0 else 1.0
            damping = 1.0 / m.quality_factor if m.quality_factor else 0.0
            rows.append(
                [
                    m.mass_ug / scale**2 / reference,
                    (m.frequency_kHz / first.frequency_kHz) ** 2,
                    damping,
                    m.contact / scale,
                    m.electrode / scale,
                    m.cubic_per_um2 / scale**2,
                ]
            )
        return np.array(rows)

    @property
    def least_rise_us(self) -> float:
        """Rise [µs] above which an edge leaves at most a tenth of a step's ringing in the slowest mode above the first.

        0 where there is no such mode. The force is that of u²: of an edge of Eqs. 12-13, u(t) ~ 1 - cos(pi t / tr), its
        content at the frequency f is sqrt((cos(pi w / 2) / (1 - w²))² + (sin(pi w / 2) / (4 - w²))²) of a step's with
        w = 2 f tr, at most 1 / (w² - 4) where w > 2.
        """
        higher = [m.frequency_kHz for m in self.mode[1:]]
        return 1e3 * math.sqrt(4.0 + 1.0 / RINGING) / (2.0 * min(higher)) if higher else 0.0

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers and texts; a campaign stores this."""
        data = asdict(self)
        return {k: _plain(v) for k, v in data.items() if v is not None}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> ReducedOrder:
        """Inverse of `to_dict`, and the reader of a file. Raises ReducedOrderError naming the key."""
        return checked(cls, data, ReducedOrderError)


def read_reduced_order(path: str | Path) -> ReducedOrder:
    """Read a model's TOML file.

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    ReducedOrder

    Raises
    ------
    ReducedOrderError
        Naming the file and what is wrong in it.
    """
    if not isinstance(path, str | os.PathLike):
        raise ReducedOrderError(f"{path!r} is no file; give the path of a TOML file")
    tables = read_tables(at_home(path), "the reduced-order model", ReducedOrderError)
    try:
        return ReducedOrder.from_dict(tables)
    except ReducedOrderError as e:
        raise ReducedOrderError(f"{path}: {e}") from e


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {k: _plain(v) for k, v in value.items() if v != ()}
    return [_plain(v) for v in value] if isinstance(value, list | tuple) else value


ONE_MODE = ReducedOrder(mode=(Mode(frequency_kHz=20.0),))
"""Eqs. 1-2: a lot's K and M say everything of one mode."""
