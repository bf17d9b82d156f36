"""Owns how a switch follows from a lot's parameters: Eqs. 4-6 of the plate, or what was measured or computed itself.

Each law names the two variables that stand beside D and G, and gives K and M from all four.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from softclose.arrays import FloatArray
from softclose.switch.plate import KG_TO_UG, mass, stiffness, stiffness_from_pull_in


@dataclass(frozen=True, slots=True, kw_only=True)
class Law:
    """Stiffness [N/m] and mass [µg] from G [µm], the law's two variables and the plate's area [µm²]."""

    variables: tuple[str, str]
    """The two variables beside D and G."""
    switch: Callable[[FloatArray, FloatArray, FloatArray, float], tuple[FloatArray, FloatArray]]
    """(G, first, second, area) -> (K, M)."""
    rests_on_area: bool = False
    """Whether the area decides K."""
    rests_on_gap: bool = False
    """Whether G decides K or M."""


def mass_from_frequency(stiffness_N_per_m: FloatArray, frequency_kHz: FloatArray) -> FloatArray:
    """M [µg] of a switch with this stiffness and resonance: K / (2 pi f)²; broadcasts."""
    return KG_TO_UG * stiffness_N_per_m / (2e3 * np.pi * frequency_kHz) ** 2


def _from_pull_in(g: FloatArray, u: FloatArray, f: FloatArray, area: float) -> tuple[FloatArray, FloatArray]:
    k = stiffness_from_pull_in(u, g, area)
    return k, mass_from_frequency(k, f)


LAWS: Mapping[tuple[str, str], Law] = {
    law.variables: law
    for law in (
        Law(variables=("E", "T"), switch=lambda g, e, t, area: (stiffness(e, t), mass(t))),
        Law(variables=("K", "M"), switch=lambda g, k, m, area: (k, m)),
        Law(variables=("K", "f"), switch=lambda g, k, f, area: (k, mass_from_frequency(k, f))),
        Law(variables=("U_pi", "f"), switch=_from_pull_in, rests_on_area=True, rests_on_gap=True),
    )
}
"""By their variables: the plate's modulus and thickness; stiffness and mass; stiffness and resonance; pull-in voltage
(Eq. 3 solved for K) and resonance."""

UNITS = {"D": "µm", "G": "µm", "E": "GPa", "T": "µm", "K": "N/m", "M": "µg", "f": "kHz", "U_pi": "V"}
"""Every variable that a lot may have, and its unit."""
