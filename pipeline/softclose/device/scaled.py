"""Owns responses of switches whose drives differ: by the kernel through equal switches, or drive by drive.

Substituting t = b s in Eq. 1 shows that a switch under a u(t / b) moves as one of stiffness K / a² and mass M / (a b)²
under u(t), b times as slowly. That is the fast way; the plain one, each switch under its own drive, is what it is
checked against.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from softclose.arrays import FloatArray
from softclose.device.drives import Drives
from softclose.waveform import AnyDrive
from softclose.waveform.scales import Scales

if TYPE_CHECKING:
    from softclose.device.simulate import Responses

Simulate = Callable[..., "Responses"]
"""(switches (n, 4), drive, horizon_us, times_us, …) -> responses."""

_TIMES = ("first_contact_us", "settling_us", "impact_time_us")
_SPEEDS = ("max_contact_speed", "final_v", "impact_speed", "v")


def effective(switches: FloatArray, scales: Scales) -> FloatArray:
    """The switches that, driven by the common waveform, move as these do by their own: (n, 4) D, G, K/a², M/(a b)².

    Their travels are the same at times b as large, their speeds b times as large.
    """
    found = np.array(switches[:, :4], dtype=np.float64)
    found[:, 2] /= scales.volts**2
    found[:, 3] /= (scales.volts * scales.times) ** 2
    return found


def by_equal_switches(simulate: Simulate, switches: FloatArray, drive: AnyDrive, scales: Scales) -> Responses:
    """For Eqs. 1-2: the responses of the switches that the common drive moves alike, in these ones' times and speeds.

    Sampled travels and speeds are those at b times the instants asked for; each is seen until b times the horizon.
    """
    found = simulate(effective(switches, scales), drive)
    changed: dict[str, Any] = {}
    for names, factor in ((_TIMES, scales.times), (_SPEEDS, 1.0 / scales.times)):
        for name in names:
            values = getattr(found, name)
            if values is not None:
                by = factor.reshape(-1, *[1] * (values.ndim - 1))
                changed[name] = (values * by).astype(values.dtype)
    return replace(found, **changed)


def drive_by_drive(
    simulate: Simulate, switches: FloatArray, drives: Drives, *, horizon_us: float, times_us: Any = None
) -> Responses:
    """For any device model: each distinct drive by itself, its horizon and sampled instants scaled with its command."""
    n = len(switches)
    ones = np.ones(n)
    factors = np.stack([ones if f is None else f for f in (drives.volts, drives.times, drives.gain)], axis=1)
    each, which = np.unique(factors, axis=0, return_inverse=True)
    order = np.argsort(which.reshape(-1), kind="stable")
    edges = np.searchsorted(which.reshape(-1)[order], np.arange(len(each) + 1))
    columns: dict[str, Any] = {}
    first: Responses | None = None
    for i, (a, b, gain) in enumerate(each):
        rows = order[edges[i] : edges[i + 1]]
        times = None if times_us is None else np.asarray(times_us) * b
        own = drives.delivered(horizon_us * b, a, b, gain)
        found = simulate(switches[rows], own, horizon_us=horizon_us * b, times_us=times)
        first = found if first is None else first
        for field in fields(found):
            values = getattr(found, field.name)
            if values is not None and field.name != "times_us":
                whole = columns.setdefault(field.name, np.empty((n, *values.shape[1:]), values.dtype))
                whole[rows] = values
    assert first is not None
    return replace(first, times_us=None if times_us is None else np.asarray(times_us), **columns)
