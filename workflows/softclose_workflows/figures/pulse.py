"""Owns the figure that says what start, rise, flat top and volts of each pulse are (Fig. 5)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from softclose.waveform import Waveform
from softclose_workflows.figures.style import COLOURS, PAGE_IN

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw_pulses(waveform: Waveform, horizon_us: float) -> Figure:
    """Each pulse with its four numbers at its edges, and their sum, which is the drive."""
    last = float(waveform.breakpoints(horizon_us)[-1])
    until = min(horizon_us, 1.25 * last + 10.0)
    t = np.linspace(0.0, until, 4001)
    n = len(waveform.pulses)
    figure = Figure(figsize=(PAGE_IN, 1.35 * (n + 1)))
    panels = figure.subplots(n + 1, 1, sharex=True, squeeze=False)[:, 0]
    top = max(float(waveform.voltage(t).max()), *(p.volts for p in waveform.pulses))
    for number, (axes, pulse) in enumerate(zip(panels, waveform.pulses, strict=False), start=1):
        axes.set(ylabel=f"Pulse {number} (V)", xlim=(0.0, until), ylim=(0.0, 1.35 * top))
        axes.plot(t, Waveform([pulse]).voltage(t), color=COLOURS["best"], linewidth=1.4)
        falls = pulse.start_us + pulse.rise_us + pulse.peak_us
        up, end = min(pulse.start_us + pulse.rise_us, until), min(falls + pulse.rise_us, until)
        held = "holds" if math.isinf(falls) else f"flat top {pulse.peak_us:.2f} µs"
        _span(axes, 0.0, pulse.start_us, 0.12 * top, f"start {pulse.start_us:.2f} µs", end)
        _span(axes, pulse.start_us, up, 0.62 * pulse.volts, f"rise {pulse.rise_us:.2f} µs", end)
        _span(axes, up, min(falls, until), 1.1 * pulse.volts, held, end)
        if falls < until:
            _span(axes, falls, end, 0.3 * pulse.volts, f"fall {pulse.rise_us:.2f} µs", end)
        axes.annotate(
            f"{pulse.volts:.1f} V", (until, pulse.volts), xytext=(3, 0), textcoords="offset points", va="center",
            fontsize=7.5, annotation_clip=False,
        )  # fmt: skip
        axes.axhline(pulse.volts, color=COLOURS["muted"], linewidth=0.6, linestyle=":")
    panels[-1].plot(t, waveform.voltage(t), color=COLOURS["ink"], linewidth=1.6)
    panels[-1].set(ylabel="Drive (V)", xlabel="Time (µs)", xlim=(0.0, until), ylim=(0.0, 1.3 * top))
    return figure


def _span(axes: Axes, begin: float, end: float, at: float, text: str, beside: float) -> None:
    """An arrow from one instant to the other, its text above or, where there is no room, behind the pulse.

    begin, end, beside: instants [µs]; at: height [V]. Nothing is drawn of a span of no width.
    """
    if end <= begin:
        return
    arrow = {"arrowstyle": "<->", "linewidth": 0.7, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", (begin, at), (end, at), arrowprops=arrow)
    wide = end - begin > 0.12 * float(np.diff(axes.get_xlim())[0])
    place = (0.5 * (begin + end), at) if wide else (beside, at)
    offset, side, base = ((0, 2), "center", "bottom") if wide else ((4, 0), "left", "center")
    axes.annotate(text, place, xytext=offset, textcoords="offset points", ha=side, va=base, fontsize=7.5)
