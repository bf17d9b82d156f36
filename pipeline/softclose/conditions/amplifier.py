"""Owns the amplifier in the loop: what reaches the switch of the waveform that is commanded.

In the order of the signal's way: the clock and the resolution in time and volts of the generator, gain and offset,
delay, slew limit, bandwidth (first or second order). What is searched, stored and exported is the commanded waveform;
what is simulated is the delivered one. Gain and clock may differ from one switch's drive to the next.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass as section

from softclose.allowed.types import SETTINGS
from softclose.arrays import FloatArray
from softclose.conditions.protocol import Condition, Coordinate, Surroundings, Uniforms
from softclose.conditions.streams import Stream
from softclose.device.drives import Drives, product
from softclose.population.lot import Lot
from softclose.waveform import AnyDrive, Delivered, Pieced, Pulse, Waveform
from softclose.waveform.fewest import fewest
from softclose.waveform.slew import limited
from softclose.waveform.steps import stepped

_LEAST = 0.05
"""Least gain or period of a clock over the nominal one: normal errors have no end, drives do."""


@section(frozen=True, slots=True, kw_only=True, config=SETTINGS)
class AmplifierSection:
    """What stands between the commanded waveform and the switch; by default nothing does."""

    gain: Annotated[float, Field(gt=0, le=2)] = 1.0
    """Volts delivered over volts commanded, at rest: a known error of the gain."""
    offset_volts: Annotated[float, Field(ge=-50, le=50)] = 0.0
    """Added to what is delivered [V]."""
    delay_us: Annotated[float, Field(ge=0, le=1000)] = 0.0
    """Everything arrives so much later [µs]."""
    slew_volts_per_us: Annotated[float, Field(ge=0, le=1e6)] = 0.0
    """Steepest slope of the output [V/µs]; 0: none is too steep."""
    bandwidth_kHz: Annotated[float, Field(ge=0, le=1e6)] = 0.0
    """Frequency at which a sine comes out at -3 dB [kHz]; 0: every frequency passes."""
    order: Literal[1, 2] = 1
    """Order of that low-pass."""
    damping: Annotated[float, Field(ge=0.05, le=5)] = 0.7071
    """Damping ratio of the second order; 0.707 is the flattest, less overshoots."""
    resolution_volts: Annotated[float, Field(ge=0, le=50)] = 0.0
    """Step of the generator's voltages [V]; 0: none."""
    resolution_us: Annotated[float, Field(ge=0, le=10)] = 0.0
    """Time between two voltages of the generator, each of which is held [µs]; 0: none."""
    step_us: Annotated[float, Field(gt=0, le=1)] = 0.05
    """Longest part of a curve that is a parabola where polynomials are fitted to many steps [µs]."""
    gain_error: Annotated[float, Field(ge=0, le=0.2)] = 0.0
    """Relative standard deviation of the gain from one switch's drive to the next."""
    time_error: Annotated[float, Field(ge=0, le=0.2)] = 0.0
    """Relative standard deviation of the generator's clock from one switch's drive to the next."""

    @property
    def is_ideal(self) -> bool:
        """Whether what is commanded is what is delivered, random errors aside."""
        plain = AmplifierSection(
            step_us=self.step_us,
            order=self.order,
            damping=self.damping,
            gain_error=self.gain_error,
            time_error=self.time_error,
        )
        return self == plain

    @property
    def is_linear(self) -> bool:
        """Whether twice the command is delivered as twice the volts, at every instant."""
        return not (self.offset_volts or self.slew_volts_per_us or self.resolution_volts)

    @property
    def keeps_pulses(self) -> bool:
        """Whether what is delivered of pulses is pulses: larger or smaller, later, and on a constant voltage."""
        dynamic = self.slew_volts_per_us or self.bandwidth_kHz or self.resolution_volts or self.resolution_us
        return not dynamic and self.offset_volts >= 0.0

    @property
    def has_closed_form(self) -> bool:
        """Whether what is delivered of pulses has a closed form: no slew limit and no steps of the generator act."""
        return not (self.slew_volts_per_us or self.resolution_volts or self.resolution_us)

    @property
    def scatters(self) -> bool:
        """Whether drives differ at random from one switch to the next."""
        return self.gain_error > 0.0 or self.time_error > 0.0


UNLIMITED_kHz = 1e6
"""Bandwidth that stands for none where drives are scaled switch by switch behind an amplifier: 0.2 ns late."""


@lru_cache(maxsize=64)
def deliver(amplifier: AmplifierSection, waveform: Waveform, horizon_us: float, gain: float = 1.0) -> AnyDrive:
    """What of a commanded waveform reaches the switch, for the kernel; arguments as of `deliver_exactly`.

    Where a generator's steps make many pieces: polynomials that have the area of them, if those are fewer.
    """
    exact = deliver_exactly(amplifier, waveform, horizon_us, gain)
    if isinstance(exact, Waveform) or (amplifier.has_closed_form and amplifier.bandwidth_kHz):
        return exact
    return fewest(exact, horizon_us, amplifier.step_us)


def deliver_exactly(
    amplifier: AmplifierSection, waveform: Waveform, horizon_us: float, gain: float = 1.0
) -> Waveform | Delivered | Pieced:
    """What of a commanded waveform reaches the switch, on [0, horizon].

    Parameters
    ----------
    amplifier : AmplifierSection
        Its settings.
    waveform : Waveform
        What is commanded; before 0 it is 0 V, and the amplifier is at rest.
    horizon_us : float
        End [µs].
    gain : float
        What its gain is multiplied by.

    Returns
    -------
    Waveform, Delivered or Pieced
        Pulses where it delivers pulses; else a closed form: steps, cosines and lines, and what a low-pass makes of
        them.
    """
    a = amplifier
    gain *= a.gain
    if a.keeps_pulses:
        pulses = [Pulse(p.start_us + a.delay_us, p.rise_us, p.peak_us, p.volts * gain) for p in waveform.pulses]
        return Waveform([*pulses, Pulse(0.0, 0.0, math.inf, a.offset_volts)] if a.offset_volts else pulses)
    if a.has_closed_form and a.bandwidth_kHz:
        return behind_low_pass(a, waveform, gain)
    flat = stepped(waveform, a.resolution_us, a.resolution_volts, horizon_us)
    flat[0][:, 2] *= gain
    flat[2][..., 0] *= gain
    if a.slew_volts_per_us > 0.0:
        flat = limited(*flat, a.slew_volts_per_us)
    if a.bandwidth_kHz > 0.0:
        return behind_low_pass(a, Pieced(*flat), 1.0)
    return Pieced(*flat).later(a.delay_us, a.offset_volts, horizon_us)


def behind_low_pass(a: AmplifierSection, waveform: Waveform | Pieced, gain: float) -> Delivered:
    """What is delivered in closed form; without a bandwidth of its own, by one of `UNLIMITED_kHz`."""
    return Delivered(
        command=waveform,
        bandwidth_kHz=a.bandwidth_kHz or UNLIMITED_kHz,
        order=a.order if a.bandwidth_kHz else 1,
        damping=a.damping,
        gain=gain,
        offset_volts=a.offset_volts,
        delay_us=a.delay_us,
    )


def normal_quantiles(u: FloatArray) -> FloatArray:
    """Standard normal numbers of uniform ones, any shape; within seven standard deviations."""
    from scipy.special import ndtri  # here: reading a configuration needs none of it, and it is slow to import

    return np.asarray(ndtri(np.clip(u, 1e-12, 1.0 - 1e-12)))


@dataclass(frozen=True, slots=True)
class Amplifier(Condition):
    """What stands between generator and switch; its gain, and the generator's clock, with errors of their own."""

    section: ClassVar[str] = "amplifier"
    settings: AmplifierSection

    @classmethod
    def of(cls, settings: Any, around: Surroundings) -> Self | None:
        """Always there: a lot may bring gains of its own."""
        return cls(settings)

    @classmethod
    def assumed(cls, a: AmplifierSection) -> list[str]:
        """What it rests on."""
        return [_delivering(a), *_varying(a)]

    @property
    def coordinates(self) -> tuple[Coordinate, ...]:  # type: ignore[override]
        """Two, where drives scatter."""
        if not self.settings.scatters:
            return ()
        return (Coordinate(name="drive", stream=Stream.DRIVE, parts=("gain", "clock")),)

    @property
    def columns(self) -> tuple[str, ...]:  # type: ignore[override]
        """Gain and clock, where drives scatter."""
        return ("gain", "clock") if self.settings.scatters else ()

    def lot(self, lot: Lot, u: Uniforms) -> Lot:
        """With the gain and the clock of each one's drive, normal about 1; the same for every candidate."""
        s = self.settings
        if not s.scatters:
            return lot
        errors = np.array([s.gain_error, s.time_error]) * normal_quantiles(u["drive"][:, :2])
        gain, clock = np.maximum(1.0 + errors, _LEAST).T
        return lot.with_columns(gain=gain, clock=clock)

    def drives(self, drives: Drives, lot: Lot) -> Drives:
        """Every command through its own generator and amplifier."""
        needed = self.settings.scatters
        gain = lot["gain"] if needed or "gain" in lot else None
        clock = lot["clock"] if needed or "clock" in lot else None
        return replace(drives, gain=product(drives.gain, gain), times=product(drives.times, clock), delivery=self)

    @property
    def is_ideal(self) -> bool:
        """Whether it delivers what is commanded, errors aside."""
        return self.settings.is_ideal

    @property
    def is_linear(self) -> bool:
        """Whether it delivers twice the volts of twice the command."""
        return self.settings.is_linear

    def closed_form(self, command: Waveform) -> Delivered | None:
        """What is delivered of pulses, where no slew limit and no steps of the generator act."""
        return behind_low_pass(self.settings, command, self.settings.gain) if self.settings.has_closed_form else None

    def deliver(self, command: Waveform, horizon_us: float, gain: float) -> AnyDrive:
        """What of a command reaches a switch."""
        return deliver(self.settings, command, horizon_us, gain)

    def deliver_exactly(self, command: Waveform, horizon_us: float, gain: float) -> AnyDrive:
        """The same in closed form, however many pieces it has."""
        return deliver_exactly(self.settings, command, horizon_us, gain)


def _delivering(a: AmplifierSection) -> str:
    if a.is_ideal:
        return "The amplifier is ideal: each switch sees exactly the voltage that is commanded."
    facts = [
        *([f"bandwidth {a.bandwidth_kHz:g} kHz (order {a.order})"] if a.bandwidth_kHz else []),
        *([f"slew rate {a.slew_volts_per_us:g} V/µs"] if a.slew_volts_per_us else []),
        *([f"gain {a.gain:g}"] if a.gain != 1.0 else []),
        *([f"offset {a.offset_volts:g} V"] if a.offset_volts else []),
        *([f"delay {a.delay_us:g} µs"] if a.delay_us else []),
        *([f"resolution {a.resolution_volts:g} V"] if a.resolution_volts else []),
        *([f"sample time {a.resolution_us:g} µs"] if a.resolution_us else []),
    ]
    return f"The amplifier is simulated: {', '.join(facts)}."


def _varying(a: AmplifierSection) -> list[str]:
    facts = [
        *([f"gain by {100 * a.gain_error:g} %"] if a.gain_error else []),
        *([f"clock by {100 * a.time_error:g} %"] if a.time_error else []),
    ]
    return [f"From one drive to the next the {' and the '.join(facts)} vary (standard deviation)."] if facts else []
