"""Owns `[waveform]`: where waveforms are searched."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator
from pydantic.dataclasses import dataclass

from softclose.allowed.types import (
    MAX_HORIZON_US,
    MOST_IN_A_WAVE,
    SETTINGS,
    Volts,
)
from softclose.waveform import LEAST_RISE_US, MIN_RISE_US, Waveform


@dataclass(frozen=True, slots=True, kw_only=True, config=SETTINGS)
class WaveformSection:
    """Where waveforms are searched."""

    space: Literal[
        "two-pulse-paper", "two-pulse-full", "three-pulse-full", "two-pulse-release", "three-pulse-release"
    ] = "two-pulse-full"
    """Search space; `-full` holds with its last pulse, `-release` lets go."""
    max_volts: Volts = 150.0
    """Limit on the sum of all pulses at any instant [V], from 1 to 1000."""
    min_rise_us: Annotated[float, Field(ge=LEAST_RISE_US, le=MAX_HORIZON_US)] = MIN_RISE_US
    """Fastest rise that may be proposed [µs]: what the second mode of the device allows; 4 is for the paper's plate."""
    initial: tuple[tuple[tuple[float | None, ...], ...], ...] = ()
    """The user's own waveforms, evaluated first: each a list of [start, rise, peak, volts]; a peak of "hold" holds."""
    initial_from: str = ""
    """A store whose best candidates are evaluated first; `softclose run` writes them into `initial`."""
    initial_count: Annotated[int, Field(ge=1, le=MOST_IN_A_WAVE, strict=True)] = 10
    """Most candidates that are taken from there."""

    @property
    def least_rise_us(self) -> float:
        """Fastest rise of waveforms that are given [µs]: a slower search refuses none of today's."""
        return min(self.min_rise_us, MIN_RISE_US)

    @field_validator("initial", mode="before")
    @classmethod
    def _read_holds(cls, value: Any) -> Any:
        """TOML has no null: a peak of "hold" (or inf) becomes None."""
        if not isinstance(value, list | tuple):
            return value
        return [
            [
                [_peak(v) if j == 2 else v for j, v in enumerate(row)] if isinstance(row, list | tuple) else row
                for row in rows
            ]
            if isinstance(rows, list | tuple)
            else rows
            for rows in value
        ]

    def initial_waveforms(self) -> tuple[Waveform, ...]:
        """`initial` as waveforms; raises WaveformError where one is malformed."""
        return tuple(Waveform.from_rows(rows) for rows in self.initial)


def _peak(value: Any) -> Any:
    return None if value == "hold" or (isinstance(value, float) and math.isinf(value)) else value
