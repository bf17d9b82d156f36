"""Owns pulses and drive waveforms: Eqs. 12-13 and what is admissible.

A pulse is a raised-cosine rise, a flat top and the mirrored fall; a waveform is the sum of pulses (volts over µs).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from softclose.arrays import FloatArray
from softclose.glance import as_table

MIN_RISE_US = 4.0
"""Fastest rise of a search unless a campaign says otherwise [µs]: faster edges excite higher modes of the paper's plate
(§3.2), which Eqs. 1-2 leave out. `waveform.min_rise_us` is a device's own."""

LEAST_RISE_US = 0.05
"""Fastest rise of a pulse [µs]; what is faster is an ideal step."""

MAX_VOLTS = 150.0
"""Default limit on the sum of all pulses at any instant [V]."""


VOLTS_SLACK = 1e-9
"""Share of a limit by which a voltage may be above it: the last digits of a sum of pulses at their limit."""


def is_above(peak: float, max_volts: float) -> bool:
    """Whether a largest voltage is above what is allowed [V]."""
    return peak > max_volts * (1.0 + VOLTS_SLACK)


class WaveformError(ValueError):
    """A pulse or waveform that is malformed or inadmissible."""


@dataclass(frozen=True, slots=True)
class Pulse:
    """One pulse of Eq. 13. `rise_us == 0` is an ideal step, for reference designs only."""

    start_us: float
    """Start of the rise [µs], at or after 0."""
    rise_us: float
    """Rise time, and fall time [µs]: 0 (ideal step) or at least `LEAST_RISE_US`."""
    peak_us: float
    """Duration of the flat top [µs]; `math.inf` holds for ever."""
    volts: float
    """Voltage of the flat top [V], not negative."""

    def __post_init__(self) -> None:
        for name in ("start_us", "rise_us", "peak_us", "volts"):
            value = getattr(self, name)
            try:
                number = float(value)
            except (TypeError, ValueError) as e:
                raise WaveformError(f"pulse {name} is {value!r}; it must be a number") from e
            object.__setattr__(self, name, number)
            if math.isnan(number) or number < 0.0:
                raise WaveformError(f"pulse {name} is {number:g}; it must be a number at or above 0")
            if math.isinf(number) and name != "peak_us":
                raise WaveformError(f"pulse {name} is infinite; only peak_us may be infinite (a pulse that holds)")
        if 0.0 < self.rise_us < LEAST_RISE_US:
            raise WaveformError(
                f"pulse rises in {self.rise_us:g} µs; rise times are {LEAST_RISE_US:g} µs or more (exactly 0 makes an "
                "ideal step)"
            )

    @property
    def holds(self) -> bool:
        """True where the flat top never ends."""
        return math.isinf(self.peak_us)

    @property
    def end_us(self) -> float:
        """Instant from which the pulse is 0 V for ever [µs]; inf where it holds."""
        return self.start_us + 2.0 * self.rise_us + self.peak_us

    def voltage(self, t_us: FloatArray) -> FloatArray:
        """Eq. 13 times the peak voltage.

        Parameters
        ----------
        t_us : ndarray of float64, any shape
            Instants [µs].

        Returns
        -------
        ndarray of float64, the same shape
            Voltages [V].
        """
        s = t_us - self.start_us
        fall = s - self.rise_us - self.peak_us  # -inf where it holds
        u = np.zeros_like(s)
        top = (s >= self.rise_us) & (fall < 0.0)
        u[top] = 1.0
        if self.rise_us > 0.0:
            rising = (s >= 0.0) & (s < self.rise_us)
            u[rising] = 0.5 - 0.5 * np.cos(np.pi * s[rising] / self.rise_us)
            falling = (fall >= 0.0) & (fall < self.rise_us)
            u[falling] = 0.5 + 0.5 * np.cos(np.pi * fall[falling] / self.rise_us)
        return self.volts * u


@dataclass(frozen=True, slots=True, init=False, repr=False)
class Waveform:
    """Eq. 12: the sum of one or more pulses."""

    pulses: tuple[Pulse, ...]

    def __init__(self, pulses: Iterable[Pulse]) -> None:
        try:
            pulses = tuple(pulses)
        except TypeError as e:
            raise WaveformError(f"{pulses!r} is no waveform; give a sequence of Pulse") from e
        if not pulses:
            raise WaveformError("a waveform needs at least one pulse; got none")
        for pulse in pulses:
            if not isinstance(pulse, Pulse):
                raise WaveformError(f"a waveform is made of Pulse objects; got {type(pulse).__name__}")
        object.__setattr__(self, "pulses", pulses)

    def __repr__(self) -> str:
        """What makes it again, in microseconds and volts."""
        rows = ", ".join(f"[{', '.join(f'{v:.6g}' for v in row)}]" for row in self.rows().tolist())
        return f"Waveform.from_rows([{rows}])"

    def _repr_html_(self) -> str:
        lines = [
            (
                f"pulse {number}",
                f"{p.volts:.2f} V from {p.start_us:.2f} µs, "
                + (f"rise {p.rise_us:.2f} µs, " if p.rise_us else "ideal step, ")
                + ("holds" if math.isinf(p.peak_us) else f"flat top {p.peak_us:.2f} µs"),
            )
            for number, p in enumerate(self.pulses, start=1)
        ]
        return as_table(f"Waveform of {len(lines)} pulse{'s' * (len(lines) != 1)}", lines)

    @classmethod
    def from_rows(cls, rows: Sequence[Sequence[float | None]] | FloatArray) -> Waveform:
        """A waveform from rows of numbers, as files and stores hold them.

        Parameters
        ----------
        rows : (n_pulse, 4) array-like
            start_us, rise_us, peak_us, volts. A peak of None or inf holds; rows of NaN are skipped.

        Raises
        ------
        WaveformError
            Where a pulse, or their order, is not allowed.
        """
        if not isinstance(rows, Iterable):
            raise WaveformError(f"{rows!r} is no waveform; give rows of start_us, rise_us, peak_us, volts")
        pulses = []
        for number, row in enumerate(rows, start=1):
            values: list[Any] = list(row) if isinstance(row, Iterable) else [row]
            if len(values) != 4:
                raise WaveformError(
                    f"pulse {number} has {len(values)} values; it needs 4: start_us, rise_us, peak_us, volts"
                )
            if all(isinstance(v, float | np.floating) and math.isnan(v) for v in values):
                continue
            if values[2] is None:
                values[2] = math.inf
            try:
                pulses.append(Pulse(*values))
            except WaveformError as e:
                raise WaveformError(f"pulse {number}: {e}") from e
        return cls(pulses)

    def rows(self) -> FloatArray:
        """(n_pulse, 4) float64: start, rise, peak [µs] (inf where it holds) and volts."""
        return np.array([(p.start_us, p.rise_us, p.peak_us, p.volts) for p in self.pulses], dtype=np.float64)

    def voltage(self, t_us: ArrayLike) -> FloatArray:
        """u(t) of Eq. 12.

        Parameters
        ----------
        t_us : float or array-like of float64, any shape
            Instants [µs].

        Returns
        -------
        ndarray of float64, the same shape
            Voltages [V].
        """
        t = _numbers(t_us, "t_us")
        u = np.zeros(np.atleast_1d(t).shape)
        for pulse in self.pulses:
            u += pulse.voltage(np.atleast_1d(t))
        return u.reshape(t.shape)

    def breakpoints(self, horizon_us: float = math.inf) -> FloatArray:
        """Instants where a pulse changes its form.

        Parameters
        ----------
        horizon_us : float
            Last instant looked at [µs].

        Returns
        -------
        ndarray of float64
            Sorted distinct instants in [0, horizon] [µs], 0 included.
        """
        knots = {0.0}
        for p in self.pulses:
            for knot in (p.start_us, p.start_us + p.rise_us, p.start_us + p.rise_us + p.peak_us, p.end_us):
                if knot <= horizon_us and math.isfinite(knot):
                    knots.add(knot)
        return np.array(sorted(knots))

    def max_voltage(self, horizon_us: float = 250.0) -> float:
        """The largest voltage, to about 1e-9 relative (`limit.largest_sum`).

        Parameters
        ----------
        horizon_us : float
            The maximum is taken over [0, horizon] [µs].

        Returns
        -------
        float
            max u(t) [V].
        """
        from softclose.waveform.limit import largest_sum  # imported where it is used: the compiler is slow to import

        return float(largest_sum(self.rows(), float(_numbers(horizon_us, "horizon_us"))))

    def check(self, max_volts: float = MAX_VOLTS, horizon_us: float = 250.0, least_rise_us: float = 0.0) -> None:
        """Make sure that the sum of the pulses stays within a limit, and that none rises too fast.

        Parameters
        ----------
        max_volts : float
            The limit [V].
        horizon_us : float
            It holds on [0, horizon] [µs].
        least_rise_us : float
            Fastest rise [µs]; ideal steps are let through.

        Raises
        ------
        WaveformError
            Where the waveform exceeds the limit, by how much; or which pulse rises too fast.
        """
        for number, pulse in enumerate(self.pulses, start=1):
            if 0.0 < pulse.rise_us < least_rise_us:
                raise WaveformError(
                    f"pulse {number} rises in {pulse.rise_us:g} µs; rise times below {least_rise_us:g} µs may excite "
                    "higher modes, which the model leaves out: use longer ones, or set waveform.min_rise_us to what "
                    "your device's second mode allows"
                )
        max_volts = float(_numbers(max_volts, "max_volts"))
        peak = self.max_voltage(horizon_us)
        if is_above(peak, max_volts):
            raise WaveformError(
                f"the waveform reaches {peak:.6g} V; the sum of its pulses may not exceed {max_volts:g} V: "
                "lower or separate the pulses, or raise waveform.max_volts"
            )


def _numbers(values: ArrayLike, name: str) -> FloatArray:
    try:
        if values is None:
            raise TypeError("None")
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as e:
        raise WaveformError(f"{name} is {values!r}; it must be a number or an array of numbers") from e
