"""Owns the figure that compares engines: best g against evaluations and against time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from softclose_workflows.analyses.engines import Compared, by_engine
from softclose_workflows.figures.drawing import LINES
from softclose_workflows.figures.style import COLOURS, PAGE_IN
from softclose_workflows.tell.labels import SERIES


def draw_engines(results: Sequence[Compared]) -> Figure:
    """Median, and the range over the seeds."""
    figure = Figure(figsize=(PAGE_IN, 2.9))
    left, right = figure.subplots(1, 2, sharey=True)
    for place, (engine, runs) in enumerate(by_engine(results).items()):
        colour, line = COLOURS[SERIES[place % len(SERIES)]], LINES[place % len(LINES)]
        n = min(len(r.run.best_g_cm_s) for r in runs)
        g = np.array([r.run.best_g_cm_s[:n] for r in runs])
        wall = np.median([r.run.wall_s[:n] for r in runs], axis=0)
        for axes, x in ((left, np.arange(1, n + 1)), (right, wall)):
            axes.plot(x, np.median(g, axis=0), color=colour, linestyle=line, label=engine)
            axes.fill_between(x, g.min(axis=0), g.max(axis=0), color=colour, alpha=0.15, linewidth=0)
    left.set(xlabel="Evaluations", ylabel="Best g on the training ensemble (cm/s)")
    right.set(xlabel="Time (s)", xscale="log")
    left.legend()
    return figure
