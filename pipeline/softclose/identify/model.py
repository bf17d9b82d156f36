"""Owns what a device model says of readings: each parameter by its name, what it changes, and the readings it gives."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from softclose.arrays import FloatArray
from softclose.device.device import Device
from softclose.device.drives import Drives
from softclose.identify.readings import Dynamics, Motion, Reading, ReadingKind
from softclose.population.lot import Lot
from softclose.population.measurements import MeasurementError
from softclose.waveform import Pulse, Trace, Waveform

PARAMETERS: dict[str, tuple[str, str]] = {
    "K": ("N/m", "stiffness"),
    "M": ("µg", "effective mass"),
    "Q": ("", "quality factor of the damping that is no film"),
    "film": ("", "film's damping over the model's own"),
    "force": ("", "electrostatic force (area, capacitance) over the model's own"),
    "restitution": ("", "coefficient of restitution"),
}
"""Name -> unit and meaning of everything that can be fitted; each is positive, and fitted by its logarithm."""
LONGER = 4.0
"""Simulated is so many times the latest instant that was measured: a model that is slower still says by how much."""
_LEAST_TRAVEL = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Model:
    """A switch and what simulates it, to begin with."""

    switch: FloatArray
    """(4,) D, G [µm], K [N/m], M [µg]."""
    device: Device
    """Its device model; one that is shipped."""
    rise_us: float = 0.0
    """Rise of the steps that closing times were measured with [µs]; 0: an ideal step."""

    def values(self) -> dict[str, float]:
        """Every parameter that this model has, at its own value."""
        d = self.device
        q = d.modes.mode[0].quality_factor if d.modes is not None else float(np.max(d.losses.quality_factor))
        found = {"K": float(self.switch[2]), "M": float(self.switch[3]), "force": 1.0, "restitution": d.restitution}
        if q:
            found["Q"] = q
        if np.any(d.losses.film_viscosity_uPa_s):
            found["film"] = 1.0
        if d.modes is not None and d.modes.contact is not None:
            del found["restitution"]
        return {name: found[name] for name in PARAMETERS if name in found}

    def at(self, values: Mapping[str, float]) -> tuple[FloatArray, Device]:
        """Switch and device with other values of some parameters."""
        d, v = self.device, self.values() | dict(values)
        switch = np.array([self.switch[0], self.switch[1], v["K"], v["M"]])
        losses, modes, side = d.losses, d.modes, math.sqrt(d.plate_area_um2)
        if "film" in v:
            losses = replace(
                losses,
                film_viscosity_uPa_s=np.max(losses.film_viscosity_uPa_s) * v["film"],
                film_length_um=losses.film_length_um or side,
                film_width_um=losses.film_width_um or side,
            )
        if modes is None and "Q" in v:
            losses = replace(losses, quality_factor=v["Q"])
        if modes is not None:
            if "Q" in v:
                modes = replace(modes, mode=(replace(modes.mode[0], quality_factor=v["Q"]), *modes.mode[1:]))
            c = modes.capacitance
            if c is not None:
                scaled = replace(
                    c,
                    polynomial_fF=tuple(x * v["force"] for x in c.polynomial_fF),
                    capacitance_fF=tuple(x * v["force"] for x in c.capacitance_fF),
                )
                modes = replace(modes, capacitance=scaled)
        return switch, replace(
            d,
            losses=losses,
            modes=modes,
            plate_area_um2=d.plate_area_um2 * v["force"],
            restitution=v.get("restitution", d.restitution),
        )

    def residuals(self, values: Mapping[str, float], dynamics: Dynamics) -> FloatArray:
        """(n,) what was measured against what the model says, in errors of each reading: ln(said / measured) of a
        number, the difference of a motion's samples."""
        switch, device = self.at(values)
        said = predicted(switch, device, dynamics.readings, self.rise_us)
        single = [math.log(s / r.value) / r.weighed for s, r in zip(said, dynamics.readings, strict=True)]
        return np.concatenate([single, *(_apart(switch, device, m) for m in dynamics.motions)])


def predicted(switch: FloatArray, device: Device, readings: tuple[Reading, ...], rise_us: float = 0.0) -> list[float]:
    """What a device model says of each reading, in the reading's unit.

    A step that closes nothing has no closing time: four times the latest one that was measured stands for it, longer
    the farther the step is below the static pull-in, so that a fit sees which way is better.
    """
    table = switch[None, :]
    static: dict[ReadingKind, float] = {}
    for reading in readings:
        if reading.volts or reading.kind in static:
            continue
        if reading.kind == "pull-in":
            static["pull-in"] = float(device.closing_voltage(table)[0])
        elif reading.kind == "pull-out":
            static["pull-out"] = max(float(device.holding_voltage(table)[0]), 1e-6)
        else:
            static["resonance"] = 1e3 * math.sqrt(1e-3 * switch[2] / switch[3]) / (2.0 * math.pi)
            own = device.modes.mode[0].quality_factor if device.modes is not None else 0.0
            damping = float(device.losses.damping_at_rest(table, device.plate_area_um2)[0]) + (1.0 / own if own else 0)
            static["quality factor"] = 1.0 / max(damping, 1e-9)
    steps = sorted({r.volts for r in readings if r.volts})
    first, second = _contacts(switch, device, steps, readings, rise_us) if steps else ({}, {})
    return [static[r.kind] if not r.volts else (first if r.kind == "closing" else second)[r.volts] for r in readings]


def _contacts(
    switch: FloatArray, device: Device, steps: list[float], readings: tuple[Reading, ...], rise_us: float
) -> tuple[dict[float, float], dict[float, float]]:
    """First and second contact of each step [µs]."""
    horizon = LONGER * max(r.value for r in readings if r.volts)
    lot = Lot.of(np.tile(switch, (len(steps), 1)))
    unit = Waveform([Pulse(0.0, rise_us, math.inf, 1.0)])
    found = replace(device, horizon_us=horizon).respond(lot, Drives(command=unit, volts=np.array(steps)), max_impacts=2)
    if found.impact_time_us is None:
        raise MeasurementError(
            f"the device model {device.name!r} tells no instants of impacts: contacts cannot be fitted"
        )
    times = np.array(found.impact_time_us, dtype=np.float64)
    short = np.maximum(float(device.closing_voltage(switch[None, :])[0]) / np.array(steps), 1.0)
    times = np.where(np.isnan(times), (horizon * short)[:, None] * [1.0, 2.0], times)
    return dict(zip(steps, times[:, 0].tolist(), strict=True)), dict(zip(steps, times[:, 1].tolist(), strict=True))


def _apart(switch: FloatArray, device: Device, motion: Motion) -> FloatArray:
    """(k,) a motion's samples less the model's, in errors."""
    t, x = motion.times_us[motion.kept], motion.x_um[motion.kept]
    scale = motion.error * max(float(np.abs(x).max()), _LEAST_TRAVEL)
    if motion.volts is None:
        return (_ringing(switch, device, t, x) - x) / scale
    start = min(float(motion.times_us[0]), 0.0)
    drive = Trace(motion.times_us - start, motion.volts)
    slow = replace(device, horizon_us=float(motion.times_us[-1] - start))
    found = slow.respond(Lot.of(switch[None, :]), Drives(command=drive), times_us=t - start)
    said = np.nan_to_num(np.asarray(found.x, dtype=np.float64)[0]) if found.x is not None else np.zeros(t.size)
    return (said - x) / scale


def _ringing(switch: FloatArray, device: Device, t: FloatArray, x: FloatArray) -> FloatArray:
    """The free, small motion nearest to x: offset and both amplitudes follow from frequency and Q by linear least
    squares (variable projection)."""
    (said,) = predicted(switch, device, (Reading(kind="quality factor", value=1.0),))
    omega = math.sqrt(1e-3 * switch[2] / switch[3])
    decay = omega / (2.0 * said)
    ring = omega * math.sqrt(max(1.0 - 0.25 / said**2, 1e-12))
    fading = np.exp(-decay * (t - t[0]))
    basis = np.stack([np.ones(t.size), fading * np.cos(ring * (t - t[0])), fading * np.sin(ring * (t - t[0]))], axis=1)
    weights = np.linalg.lstsq(basis, x, rcond=None)[0]
    return np.asarray(basis @ weights)
