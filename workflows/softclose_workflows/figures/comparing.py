"""Owns the figure that puts campaigns side by side: waveforms and densities of V over each other."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure

from softclose_workflows.figures.drawing import LINES, overlay
from softclose_workflows.figures.style import COLOURS, PAGE_IN, literal
from softclose_workflows.report.compare_page import judged, top_speed
from softclose_workflows.report.comparison import Entry
from softclose_workflows.report.packed import waveform_points


def draw_comparison(entries: Sequence[Entry]) -> Figure:
    """Waveforms on the left, densities of V on the right."""
    designs = judged(entries)
    figure = Figure(figsize=(PAGE_IN, 2.9))
    volts, density = figure.subplots(1, 2)
    horizon = max(e.data.config.model.horizon_us for e in entries)
    for place, (design, role) in enumerate(designs):
        volts.plot(*waveform_points(design.waveform, horizon), color=COLOURS[role], linestyle=LINES[place % len(LINES)])
    volts.set(xlabel="Time (µs)", ylabel="Voltage (V)", xlim=(0.0, horizon))
    volts.set_ylim(bottom=0.0)
    overlay(density, designs, top_speed(entries))
    handles, names = density.get_legend_handles_labels()
    # A name is a stranger's text: matplotlib would read what is between dollar signs as mathematics.
    figure.legend(handles, [literal(n) for n in names], loc="outside upper center", ncols=2)
    return figure
