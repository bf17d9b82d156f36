"""Owns trim: one waveform, adjusted to each switch by two numbers that were measured on it.

A switch's drive is a u(t / b): voltage scale a, time scale b. Substituting t = b s in Eq. 1 leaves the same equation
with stiffness K / a² and mass M / (a b)², speeds divided by b: a switch that is stiff and slow becomes one like the
mean switch as far as what was measured tells (ADR 066).
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field
from pydantic.dataclasses import dataclass as section

from softclose.allowed.types import SETTINGS
from softclose.arrays import FloatArray
from softclose.conditions.amplifier import normal_quantiles
from softclose.conditions.protocol import Condition, Coordinate, Surroundings, Uniforms
from softclose.conditions.streams import Stream
from softclose.device.device import Device
from softclose.device.drives import Drives, product
from softclose.device.told import mean_switch, sobol_switches
from softclose.population.lot import Lot
from softclose.population.population import Population, index_uniforms
from softclose.switch.plate import resonance
from softclose.waveform import Drive, Trace
from softclose.waveform.scales import Scales

Measured = Literal["nothing", "pull-in", "resonance", "pull-in and resonance", "contact times"]

Scaled = Literal["voltage", "time", "voltage and time"]

N_SCALES = 2
"""Voltage and time scale."""

_FARTHEST = 3.0
"""A measured value beyond so many times the mean switch's, or below that part of it, is a slip of units."""

_N_REFERENCE = 16384
"""Switches from which the edges of bins are computed: a quantile of them is known to half a percent of the spread."""


@section(frozen=True, slots=True, kw_only=True, config=SETTINGS)
class TrimSection:
    """One waveform, adjusted to each switch by what was measured on it."""

    measured: Measured = "nothing"
    """What is measured on each switch: the voltage at which it closes when that is raised slowly, its resonance; or
    only whether and when it touches in a few actuations."""
    scaled: Scaled = "voltage and time"
    """What the measurements change of its drive, each as far as they tell: volts as pull-in voltages, times as
    periods."""
    pull_in_error: Annotated[float, Field(ge=0, le=0.3)] = 0.01
    """Relative standard deviation of a measured pull-in voltage."""
    resonance_error: Annotated[float, Field(ge=0, le=0.3)] = 0.01
    """Relative standard deviation of a measured resonance."""
    actuations: Annotated[int, Field(ge=2, le=64, strict=True)] = 10
    """Contact times: closings and attempts of each switch in all, from which its scales are learned."""
    contact_time_error_us: Annotated[float, Field(ge=0, le=10)] = 0.1
    """Contact times: standard deviation of one timed contact [µs]."""
    bins: Annotated[int, Field(ge=0, le=4096, strict=True)] = 0
    """Bins of each measured quantity, whose switches share a drive; 0: each switch has its own."""
    keep_limits: bool = True
    """Whether every scaled drive keeps waveform.max_volts and waveform.min_rise_us; its scale ends there."""


class TrimError(ValueError):
    """A trim or a measured value that cannot be."""


@dataclass(frozen=True, kw_only=True)
class Trim:
    """What is measured on each switch, how well, and the scales that follow from it.

    a is the pull-in voltage, over the mean switch's, that is to be expected of a switch of this lot with these measured
    values; b is the mean switch's frequency over the one to be expected: linear regressions of the logarithms on the
    measured ones, errors of measurement included. So noisy measurements are shrunk towards the mean
    switch, and what is not measured is followed as far as it correlates with what is: in the paper's lot, pull-in
    voltage and resonance are correlated to 0.97.
    With n bins a measured value counts as the median of its bin, of n that are equally likely.
    """

    population: Population
    """The lot."""
    device: Device
    """What its switches are: the voltage at which one closes is measured in it."""
    measured: Measured
    """What is measured: the voltage at which a switch closes when it is raised slowly, its first resonance, or both; or
    contact times only, from which `softclose.conditions.learning` estimates the two."""
    pull_in_error: float
    """Relative standard deviation of a measured pull-in voltage."""
    resonance_error: float
    """Relative standard deviation of a measured frequency."""
    bins: int
    """Bins of each measured quantity; 0: each switch by itself."""
    scaled: Scaled
    """Which of a drive's two scales its generator has."""

    @property
    def reference(self) -> tuple[float, float]:
        """Pull-in voltage [V] and resonance [kHz] of the mean switch, whose scales are 1."""
        return _reference(self)

    @property
    def columns(self) -> tuple[int, ...]:
        """Columns of measured values that are used: 0 the pull-in voltage, 1 the resonance."""
        if self.measured == "contact times":  # estimates of both
            return 0, 1
        return tuple(i for i, name in enumerate(("pull-in", "resonance")) if name in self.measured)

    def true(self, switches: ArrayLike) -> FloatArray:
        """What a perfect instrument would measure: (n, 2) pull-in voltage [V], resonance [kHz].

        Parameters
        ----------
        switches : (n, 4) array-like of float64
            Columns D, G [µm], K [N/m], M [µg].
        """
        s = np.asarray(switches, dtype=np.float64)
        return np.column_stack([self.device.closing_voltage(s), resonance(s)])

    def measured_of(self, switches: ArrayLike, u: FloatArray) -> FloatArray:
        """What is measured on switches.

        Parameters
        ----------
        switches : (n, 4) array-like of float64
            Columns D, G [µm], K [N/m], M [µg].
        u : (n, 2) ndarray of float64
            Uniform numbers that its errors come from.

        Returns
        -------
        (n, 2) ndarray of float64
            Pull-in voltage [V], resonance [kHz].
        """
        return self.true(switches) * self.factors(u)

    def factors(self, u: FloatArray) -> FloatArray:
        """1 + relative errors of (n, 2) uniform numbers; no instrument is wrong by more than nine tenths."""
        return np.asarray(np.maximum(1.0 + normal_quantiles(u) * [self.pull_in_error, self.resonance_error], 0.1))

    def scales(self, measured: ArrayLike) -> Scales:
        """The scales of switches that were measured.

        Parameters
        ----------
        measured : (n, 2) array-like of float64
            Pull-in voltage [V], resonance [kHz]; what is not used may be NaN.

        Returns
        -------
        Scales
            (n,) voltage and time scales.

        Raises
        ------
        TrimError
            For another shape, or a value in use that is not above 0.
        """
        m = np.asarray(measured, dtype=np.float64)
        if m.ndim != 2 or m.shape[1] != N_SCALES:
            raise TrimError(f"measured values have shape {m.shape}; give (n, 2): pull-in voltage [V], resonance [kHz]")
        rows = [np.ones(len(m))]
        for column in self.columns:
            values = m[:, column]
            what = ("pull-in voltage", "resonance")[column]
            bad = ~(np.isfinite(values) & (values > 0.0))
            if bad.any():
                raise TrimError(f"row {int(np.argmax(bad))}: the {what} is {values[bad][0]:g}; it must be above 0")
            far = np.abs(np.log(values / self.reference[column])) > math.log(_FARTHEST)
            if far.any():
                usual = f"{self.reference[column]:.3g} {('V', 'kHz')[column]}"
                raise TrimError(
                    f"row {int(np.argmax(far))}: the {what} is {values[far][0]:g}, but the mean switch of "
                    f"{self.population.name!r} has {usual}: what unit is it?"
                )
            if self.bins:
                edges, middles = self.bins_of(column)
                values = middles[np.searchsorted(edges, values, side="right")]
            rows.append(np.log(values / self.reference[column]))
        voltage, frequency = self.coefficients @ np.stack(rows)
        plain = np.zeros(len(m))
        return Scales(
            volts=np.exp(voltage if "voltage" in self.scaled else plain),
            times=np.exp(-frequency if "time" in self.scaled else plain),
        )

    @property
    def coefficients(self) -> FloatArray:
        """(2, 1 + number of measured quantities) regression of the logarithms of pull-in voltage and frequency, each
        over the mean switch's: constant, then slopes on the measured ones."""
        if self.measured == "contact times":  # what is learned has gone through a regression of its own
            return np.eye(3)[1:]
        return _regression(self)

    def bins_of(self, column: int) -> tuple[FloatArray, FloatArray]:
        """(bins - 1,) edges and (bins,) medians of the measured values: column 0 in volts, column 1 in kHz."""
        values, p = _sorted_values(self, column), np.arange(self.bins) / self.bins
        return np.quantile(values, p[1:]), np.quantile(values, p + 0.5 / self.bins)


@functools.lru_cache(maxsize=16)
def _reference(trim: Trim) -> tuple[float, float]:
    mean = mean_switch(trim.population, trim.device)
    return float(trim.device.closing_voltage(mean)[0]), float(resonance(mean))


def _sample(trim: Trim) -> FloatArray:
    return sobol_switches(trim.population, trim.device, _N_REFERENCE)


def _measured_on_sample(trim: Trim, switches: FloatArray) -> FloatArray:
    u = index_uniforms(len(switches), seed=0, start=0, stream=int(Stream.MEASUREMENT))[:, :N_SCALES]
    return trim.measured_of(switches, u)


@functools.lru_cache(maxsize=16)
def _sorted_values(trim: Trim, column: int) -> FloatArray:
    """Measured values of many switches of the lot, in order."""
    switches = _sample(trim)
    return np.sort(_measured_on_sample(trim, switches)[:, column])


@functools.lru_cache(maxsize=16)
def _regression(trim: Trim) -> FloatArray:
    switches = _sample(trim)
    wanted = np.log(trim.true(switches) / trim.reference)
    known = np.log(_measured_on_sample(trim, switches) / trim.reference)[:, trim.columns]
    table = np.column_stack([np.ones(len(known)), known])
    # Rounded: another machine's linear algebra ends in other bits, and the scales are part of a store's identity.
    return np.asarray(np.round(np.linalg.lstsq(table, wanted, rcond=None)[0].T, 9))


def own_drives(t: TrimSection, what: str) -> str:
    """What drives of its own for each switch rest on. what: is measured of a part."""
    shared = f"; parts of the same of {t.bins} bins share a drive" if t.bins else ""
    return f"Every switch is driven by its own scaled copy of the waveform ({t.scaled}), which needs {what}{shared}."


def limited(scales: Scales, *, peak_V: float, max_volts: float, shortest_rise_us: float, min_rise_us: float) -> Scales:
    """Scales that keep a waveform within the drive's limits: a peak / max_volts at most 1, a rise at least as long.

    Parameters
    ----------
    scales : Scales
        What the measurements ask for.
    peak_V, shortest_rise_us : float
        Of the common waveform [V], [µs].
    max_volts, min_rise_us : float
        Limits of every drive [V], [µs].
    """
    highest = max_volts / peak_V if peak_V > 0.0 else math.inf
    lowest = min_rise_us / shortest_rise_us if shortest_rise_us > 0.0 else 0.0
    return Scales(volts=np.minimum(scales.volts, highest), times=np.maximum(scales.times, lowest))


MEASUREMENT = Coordinate(
    name="measurement", stream=Stream.MEASUREMENT, parts=("error of pull-in voltage", "error of resonance")
)


def trim_of(settings: TrimSection, around: Surroundings) -> Trim:
    """The trim that a section stands for, on the lot that it is for.

    Parameters
    ----------
    settings : TrimSection
        What is measured, with what errors, and what is scaled by it.
    around : Surroundings
        The lot and the device model.

    Returns
    -------
    Trim
    """
    return Trim(
        population=around.population,
        device=around.device,
        measured=settings.measured,
        pull_in_error=settings.pull_in_error,
        resonance_error=settings.resonance_error,
        bins=settings.bins,
        scaled=settings.scaled,
    )


@dataclass(frozen=True, slots=True)
class Tailored(Condition):
    """A drive for each switch: the common command, scaled by what was measured on it."""

    section: ClassVar[str] = "trim"
    tailored: ClassVar[bool] = True
    columns: ClassVar[tuple[str, ...]] = ("measured_pull_in", "measured_resonance", "voltage_scale", "time_scale")  # type: ignore[misc]
    settings: TrimSection
    around: Surroundings

    @classmethod
    def of(cls, settings: Any, around: Surroundings) -> Self | None:
        """None where pull-in voltage and resonance are not measured."""
        return cls(settings, around) if settings.measured not in ("nothing", "contact times") else None

    @classmethod
    def assumed(cls, t: TrimSection) -> list[str]:
        """What it rests on."""
        what = {
            "pull-in": f"one measurement a part: its pull-in voltage, to {100 * t.pull_in_error:g} %",
            "resonance": f"one measurement a part: its resonance, to {100 * t.resonance_error:g} %",
            "pull-in and resonance": f"two measurements a part: its pull-in voltage, to {100 * t.pull_in_error:g} %, "
            f"and its resonance, to {100 * t.resonance_error:g} %",
        }.get(t.measured)
        return [] if what is None else [own_drives(t, what)]

    @property
    def coordinates(self) -> tuple[Coordinate, ...]:  # type: ignore[override]
        """Errors of measurement."""
        return (MEASUREMENT,)

    def lot(self, lot: Lot, u: Uniforms) -> Lot:
        """With what was measured, and the scales that follow from it."""
        trim = trim_of(self.settings, self.around)
        measured = trim.measured_of(lot.switches, u[MEASUREMENT.name])
        scales = trim.scales(measured)
        return lot.with_columns(
            measured_pull_in=measured[:, 0],
            measured_resonance=measured[:, 1],
            voltage_scale=scales.volts,
            time_scale=scales.times,
        )

    def drives(self, drives: Drives, lot: Lot) -> Drives:
        """Scaled as far as the drive's limits allow."""
        return within_limits(self.settings, self.around, drives, lot)


def within_limits(settings: TrimSection, around: Surroundings, drives: Drives, lot: Lot) -> Drives:
    """The command scaled for each switch of a lot that has been trimmed."""
    given = given_scales(settings, around, Scales(volts=lot["voltage_scale"], times=lot["time_scale"]), drives.command)
    return replace(drives, volts=product(drives.volts, given.volts), times=product(drives.times, given.times))


def given_scales(settings: TrimSection, around: Surroundings, asked: Scales, command: Drive) -> Scales:
    """What of the scales asked for is given under one command: all, unless trim keeps its drive's limits.

    A trace was recorded at some drive: it is scaled as asked for.
    """
    if not settings.keep_limits or isinstance(command, Trace):
        return asked
    return limited(
        asked,
        peak_V=command.max_voltage(around.device.horizon_us),
        max_volts=around.max_volts,
        shortest_rise_us=min(p.rise_us for p in command.pulses),
        min_rise_us=around.min_rise_us,
    )
