"""Owns drives that are no pulses: sampled voltages, such as a record of an amplifier's output, as straight lines.

The kernels take one as pieces on which u(t) is a line (`softclose.kernel.pieces`), so that a step ends at every knot: a
record of thousands of samples takes as many steps. `simplified` leaves out those that a line through the others meets.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from softclose.arrays import FloatArray
from softclose.waveform.pulses import MAX_VOLTS, WaveformError, is_above


@dataclass(frozen=True, slots=True, init=False, eq=False)
class Trace:
    """A sampled drive: straight lines between samples, the last voltage ever after."""

    times_us: FloatArray
    """(n,) instants [µs], ascending from 0."""
    volts: FloatArray
    """(n,) voltages [V]; the force does not tell their sign."""

    def __init__(self, times_us: ArrayLike, volts: ArrayLike) -> None:
        try:
            t, u = np.array(times_us, dtype=np.float64), np.array(volts, dtype=np.float64)
        except (TypeError, ValueError) as e:
            raise WaveformError(
                f"the samples cannot be read as numbers ({e}); give instants [µs] and voltages [V]"
            ) from e
        if t.ndim != 1 or t.shape != u.shape or t.size < 2:
            raise WaveformError(
                f"the samples have shapes {t.shape} and {u.shape}; both must be (n,), with two samples or more"
            )
        for name, values in (("time", t), ("voltage", u)):
            bad = np.flatnonzero(~np.isfinite(values))
            if bad.size:
                raise WaveformError(
                    f"the {name} of sample {bad[0] + 1} is {values[bad[0]]}; it must be a finite number"
                )
        back = np.flatnonzero(np.diff(t) <= 0.0)
        if back.size:
            k = int(back[0]) + 1
            raise WaveformError(
                f"sample {k + 1} is at {t[k]:g} µs, not after sample {k} at {t[k - 1]:g} µs; times must ascend "
                "(a step takes two samples a little apart)"
            )
        if t[0] > 0.0:
            raise WaveformError(
                f"the first sample is at {t[0]:g} µs; what is applied from 0 on? Add a sample at 0, or shift the times"
            )
        if t[-1] <= 0.0:
            raise WaveformError(f"the last sample is at {t[-1]:g} µs; nothing is applied from 0 on: shift the times")
        if t[0] < 0.0:  # what lies before the trigger
            u = np.concatenate([[np.interp(0.0, t, u)], u[t > 0.0]])
            t = np.concatenate([[0.0], t[t > 0.0]])
        object.__setattr__(self, "times_us", t)
        object.__setattr__(self, "volts", u)

    def voltage(self, t_us: ArrayLike) -> FloatArray:
        """u(t) [V] at instants t_us [µs]; any shape."""
        return np.asarray(np.interp(np.asarray(t_us, dtype=np.float64), self.times_us, self.volts))

    def breakpoints(self, horizon_us: float = math.inf) -> FloatArray:
        """Instants of the samples in [0, horizon] [µs]."""
        return self.times_us[self.times_us <= horizon_us]

    def max_voltage(self, horizon_us: float = 250.0) -> float:
        """Largest magnitude of the voltage over [0, horizon] [V]."""
        inside = np.abs(self.volts[self.times_us <= horizon_us])
        return float(max(inside.max(), abs(float(self.voltage(horizon_us)))))

    def check(self, max_volts: float = MAX_VOLTS, horizon_us: float = 250.0) -> None:
        """Make sure that the magnitude of the voltage stays within a limit.

        Parameters
        ----------
        max_volts : float
            The limit [V].
        horizon_us : float
            It holds on [0, horizon] [µs].

        Raises
        ------
        WaveformError
            Where the trace exceeds it.
        """
        peak = self.max_voltage(horizon_us)
        if is_above(peak, max_volts):
            raise WaveformError(f"the trace reaches {peak:.6g} V; {max_volts:g} V are allowed (waveform.max_volts)")

    def simplified(self, tolerance_volts: float = 1e-6) -> Trace:
        """The fewest of its samples, found greedily, whose lines meet all others to the tolerance [V]."""
        t, u = self.times_us.tolist(), self.volts.tolist()  # plain numbers: an array hands each out slowly
        kept, anchor = [0], 0
        low, high = -math.inf, math.inf
        for i in range(1, len(t)):
            run = t[i] - t[anchor]
            slope = (u[i] - u[anchor]) / run
            if not low <= slope <= high:
                anchor = i - 1
                kept.append(anchor)
                run = t[i] - t[anchor]
                slope = (u[i] - u[anchor]) / run
                low, high = -math.inf, math.inf
            low, high = max(low, slope - tolerance_volts / run), min(high, slope + tolerance_volts / run)
        kept.append(len(t) - 1)
        return Trace(self.times_us[kept], self.volts[kept])
