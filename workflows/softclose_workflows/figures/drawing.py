"""Owns the figures for publication: the report's data, drawn with matplotlib. Numbers of figures are the paper's."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from softclose.propose.dependence import Dependence
from softclose.propose.origins import group_of
from softclose_workflows.figures.pulse import draw_pulses
from softclose_workflows.figures.style import COLOURS, COLUMN_IN, PAGE_IN
from softclose_workflows.report import shapes
from softclose_workflows.report.charts import population_density
from softclose_workflows.report.data import Design, ReportData
from softclose_workflows.report.packed import SLOWEST_IMPACT_CM_S, waveform_points
from softclose_workflows.tell import labels

Drawing = Callable[[ReportData], "Figure | None"]

LINES = ("-", "--", ":", "-.", (0, (8, 3)))
MARKERS = {
    "circle-open": "o",
    "circle": "o",
    "diamond": "D",
    "star": "*",
    "square-open": "s",
    "triangle-up": "^",
    "x": "x",
}


def response(data: ReportData) -> Figure | None:
    """Voltage, distance to the contact and velocity over time (Figs. 6, 8, 10)."""
    design = data.best_design
    if design is None:
        return None
    figure = Figure(figsize=(PAGE_IN, 5.4))
    voltage, distance, velocity = figure.subplots(3, 1, sharex=True, gridspec_kw={"height_ratios": [0.7, 1.0, 1.0]})
    horizon, traces = data.config.model.horizon_us, design.traces
    voltage.plot(*waveform_points(design.waveform, horizon), color=COLOURS["ink"], linewidth=1.4)
    voltage.set(ylabel="Voltage (V)", xlim=(0.0, horizon))
    voltage.set_ylim(bottom=0.0)
    if traces is not None:
        for axes, motion in ((distance, traces.distance_um), (velocity, traces.velocity_cm_s)):
            draw_motion(axes, traces.times_us, motion, traces.closed)
        if not traces.closed.all():
            distance.plot([], [], "--", color=COLOURS["open"], linewidth=0.8, label="stays open")
            distance.legend(loc="upper right")
        hard = traces.impact_cm_s >= SLOWEST_IMPACT_CM_S
        velocity.plot(
            traces.impact_us[hard],
            traces.impact_cm_s[hard],
            ".",
            markersize=2.2,
            color=COLOURS["deterministic"],
            markeredgewidth=0.0,
            label=f"impacts of {SLOWEST_IMPACT_CM_S:g} cm/s or more",
        )
        velocity.legend(loc="upper left")
    distance.axhline(0.0, color=COLOURS["ink"], linewidth=1.0)
    distance.annotate(
        "contact",
        (horizon, 0.0),
        xytext=(-2, 2),
        textcoords="offset points",
        ha="right",
        va="bottom",
        fontsize=7.0,
        color=COLOURS["muted"],
    )
    distance.set(ylabel="Distance to contact (µm)")
    velocity.set(ylabel="Velocity (cm/s)", xlabel="Time (µs)")
    return figure


def draw_motion(
    axes: Axes, times_us: NDArray[np.floating[Any]], motion: NDArray[np.floating[Any]], closed: NDArray[np.bool_]
) -> None:
    """A line a switch over times_us (n_times,), motion (n_switch, n_times); who stays open has a colour and a dash."""
    for closes, colour, dash in ((True, "best", "solid"), (False, "open", "dashed")):
        lines = [np.column_stack([times_us, row]) for row in motion[closed == closes]]
        axes.add_collection(
            LineCollection(
                lines, colors=COLOURS[colour], linewidths=0.35 if closes else 0.6, alpha=0.4, linestyles=dash
            )
        )
    axes.autoscale_view()


def pulses(data: ReportData) -> Figure | None:
    """What start, rise, flat top and volts of each pulse are (Fig. 5)."""
    design = data.best_design
    return None if design is None else draw_pulses(design.waveform, data.config.model.horizon_us)


def histogram(data: ReportData) -> Figure | None:
    """Histogram of V with v_u and the mean (Figs. 7, 9, 11, 12)."""
    if not data.judged_designs:
        return None
    design = data.judged_designs[0]
    a, edges = design.assessment, np.arange(0.0, math.ceil(_top(data)) + 1.0)
    figure = Figure(figsize=(COLUMN_IN, 2.5))
    axes = figure.subplots()
    axes.stairs(shapes.shares(design.speed_cm_s, edges), edges, fill=True, color=COLOURS["best"], alpha=0.6)
    for value, style, text in ((a.mean_cm_s, ":", "mean"), (a.v_u_cm_s, "--", "$v_u$")):
        if math.isfinite(value):
            axes.axvline(value, color=COLOURS["deterministic"], linestyle=style, label=f"{text} {value:.1f} cm/s")
    last = float(np.nanmax(design.speed_cm_s, initial=5.0))
    axes.set(xlabel="Largest contact speed V (cm/s)", ylabel="Share of switches (%)", xlim=(0.0, last * 1.05))
    axes.set_ylim(bottom=0.0)
    axes.legend(loc="upper left")
    return figure


def densities(data: ReportData) -> Figure | None:
    """Densities of V of the best and the reference designs (Fig. 13)."""
    if not data.judged_designs:
        return None
    figure = Figure(figsize=(COLUMN_IN, 2.8))
    axes = figure.subplots()
    overlay(axes, [(d, d.role) for d in data.judged_designs], _top(data))
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=2)
    return figure


def exceedance(data: ReportData) -> Figure | None:
    """P(V > v) of the best and the reference designs on a logarithmic axis, the best with its interval."""
    if not data.judged_designs:
        return None
    figure = Figure(figsize=(COLUMN_IN, 2.8))
    axes = figure.subplots()
    for place, design in enumerate(data.judged_designs):
        found = shapes.exceedance(design.speed_cm_s, _top(data), design.assessment.confidence)
        colour = COLOURS[design.role]
        if place == 0 and design.assessment.intervals_valid:
            axes.fill_between(found.v_cm_s, found.lower, found.upper, color=colour, alpha=0.18, linewidth=0.0)
        shown = found.probability > 0.0
        line = LINES[place % len(LINES)]
        axes.plot(found.v_cm_s[shown], found.probability[shown], color=colour, linestyle=line, label=design.name)
    for limit in data.config.objective.limits_cm_s:
        axes.axvline(limit, color=COLOURS["muted"], linestyle="dotted", linewidth=0.8)
    least = 0.1 / max(max(d.assessment.n_contact for d in data.judged_designs), 1)
    axes.set(xlabel="Speed v (cm/s)", ylabel="P(V > v)", xlim=(0.0, _top(data)), yscale="log", ylim=(least, 1.0))
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=2)
    return figure


def overlay(axes: Axes, designs: list[tuple[Design, str]], top_cm_s: float) -> None:
    """Densities of V over each other, each with its v_u marked on the curve."""
    for place, (design, role) in enumerate(designs):
        x, y = shapes.speed_density(design.speed_cm_s, top_cm_s)
        if not x.size:
            continue
        axes.plot(x, y, color=COLOURS[role], linestyle=LINES[place % len(LINES)], label=design.name)
        v_u = design.assessment.v_u_cm_s
        if math.isfinite(v_u):
            axes.plot([v_u], np.interp([v_u], x, y), "|", color=COLOURS[role], markersize=9, markeredgewidth=1.4)
    axes.set(xlabel="Largest contact speed V (cm/s)", ylabel="Density (per cm/s)", xlim=(0.0, top_cm_s))
    axes.set_ylim(bottom=0.0)


def switches(data: ReportData) -> Figure | None:
    """V of each switch against D, G, E and T: which hit hardest, which stay open."""
    design = data.best_design
    if design is None:
        return None
    v, closed = design.speed_cm_s, design.closed
    never = ~np.isfinite(v)
    slow, slam = ~closed & ~never, closed & (v > design.assessment.v_u_cm_s)
    figure = Figure(figsize=(PAGE_IN, 4.4))
    grid = figure.subplots(2, 2, sharey=True)
    groups: tuple[tuple[str, Any, dict[str, Any]], ...] = (
        ("closes", closed & ~slam & ~never, {"marker": ".", "color": COLOURS["best"], "markersize": 2.5, "alpha": 0.6}),
        (
            f"closes, among the hardest {100.0 * (1.0 - design.assessment.level):g} %",
            slam,
            {"marker": "^", "color": COLOURS["deterministic"], "markersize": 3.5},
        ),
        (
            "touches, not closed",
            slow,
            {"marker": "s", "color": COLOURS["open"], "markersize": 3.5, "fillstyle": "none"},
        ),
        ("never touches (at 0)", never, {"marker": "x", "color": COLOURS["open"], "markersize": 3.5, "clip_on": False}),
    )
    for axes, name in zip(grid.flat, data.shown_parameters, strict=True):
        for label, which, look in groups:
            if which.any():
                axes.plot(
                    data.parameters[name][: len(v)][which],
                    np.where(never, 0.0, v)[which],
                    label=label,
                    linestyle="none",
                    markeredgewidth=0.7,
                    **look,
                )
        axes.set(xlabel=_axis_label(name))
        axes.set_ylim(bottom=0.0)
    for axes in grid[:, 0]:
        axes.set(ylabel="V (cm/s)")
    handles, names = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside upper center", ncols=len(names))
    return figure


def population(data: ReportData) -> Figure | None:
    """Properties of the ensemble with the distributions that they come from (Figs. 3, 4)."""
    figure = Figure(figsize=(PAGE_IN, 3.6))
    for axes, name in zip(figure.subplots(2, 3).flat, data.parameters, strict=False):
        values = data.parameters[name]
        axes.hist(values, bins=min(40, max(8, int(values.size**0.5))), density=True, color=COLOURS["best"], alpha=0.4)
        grid, density, _ = population_density(data, name)
        axes.plot(grid, density, color=COLOURS["ink"], linewidth=1.0)
        axes.set(xlabel=_axis_label(name), ylabel="Density")
    return figure


def convergence(data: ReportData) -> Figure | None:
    """g of every candidate with its interval, and the best so far."""
    c = shapes.convergence(data)
    if not c.index.size:
        return None
    figure = Figure(figsize=(PAGE_IN, 2.8))
    axes = figure.subplots()
    axes.step(c.index, c.best_cm_s, where="post", color=COLOURS["ink"], linewidth=1.2, label="best so far")
    over = c.g_cm_s > c.ceiling_cm_s
    groups = np.array([group_of(data.candidates.origin[int(i)]) for i in c.index], dtype=object)
    for name, (symbol, role) in labels.ORIGIN_GROUPS.items():
        which = (groups == name) & ~over
        if not which.any():
            continue
        colour = COLOURS[role]
        spread = np.stack([c.g_cm_s - c.lower_cm_s, c.upper_cm_s - c.g_cm_s])[:, which]
        axes.errorbar(
            c.index[which],
            c.g_cm_s[which],
            yerr=np.where(np.isfinite(spread), spread, 0.0),
            color=colour,
            fmt=MARKERS[symbol],
            fillstyle="none" if symbol.endswith("open") else "full",
            markersize=3.0,
            elinewidth=0.6,
            label=name,
        )
    if over.any():
        axes.plot(
            c.index[over],
            np.full(int(over.sum()), c.ceiling_cm_s),
            "^",
            fillstyle="none",
            markersize=3.0,
            color=COLOURS["unshaped"],
            label="above the axis",
            clip_on=False,
        )
    low = float(np.fmin(c.lower_cm_s, c.g_cm_s).min())
    axes.set(xlabel="Candidate", ylabel="Objective g (cm/s)", ylim=(max(0.0, low - 1.0), c.ceiling_cm_s))
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=6)
    return figure


def length_scales(data: ReportData) -> Figure | None:
    """Length scale of each parameter over the campaign."""
    found = shapes.length_scales(data)
    if not found:
        return None
    figure = Figure(figsize=(PAGE_IN, 2.8))
    axes = figure.subplots()
    for place, (name, values) in enumerate(found.items()):
        axes.plot(
            np.arange(len(values)),
            values,
            color=COLOURS[labels.SERIES[place % 5]],
            linestyle=LINES[place // 5],
            linewidth=1.0,
            label=labels.coordinate_label(name, unit=False),
        )
    axes.set(xlabel="Candidate", ylabel="Length scale (share of range)", yscale="log")
    axes.yaxis.set_major_formatter("{x:g}")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=min(4, len(found)))
    return figure


def dependence(data: ReportData) -> Figure | None:
    """g against each parameter: through the best with two standard deviations, and averaged."""
    d = data.dependence
    if d is None:
        return None
    columns = 3
    rows = math.ceil(len(d.names) / columns)
    figure = Figure(figsize=(PAGE_IN, 1.75 * rows + 0.3))
    grid = figure.subplots(rows, columns, sharey=True, squeeze=False)
    low, high = shapes.dependence_span(d)
    for i, axes in enumerate(grid.flat):
        if i >= len(d.names):
            axes.set_visible(False)
            continue
        middle, sd = d.slice_cm_s[i], d.slice_sd_cm_s[i]
        axes.fill_between(
            d.grid[i], middle - 2.0 * sd, middle + 2.0 * sd, color=COLOURS["best"], alpha=0.18, linewidth=0
        )
        axes.plot(d.grid[i], middle, color=COLOURS["best"], label="through the smallest g, ±2 sd")
        axes.plot(d.grid[i], d.mean_cm_s[i], "--", color=COLOURS["deterministic"], label="average over candidates")
        axes.axvline(d.incumbent[i], color=COLOURS["muted"], linestyle=":", linewidth=0.9)
        axes.set(xlabel=_capital(labels.coordinate_label(d.names[i])), ylim=(low, high))
    for axes in grid[:, 0]:
        axes.set(ylabel="g (cm/s)")
    figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return figure


def dependence_pairs(data: ReportData) -> Figure | None:
    """g against the four pairs of parameters that matter most."""
    d = data.dependence
    if d is None or not d.pairs:
        return None
    n = min(4, len(d.pairs))
    figure = Figure(figsize=(PAGE_IN, 2.7 * math.ceil(n / 2)))
    grid = figure.subplots(math.ceil(n / 2), 2, squeeze=False)
    for place, axes in enumerate(grid.flat):
        if place >= n:
            axes.set_visible(False)
        else:
            _map(figure, axes, d, place)
    return figure


def _map(figure: Figure, axes: Axes, d: Dependence, place: int) -> None:
    i, j = d.pairs[place]
    filled = axes.contourf(d.pair_grid[i], d.pair_grid[j], d.pair_cm_s[place], levels=14, cmap="cividis_r")
    axes.plot(d.incumbent[i], d.incumbent[j], "o", markersize=5, markerfacecolor="white", markeredgecolor="black")
    axes.grid(visible=False)
    axes.set(xlabel=_capital(labels.coordinate_label(d.names[i])), ylabel=_capital(labels.coordinate_label(d.names[j])))
    bar = figure.colorbar(filled, ax=axes, label="g (cm/s)")
    bar.outline.set_visible(False)


def _axis_label(name: str) -> str:
    words, unit = labels.PARAMETERS[name]
    return f"{_capital(words)} ({unit})"


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _top(data: ReportData) -> float:
    """End of the axes of speed: the largest speed of any design, in whole 5 cm/s."""
    tops = [d.assessment.max_cm_s for d in data.judged_designs if math.isfinite(d.assessment.max_cm_s)]
    return 5.0 * math.ceil((max(tops, default=10.0) + 1.0) / 5.0)


FIGURES: dict[str, Drawing] = {
    "response": response,
    "pulses": pulses,
    "histogram": histogram,
    "densities": densities,
    "exceedance": exceedance,
    "switches": switches,
    "population": population,
    "convergence": convergence,
    "length-scales": length_scales,
    "dependence": dependence,
    "dependence-pairs": dependence_pairs,
}
"""Name of a figure, also of its files, and what draws it; None where the store has nothing to show in it."""
