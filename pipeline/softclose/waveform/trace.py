"""Owns drives that are no pulses: sampled voltages, such as a record of an amplifier's output, as straight lines.

The kernels take one as pieces on which u(t) is a line (`softclose.kernel.pieces`), so that a step ends at every knot: a
record of thousands of samples takes as many steps. `simplified` leaves out those that a line through the others meets.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from softclose.waveform.pulses import MAX_VOLTS, FloatArray, WaveformError

TO_US = {"s": 1e6, "ms": 1e3, "us": 1.0, "µs": 1.0, "ns": 1e-3}
"""Units of time, in µs."""

_UNIT = re.compile(r"(?<![a-z])(ns|[uµ]s|ms|s|sec|seconds)(?![a-z])", re.IGNORECASE)


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
        """Largest |u| over [0, horizon] [V]."""
        inside = np.abs(self.volts[self.times_us <= horizon_us])
        return float(max(inside.max(), abs(float(self.voltage(horizon_us)))))

    def check(self, max_volts: float = MAX_VOLTS, horizon_us: float = 250.0) -> None:
        """Raise WaveformError where |u| exceeds max_volts on [0, horizon]."""
        peak = self.max_voltage(horizon_us)
        if peak > max_volts * (1.0 + 1e-9):
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


def read_trace(path: str | Path, *, time_unit: str | None = None, shift_us: float = 0.0, gain: float = 1.0) -> Trace:
    """A drive from a CSV file of two or more columns: instants first, volts next.

    Parameters
    ----------
    path : str or Path
        Lines that begin with # and empty ones are skipped; a heading may name the unit of the instants (`time_us`,
        `Time (s)`). Separators are commas, semicolons or tabs.
    time_unit : {"s", "ms", "us", "ns"}, optional
        Where no heading says it.
    shift_us : float
        Added to the instants [µs]; what comes before 0 then is left out.
    gain : float
        Volts are multiplied by it: of a probe, or an amplifier whose input was recorded.

    Returns
    -------
    Trace

    Raises
    ------
    WaveformError
        Naming the file and the line.
    """
    if time_unit is not None and time_unit not in TO_US:
        raise WaveformError(f"the unit of time is {time_unit!r}; it must be one of {', '.join(TO_US)}")
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as e:
        raise WaveformError(f"{path} cannot be read: {e}") from e
    lines = [(n, line) for n, line in enumerate(text.splitlines(), start=1) if line.strip() and line[0] != "#"]
    separator = next((s for s in (";", "\t", ",") if lines and s in lines[-1][1]), ",")
    rows = list(csv.reader((line for _, line in lines), delimiter=separator))
    samples: list[tuple[float, float]] = []
    for (number, line), row in zip(lines, rows, strict=True):
        try:
            samples.append((float(row[0]), float(row[1])))
        except (ValueError, IndexError) as e:
            if samples:
                raise WaveformError(f"{path}, line {number}: {line.strip()!r} is no pair of instant and volts") from e
            time_unit = time_unit or _unit_of(row)
    if time_unit is None:
        raise WaveformError(
            f"{path} does not say the unit of its instants: name the first column time_us (or s, ms, ns), or give it "
            "(--time-unit)"
        )
    found = np.array(samples, dtype=np.float64).reshape(-1, 2)
    try:
        return Trace(found[:, 0] * TO_US[time_unit] + shift_us, found[:, 1] * gain)
    except WaveformError as e:
        raise WaveformError(f"{path}: {e}") from e


def _unit_of(heading: Sequence[str]) -> str | None:
    """Of `time_us`, `Time (s)`, `t [ms]`, `Seconds`; None where it says none."""
    words = heading[0].replace("_", " ").lower() if heading else ""
    found = _UNIT.findall(words)
    if not found:
        return None
    unit = found[-1].replace("µ", "u")
    return "s" if unit in ("sec", "seconds") else unit
