"""Owns the statics behind a closed contact: up to which voltage the electrode stays off its counter-electrode.

A closed contact fixes one point of the switch. The electrode, which moves with the modes, goes on towards its
counter-electrode, and above a voltage no position of rest is left for it: it collapses.
"""

from __future__ import annotations

import math

import numpy as np

from softclose.arrays import FloatArray
from softclose.switch.reduced_order import ReducedOrder
from softclose.switch.statics import compliances, pull

_LOOKS = 400
"""Positions of the electrode between contact and counter-electrode that are looked at."""
_CLOSEST = 1e-3
"""Part of the way to the counter-electrode at which the look ends."""


def collapse_voltage(switches: FloatArray, modes: ReducedOrder, plate_area_um2: float) -> FloatArray:
    """Slowly raised voltage at which the electrode of a closed switch collapses [V]; inf where none does it.

    The springs push the electrode back with F(x), the voltage pulls it with u² e(x): the largest u that is borne is the
    maximum of sqrt(F / e) over the electrode's positions x behind the contact. Beyond the end of a table of capacitance
    nothing is known: the maximum is that of its range. A drive that swings collapses a switch at less; stretching,
    which is left out, holds it to more.

    switches: (n, 4) columns D, G [µm], K [N/m], M [µg]; returns (n,). Independent of the mass.
    """
    table = np.asarray(switches, dtype=np.float64)
    travel, gap = table[:, :1], table[:, 1:2]
    cc, ce, ee = compliances(table, modes)
    if modes.contact is None and (cc * ee - ce * ce <= 1e-12 * cc * ee).all():
        return np.full(len(table), math.inf)  # the electrode moves with the contact alone
    at_contact = modes.ratios()[0, 4] * travel
    x = at_contact + (1.0 - _CLOSEST) * (gap - at_contact) * np.linspace(0.0, 1.0, _LOOKS)
    per_volt, back = pull(x, gap, modes, plate_area_um2), _reaction(x, travel, cc, ce, ee, modes)
    borne = np.where(np.isfinite(per_volt) & (back > 0.0), back / per_volt, 0.0)
    return np.asarray(np.sqrt(borne.max(axis=1)))


def _reaction(
    x: FloatArray, travel: FloatArray, cc: FloatArray, ce: FloatArray, ee: FloatArray, modes: ReducedOrder
) -> FloatArray:
    """Force P [mN] with which springs and contact hold the electrode off at its positions x [µm].

    With the contact's force R: x = ee P - ce R, and the contact is at ce P - cc R.
    """
    c = modes.contact
    if c is None:  # R keeps the contact at the travel
        return np.asarray((x - ce / cc * travel) / (ee - ce * ce / cc))
    low, high = np.zeros_like(x), np.broadcast_to(10.0 * np.maximum(x, travel), x.shape).copy()
    for _ in range(60):  # R = k d^n grows with the depth d, and what is left of the contact's way shrinks
        depth = 0.5 * (low + high)
        reaction = 1e-3 * c.force_at_1_um_uN * depth**c.exponent
        beyond = ce * (x + ce * reaction) / ee - cc * reaction > travel + depth
        low, high = np.where(beyond, depth, low), np.where(beyond, high, depth)
    return np.asarray((x + ce * (1e-3 * c.force_at_1_um_uN * low**c.exponent)) / ee)
