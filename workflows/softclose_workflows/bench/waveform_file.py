"""Owns reading a waveform that somebody chose by hand, from a file."""

from __future__ import annotations

import json
import math

from softclose.waveform import Waveform, WaveformError
from softclose_workflows.errors import BenchError


def read_waveform(path: str) -> Waveform:
    """Read rows of start, rise, peak [µs] and volts as JSON; null as peak: the pulse holds.

    An object with such rows as `waveform` will do, as `softclose bench ask --json` and `status --json` print it. Raises
    BenchError.
    """
    try:
        with open(path, encoding="utf-8-sig") as file:
            said = json.load(file)
    except (OSError, ValueError, RecursionError) as e:
        raise BenchError(f"{path} cannot be read as JSON: {e}") from e
    rows = said.get("waveform", ()) if isinstance(said, dict) else said
    try:
        return Waveform.from_rows([[math.inf if value is None else float(value) for value in row] for row in rows])
    except (TypeError, ValueError, OverflowError, WaveformError) as e:
        raise BenchError(
            f"{path} holds no waveform ({e}): expected are rows of start, rise, peak [µs] (null: holds) and volts"
        ) from e
