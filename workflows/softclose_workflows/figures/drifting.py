"""Owns the figure of a drift: upper velocity and open switches as the pull-in voltages move."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from softclose.metrics.intervals import Interval
from softclose.uncertainty.drift import Drift
from softclose_workflows.figures.style import COLOURS, PAGE_IN, literal


def draw_drift(found: Drift, title: str) -> Figure:
    """v_u with its double as a line, and p_nc, over the drift, with their intervals."""
    figure = Figure(figsize=(PAGE_IN, 2.9))
    left, right = figure.subplots(1, 2)
    scale, unit = (100.0, "%") if found.kind == "stiffness" else (1.0, "V")
    x = scale * np.array([r.drift for r in found.rows])
    a = [r.assessment for r in found.rows]
    _line(left, x, [v.v_u_cm_s for v in a], [v.v_u_interval for v in a], "best")
    _line(
        right,
        x,
        [100.0 * v.p_nc for v in a],
        [(100.0 * v.p_nc_intervals.wilson[0], 100.0 * v.p_nc_intervals.wilson[1]) for v in a],
        "open",
    )
    still = next(r.assessment.v_u_cm_s for r in found.rows if r.drift == 0.0)
    left.axhline(2.0 * still, color=COLOURS["muted"], linestyle="dashed", linewidth=0.9, label="twice $v_u$")
    for value in found.doubled:
        if math.isfinite(value):
            left.axvline(scale * value, color=COLOURS["muted"], linestyle="dotted", linewidth=0.9)
    for axes in (left, right):
        axes.set_xlabel(f"Drift of pull-in voltages by {found.kind} ({unit})")
        axes.set_ylim(bottom=0.0)
    left.set_ylabel("$v_u$ (cm/s)")
    right.set_ylabel("Not closed (%)")
    left.legend(loc="best")
    figure.suptitle(literal(title), fontsize=8.5)
    return figure


def _line(axes: Axes, x: np.ndarray, estimate: list[float], interval: list[Interval], colour: str) -> None:
    y, ends = np.array(estimate), np.array(interval)
    axes.errorbar(x, y, yerr=np.abs(ends.T - y), color=COLOURS[colour], marker="o", markersize=3, capsize=2)
