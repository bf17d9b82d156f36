"""Owns the tables that commands print."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from typing import Any

from softclose.config import CampaignConfig
from softclose.objective import Assessment
from softclose.waveform import FloatArray, Waveform


def describe_waveform(rows: Sequence[Sequence[float]] | FloatArray) -> str:
    """One line a pulse: `150.0 V from 0.00 µs, rise 4.00, top 5.31`."""
    lines = []
    for start, rise, peak, volts in rows:
        top = "holds" if peak is None or math.isinf(peak) else f"top {peak:.2f} µs"
        edge = "ideal step" if rise == 0 else f"rise {rise:.2f} µs"
        lines.append(f"{volts:6.2f} V from {start:6.2f} µs, {edge}, {top}")
    return "\n".join(lines)


def with_interval(value: float, lower: float, upper: float, digits: int) -> str:
    """`19.70 (19.21–20.14)`; a dash where there is no value."""
    if math.isnan(value):
        return "–"
    if math.isnan(lower) or math.isnan(upper):
        return f"{value:.{digits}f}"
    return f"{value:.{digits}f} ({lower:.{digits}f}–{upper:.{digits}f})"
