"""Owns which formats a drive is written in, and which settings mean something for each. It imports nothing slow."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, Self

from softclose_workflows.errors import ExportError

MEANT_FOR: dict[str, frozenset[str]] = {
    "csv": frozenset({"rate_MSps", "duration_us"}),
    "pwl": frozenset({"tolerance_mV", "source", "nodes"}),
    "dac": frozenset({"rate_MSps", "duration_us", "bits", "full_scale_V", "signed", "header"}),
    "keysight-arb": frozenset({"rate_MSps", "duration_us", "gain"}),
    "tektronix-tfw": frozenset({"rate_MSps", "duration_us", "gain"}),
    "siglent-csv": frozenset({"duration_us", "gain"}),
}
"""Format -> the settings that mean something for it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveSettings:
    """How a drive is to be written."""

    format: str = "csv"
    """csv, pwl, dac, keysight-arb, tektronix-tfw or siglent-csv."""
    rate_MSps: float = 10.0
    """Samples per µs; siglent-csv has 16,384 samples in any case."""
    duration_us: float | None = None
    """Length [µs]; None: the campaign's horizon."""
    tolerance_mV: float = 1.0
    """pwl: largest deviation of the straight lines from the waveform [mV]."""
    source: str = "Vdrive"
    """pwl: name of the voltage source."""
    nodes: str = "drive 0"
    """pwl: its positive and negative node."""
    bits: int = 14
    """dac: resolution."""
    full_scale_V: float | None = None
    """dac: voltage at the switch of the largest code, amplifier included [V]; required."""
    gain: float | None = None
    """Files of generators: volts at the switch per volt of the generator; required."""
    signed: bool = True
    """dac: two's complement, or 0 V as lowest code."""
    header: bool = True
    """dac: lines beginning with # before the codes."""
    max_error_cm_s: float = 0.5
    """How far v_u of the delivered samples may be from the waveform's [cm/s], p_nc a hundredth of it."""
    release: bool = False
    """The whole drive, with the opening that the campaign designed."""
    pull_in_V: float | None = None
    """Trimmed: the switch's measured pull-in voltage [V]."""
    resonance_kHz: float | None = None
    """Trimmed: its measured resonance [kHz]."""

    @classmethod
    def of(cls, **given: Any) -> Self:
        """From what a caller names. Raises ExportError for a name that is none, or has no meaning for the format."""
        unknown = set(given) - {f.name for f in fields(cls)}
        if unknown:
            raise ExportError(f"a waveform has no setting {', '.join(sorted(unknown))}")
        settings = cls(**given)
        check_meant(settings.format, {name: name for name in given})
        return settings


def check_meant(form: str, given: Mapping[str, str]) -> None:
    """Refuse a setting that has no meaning for a format.

    given: name of a setting of `DriveSettings` -> how its user wrote it. Raises ExportError.
    """
    of_formats = frozenset().union(*MEANT_FOR.values())
    for name, written in given.items():
        if name in of_formats - MEANT_FOR.get(form, of_formats):
            meant = ", ".join(sorted(f for f, names in MEANT_FOR.items() if name in names))
            raise ExportError(f"{written} has no meaning for --format {form}; it belongs to {meant}")
