"""Owns learning what a switch is like from a few actuations alone: whether it touches, and when.

No instrument but a drive and a contact: step voltages are bisected for the lowest at which the switch touches, then a
few steps somewhat above it are timed. A regression over the lot turns the two into pull-in voltage and resonance
(ADR 066).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from softclose.arrays import FloatArray
from softclose.conditions.amplifier import normal_quantiles
from softclose.conditions.protocol import Condition, Coordinate, Surroundings, Uniforms
from softclose.conditions.streams import Stream
from softclose.conditions.trim import Trim, TrimSection, own_drives, trim_of, within_limits
from softclose.device.drives import Drives
from softclose.device.told import sobol_switches
from softclose.population.lot import Lot
from softclose.population.population import index_uniforms
from softclose.waveform import Pulse, Waveform

if TYPE_CHECKING:
    from softclose.device.simulate import Responses

Touch = Callable[[FloatArray, FloatArray], FloatArray]
"""(switches (n, 4), volts (n,) of each one's step) -> (n,) first contact [µs], infinite where it never touches."""

STEP_VOLTS = 100.0
"""The step that is scaled for each switch [V]."""

OVERDRIVE = 1.25
"""A timed step over the threshold: far enough above that its time says more of the frequency than of the threshold."""

MOST_TIMED = 3
"""Actuations that are timed: averaging more tells less than another halving of the threshold's bracket."""

NEVER_US = 250.0
"""What a contact that never came counts as [µs]."""

_N_TRAINING = 8192


def step(rise_us: float) -> Waveform:
    """The drive of an actuation before it is scaled: it rises, and holds."""
    return Waveform([Pulse(0.0, rise_us, math.inf, STEP_VOLTS)])


def timed_of(actuations: int) -> int:
    """How many of so many actuations are timed."""
    return min(MOST_TIMED, max(1, actuations // 3))


@dataclass(frozen=True, slots=True, kw_only=True)
class Protocol:
    """How a switch is actuated to learn what it is like."""

    actuations: int
    """Closings and attempts in all."""
    error_us: float
    """Standard deviation of one timed contact [µs]."""
    lowest_V: float
    """Where the bisection begins; no switch of the lot touches below."""
    highest_V: float
    """Every switch of the lot touches here, or the drive's limit is reached."""

    @property
    def timed(self) -> int:
        """Actuations that are timed, the last ones."""
        return timed_of(self.actuations)


def training_switches(trim: Trim) -> FloatArray:
    """(n, 4) switches of the lot that the regression is learned on."""
    return sobol_switches(trim.population, trim.device, _N_TRAINING)


def protocol_of(trim: Trim, *, actuations: int, error_us: float, max_volts: float) -> Protocol:
    """The protocol for a lot; steps end at max_volts [V]."""
    closing = trim.true(training_switches(trim))[:, 0]
    # A step swings past its static travel: it closes a switch at some nine tenths of the static pull-in voltage.
    return Protocol(
        actuations=actuations,
        error_us=error_us,
        lowest_V=min(0.75 * float(closing.min()), 0.5 * max_volts),
        highest_V=min(1.05 * float(closing.max()), max_volts),
    )


def actuate(touch: Touch, switches: FloatArray, protocol: Protocol, u: FloatArray) -> FloatArray:
    """What the actuations of each switch tell.

    Parameters
    ----------
    touch : callable
        The switches' answer to steps.
    switches : (n, 4) ndarray of float64
        Columns D, G [µm], K [N/m], M [µg].
    protocol : Protocol
        How they are actuated.
    u : (n,) ndarray of float64
        Uniform numbers that its errors of timing come from.

    Returns
    -------
    (n, 2) ndarray of float64
        Threshold of touching under a step [V], mean time of the timed contacts [µs] (infinite where it never touches).
    """
    low = np.full(len(switches), protocol.lowest_V)
    high = np.full(len(switches), protocol.highest_V)
    for _ in range(protocol.actuations - protocol.timed):
        middle = np.sqrt(low * high)
        touches = np.isfinite(touch(switches, middle))
        low, high = np.where(touches, low, middle), np.where(touches, middle, high)
    threshold = np.sqrt(low * high)
    z = normal_quantiles(u)
    timed = touch(switches, OVERDRIVE * threshold) + protocol.error_us / math.sqrt(protocol.timed) * z
    return np.column_stack([threshold, np.maximum(timed, 1e-3)])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Actuation:
    """One actuation of a lot."""

    volts: FloatArray
    """(n,) step of each switch [V]."""
    response: Responses
    """What they did."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Learned:
    """From threshold and time of contact to pull-in voltage and resonance, for one lot and protocol."""

    trim: Trim
    protocol: Protocol
    centre: FloatArray
    """(2,) mean logarithms of threshold and time over the lot."""
    coefficients: FloatArray
    """(2, 6) quadratic regression of the logarithms of pull-in voltage and resonance over the mean switch's."""

    @classmethod
    def of(cls, trim: Trim, protocol: Protocol, touch: Touch) -> Learned:
        """Learn the regression on simulated switches of the lot, errors of timing included."""
        switches = training_switches(trim)
        u = index_uniforms(len(switches), seed=0, start=0, stream=int(Stream.TIMING))[:, 0]
        known = np.log(_timed(actuate(touch, switches, protocol, u)))
        centre = np.round(known.mean(axis=0), 9)
        wanted = np.log(trim.true(switches) / trim.reference)
        # Rounded: another machine's linear algebra ends in other bits, and the scales are part of a store's identity.
        found = np.round(np.linalg.lstsq(_features(known - centre), wanted, rcond=None)[0].T, 9)
        return cls(trim=trim, protocol=protocol, centre=centre, coefficients=np.asarray(found))

    def estimate(self, told: FloatArray) -> FloatArray:
        """Estimates from what `actuate` returns: (n, 2) pull-in voltage [V], resonance [kHz]."""
        logarithms = _features(np.log(_timed(told)) - self.centre) @ self.coefficients.T
        return np.asarray(np.exp(logarithms) * self.trim.reference)


def _timed(told: FloatArray) -> FloatArray:
    """A contact that never came counts as a very late one: such a switch is beyond the drive, whatever it is given."""
    return np.column_stack([told[:, 0], np.minimum(told[:, 1], NEVER_US)])


def _features(x: FloatArray) -> FloatArray:
    u, t = x.T
    return np.column_stack([np.ones(len(x)), u, t, u * u, u * t, t * t])


TIMING = Coordinate(name="timing", stream=Stream.TIMING, parts=("error of timing",))


@dataclass(frozen=True, slots=True)
class TailoredByLearning(Condition):
    """A drive for each switch: the common command, scaled by what a few actuations told of it."""

    section: ClassVar[str] = "trim"
    tailored: ClassVar[bool] = True
    columns: ClassVar[tuple[str, ...]] = ("threshold", "contact_time", "voltage_scale", "time_scale")  # type: ignore[misc]
    settings: TrimSection
    around: Surroundings

    @classmethod
    def of(cls, settings: Any, around: Surroundings) -> Self | None:
        """None where something else is measured."""
        return cls(settings, around) if settings.measured == "contact times" else None

    @classmethod
    def assumed(cls, t: TrimSection) -> list[str]:
        """What it rests on."""
        if t.measured != "contact times":
            return []
        what = f"{t.actuations} actuations a part, each contact timed to {t.contact_time_error_us:g} µs"
        return [own_drives(t, what)]

    @property
    def coordinates(self) -> tuple[Coordinate, ...]:  # type: ignore[override]
        """Errors of timing."""
        return (TIMING,)

    @property
    def learned(self) -> Learned:
        """What contact times tell of a switch of this lot."""
        return _learned(self.settings, self.around)

    def told(self, lot: Lot, u: FloatArray) -> FloatArray:
        """What the actuations of each switch tell; see `actuate`. u: (n,) uniform numbers.

        They take place where the lot is as the population has it, before temperature and scatter of drives.
        """
        return actuate(_touch(self.around), lot.switches, self.protocol, u)

    @property
    def protocol(self) -> Protocol:
        """How a switch of this lot is actuated."""
        return _protocol(self.settings, self.around)

    @property
    def n_motions(self) -> int:
        """Different motions among the actuations of a switch: those that are timed repeat one."""
        return self.settings.actuations - timed_of(self.settings.actuations) + 1

    def actuations(self, lot: Lot, **outputs: Any) -> list[Actuation]:
        """The motions behind what `told` says, in the order in which they are made.

        lot: as `told` is given it; outputs: of `Device.respond`.
        """
        made: list[Actuation] = []

        def touch(switches: FloatArray, volts: FloatArray) -> FloatArray:
            found = _stepped(self.around, switches, volts, **outputs)
            made.append(Actuation(volts=np.minimum(volts, self.around.max_volts), response=found))
            return found.first_contact_us

        actuate(touch, lot.switches, self.protocol, np.full(len(lot), 0.5))  # errors of timing change no motion
        return made

    def lot(self, lot: Lot, u: Uniforms) -> Lot:
        """With what the actuations told, and the scales that follow from it."""
        return self._with(lot, self.told(lot, u[TIMING.name][:, 0]))

    def lot_after(self, lot: Lot, u: Uniforms, contacts: Sequence[FloatArray]) -> Lot:
        """As `lot`, where its actuations have been made already: (n,) first contacts [µs] of each of them."""
        made = iter(contacts)
        return self._with(lot, actuate(lambda *_: next(made), lot.switches, self.protocol, u[TIMING.name][:, 0]))

    def _with(self, lot: Lot, told: FloatArray) -> Lot:
        estimate = self.learned.estimate(told)
        scales = self.learned.trim.scales(estimate)
        return lot.with_columns(
            threshold=told[:, 0],
            contact_time=told[:, 1],
            voltage_scale=scales.volts,
            time_scale=scales.times,
        )

    def drives(self, drives: Drives, lot: Lot) -> Drives:
        """Scaled as far as the drive's limits allow."""
        return within_limits(self.settings, self.around, drives, lot)


def _touch(around: Surroundings) -> Touch:
    """How the campaign's switches answer steps, each of its own voltage within the drive's limit."""

    return lambda switches, volts: _stepped(around, switches, volts).first_contact_us


def _stepped(around: Surroundings, switches: FloatArray, volts: FloatArray, **outputs: Any) -> Responses:
    highest = np.minimum(volts, around.max_volts) / STEP_VOLTS
    drives = Drives(command=step(around.min_rise_us), volts=highest, delivery=around.delivery)
    return around.device.respond(Lot.of(switches), drives, **outputs)


@lru_cache(maxsize=8)
def _protocol(settings: TrimSection, around: Surroundings) -> Protocol:
    return protocol_of(
        trim_of(settings, around),
        actuations=settings.actuations,
        error_us=settings.contact_time_error_us,
        max_volts=around.max_volts,
    )


@lru_cache(maxsize=8)
def _learned(settings: TrimSection, around: Surroundings) -> Learned:
    return Learned.of(trim_of(settings, around), _protocol(settings, around), _touch(around))
