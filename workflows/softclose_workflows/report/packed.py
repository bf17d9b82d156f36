"""Owns the compact form in which a page carries motions and histograms of every candidate that a reader may pick."""

from __future__ import annotations

import base64
import math
from typing import Any

import numpy as np

from softclose.arrays import FloatArray
from softclose.waveform import Waveform
from softclose_workflows.report.data import Traces

SLOWEST_IMPACT_CM_S = 1.0
"""Impacts below this are not marked: the end of every chatter would hide the others [cm/s]."""

_STEPS = 65534
"""16 bits: 0.1 nm in the distance, 0.01 cm/s in the velocity. 65535 is "no value"."""


def pack(values: FloatArray) -> dict[str, Any]:
    """An array as 16-bit steps between its extremes, base64; NaN has a code of its own."""
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)
    step = (high - low) / _STEPS or 1.0
    codes = np.full(values.shape, _STEPS + 1, dtype="<u2")
    good = np.isfinite(values)
    codes[good] = np.rint((values[good] - low) / step).astype("<u2")
    return {"low": low, "step": step, "codes": base64.b64encode(codes.tobytes()).decode("ascii")}


def pack_traces(traces: Traces) -> dict[str, Any]:
    """Motions: the page's script unpacks them into one line per panel."""
    return {
        "n": len(traces.rows),
        "open": np.flatnonzero(~traces.closed).tolist(),
        "times": [round(float(t), 4) for t in traces.times_us],
        "x": pack(traces.distance_um),
        "v": pack(traces.velocity_cm_s),
        "impacts": [
            [round(float(t), 2), round(float(s), 2)]
            for t, s in zip(traces.impact_us.ravel(), traces.impact_cm_s.ravel(), strict=True)
            if s >= SLOWEST_IMPACT_CM_S
        ],
    }


def waveform_points(waveform: Waveform, horizon_us: float) -> tuple[FloatArray, FloatArray]:
    """u(t) for drawing: times [µs], volts. An ideal step has two points at its instant."""
    knots = [waveform.breakpoints(horizon_us), np.array([0.0, horizon_us])]
    for p in waveform.pulses:
        for start in (p.start_us, p.start_us + p.rise_us + p.peak_us):
            if p.rise_us > 0.0 and math.isfinite(start):
                knots.append(np.linspace(start, start + p.rise_us, 24))
            elif math.isfinite(start):
                knots.append(np.array([np.nextafter(start, -1.0), start]))
    times = np.unique(np.concatenate(knots))
    times = times[(times <= horizon_us) & (times >= -1e-9)]
    return times, waveform.voltage(times)
