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
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softclose.switch.losses import LEAST_Q
from softclose.tables import at_home, check_keys, finite_number, read_tables

FloatArray = NDArray[np.float64]

MAX_MODES = 32
"""Modes at most: the fastest decides the step."""


RINGING = 0.1
"""What an edge may leave of a step's ringing."""


class ReducedOrderError(ValueError):
    """A reduced-order model that cannot be used."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Mode:
    """One mode, in any normalisation of its shape."""

    frequency_kHz: float
    """Natural frequency [kHz]."""
    mass_ug: float = 1.0
    """Modal mass [µg], of the shape whose values are `contact` and `electrode`."""
    quality_factor: float = 0.0
    """Q; 0: no damping."""
    contact: float = 1.0
    """Displacement of the contact per unit of the mode's coordinate, towards closing."""
    electrode: float = 1.0
    """Mean displacement of the electrode per unit of the mode's coordinate, towards closing."""
    cubic_per_um2: float = 0.0
    """Stretching, as of a beam fixed at both ends: the mode's force is k (q + cubic q³) [1/µm²]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Capacitance:
    """Capacitance over the displacement of the electrode, of the nominal device."""

    gap_um: float
    """Gap of that device [µm]: other gaps are scaled from it."""
    polynomial_fF: tuple[float, ...] = ()
    """Coefficients of 1, x, x², ... [fF, fF/µm, ...]."""
    valid_um: tuple[float, ...] = ()
    """Displacements from and to which the polynomial holds [µm]; (): from rest to 0.999 of the gap."""
    travel_um: tuple[float, ...] = ()
    """Displacements of a table [µm], rising; a cubic spline joins them."""
    capacitance_fF: tuple[float, ...] = ()
    """Capacitances there [fF]."""

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


@dataclass(frozen=True, slots=True, kw_only=True)
class Dielectric:
    """A layer on the counter-electrode: the field crosses it, the plate does not. The population's gap is the air's."""

    thickness_um: float
    """Thickness [µm]."""
    permittivity: float
    """Relative permittivity."""

    @property
    def gap_um(self) -> float:
        """The gap of air that takes as much voltage [µm]."""
        return self.thickness_um / self.permittivity


@dataclass(frozen=True, slots=True, kw_only=True)
class CompliantContact:
    """Hunt and Crossley's contact, and a dashpot: stiffness d^exponent (1 + loss d') + dashpot d' at the depth d, never
    pulling. An exponent of 1 with a dashpot alone is the linear contact."""

    stiffness_N_per_m: float
    """Stiffness [N/m] (with an exponent other than 1 [N/µm^exponent x 1e-6])."""
    exponent: float = 1.5
    """1: a spring; 1.5: Hertz."""
    loss_us_per_um: float = 0.0
    """Hunt and Crossley's damping [µs/µm]; about 1.5 (1 - e) / v for restitution e at the speed v."""
    dashpot_uN_s_per_m: float = 0.0
    """Dashpot [µN s/m]: 2 zeta sqrt(stiffness x mass) for the damping ratio zeta."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReducedOrder:
    """A switch of several modes."""

    mode: tuple[Mode, ...]
    """The modes, that of the population's K and M first."""
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
        for number, mode in enumerate(self.mode, 1):
            where = f"mode {number}: "
            _within(where, "frequency_kHz", mode.frequency_kHz, 1e-3, 1e6)
            _within(where, "mass_ug", mode.mass_ug, 1e-9, 1e12)
            if mode.quality_factor:
                _within(where, "quality_factor", mode.quality_factor, LEAST_Q, 1e9)
            _within(where, "cubic_per_um2", mode.cubic_per_um2, 0.0, 1e6)
            for key in ("contact", "electrode"):
                _within(where, key, getattr(mode, key), -1e6, 1e6)
        first = self.mode[0]
        if first.contact <= 0.0 or first.electrode <= 0.0:
            raise ReducedOrderError(
                f"mode 1 moves the contact by {first.contact:g} and the electrode by {first.electrode:g}; both must be "
                "above 0: list the mode that closes the switch first, with the sign that closes it"
            )
        if self.capacitance is not None:
            _check_capacitance(self.capacitance)
        if self.dielectric is not None:
            _within("[dielectric] ", "thickness_um", self.dielectric.thickness_um, 1e-4, 1e3)
            _within("[dielectric] ", "permittivity", self.dielectric.permittivity, 1.0, 1e4)
            if self.capacitance is not None:
                raise ReducedOrderError("[dielectric] has no place beside [capacitance], which says what it does")
        if self.contact is not None:
            where = "[contact] "
            _within(where, "stiffness_N_per_m", self.contact.stiffness_N_per_m, 1.0, 1e12)
            _within(where, "exponent", self.contact.exponent, 1.0, 3.0)
            _within(where, "loss_us_per_um", self.contact.loss_us_per_um, 0.0, 1e3)
            _within(where, "dashpot_uN_s_per_m", self.contact.dashpot_uN_s_per_m, 0.0, 1e12)

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
        check_keys(data, ("name", "mode", "capacitance", "dielectric", "contact"), "", ReducedOrderError)
        modes = data.get("mode", [])
        if not isinstance(modes, Sequence) or isinstance(modes, str):
            raise ReducedOrderError("modes are tables, each under its own [[mode]]")
        parts: dict[str, Any] = {"mode": tuple(_part(Mode, m, f"mode {i}: ") for i, m in enumerate(modes, 1))}
        if "capacitance" in data:
            parts["capacitance"] = _part(Capacitance, data["capacitance"], "[capacitance] ")
        if "dielectric" in data:
            parts["dielectric"] = _part(Dielectric, data["dielectric"], "[dielectric] ")
        if "contact" in data:
            parts["contact"] = _part(CompliantContact, data["contact"], "[contact] ")
        if "name" in data:
            parts["name"] = str(data["name"])
        return cls(**parts)


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


def _check_capacitance(c: Capacitance) -> None:
    where = "[capacitance] "
    _within(where, "gap_um", c.gap_um, 1e-3, 1e6)
    if bool(c.polynomial_fF) == bool(c.travel_um or c.capacitance_fF):
        raise ReducedOrderError(f"{where}give either polynomial_fF, or travel_um and capacitance_fF")
    if c.polynomial_fF and len(c.polynomial_fF) < 2:
        raise ReducedOrderError(f"{where}polynomial_fF has one coefficient; a force takes two or more")
    if not c.polynomial_fF:
        if len(c.travel_um) != len(c.capacitance_fF) or len(c.travel_um) < 4:
            raise ReducedOrderError(
                f"{where}travel_um has {len(c.travel_um)} entries and capacitance_fF {len(c.capacitance_fF)}; give as "
                "many of both, 4 or more"
            )
        if not (np.diff(c.travel_um) > 0.0).all():
            raise ReducedOrderError(f"{where}travel_um must rise from entry to entry")
        if not c.travel_um[0] <= 0.0 < c.travel_um[-1] < c.gap_um:
            raise ReducedOrderError(
                f"{where}travel_um runs from {c.travel_um[0]:g} to {c.travel_um[-1]:g} µm; it must begin at rest (0) "
                f"or before, and end within the gap of {c.gap_um:g} µm"
            )
    if c.valid_um and not c.polynomial_fF:
        raise ReducedOrderError(f"{where}valid_um belongs to polynomial_fF; a table holds from first to last entry")
    if c.valid_um and not (len(c.valid_um) == 2 and c.valid_um[0] <= 0.0 < c.valid_um[1] < c.gap_um):
        raise ReducedOrderError(
            f"{where}valid_um is {list(c.valid_um)}; it must be two displacements, from rest (0) or before to within "
            f"the gap of {c.gap_um:g} µm"
        )
    far = 0.5 * c.gap_um if c.polynomial_fF and not c.valid_um else c.slope()[0][-1]
    if not (c.slope_at(np.linspace(0.0, far, 200)[:-1]) > 0.0).all():
        raise ReducedOrderError(
            f"{where}the capacitance falls somewhere between rest and contact, so that a voltage would open the "
            "switch: check the sign of the travel, and noise of the table"
        )


def _part(kind: type[Any], data: Any, where: str) -> Any:
    if not isinstance(data, Mapping):
        raise ReducedOrderError(f"{where}{data!r} must be a table of keys")
    known = tuple(kind.__dataclass_fields__)
    check_keys(data, known, where, ReducedOrderError)
    values: dict[str, Any] = {}
    for key, value in data.items():
        listed = isinstance(value, Sequence) and not isinstance(value, str)
        if listed != str(kind.__dataclass_fields__[key].type).startswith("tuple"):
            raise ReducedOrderError(f"{where}{key} is {value!r}; it must be a {'finite number' if listed else 'list'}")
        if listed:
            values[key] = tuple(finite_number(where + key, v, ReducedOrderError) for v in value)
        else:
            values[key] = finite_number(where + key, value, ReducedOrderError)
    try:
        return kind(**values)
    except TypeError as e:
        missing = [n for n, f in kind.__dataclass_fields__.items() if n not in values and f.default is MISSING]
        raise ReducedOrderError(f"{where}{', '.join(missing)} is missing") from e


def _within(where: str, key: str, value: float, low: float, high: float) -> None:
    if not low <= value <= high:
        raise ReducedOrderError(f"{where}{key} is {value:g}; it must be from {low:g} to {high:g}")


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {k: _plain(v) for k, v in value.items() if v != ()}
    return [_plain(v) for v in value] if isinstance(value, list | tuple) else value


ONE_MODE = ReducedOrder(mode=(Mode(frequency_kHz=20.0),))
"""Eqs. 1-2: a lot's K and M say everything of one mode."""
