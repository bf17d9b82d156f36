"""Owns the statics of a switch of several modes: at which voltage it closes, until which it holds, how hard it presses.

Slowly raised, the voltage pulls the electrode with P = u² e(y) at its position y, and the modes give way by what they
are compliant; a closed contact pushes back with R. With the springs' compliances at the electrode (ee), at the contact
(cc) and between them (ce): y = ee P - ce R, and the contact is at ce P - cc R. One mode that moves both alike gives
Eq. 3 and the holding voltage of an ideal plate.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from softclose.arrays import FloatArray
from softclose.switch.plate import EPSILON_0
from softclose.switch.reduced_order import ReducedOrder

_LOOKS = 257
"""Positions that are looked at in each pass of a search for a maximum."""
_PASSES = 4
"""Passes, each in the two cells about the best position of the one before: the last is good to 1e-9 of the range."""
_ROUNDS = 50
"""Rounds in which the secants of stretching modes settle."""
_CLOSEST = 1e-3
"""Part of the gap at which a search for a position ends."""


def compliances(
    switches: FloatArray, modes: ReducedOrder, displacements: FloatArray | None = None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """cc, ce and ee: displacement by a force of 1 mN [µm/mN], (n, 1) each.

    switches: (n, 4) D, G [µm], K [N/m], M [µg]; K is the stiffness of the first mode, the others in proportion.
    displacements: (n, n_modes) of the modes [µm]; where they stretch, their secant there counts, at rest without.
    """
    ratios = modes.ratios()
    contact, electrode = ratios[:, 3], ratios[:, 4]
    each = 1.0 / _stiffness(switches, modes, displacements)
    cc, ce, ee = ((each @ w)[:, None] for w in (contact**2, contact * electrode, electrode**2))
    return cc, ce, ee


def _stiffness(switches: FloatArray, modes: ReducedOrder, displacements: FloatArray | None) -> FloatArray:
    """(n, n_modes) stiffness of every mode, its secant at a displacement [mN/µm]."""
    ratios = modes.ratios()
    linear = 1e-3 * switches[:, 2:3] * (ratios[:, 0] * ratios[:, 1])
    return linear if displacements is None else linear * (1.0 + ratios[:, 5] * displacements**2)


def _given_way(force: FloatArray, stiffness: FloatArray, cubic: FloatArray) -> FloatArray:
    """Displacement q of k (q + cubic q³) = force, any shape: Cardano's one real root, in its hyperbolic form."""
    linear = force / stiffness
    with np.errstate(divide="ignore", invalid="ignore"):
        r = np.sqrt(3.0 * cubic)
        stretched = 2.0 / r * np.sinh(np.arcsinh(1.5 * r * linear) / 3.0)
    return np.where(cubic > 0.0, stretched, linear)


def pull(y: FloatArray, gap: FloatArray, modes: ReducedOrder, plate_area_um2: float) -> FloatArray:
    """Electrostatic force over the voltage squared [mN/V²] at positions of the electrode [µm]; NaN where not known."""
    c = modes.capacitance
    if c is None:
        coat = modes.dielectric.gap_um if modes.dielectric else 0.0
        return np.asarray(0.5e3 * EPSILON_0 * plate_area_um2 / (gap + coat - y) ** 2)
    shrink = c.gap_um / gap
    return np.asarray(0.5e-6 * c.slope_at(y * shrink) * shrink * shrink)


def closing_voltage(switches: ArrayLike, modes: ReducedOrder, plate_area_um2: float) -> FloatArray:
    """Slowly raised voltage at which a switch closes [V]: it pulls in on its way, or is pulled to the contact.

    The largest voltage that any position between rest and contact can bear: sqrt(y / (ee e(y))).

    Parameters
    ----------
    switches : (n, 4) array-like of float64
        Columns D, G [µm], K [N/m], M [µg].
    modes : ReducedOrder
        Its modes and capacitance.
    plate_area_um2 : float
        Area of parallel plates [µm²], where there is no capacitance of its own.

    Returns
    -------
    (n,) ndarray of float64
        Independent of the mass. Infinite where the electrode's pull does not move the contact towards closing.
    """
    s = np.asarray(switches, dtype=np.float64).reshape(-1, 4)
    ratios, gap = modes.ratios(), s[:, 1:2]
    stiffness = _stiffness(s, modes, None)
    _, ce, _ = compliances(s, modes)

    def moved(force: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Contact and electrode [µm] under a force on the electrode [mN], (n, k)."""
        q = _given_way(force[..., None] * ratios[:, 4], stiffness[:, None, :], ratios[:, 5])
        return q @ ratios[:, 3], q @ ratios[:, 4]

    # The force that brings the contact to the travel, or the electrode to its counter-electrode, by halving.
    low, high = np.zeros((len(s), 1)), np.full((len(s), 1), 1e-3)
    closest = (1.0 - _CLOSEST) * gap
    for _ in range(60):
        x, y = moved(high)
        high = np.where((x < s[:, :1]) & (y < closest), 4.0 * high, high)
    for _ in range(80):
        middle = 0.5 * (low + high)
        x, y = moved(middle)
        short = (x < s[:, :1]) & (y < closest)
        low, high = np.where(short, middle, low), np.where(short, high, middle)
    low, high, best = np.zeros_like(high), low, np.zeros_like(high)
    for _ in range(_PASSES):
        force = low + (high - low) * np.linspace(0.0, 1.0, _LOOKS)
        _, y = moved(force)
        with np.errstate(invalid="ignore", divide="ignore"):
            borne = force / pull(y, gap, modes, plate_area_um2)
        borne = np.where(np.isfinite(borne), borne, 0.0)
        k = borne.argmax(axis=1)[:, None]
        best = np.maximum(best, np.take_along_axis(borne, k, axis=1))
        low, high = (np.take_along_axis(force, np.clip(k + d, 0, _LOOKS - 1), axis=1) for d in (-1, 1))
    return np.where(ce[:, 0] > 0.0, np.sqrt(best[:, 0]), math.inf)


def holding_voltage(
    switches: ArrayLike, modes: ReducedOrder, plate_area_um2: float, adhesion_uN: float = 0.0
) -> FloatArray:
    """Smallest voltage that holds a closed switch with a rigid contact [V]; 0 where adhesion alone does.

    The contact lets go where R falls to minus the adhesion; the electrode is then at y = ee P - ce R.

    switches: (n, 4) D, G [µm], K [N/m], M [µg]; returns (n,).
    """
    s = np.asarray(switches, dtype=np.float64).reshape(-1, 4)
    reaction, ratios, q = -1e-3 * adhesion_uN, modes.ratios(), _at_contact(s, modes)
    for _ in range(_ROUNDS if ratios[:, 5].any() else 1):  # a mode that does not stretch has one stiffness
        cc, ce, ee = compliances(s, modes, q)
        force = (s[:, :1] + cc * reaction) / ce
        q = (ratios[:, 4] * force - ratios[:, 3] * reaction) / _stiffness(s, modes, q)
    y = ee * force - ce * reaction
    with np.errstate(invalid="ignore"):
        square = force / pull(y, s[:, 1:2], modes, plate_area_um2)
    return np.sqrt(np.maximum(square, 0.0))[:, 0]


def _at_contact(switches: FloatArray, modes: ReducedOrder) -> FloatArray:
    """(n, n_modes) displacements of a closed switch to begin with: the first mode takes the contact to the travel."""
    q = np.zeros((len(switches), len(modes.mode)))
    q[:, 0] = switches[:, 0]
    return q


def contact_force(switches: ArrayLike, volts: ArrayLike, modes: ReducedOrder, plate_area_um2: float) -> FloatArray:
    """Force with which a closed switch presses on its rigid contact under a voltage at rest [µN].

    Negative where the voltage does not hold it; NaN where the electrode finds no rest behind the contact (it
    collapses), or its capacitance is not known.

    switches: (n, 4) D, G [µm], K [N/m], M [µg]; volts: (n,) [V]; returns (n,).
    """
    s = np.asarray(switches, dtype=np.float64).reshape(-1, 4)
    u = np.broadcast_to(np.asarray(volts, dtype=np.float64), (len(s),))[:, None]
    travel, gap, ratios, q = s[:, :1], s[:, 1:2], modes.ratios(), _at_contact(s, modes)
    cc, ce, ee = compliances(s, modes, q)
    y = travel * ce / cc
    for _ in range(200):  # from the contact's own position on the rest is approached from below
        with np.errstate(invalid="ignore"):
            force = np.where(y < gap, u * u * pull(y, gap, modes, plate_area_um2), math.nan)
            reaction = (ce * force - travel) / cc
            y = ee * force - ce * reaction
            q = (ratios[:, 4] * force - ratios[:, 3] * reaction) / _stiffness(s, modes, q)
        cc, ce, ee = compliances(s, modes, q)
    return (1e3 * reaction)[:, 0]
