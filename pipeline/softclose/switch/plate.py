"""Owns the algebra of the switch plate: Eqs. 3-6, from geometry and modulus to stiffness, mass and pull-in voltage.

Units: D, G, T and x in µm, E in GPa, K in N/m, M in µg, plate area in µm², volts.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from softclose.arrays import FloatArray

EPSILON_0 = 8.8541878128e-12
"""Permittivity of the gap [F/m]."""
V_STICK = 1e-5
"""Speed of a rebound below which a switch whose force presses stays closed [µm/µs]."""
PLATE_AREA_UM2 = 16700.0
"""Default plate area a [µm²]: the value at which a 100 V step gives the published mean V."""


class Switches(np.ndarray[tuple[int, int], np.dtype[np.float64]]):
    """(n, 4) D, G [µm], K [N/m], M [µg] with the plate area that they belong to; its rows and copies keep it.

    To numpy it is an array as any other. What computes with an area asks for it here, so that switches of one area are
    not taken for those of another.
    """

    plate_area_um2: float | None

    def __array_finalize__(self, obj: object) -> None:
        self.plate_area_um2 = getattr(obj, "plate_area_um2", None)

    @classmethod
    def of(cls, table: FloatArray, plate_area_um2: float) -> Switches:
        """The table with its area [µm²]."""
        found = table.view(cls)
        found.plate_area_um2 = plate_area_um2
        return found


class OtherAreaError(ValueError):
    """Switches of one plate area that are to be computed with another."""


def plate_area_of(switches: object, asked_um2: float | None = None) -> float:
    """Plate area to compute switches with: their own, else what is asked for, else that of Table 1.

    Parameters
    ----------
    switches : Lot, Switches, Population or array-like
        With their own in `plate_area_um2`, or without.
    asked_um2 : float, optional
        What is asked for [µm²].

    Returns
    -------
    float
        Plate area [µm²].

    Raises
    ------
    OtherAreaError
        Where both are given and differ.
    """
    own: float | None = getattr(switches, "plate_area_um2", None)
    if own is None:
        return PLATE_AREA_UM2 if asked_um2 is None else float(asked_um2)
    if asked_um2 is not None and not np.isclose(asked_um2, own, rtol=1e-9, atol=0.0):
        raise OtherAreaError(
            f"the plate area is given as {asked_um2:g} µm², and the switches are of a population of {own:g} µm²: "
            "leave it out"
        )
    return own


A1 = 3.1458
"""Eq. 4 [µm]; the fit is of plates 5 to 9 µm thick."""
A2 = 0.027186
"""Eq. 4 [N/m per GPa µm²]."""
B0 = 0.43613
"""Eq. 5 [µm]."""
B1 = 311.79
"""Eq. 5 [Hz per sqrt(GPa) µm]."""
KG_TO_UG = 1e9


def stiffness(modulus_GPa: ArrayLike, thickness_um: ArrayLike) -> FloatArray:
    """Effective stiffness K [N/m] of Eq. 4; broadcasts."""
    t = np.asarray(thickness_um, dtype=np.float64)
    return np.asarray(A2 * np.asarray(modulus_GPa, dtype=np.float64) * t * (t - A1))


def modulus(stiffness_N_per_m: ArrayLike, thickness_um: ArrayLike) -> FloatArray:
    """Modulus E [GPa] that gives this stiffness: Eq. 4 solved for E; broadcasts."""
    t = np.asarray(thickness_um, dtype=np.float64)
    return np.asarray(np.asarray(stiffness_N_per_m, dtype=np.float64) / (A2 * t * (t - A1)))


def mass(thickness_um: ArrayLike) -> FloatArray:
    """Effective mass M [µg] of Eq. 6, which does not depend on E; any shape."""
    t = np.asarray(thickness_um, dtype=np.float64)
    return np.asarray(KG_TO_UG * A2 * t * (t - A1) / (2.0 * np.pi * B1 * (t + B0)) ** 2)


def frequency(modulus_GPa: ArrayLike, thickness_um: ArrayLike) -> FloatArray:
    """Frequency of the plate's bounce mode [Hz], Eq. 5; broadcasts."""
    t = np.asarray(thickness_um, dtype=np.float64)
    return np.asarray(np.sqrt(np.asarray(modulus_GPa, dtype=np.float64)) * B1 * (t + B0))


def pull_in_voltage(switches: ArrayLike, plate_area_um2: float | None = None) -> FloatArray:
    """Static pull-in voltage U_pi [V], Eq. 3.

    switches: (..., 4) columns D, G [µm], K [N/m], M [µg]; returns shape (...). plate_area_um2: see `plate_area_of`.
    """
    s, area = np.asarray(switches, dtype=np.float64), plate_area_of(switches, plate_area_um2)
    return np.asarray(np.sqrt(8e-6 * s[..., 2] * s[..., 1] ** 3 / (27.0 * EPSILON_0 * area)))


def closing_voltage(switches: ArrayLike, plate_area_um2: float | None = None) -> FloatArray:
    """Slowly raised voltage at which a switch closes [V].

    It is the pull-in voltage (Eq. 3) where the travel goes beyond G/3, else what holds the plate at the contact.

    switches: (..., 4) columns D, G [µm], K [N/m], M [µg]; returns shape (...). Independent of the mass.
    """
    s = np.asarray(switches, dtype=np.float64)
    area = plate_area_of(switches, plate_area_um2)
    beyond = s[..., 0] > s[..., 1] / 3.0
    return np.where(beyond, pull_in_voltage(s, area), holding_voltage(s, area))


def resonance(switches: ArrayLike) -> FloatArray:
    """First resonance of a switch at rest [kHz]: √(K / M) / 2π.

    switches: (..., 4) columns D, G [µm], K [N/m], M [µg]; returns shape (...).
    """
    s = np.asarray(switches, dtype=np.float64)
    return np.asarray(np.sqrt(s[..., 2] / s[..., 3] * KG_TO_UG) / (2e3 * np.pi))


def stiffness_from_pull_in(volts: ArrayLike, gap_um: ArrayLike, plate_area_um2: float = PLATE_AREA_UM2) -> FloatArray:
    """Stiffness K [N/m] of a plate that pulls in at this voltage: Eq. 3 solved for K; broadcasts."""
    u = np.asarray(volts, dtype=np.float64)
    g = np.asarray(gap_um, dtype=np.float64)
    return np.asarray(27.0 * EPSILON_0 * plate_area_um2 * u**2 / (8e-6 * g**3))


def holding_voltage(switches: ArrayLike, plate_area_um2: float | None = None) -> FloatArray:
    """Smallest voltage that holds a closed switch [V]: c (u/(G-D))² = k D.

    switches: (..., 4) columns D, G [µm], K [N/m], M [µg]; returns shape (...). Independent of the mass.
    """
    s = np.asarray(switches, dtype=np.float64)
    area = plate_area_of(switches, plate_area_um2)
    d, g, k = s[..., 0], s[..., 1], s[..., 2]
    return np.asarray((g - d) * np.sqrt(2e-6 * k * d / (EPSILON_0 * area)))
