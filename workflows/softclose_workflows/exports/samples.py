"""Owns waveforms as samples: volts over time as CSV, and integer codes for a waveform generator."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from softclose.arrays import FloatArray
from softclose.waveform import Waveform
from softclose_workflows.errors import ExportError

MAX_SAMPLES = 10_000_000
"""Most samples of one export."""


def sample_times_us(rate_MSps: float, duration_us: float) -> FloatArray:
    """(n,) instants k/rate from 0 to the first at or after the duration [µs]. Raises ExportError."""
    for name, value in (("the sample rate", rate_MSps), ("the duration", duration_us)):
        if not (math.isfinite(value) and value > 0.0):
            raise ExportError(f"{name} is {value:g}; it must be above 0")
    n = math.ceil(rate_MSps * duration_us * (1.0 - 1e-12)) + 1
    if n > MAX_SAMPLES:
        raise ExportError(
            f"{rate_MSps:g} MS/s over {duration_us:g} µs are {n:,} samples; at most {MAX_SAMPLES:,} are written: "
            "lower the rate (--rate) or the duration (--duration)"
        )
    return np.arange(n) / rate_MSps


def volts_csv(waveform: Waveform, times_us: FloatArray) -> str:
    """Two columns, time_us and volts."""
    volts = waveform.voltage(times_us)
    lines = ["time_us,volts", *(f"{t:.9g},{u:.9g}" for t, u in zip(times_us, volts, strict=True))]
    return "\n".join(lines) + "\n"


@dataclass(frozen=True, slots=True, kw_only=True)
class CodeScale:
    """How codes stand for volts at the switch, any amplifier between included."""

    bits: int
    """Resolution of the generator."""
    full_scale_V: float
    """What the largest code stands for [V]."""
    signed: bool
    """Two's complement, 0 V at code 0 in the middle of the range; otherwise 0 V is the lowest code."""
    rate_MSps: float
    """Samples per µs."""

    def __post_init__(self) -> None:
        if not 2 <= self.bits <= 32:
            raise ExportError(f"the generator has {self.bits} bits; 2 to 32 are allowed (--bits)")
        if not (math.isfinite(self.full_scale_V) and self.full_scale_V > 0.0):
            raise ExportError(f"full scale is {self.full_scale_V:g} V; it must be above 0 (--full-scale)")

    @property
    def max_code(self) -> int:
        """Largest code."""
        return int(2 ** (self.bits - 1) - 1 if self.signed else 2**self.bits - 1)

    @property
    def volts_per_code(self) -> float:
        """Volts between neighbouring codes."""
        return self.full_scale_V / self.max_code

    def encode(self, volts: FloatArray) -> NDArray[np.int64]:
        """The nearest codes, (n,) int64, within half of `volts_per_code`. Raises ExportError above full scale."""
        codes: NDArray[np.int64] = np.rint(volts / self.volts_per_code).astype(np.int64)
        if codes.max() > self.max_code:
            raise ExportError(
                f"the waveform reaches {volts.max():.6g} V, above the full scale of {self.full_scale_V:g} V; "
                "give the voltage that the largest code stands for, amplifier included (--full-scale)"
            )
        return codes


def metadata(scale: CodeScale, codes: NDArray[np.int64], volts: FloatArray) -> dict[str, float | int | bool | str]:
    """What somebody needs to play the codes back, and how far they are from the waveform."""
    return asdict(scale) | {
        "volts": "code * volts_per_code",
        "volts_per_code": scale.volts_per_code,
        "smallest_code": int(codes.min()),
        "largest_code": int(codes.max()),
        "n_samples": int(codes.size),
        "largest_rounding_error_V": float(np.abs(codes * scale.volts_per_code - volts).max()),
        "largest_step_between_samples_V": float(np.abs(np.diff(volts)).max()) if volts.size > 1 else 0.0,
        "final_volts_to_hold": float(codes[-1] * scale.volts_per_code),
    }


def codes_text(codes: NDArray[np.int64], header: list[str]) -> str:
    """One code a line after `# ` comment lines."""
    return "\n".join([*(f"# {line}" for line in header), *(str(c) for c in codes)]) + "\n"
