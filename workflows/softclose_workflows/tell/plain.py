"""Owns how values go into JSON: no NaN, no infinity, a waveform as rows."""

from __future__ import annotations

import json
import math
from typing import Any


def finite(value: Any) -> Any:
    """JSON has no NaN and no infinity: they become null, however deep. Tuples become lists."""
    if isinstance(value, dict):
        return {k: finite(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [finite(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def json_text(value: Any, indent: int = 2) -> str:
    """One JSON object as text."""
    return json.dumps(finite(value), indent=indent, allow_nan=False)


def waveform_rows(rows: Any) -> list[list[float | None]]:
    """[[start, rise, peak (None where it holds), volts], …] of rows (n, 4), without those of absent pulses (NaN)."""
    return [finite([float(v) for v in row]) for row in rows if not math.isnan(float(row[0]))]
