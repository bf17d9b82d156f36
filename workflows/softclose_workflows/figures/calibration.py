"""Owns the figure of a calibration, after the published Fig. 3: histogram and fitted density of E, G, T and D."""

from __future__ import annotations

from matplotlib.figure import Figure

from softclose.population import UNITS
from softclose.population.calibrate import KINDS, Calibration
from softclose_workflows.figures.style import COLOURS, PAGE_IN


def draw_calibration(calibration: Calibration) -> Figure:
    """The four panels."""
    panels = calibration.panels()
    figure = Figure(figsize=(PAGE_IN, 4.8))
    for axes, v in zip(figure.subplots(2, 2).flat, "EGTD", strict=True):
        p = panels[v]
        axes.stairs(p["density"], p["edges"], fill=True, color=COLOURS["best"], alpha=0.3)
        axes.plot(p["grid"], p["fitted"], color=COLOURS["best"])
        axes.set(xlabel=f"{v} ({UNITS[v]}), {KINDS[v]}, p = {calibration.fits[v].p_value:.2f}", ylabel="Density")
    return figure
