"""Owns the charts of the report, as Plotly figures: plain dictionaries with colours named by role ("@best").

The page's script replaces the roles by the colours of the reader's theme. Every chart has a text for those who cannot
see it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from softclose.arrays import FloatArray
from softclose.propose.dependence import Dependence
from softclose.propose.origins import group_of
from softclose_workflows.report import shapes
from softclose_workflows.report.data import Design, ReportData
from softclose_workflows.tell import labels

Chart = dict[str, Any]

DASHES = ("solid", "dash", "dot", "dashdot", "longdash")
"""A second channel beside colour, for grey prints and colour-blind readers."""


def numbers(values: FloatArray, digits: int = 4) -> list[float | None]:
    """JSON numbers of so many significant digits; None where undefined (JSON has no NaN)."""
    return [float(f"{v:.{digits}g}") if math.isfinite(v) else None for v in np.asarray(values, dtype=float).tolist()]


def axis(title: str, **more: Any) -> dict[str, Any]:
    """One axis in the house style."""
    return {
        "title": {"text": title, "standoff": 8},
        "gridcolor": "@grid",
        "linecolor": "@line",
        "zeroline": False,
        "ticks": "outside",
        "tickcolor": "@line",
        "ticklen": 4,
        "automargin": True,
    } | more


MOST_INTERVALS = 1000
"""Candidates of one kind whose intervals are drawn: more of them are a grey wall, and half of the page."""


def layout(x: dict[str, Any], y: dict[str, Any], **more: Any) -> dict[str, Any]:
    """One panel in the house style."""
    return {
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "font": {"color": "@ink", "size": 13},
        "margin": {"l": 60, "r": 18, "t": 16, "b": 48},
        "xaxis": x,
        "yaxis": y,
        "showlegend": False,
        "hoverlabel": {"bgcolor": "@card", "bordercolor": "@line", "font": {"color": "@ink"}},
        "height": 340,
        "modebar": {"bgcolor": "rgba(0,0,0,0)", "color": "@muted", "activecolor": "@best"},
        "legend": {"orientation": "h", "x": 0, "y": 1.02, "yanchor": "bottom", "bgcolor": "rgba(0,0,0,0)"},
    } | more


def response(data: ReportData) -> Chart:
    """Three panels over one time axis, as Figs. 6, 8 and 10: voltage, distance, velocity. The script fills it in."""
    line = {"line": {"color": "@best", "width": 0.7}, "mode": "lines", "opacity": 0.6, "hoverinfo": "skip"}
    stays = line | {"line": {"color": "@open", "width": 0.9, "dash": "dot"}}
    return {
        "data": [
            {
                "name": "voltage",
                "x": [],
                "y": [],
                "mode": "lines",
                "line": {"color": "@ink", "width": 2},
                "hovertemplate": "%{x:.1f} µs: %{y:.1f} V<extra></extra>",
            },
            {"name": "distance", "x": [], "y": [], "yaxis": "y2", **line},
            {"name": "velocity", "x": [], "y": [], "yaxis": "y3", **line},
            {"name": "distance, stays open", "x": [], "y": [], "yaxis": "y2", **stays},
            {"name": "velocity, stays open", "x": [], "y": [], "yaxis": "y3", **stays},
            {
                "name": "impacts",
                "x": [],
                "y": [],
                "yaxis": "y3",
                "mode": "markers",
                "marker": {"color": "@deterministic", "size": 4, "opacity": 0.75},
                "hovertemplate": "impact at %{x:.1f} µs: %{y:.1f} cm/s<extra></extra>",
            },
        ],
        "layout": layout(
            axis("Time (µs)", range=[0, _until(data)], anchor="y3"),
            axis("Voltage (V)", domain=[0.76, 1.0], rangemode="tozero"),
            yaxis2=axis("Distance (µm)", domain=[0.39, 0.72]),
            yaxis3=axis("Velocity (cm/s)", domain=[0.0, 0.35]),
            height=680,
            shapes=[
                {
                    "type": "line",
                    "xref": "paper",
                    "x0": 0,
                    "x1": 1,
                    "yref": "y2",
                    "y0": 0,
                    "y1": 0,
                    "line": {"color": "@ink", "width": 1.4},
                },
                {
                    "type": "line",
                    "xref": "paper",
                    "x0": 0,
                    "x1": 1,
                    "yref": "y3",
                    "y0": 0,
                    "y1": 0,
                    "line": {"color": "@line", "width": 1},
                },
            ],
            annotations=[
                {
                    "xref": "paper",
                    "x": 1,
                    "xanchor": "right",
                    "yref": "y2",
                    "y": 0,
                    "yanchor": "bottom",
                    "text": "contact",
                    "showarrow": False,
                    "font": {"size": 12, "color": "@muted"},
                }
            ],
        ),
        "alt": "Three panels over time: the drive voltage, each drawn switch's distance to the closed position with "
        "the contact line at zero, and its velocity with a mark for each impact.",
    }


def _until(data: ReportData) -> float:
    """Where the panels over time begin to end: a little after the last impact that is drawn of the best [µs]."""
    horizon, best = data.config.model.horizon_us, data.best_design
    if best is None or best.traces is None or not np.isfinite(best.traces.impact_us).any():
        return horizon
    last = max(float(np.nanmax(best.traces.impact_us)), best.waveform.pulses[-1].start_us + 20.0)
    return min(horizon, 10.0 * math.ceil(0.115 * last))


def histogram(data: ReportData) -> Chart:
    """Histogram of V with v_u and the mean, as Figs. 7, 9, 11, 12. The script fills in the candidate that is shown."""
    centres = 0.5 * (data.edges_cm_s[1:] + data.edges_cm_s[:-1])
    return {
        "data": [
            {
                "type": "bar",
                "x": numbers(centres),
                "y": [],
                "width": 0.94,
                "marker": {"color": "@best/0.65", "line": {"width": 0}},
                "hovertemplate": "%{x:.1f} ± 0.5 cm/s: %{y:.2f} % of the switches<extra></extra>",
            }
        ],
        "layout": layout(
            axis("Largest contact speed V (cm/s)", rangemode="tozero"),
            axis("Share of switches (%)"),
            bargap=0,
            margin={"l": 60, "r": 18, "t": 44, "b": 48},
        ),
        "alt": "Histogram of the largest contact speed V of each switch, with the upper velocity and the mean marked.",
    }


def densities(designs: Sequence[Design], colours: Sequence[str], top_cm_s: float) -> Chart:
    """Densities of V of several designs over each other, as Fig. 13, each with its v_u marked."""
    traces: list[Chart] = []
    for place, (design, colour) in enumerate(zip(designs, colours, strict=True)):
        x, y = shapes.speed_density(design.speed_cm_s, top_cm_s)
        a = design.assessment
        traces.append(
            {
                "name": f"{design.name}: v<sub>u</sub> {labels.number(a.v_u_cm_s)} cm/s",
                "x": numbers(x),
                "y": numbers(y, 3),
                "mode": "lines",
                "line": {"color": f"@{colour}", "width": 2.2, "dash": DASHES[place % len(DASHES)]},
                "hovertemplate": "%{y:.3f}<extra>" + plain(design.name) + "</extra>",
                **({"fill": "tozeroy", "fillcolor": f"@{colour}/0.10"} if place == 0 else {}),
            }
        )
        if math.isfinite(a.v_u_cm_s) and x.size:
            traces.append(
                {
                    "x": [round(a.v_u_cm_s, 3)],
                    "y": numbers(np.interp([a.v_u_cm_s], x, y), 3),
                    "mode": "markers",
                    "marker": {"color": f"@{colour}", "size": 10, "symbol": "line-ns-open", "line": {"width": 2.5}},
                    "showlegend": False,
                    "hovertemplate": "v<sub>u</sub> %{x:.1f} cm/s<extra>" + plain(design.name) + "</extra>",
                }
            )
    spoken = "; ".join(
        f"{d.name}: upper velocity {labels.number(d.assessment.v_u_cm_s)}, mean "
        f"{labels.number(d.assessment.mean_cm_s)} cm/s"
        for d in designs
    )
    return {
        "data": traces,
        "layout": layout(
            axis("Largest contact speed V (cm/s)", range=[0, top_cm_s], unifiedhovertitle={"text": "%{x:.1f} cm/s"}),
            axis("Density (per cm/s)", rangemode="tozero"),
            showlegend=True,
            height=380,
            hovermode="x unified",
        ),
        "alt": f"Densities of the largest contact speed, one curve per design. {spoken}.",
    }


def band(x: FloatArray, low: FloatArray, high: FloatArray, role: str, digits: int = 3) -> Chart:
    """What lies between two curves, shaded in the colour of a role."""
    return {
        "x": numbers(np.concatenate([x, x[::-1]])),
        "y": numbers(np.concatenate([high, low[::-1]]), digits),
        "mode": "lines",
        "line": {"width": 0},
        "fill": "toself",
        "fillcolor": f"@{role}/0.18",
        "hoverinfo": "skip",
        "showlegend": False,
    }


def top_speed(designs: Sequence[Design]) -> float:
    """End of the axis of densities: the largest speed of any design, in whole 5 cm/s."""
    tops = [d.assessment.max_cm_s for d in designs if math.isfinite(d.assessment.max_cm_s)]
    return 5.0 * math.ceil((max(tops, default=10.0) + 1.0) / 5.0)


def exceedance(designs: Sequence[Design], limits_cm_s: Sequence[float], top_cm_s: float) -> Chart:
    """P(V > v) of several designs down to what their switches can tell, the first with its interval."""
    traces: list[Chart] = []
    for place, design in enumerate(designs):
        found = shapes.exceedance(design.speed_cm_s, top_cm_s, design.assessment.confidence)
        shown = found.probability > 0.0
        if place == 0 and design.assessment.intervals_valid:
            floor = 0.1 / max(design.assessment.n_contact, 1)  # a logarithmic axis has no 0
            traces.append(band(found.v_cm_s, np.maximum(found.lower, floor), found.upper, design.role))
        traces.append(
            {
                "name": plain(design.name),
                "x": numbers(found.v_cm_s[shown]),
                "y": numbers(found.probability[shown], 3),
                "mode": "lines",
                "line": {"color": f"@{design.role}", "width": 2.2, "dash": DASHES[place % len(DASHES)]},
                "hovertemplate": "P(V > %{x:.2f} cm/s) = %{y:.2g}<extra>" + plain(design.name) + "</extra>",
            }
        )
    least = min((0.1 / d.assessment.n_contact for d in designs if d.assessment.n_contact), default=0.1)
    spoken = "; ".join(
        f"{d.name}: {e.probability.estimate:.2g} above {e.limit_cm_s:g} cm/s"
        for d in designs
        for e in d.assessment.p_exceed
    )
    return {
        "data": traces,
        "layout": layout(
            axis("Speed v (cm/s)", range=[0, top_cm_s]),
            axis("P(V > v)", type="log", range=[math.log10(least), 0.0], exponentformat="power", dtick=1),
            showlegend=True,
            height=380,
            shapes=[
                {
                    "type": "line",
                    "x0": limit,
                    "x1": limit,
                    "yref": "paper",
                    "y0": 0,
                    "y1": 1,
                    "line": {"color": "@muted", "width": 1, "dash": "dot"},
                }
                for limit in limits_cm_s
            ],
        ),
        "alt": f"Probability of exceeding a contact speed, on a logarithmic axis, one curve per design. {spoken}.",
    }


def plain(text: str) -> str:
    """Plotly reads a little markup in its texts: strangers' names must not."""
    return text.replace("&", "&amp;").replace("<", "&lt;").replace("%{", "% {")


def switches(data: ReportData, design: Design, name: str, limit: int = 2000) -> Chart:
    """V against one parameter: which switches hit hardest (above v_u), which never close."""
    values, unit = data.parameters[name], labels.PARAMETERS[name][1]
    n = min(len(design.speed_cm_s), limit)
    v, closed, a = design.speed_cm_s[:n], design.closed[:n], design.assessment
    never, slow = ~np.isfinite(v), ~closed & np.isfinite(v)
    slam = closed & (v > a.v_u_cm_s)
    groups = (
        ("closes", closed & ~slam & ~never, "@best/0.55", "circle", 4),
        (f"closes, among the hardest {100.0 * (1.0 - a.level):g} %", slam, "@deterministic", "triangle-up", 7),
        ("touches, not closed at the end", slow, "@open", "square-open", 7),
        ("never touches (drawn at 0)", never, "@open", "x-thin-open", 7),
    )
    traces = [
        {
            "name": label,
            "x": numbers(values[:n][which]),
            "y": numbers(np.where(never, 0.0, v)[which]),
            "mode": "markers",
            "marker": {
                "color": colour,
                "symbol": symbol,
                "size": size,
                "line": {"width": 1.4 * symbol.endswith("open")},
            },
            "customdata": np.flatnonzero(which).tolist(),
            "cliponaxis": False,
            "hovertemplate": f"switch %{{customdata}}<br>{name} %{{x:.4g}} {unit}<br>V %{{y:.1f}} cm/s"
            f"<extra>{label}</extra>",
        }
        for label, which, colour, symbol, size in groups
        if which.any()
    ]
    words = labels.PARAMETERS[name][0]
    return {
        "data": traces,
        "layout": layout(
            # Margins that follow the labels chase each other here: plotly.js gives up and says so on the console.
            axis(f"{words[0].upper()}{words[1:]} ({unit})", automargin=False),
            axis("V (cm/s)", rangemode="tozero", automargin=False),
            height=300,
            margin={"l": 52, "r": 10, "t": 8, "b": 46},
        ),
        "alt": f"Largest contact speed of each switch against its {words}: {int(slam.sum())} of {n} switches are above "
        f"the upper velocity, {int((slow | never).sum())} are not closed at the end.",
    }


def population(data: ReportData, name: str) -> Chart:
    """One property of the ensemble: histogram, and the density that it was drawn from (Figs. 3 and 4)."""
    words, unit = labels.PARAMETERS[name]
    values = data.parameters[name]
    counts, edges = np.histogram(values, bins=min(40, max(8, int(values.size**0.5))), density=True)
    grid, density, drawn = population_density(data, name)
    return {
        "data": [
            {
                "type": "bar",
                "x": numbers(0.5 * (edges[1:] + edges[:-1]), 6),
                "y": numbers(counts),
                "width": float(edges[1] - edges[0]),
                "marker": {"color": "@best/0.40", "line": {"width": 0}},
                "hovertemplate": "%{x:.4g} " + unit + ": %{y:.3g}<extra>ensemble</extra>",
            },
            {
                "x": numbers(grid, 6),
                "y": numbers(density),
                "mode": "lines",
                "line": {"color": "@ink", "width": 1.6},
                "hovertemplate": "%{x:.4g} " + unit + ": %{y:.3g}<extra>" + drawn + "</extra>",
            },
        ],
        "layout": layout(
            axis(f"{words[0].upper()}{words[1:]} ({unit})", nticks=6),
            axis("Density", rangemode="tozero", nticks=5),
            height=230,
            bargap=0,
            margin={"l": 48, "r": 8, "t": 8, "b": 44},
        ),
        "alt": f"{words}: mean {values.mean():.4g} {unit}, from {values.min():.4g} to {values.max():.4g}.",
    }


def population_density(data: ReportData, name: str) -> tuple[FloatArray, FloatArray, str]:
    """Density of one property: the distribution itself for D, G, E, T, a kernel estimate for K and M that follow."""
    values = data.parameters[name]
    if name in ("K", "M"):
        grid = np.linspace(values.min(), values.max(), 120)
        usable = values.size > 3 and np.ptp(values) > 0.0
        ends = (float(values.min()), float(values.max()))
        return (
            grid,
            shapes.gaussian_density(values, grid, mirrors=ends) if usable else np.zeros_like(grid),
            "kernel estimate",
        )
    bounded = getattr(data.config.build_population(), name)
    pad = 0.03 * (bounded.upper - bounded.lower) or 1e-3
    grid = np.linspace(bounded.lower - pad, bounded.upper + pad, 160)
    return grid, bounded.density(grid) if bounded.upper > bounded.lower else np.zeros_like(grid), "distribution"


def convergence(data: ReportData) -> Chart:
    """g of every candidate with its interval, and the best so far; a click shows the candidate."""
    c = shapes.convergence(data)
    over = c.g_cm_s > c.ceiling_cm_s
    groups = np.array([group_of(data.candidates.origin[int(i)]) for i in c.index], dtype=object)
    traces: list[Chart] = [
        {
            "name": "best so far",
            "x": numbers(c.index[c.steps], 6),
            "y": numbers(c.best_cm_s[c.steps]),
            "mode": "lines",
            "line": {"color": "@ink", "width": 1.8, "shape": "hv"},
            "hovertemplate": "best so far %{y:.2f} cm/s<extra></extra>",
        }
    ]
    for name, (symbol, role) in labels.ORIGIN_GROUPS.items():
        which = (groups == name) & ~over
        if not which.any():
            continue
        colour, top = f"@{role}", np.minimum(c.upper_cm_s, c.ceiling_cm_s)
        traces.append(
            {
                "name": name,
                "x": numbers(c.index[which], 6),
                "y": numbers(c.g_cm_s[which]),
                "mode": "markers",
                "marker": {"color": colour, "symbol": symbol, "size": 7},
                **(
                    {}
                    if which.sum() > MOST_INTERVALS
                    else {
                        "error_y": {
                            "type": "data",
                            "symmetric": False,
                            "array": numbers((top - c.g_cm_s)[which]),
                            "arrayminus": numbers((c.g_cm_s - c.lower_cm_s)[which]),
                            "thickness": 1,
                            "width": 0,
                            "color": f"{colour}/0.55",
                        }
                    }
                ),
                "hovertemplate": "candidate %{x}: g %{y:.2f} cm/s<extra>" + name + "</extra>",
            }
        )
    if over.any():
        traces.append(
            {
                "name": "above the axis",
                "x": numbers(c.index[over], 6),
                "mode": "markers",
                "y": [round(c.ceiling_cm_s, 3)] * int(over.sum()),
                "marker": {"color": "@unshaped", "symbol": "triangle-up-open", "size": 7},
                "customdata": numbers(c.g_cm_s[over]),
                "hovertemplate": "candidate %{x}: g %{customdata:.2f} cm/s<extra></extra>",
            }
        )
    if c.failed.size:
        traces.append(
            {
                "name": "failed",
                "x": numbers(c.failed, 6),
                "mode": "markers",
                "y": [c.ceiling_cm_s] * c.failed.size,
                "marker": {"color": "@open", "symbol": "x", "size": 8},
                "hovertemplate": "candidate %{x} failed<extra></extra>",
            }
        )
    low = float(np.fmin(c.lower_cm_s, c.g_cm_s).min()) if c.g_cm_s.size else 0.0
    return {
        "data": traces,
        "layout": layout(
            axis("Candidate", rangemode="nonnegative"),
            axis("Objective g (cm/s)", range=[max(0.0, low - 1.0), c.ceiling_cm_s + 0.6]),
            showlegend=True,
            height=400,
            clickmode="event",
            shapes=[
                {"type": "line", "x0": i, "x1": i, "yref": "paper", "y0": 0, "y1": 1}
                | {"line": {"color": "@muted", "width": 1, "dash": "dot"}}
                for i, _ in c.larger
            ],
            annotations=[
                {"x": i, "yref": "paper", "y": 1, "yanchor": "top", "xanchor": "right", "showarrow": False}
                | {"text": f"{n:,} switches from here ", "font": {"color": "@muted", "size": 12}}
                for i, n in c.larger
            ],
        ),
        "alt": "Objective g of every candidate with its interval, and the best so far"
        + (f", which falls from {c.best_cm_s[0]:.1f} to {c.best_cm_s[-1]:.1f} cm/s." if c.g_cm_s.size else "."),
    }


def length_scales(data: ReportData) -> dict[str, Chart]:
    """Length scale of each parameter over the campaign, a panel each on one axis; none where no surrogate spoke."""
    found = shapes.length_scales(data)
    every = np.concatenate([v[np.isfinite(v)] for v in found.values()]) if found else np.empty(0)
    charts: dict[str, Chart] = {}
    for name, values in found.items():
        which, label = np.isfinite(values), labels.coordinate_label(name, unit=False)
        charts[name] = {
            "data": [
                {
                    "x": numbers(np.flatnonzero(which).astype(float), 6),
                    "y": numbers(values[which]),
                    "mode": "lines",
                    "line": {"width": 1.7, "color": "@best"},
                    "hovertemplate": "candidate %{x}: %{y:.2f}<extra></extra>",
                }
            ],
            "layout": layout(
                axis("Candidate"),
                axis(
                    "Length scale",
                    type="log",
                    dtick=1,
                    range=[math.log10(every.min()) - 0.1, math.log10(every.max()) + 0.1],
                ),
                title={
                    "text": label[0].upper() + label[1:],
                    "font": {"size": 13, "color": "@ink"},
                    "x": 0.5,
                    "y": 0.97,
                },
                margin={"l": 60, "r": 14, "t": 30, "b": 44},
                height=210,
            ),
            "alt": f"Length scale of {plain(label)} over the campaign, from {values[which][0]:.2f} to "
            f"{values[which][-1]:.2f}.",
        }
    return charts


def dependence(d: Dependence, i: int, span: tuple[float, float]) -> Chart:
    """g against one parameter: averaged over the recorded points, and through the best with two standard deviations.

    span: axis of g, the same for every parameter.
    """
    x, sd = numbers(d.grid[i], 5), d.slice_sd_cm_s[i]
    label = labels.coordinate_label(d.names[i])
    edge = {"mode": "lines", "line": {"width": 0}, "hoverinfo": "skip", "showlegend": False}
    return {
        "data": [
            {"x": x, "y": numbers(d.slice_cm_s[i] - 2.0 * sd, 5), **edge},
            {"x": x, "y": numbers(d.slice_cm_s[i] + 2.0 * sd, 5), **edge, "fill": "tonexty", "fillcolor": "@best/0.18"},
            {
                "x": x,
                "y": numbers(d.slice_cm_s[i], 5),
                "mode": "lines",
                "line": {"color": "@best", "width": 2},
                "hovertemplate": "%{x:.4g}: %{y:.1f} cm/s<extra>through the smallest g</extra>",
            },
            {
                "x": x,
                "y": numbers(d.mean_cm_s[i], 5),
                "mode": "lines",
                "line": {"color": "@deterministic", "width": 2, "dash": "dash"},
                "hovertemplate": "%{x:.4g}: %{y:.1f} cm/s<extra>average</extra>",
            },
        ],
        "layout": layout(
            axis(label[0].upper() + label[1:], nticks=6),
            axis("g (cm/s)", nticks=5, range=list(span)),
            height=240,
            margin={"l": 50, "r": 8, "t": 8, "b": 46},
            shapes=[
                {
                    "type": "line",
                    "yref": "paper",
                    "y0": 0,
                    "y1": 1,
                    "x0": float(d.incumbent[i]),
                    "x1": float(d.incumbent[i]),
                    "line": {"color": "@muted", "width": 1.2, "dash": "dot"},
                }
            ],
        ),
        "alt": f"Expected objective against {label}: length scale {d.length_scales[i]:.2f} of the range, best at "
        f"{d.incumbent[i]:.4g}.",
    }


def pair(d: Dependence, place: int) -> Chart:
    """g against two parameters, as a map with the best point."""
    i, j = d.pairs[place]
    first, second = (labels.coordinate_label(d.names[k]) for k in (i, j))
    return {
        "data": [
            {
                "type": "contour",
                "x": numbers(d.pair_grid[i], 5),
                "y": numbers(d.pair_grid[j], 5),
                "z": [numbers(row, 5) for row in d.pair_cm_s[place]],
                "colorscale": "Cividis",
                "reversescale": True,
                "ncontours": 18,
                "line": {"width": 0.4},
                "contours": {"coloring": "fill"},
                "colorbar": {
                    "title": {"text": "g (cm/s)", "side": "right"},
                    "thickness": 14,
                    "outlinewidth": 0,
                    "tickcolor": "@line",
                },
                "hovertemplate": "%{x:.4g}, %{y:.4g}: %{z:.1f} cm/s<extra></extra>",
            },
            {
                "x": numbers(d.tried[:, i], 5),
                "y": numbers(d.tried[:, j], 5),
                "mode": "markers",
                "marker": {"size": 3, "color": "#ffffff", "line": {"color": "#000000", "width": 0.6}},
                "hoverinfo": "skip",
            },
            {
                "x": [float(d.incumbent[i])],
                "y": [float(d.incumbent[j])],
                "mode": "markers",
                "marker": {
                    "symbol": "circle",
                    "size": 11,
                    "color": "#ffffff",
                    "line": {"color": "#000000", "width": 2},
                },
                "hovertemplate": "candidate of smallest g<extra></extra>",
            },
        ],
        "layout": layout(
            axis(first[0].upper() + first[1:], range=[float(d.pair_grid[i][0]), float(d.pair_grid[i][-1])]),
            axis(second[0].upper() + second[1:], range=[float(d.pair_grid[j][0]), float(d.pair_grid[j][-1])]),
            height=420,
        ),
        "alt": f"Map of the expected objective over {first} and {second}; the candidate of smallest g is marked.",
    }
