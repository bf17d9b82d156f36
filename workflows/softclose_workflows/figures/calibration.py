"""Owns the figure of a calibration, after the published Fig. 3: histogram and fitted density of each variable."""

from __future__ import annotations

from matplotlib.figure import Figure

from softclose.population import UNITS
from softclose.population.calibrate import KINDS, Calibration
from softclose_workflows.figures.style import COLOURS, PAGE_IN


def draw_calibration(calibration: Calibration) -> Figure:
    """The four panels."""
    panels = calibration.panels()
    figure = Figure(figsize=(PAGE_IN, 4.8))
    for axes, v in zip(figure.subplots(2, 2).flat, _order(calibration.population.variables), strict=True):
        p = panels[v]
        axes.stairs(p["density"], p["edges"], fill=True, color=COLOURS["best"], alpha=0.3)
        axes.plot(p["grid"], p["fitted"], color=COLOURS["best"])
        axes.set(xlabel=f"{v} ({UNITS[v]}), {KINDS[v]}, p = {calibration.fits[v].p_value:.2f}", ylabel="Density")
    return figure


def _order(variables: tuple[str, ...]) -> tuple[str, ...]:
    """That of the published figure: E, G, T, D."""
    d, g, first, second = variables
    return first, g, second, d
