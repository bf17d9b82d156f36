"""Owns waveforms as SPICE sources: piecewise-linear, with as many points as a stated error needs."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

import numpy as np

from softclose.arrays import FloatArray
from softclose.waveform import Waveform
from softclose_workflows.errors import ExportError

STEP_EDGE_US = 1e-4
"""Time that an ideal step takes in a piecewise-linear source [µs]: 0.1 ns."""

MAX_POINTS = 100_000
"""Most points of a source."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Polyline:
    """A waveform as straight lines between points."""

    times_us: FloatArray
    """(n,) increasing [µs], from 0; the last value holds for ever."""
    volts: FloatArray
    """(n,) [V]."""
    tolerance_V: float
    """The lines are nowhere farther from the waveform than this, the edges of ideal steps excepted [V]."""
    has_steps: bool
    """True where the waveform has ideal steps: each is drawn as an edge of STEP_EDGE_US."""


def draw(waveform: Waveform, tolerance_V: float = 1e-3) -> Polyline:
    """The fewest points, from left to right, whose linear interpolation stays within tolerance_V of Eq. 12.

    A chord over a stretch of length h deviates by at most h²/8·max|u''| there, and u'' is a sum of cosines with known
    extremes: the bound holds everywhere, not only where it was sampled. Raises ExportError.
    """
    if not (math.isfinite(tolerance_V) and tolerance_V > 0.0):
        raise ExportError(f"the tolerance is {tolerance_V:g} V; it must be above 0 (for example 0.001)")
    knots = waveform.breakpoints()
    times: list[float] = [0.0]
    volts: list[float] = [_before(waveform, 0.0)]

    def edge(t: float) -> float:
        """Add the edge of a step at t; returns where the smooth course goes on."""
        if not _jump(waveform, t):
            return t
        end = t + STEP_EDGE_US
        times.append(end)
        volts.append(float(waveform.voltage(end)))
        return end

    a = edge(0.0)
    for b in knots[1:]:
        while a < b:
            a = _reach(waveform, a, float(b), tolerance_V)
            times.append(a)
            volts.append(_before(waveform, a) if a == b else float(waveform.voltage(a)))
            if len(times) > MAX_POINTS:
                raise ExportError(
                    f"a tolerance of {tolerance_V:g} V needs more than {MAX_POINTS:,} points; allow a larger one"
                )
        a = edge(float(b))
    has_steps = any(p.rise_us == 0.0 for p in waveform.pulses)
    return Polyline(times_us=np.array(times), volts=np.array(volts), tolerance_V=tolerance_V, has_steps=has_steps)


def _jump(waveform: Waveform, t: float) -> float:
    """Height of the ideal steps at t [V]."""
    up = sum(p.volts for p in waveform.pulses if p.rise_us == 0.0 and p.start_us == t)
    down = sum(p.volts for p in waveform.pulses if p.rise_us == 0.0 and p.start_us + p.rise_us + p.peak_us == t)
    return up - down


def _before(waveform: Waveform, t: float) -> float:
    """u just before t [V]."""
    return float(waveform.voltage(t)) - _jump(waveform, t)


def _reach(waveform: Waveform, a: float, b: float, tolerance_V: float) -> float:
    """The end of the longest chord from a that keeps the tolerance, at most b."""

    def fits(end: float) -> bool:
        return (end - a) ** 2 * _curvature(waveform, a, end) <= 8.0 * tolerance_V

    if fits(b):
        return b
    low, high = a, b
    while high - low > 1e-12 * b + 1e-9 * (high - a):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if fits(middle) else (low, middle)
    if low <= a:
        raise ExportError(f"a tolerance of {tolerance_V:g} V is beyond double precision; allow a larger one")
    return low


def _curvature(waveform: Waveform, a: float, b: float) -> float:
    """Upper bound of |u''| on [a, b], which no breakpoint divides [V/µs²]."""
    total = 0.0
    for p in waveform.pulses:
        if p.rise_us == 0.0:
            continue
        for start in (p.start_us, p.start_us + p.rise_us + p.peak_us):
            if start <= 0.5 * (a + b) <= start + p.rise_us:
                theta = np.pi * (np.array([a, b]) - start) / p.rise_us
                # |cos| is largest at an end: it is largest at 0 and π, the ends of the whole ramp.
                total += p.volts * np.pi**2 / (2.0 * p.rise_us**2) * float(np.abs(np.cos(theta)).max())
    return total


NAME = re.compile(r"[A-Za-z0-9_.:\[\]<>+-]+")
"""What a node may be called here: what SPICE dialects agree on."""


def spice_source(line: Polyline, *, source: str = "Vdrive", nodes: str = "drive 0", comments: list[str]) -> str:
    """The text of a SPICE file with one independent voltage source, to be included in a netlist.

    source: its name, beginning with V; nodes: positive and negative. Raises ExportError.
    """
    if source[:1] not in ("V", "v") or not NAME.fullmatch(source):
        raise ExportError(
            f"the source is named {source!r}; a SPICE voltage source begins with V, e.g. Vdrive (--source)"
        )
    names = nodes.split()
    if len(names) != 2 or not all(NAME.fullmatch(n) for n in names):
        raise ExportError(f"the nodes are {nodes!r}; give two names with a space between, e.g. 'drive 0' (--nodes)")
    steps = f"; ideal steps take {STEP_EDGE_US * 1e3:g} ns" if line.has_steps else ""
    head = [
        *comments,
        f"{line.times_us.size} points; linear interpolation is within {line.tolerance_V * 1e3:g} mV{steps}; "
        "the last value holds",
    ]
    rows = [f"* {text}" for text in head]
    rows.append(f"{source} {names[0]} {names[1]} PWL(")
    rows += [f"+ {t * 1e-6:.15e} {u:.12g}" for t, u in zip(line.times_us, line.volts, strict=True)]
    rows.append("+ )")
    return "\n".join(rows) + "\n"
