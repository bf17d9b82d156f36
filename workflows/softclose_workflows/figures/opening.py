"""Owns the figure of an opening: how the lot falls back, without and with a brake, over the drive."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from softclose.opening import Openings
from softclose_workflows.figures.style import COLOURS, PAGE_IN, literal


def draw_opening(found: Openings, title: str) -> Figure:
    """x in travels (median, and from 5 to 95 %) and volts, from the begin of the fall."""
    figure = Figure(figsize=(PAGE_IN, 3.4))
    motion, drive = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    for o, colour, label in ((found.plain, "open", "falls"), (found.braked, "best", "with a brake")):
        if o is None:
            continue
        r = o.released
        low, middle, high = r.quantiles
        motion.fill_between(r.times_us, low, high, color=COLOURS[colour], alpha=0.25, linewidth=0)
        motion.plot(r.times_us, middle, color=COLOURS[colour], linewidth=1.2, label=label)
        volts = r.waveform.voltage(found.at_us + np.asarray(r.times_us))
        drive.plot(r.times_us, volts, color=COLOURS[colour], linewidth=1.0)
    motion.axhline(0.0, color=COLOURS["muted"], linewidth=0.7, linestyle="dotted")
    motion.set_ylabel("x / D")
    motion.legend(loc="upper right")
    drive.set(xlabel="Time from the begin of the fall (µs)", ylabel="u (V)")
    drive.set_ylim(bottom=0.0)
    figure.suptitle(literal(title), fontsize=8.5)
    return figure
