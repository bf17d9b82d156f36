"""Owns waveforms as files of laboratory generators: Keysight, Tektronix and Siglent.

In every file the waveform spans the whole range of codes, from the low level (0 V) to the high level (its peak). So it
means the same whether an instrument takes its levels for the ends of the code range or for the extremes of the data.

Keysight (33500 and 33600 series, `.arb` as text): the fields of the writer that N. Forcier of Agilent published
("Convert Vector to Arbitrary Waveform", MATLAB Central File Exchange 34840); the format's reference is the Operating
and Service Guide (part 33500-90901).
Tektronix (AFG1000, 2000 and 3000, `.tfw`): a header of 512 bytes, then codes from 0 to 16382, big-endian, as in the
sample code that Tektronix published ("Python Read/Write AFG TFW", forum.tek.com, topic 140915).
Siglent (SDG series, EasyWave `.csv`): header lines and 16,384 rows, as EasyWaveX saves and loads them. No printed
specification of it was found; the layout is that of files from the program itself.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from softclose.arrays import FloatArray
from softclose.waveform import Waveform
from softclose_workflows.errors import ExportError
from softclose_workflows.exports.samples import sample_times_us
from softclose_workflows.tell.outputs import whole_file

MAX_GENERATOR_VOLTS = 20.0
"""No generator of these series gives more into an open output [V]."""

SIGLENT_POINTS = 16_384
"""Rows of an EasyWave CSV, always."""

_KEYSIGHT = (8, 1_000_000)
_TEKTRONIX = (2, 131_072)
_TEK_TOP = 16_382
_TEK_ENVELOPE = 206


@dataclass(frozen=True, slots=True, kw_only=True)
class Played:
    """What the generator gives."""

    volts: FloatArray
    """(n,) volts of the generator, at equal steps from the start."""
    rate_MSps: float
    """Samples per µs."""
    gain: float
    """Volts at the switch per volt of the generator."""

    @property
    def low_V(self) -> float:
        """Low level [V]: the lowest code."""
        return min(0.0, float(self.volts.min()))

    @property
    def high_V(self) -> float:
        """High level [V]: the highest code."""
        return float(self.volts.max())

    def codes(self, top: int) -> NDArray[np.int64]:
        """(n,) nearest codes: 0 at the low level, top at the high level."""
        return np.rint((self.volts - self.low_V) / (self.high_V - self.low_V) * top).astype(np.int64)

    def settings(self) -> dict[str, float]:
        """What has to be set at the instrument where the file does not say it, and what to expect."""
        return {
            "high_level_V": self.high_V,
            "low_level_V": self.low_V,
            "frequency_Hz": self.rate_MSps * 1e6 / self.volts.size,
            "sample_rate_Hz": self.rate_MSps * 1e6,
            "n_samples": self.volts.size,
            "volts_at_the_switch_per_generator_volt": self.gain,
            "final_volts_at_the_switch": float(self.volts[-1]) * self.gain,
        }


def play(waveform: Waveform, *, rate_MSps: float, duration_us: float, gain: float | None) -> Played:
    """Sample a waveform for a generator in front of an amplifier of that gain. Raises ExportError."""
    if gain is None:
        raise ExportError(
            "a generator's file needs the gain of the amplifier behind it, in volts at the switch per volt of the "
            "generator: give --gain (1 where there is none)"
        )
    if not (math.isfinite(gain) and gain > 0.0):
        raise ExportError(f"the gain is {gain:g}; it must be above 0 (--gain)")
    volts = waveform.voltage(sample_times_us(rate_MSps, duration_us)) / gain
    if volts.max() > MAX_GENERATOR_VOLTS:
        raise ExportError(
            f"with a gain of {gain:g} the generator would have to give {volts.max():.4g} V; generators of these series "
            f"give at most {MAX_GENERATOR_VOLTS:g} V: check the amplifier's gain (--gain)"
        )
    if volts.max() <= 0.0:
        raise ExportError("the waveform is 0 V throughout: there is nothing to play")
    return Played(volts=volts, rate_MSps=rate_MSps, gain=gain)


def keysight_arb(played: Played) -> bytes:
    """A Keysight .arb file: codes from -32767 (Low Level) to 32767 (High Level)."""
    _check_size(played, *_KEYSIGHT)
    if played.rate_MSps > 1000.0:
        raise ExportError(f"{played.rate_MSps:g} MS/s is above the 1,000 MS/s of a 33600: lower it (--rate)")
    head = [
        "File Format:1.10",
        "Channel Count:1",
        "Column Char:TAB",
        f"Sample Rate:{played.rate_MSps * 1e6:.6f}",
        f"High Level:{played.high_V:.9f}",
        f"Low Level:{played.low_V:.9f}",
        'Data Type:"short"',
        'Filter:"off"',
        f"Data Points:{played.volts.size}",
        "Data:",
    ]
    return ("\r\n".join([*head, *map(str, played.codes(65_534) - 32_767)]) + "\r\n").encode("ascii")


def tektronix_tfw(played: Played) -> bytes:
    """A Tektronix .tfw file: the shape alone; levels and frequency are set at the instrument."""
    _check_size(played, *_TEKTRONIX)
    codes = played.codes(_TEK_TOP).astype(">u2")
    header = bytearray(512)
    envelope = _envelope(codes)
    # Magic, version, number of samples, and a flag: an envelope for the preview on the instrument's screen follows.
    struct.pack_into(">10s6x3I", header, 0, b"TEKAFG3000", 20_050_114, codes.size, 1)
    header[28 : 28 + envelope.size] = envelope.tobytes()
    return bytes(header) + codes.tobytes()


def _envelope(codes: NDArray[np.uint16]) -> NDArray[np.uint8]:
    """Lowest and highest of each of at most 206 stretches, upper eight bits, by turns."""
    parts = np.array_split(codes >> 6, min(_TEK_ENVELOPE, codes.size))
    return np.array([(part.min(), part.max()) for part in parts], dtype=np.uint8).ravel()


def siglent_csv(played: Played) -> bytes:
    """An EasyWave .csv file: one period of 16,384 rows, in volts."""
    _check_size(played, SIGLENT_POINTS, SIGLENT_POINTS)
    head = [
        f"data length,{played.volts.size}",
        f"frequency,{played.settings()['frequency_Hz']:.6f}",
        f"amp,{played.high_V - played.low_V:.6f}",
        f"offset,{0.5 * (played.high_V + played.low_V):.6f}",
        "phase,0.000000",
        *[""] * 7,
        "xpos,value",
    ]
    rows = (f"{i},{volts:.6f}" for i, volts in enumerate(played.volts, start=1))
    return ("\r\n".join([*head, *rows]) + "\r\n").encode("ascii")


WRITERS: dict[str, Callable[[Played], bytes]] = {
    "keysight-arb": keysight_arb,
    "tektronix-tfw": tektronix_tfw,
    "siglent-csv": siglent_csv,
}
"""Format -> what makes the file's content."""


def write_bytes(target: Path, content: bytes) -> None:
    """Write one file whole."""
    with whole_file(target) as partial:
        partial.write_bytes(content)


def _check_size(played: Played, least: int, most: int) -> None:
    n = played.volts.size
    if not least <= n <= most:
        raise ExportError(
            f"{n:,} samples; this format takes {least:,} to {most:,}: change the rate (--rate) or duration (--duration)"
        )
