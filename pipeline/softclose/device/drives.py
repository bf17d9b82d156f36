"""Owns what drives a lot: one command for all, what differs from switch to switch, and what stands in between.

A condition makes another `Drives` of one. Nothing but the device looks at what became of them all.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, overload

import numpy as np

from softclose.arrays import FloatArray
from softclose.waveform import AnyDrive, Delivered, Drive, Pulse, Trace, Waveform


class Delivery(Protocol):
    """What stands between generator and switch, such as an amplifier."""

    @property
    def is_ideal(self) -> bool:
        """Whether it delivers what is commanded."""

    @property
    def is_linear(self) -> bool:
        """Whether twice the command is delivered as twice the volts."""

    def closed_form(self, command: Waveform) -> Delivered | None:
        """What it delivers of pulses in closed form, which the kernel scales switch by switch; None: it has none."""

    def deliver(self, command: Waveform, horizon_us: float, gain: float) -> AnyDrive:
        """What of a command reaches the switch on [0, horizon], its gain multiplied by another."""

    def deliver_exactly(self, command: Waveform, horizon_us: float, gain: float) -> AnyDrive:
        """The same in closed form: what a kernel reads may be polynomials of the same area."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Drives:
    """The drives of the n switches of a lot under one command."""

    command: Drive
    """A waveform that is commanded; or a trace, which has been delivered already."""
    volts: FloatArray | None = None
    """(n,) what the command's volts are multiplied by; None: 1."""
    times: FloatArray | None = None
    """(n,) what its instants and durations are multiplied by; None: 1."""
    gain: FloatArray | None = None
    """(n,) gain of what delivers it, over the nominal one; None: 1."""
    delivery: Delivery | None = None
    """What delivers it; None: nothing stands in between."""

    @property
    def is_common(self) -> bool:
        """Whether one and the same drive reaches every switch."""
        return self.volts is None and self.times is None and self.gain is None

    @property
    def in_between(self) -> Delivery | None:
        """What changes the command on its way; None where the command itself reaches the switches."""
        if isinstance(self.command, Trace) or self.delivery is None or self.delivery.is_ideal:
            return None
        return self.delivery

    def delivered(self, horizon_us: float, volts: float = 1.0, times: float = 1.0, gain: float = 1.0) -> AnyDrive:
        """What reaches a switch whose command is scaled so; horizon [µs]: of that switch."""
        if isinstance(self.command, Trace) or self.in_between is None:
            return scaled(self.command, volts * gain, times)
        return self.in_between.deliver(scaled(self.command, volts, times), horizon_us, gain)

    def nominal(self, horizon_us: float) -> AnyDrive:
        """What reaches the nominal switch, in closed form: whose slope and volts at an instant are asked for."""
        if isinstance(self.command, Trace) or self.in_between is None:
            return self.command
        return self.in_between.deliver_exactly(self.command, horizon_us, 1.0)


def product(a: FloatArray | None, b: FloatArray | None) -> FloatArray | None:
    """Factors of both, where None stands for 1."""
    if a is None or b is None:
        return b if a is None else a
    return np.asarray(a * b)


@overload
def scaled(drive: Waveform, volts: float, times: float) -> Waveform: ...
@overload
def scaled(drive: Trace, volts: float, times: float) -> Trace: ...
def scaled(drive: Drive, volts: float, times: float) -> Drive:
    """volts times u(t / times): of a waveform its pulses, of a trace its samples."""
    if volts == 1.0 and times == 1.0:
        return drive
    if isinstance(drive, Trace):
        return Trace(drive.times_us * times, drive.volts * volts)
    return Waveform(
        Pulse(p.start_us * times, p.rise_us * times, p.peak_us * times, p.volts * volts) for p in drive.pulses
    )
