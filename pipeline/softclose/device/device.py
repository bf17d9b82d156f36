"""Owns a device: a device model with everything that it is told. A lot and its drives go in, responses come out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import partial, reduce
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BaseModel

from softclose.arrays import FloatArray
from softclose.device.drives import Drives, product
from softclose.device.protocol import load_model
from softclose.device.scaled import Simulate, by_equal_switches, drive_by_drive
from softclose.plugins import MEASURED, REDUCED_ORDER, SINGLE_MODE, ModelError
from softclose.population.lot import Lot
from softclose.switch import plate, statics
from softclose.switch.losses import Losses
from softclose.switch.reduced_order import ONE_MODE, ReducedOrder
from softclose.waveform import AnyDrive, Trace, Waveform
from softclose.waveform.scales import Scales

if TYPE_CHECKING:
    from softclose.device.simulate import Responses


RAMP_PERIODS = 60.0
"""Periods of the slowest switch in which a ramp reaches its pull-in voltage: inertia lets each close some 2 % late."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Device:
    """A device model, its settings and the end of the simulation."""

    name: str
    """Which model; see `softclose.plugins.MODELS`."""
    horizon_us: float
    """End of the simulation [µs]; where times of a drive are scaled, that of its switch is scaled too."""
    restitution: float
    """Coefficient of restitution."""
    plate_area_um2: float
    """Plate area [µm²]."""
    rtol: float
    """Tolerance of the integrator."""
    method: str
    """Integrator."""
    losses: Losses
    """Of the shipped models."""
    options: BaseModel | None = None
    """Settings of an installed model's own; None for a model that has none."""
    modes: ReducedOrder | None = None
    """Of the reduced-order model."""

    @property
    def scales(self) -> bool:
        """Whether a scaled drive is the common one on another switch: Eqs. 1-2 scale, losses and modes do not."""
        return self.name == SINGLE_MODE and self.losses.none

    def respond(self, lot: Lot, drives: Drives, *, max_volts: float = math.inf, **outputs: Any) -> Responses:
        """What each switch of a lot does under its drive.

        Parameters
        ----------
        lot : Lot
            n switches.
        drives : Drives
            Their drives.
        max_volts : float
            A command above it is a WaveformError [V]; what is scaled or delivered of one within is simulated.
        outputs : dict
            `times_us`, `max_impacts`, `dtype` and `threads` of the device model.

        Returns
        -------
        Responses
            (n,) each; of a switch that could not be integrated nothing but its status.
        """
        switches = lot.switches
        own: dict[str, Any] = {} if self.options is None else {"options": self.options}
        simulate: Simulate = partial(
            load_model(self.name),
            restitution=self.restitution,
            plate_area_um2=self.plate_area_um2,
            rtol=self.rtol,
            method=self.method,
            **{"horizon_us": self.horizon_us} | own | self._own() | outputs,
        )
        command, delivery = drives.command, drives.delivery
        as_commanded = drives.in_between is None
        if not (drives.is_common and as_commanded):  # else the model looks for itself
            command.check(max_volts, self.horizon_us)
            max_volts = math.inf
        simulate = partial(simulate, max_volts=max_volts)
        common = drives.delivered(self.horizon_us)
        if drives.is_common:
            return simulate(switches, common)
        volts, times = product(drives.volts, drives.gain), drives.times
        if volts is None or (volts > 0.0).all():
            # Behind a low-pass times do not scale, volts do: of twice the command twice the volts.
            if self.scales and (as_commanded or (times is None and delivery is not None and delivery.is_linear)):
                ones = np.ones(len(lot))
                scales = Scales(volts=ones if volts is None else volts, times=ones if times is None else times)
                return by_equal_switches(simulate, switches, common, scales)
            form: AnyDrive | None = command
            if not as_commanded and delivery is not None and isinstance(command, Waveform):
                form = delivery.closed_form(command)
            if self.method == "taylor" and form is not None and self._in_series():
                return simulate(switches, form, drive_volts=volts, drive_times=times)
        return drive_by_drive(simulate, switches, drives, horizon_us=self.horizon_us, times_us=outputs.get("times_us"))

    def closing_voltage(self, switches: ArrayLike) -> FloatArray:
        """Slowly raised voltage at which each switch closes in this device model [V].

        By statics of the shipped models; a model of somebody else's is asked by a slow ramp.

        switches: (n, 4) D, G [µm], K [N/m], M [µg]; returns (n,).
        """
        table = np.asarray(switches, dtype=np.float64).reshape(-1, 4)
        if self.modes is not None:
            return statics.closing_voltage(table, self.modes, self.plate_area_um2)
        if self.name in (SINGLE_MODE, MEASURED):
            return plate.closing_voltage(table, self.plate_area_um2)
        return self._closing_on_a_ramp(table)

    def holding_voltage(self, switches: ArrayLike, *, sticks: bool = True) -> FloatArray:
        """Smallest voltage that holds each closed switch [V]; NaN for a model of somebody else's.

        switches: (n, 4) D, G [µm], K [N/m], M [µg]; sticks: with the contact's adhesion; returns (n,).
        """
        table = np.asarray(switches, dtype=np.float64).reshape(-1, 4)
        modes = self.modes or ONE_MODE
        if self.name not in (SINGLE_MODE, REDUCED_ORDER, MEASURED):
            return np.full(len(table), math.nan)
        adhesion = float(np.max(self.losses.adhesion_uN)) if sticks else 0.0
        return statics.holding_voltage(table, modes, self.plate_area_um2, adhesion)

    def contact_force(self, switches: ArrayLike, volts: ArrayLike) -> FloatArray:
        """Force on each closed contact at rest under a voltage [µN]; NaN for a model of somebody else's.

        switches: (n, 4) D, G [µm], K [N/m], M [µg]; volts: (n,) [V]; returns (n,).
        """
        table = np.asarray(switches, dtype=np.float64).reshape(-1, 4)
        if self.name not in (SINGLE_MODE, REDUCED_ORDER, MEASURED):
            return np.full(len(table), math.nan)
        return statics.contact_force(table, volts, self.modes or ONE_MODE, self.plate_area_um2)

    def _closing_on_a_ramp(self, table: FloatArray) -> FloatArray:
        """First contact under a voltage that rises over `RAMP_PERIODS` of the slowest switch."""
        guess = plate.closing_voltage(table, self.plate_area_um2)
        period = 1e3 / float(plate.resonance(table).min())
        for reach in (1.5, 4.0, 12.0):
            volts, rise = reach * float(guess.max()), RAMP_PERIODS * reach * period
            ramp = Drives(command=Trace([0.0, rise], [0.0, volts]))
            slow = replace(self, horizon_us=rise)
            first = slow.respond(Lot.of(table), ramp).first_contact_us
            if np.isfinite(first).all():
                return np.asarray(volts * first / rise)
        raise ModelError(
            f"the device model {self.name!r} leaves {int((~np.isfinite(first)).sum())} of {len(table)} switches open "
            f"on a ramp up to {volts:.4g} V: there is no pull-in voltage to scale drives by"
        )

    def _in_series(self) -> bool:
        """Whether a Taylor kernel simulates it, which scales the command of each switch itself."""
        if self.name not in (SINGLE_MODE, REDUCED_ORDER):
            return False
        from softclose.kernel.dispatch import in_series  # here: whoever only reads a configuration needs no compiler

        return in_series(self.modes, self.losses)

    def _own(self) -> dict[str, Any]:
        """What only the shipped models take: losses where there are any, and modes."""
        settings: dict[str, Any] = {} if self.losses.none else {"losses": self.losses}
        if self.modes is not None:
            settings["modes"] = self.modes
        return settings


def joined(parts: Sequence[Responses]) -> Responses:
    """Responses of several lots, one after the other."""
    if len(parts) == 1:
        return parts[0]
    found = {
        f.name: np.concatenate([np.asarray(getattr(part, f.name)) for part in parts])
        for f in fields(parts[0])
        if f.name != "times_us" and getattr(parts[0], f.name) is not None
    }
    return replace(parts[0], **found)


def worse(a: Responses, b: Responses) -> Responses:
    """Of each switch the response with the larger V, closed only if closed in both; the settling time is the later one.

    What else is told of a switch (impacts, motion) is that of the response with the larger V; of equals the first.
    """
    va, vb = np.asarray(a.max_contact_speed), np.asarray(b.max_contact_speed)
    second = (vb > va) | (np.isnan(va) & ~np.isnan(vb))

    def chosen(of_a: Any, of_b: Any) -> Any:
        if of_a is None:
            return None
        first, other = np.asarray(of_a), np.asarray(of_b)
        return np.where(second.reshape(-1, *[1] * (first.ndim - 1)), other, first)

    found = {f.name: chosen(getattr(a, f.name), getattr(b, f.name)) for f in fields(a) if f.name != "times_us"}
    found |= {
        "closed": np.asarray(a.closed) & np.asarray(b.closed),
        "settling_us": np.maximum(a.settling_us, b.settling_us),
        "status": np.maximum(a.status, b.status),
        "times_us": a.times_us,
    }
    return type(a)(**found)


def worst(each: list[Responses]) -> Responses:
    """Of each switch its worst response of several; see `worse`. Of a switch that failed in any nothing is told."""
    return reduce(worse, each)
