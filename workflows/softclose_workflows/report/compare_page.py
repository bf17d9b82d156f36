"""Owns the page that puts campaigns side by side."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from softclose_workflows.report import charts, packed, shapes
from softclose_workflows.report.comparison import Entry, differing_settings
from softclose_workflows.report.data import Design
from softclose_workflows.report.page import render
from softclose_workflows.tell import labels
from softclose_workflows.tell.tables import with_interval


def render_comparison(entries: Sequence[Entry]) -> str:
    """The whole page, self-contained like a report."""
    figures = _figures(entries)
    return render(
        "compare.html.j2",
        payload={
            "palettes": labels.PALETTE,
            "figures": {k: {"data": f["data"], "layout": f["layout"]} for k, f in figures.items()},
        },
        figures=figures,
        entries=entries,
        rows=table_rows(entries),
        settings=differing_settings(entries),
        fair=[e for e in entries if e.is_fair],
        is_fresh=any(e.fresh is not None for e in entries),
    )


def table_rows(entries: Sequence[Entry]) -> list[tuple[str, list[str]]]:
    """(figure, its text for each campaign); intervals in brackets where they hold."""
    found = [_metrics(entry) for entry in entries]
    names = (
        "Upper velocity (cm/s)",
        "Mean V (cm/s)",
        "Not closed",
        "Objective g (cm/s)",
        "Judged on",
        "Best candidate",
        "Candidates",
    )
    return [(name, [texts[k] for texts in found]) for k, name in enumerate(names)]


def _metrics(entry: Entry) -> list[str]:
    committed = f"{entry.data.n_committed} of {entry.data.n_total}"
    if entry.design is None:
        return ["–"] * 4 + [entry.basis, "–", committed]
    a = entry.design.assessment

    def speed(value: float, ends: tuple[float, float]) -> str:
        return with_interval(value, *(ends if a.intervals_valid else ()))

    share = labels.estimated_share(a.p_nc, *a.p_nc_intervals.wilson)
    return [
        speed(a.v_u_cm_s, a.v_u_interval),
        speed(a.mean_cm_s, a.mean_interval),
        f"{share[0]} ({share[1]})" if share[1] and a.intervals_valid else share[0],
        speed(a.g_cm_s, a.g_interval),
        entry.basis,
        str(entry.data.best),
        committed,
    ]


def judged(entries: Sequence[Entry]) -> list[tuple[Design, str]]:
    """The designs under their campaigns' names, each with its colour."""
    return [
        (replace(e.design, name=e.label), labels.SERIES[k % len(labels.SERIES)])
        for k, e in enumerate(entries)
        if e.design is not None
    ]


def top_speed(entries: Sequence[Entry]) -> float:
    """End of the axis of speeds, in whole 5 cm/s."""
    tops = [d.assessment.max_cm_s for d, _ in judged(entries) if math.isfinite(d.assessment.max_cm_s)]
    return 5.0 * math.ceil((max(tops, default=10.0) + 1.0) / 5.0)


def _figures(entries: Sequence[Entry]) -> dict[str, charts.Chart]:
    designs = judged(entries)
    figures: dict[str, charts.Chart] = {}
    if designs:
        figures["densities"] = charts.densities([d for d, _ in designs], [c for _, c in designs], top_speed(entries))
        figures["waveforms"] = _waveforms(entries)
    if any(e.data.n_committed for e in entries):
        figures["convergence"] = _convergence(entries)
    return figures


def _line(k: int, label: str) -> dict[str, Any]:
    return {
        "name": charts.plain(label),
        "mode": "lines",
        "line": {
            "color": f"@{labels.SERIES[k % len(labels.SERIES)]}",
            "width": 2,
            "dash": charts.DASHES[k % len(charts.DASHES)],
        },
    }


def _waveforms(entries: Sequence[Entry]) -> charts.Chart:
    traces = []
    for k, e in enumerate(entries):
        if e.design is None:
            continue
        times, volts = packed.waveform_points(e.design.waveform, e.data.config.model.horizon_us)
        traces.append(
            {
                **_line(k, e.label),
                "x": charts.numbers(times, 6),
                "y": charts.numbers(volts, 5),
                "hovertemplate": "%{x:.1f} µs: %{y:.1f} V<extra>" + charts.plain(e.label) + "</extra>",
            }
        )
    return {
        "data": traces,
        "layout": charts.layout(
            charts.axis("Time (µs)"), charts.axis("Voltage (V)", rangemode="tozero"), showlegend=True
        ),
        "alt": "Drive voltage of each campaign's best waveform over time.",
    }


def _convergence(entries: Sequence[Entry]) -> charts.Chart:
    traces, ceilings = [], []
    for k, e in enumerate(entries):
        c = shapes.convergence(e.data)
        if c.index.size:
            line = _line(k, e.label)
            line["line"]["shape"] = "hv"
            traces.append(
                {
                    **line,
                    "x": charts.numbers(c.index, 6),
                    "y": charts.numbers(c.best_cm_s),
                    "hovertemplate": "candidate %{x}: %{y:.2f} cm/s<extra>" + charts.plain(e.label) + "</extra>",
                }
            )
            ceilings.append((float(c.best_cm_s.min()), c.ceiling_cm_s))
    low, high = (min(c[0] for c in ceilings), max(c[1] for c in ceilings)) if ceilings else (0.0, 1.0)
    return {
        "data": traces,
        "layout": charts.layout(
            charts.axis("Candidate", rangemode="nonnegative"),
            charts.axis("Best g so far (cm/s)", range=[max(0.0, low - 1.0), high]),
            showlegend=True,
        ),
        "alt": "Smallest objective so far over each campaign's candidates, on its own training switches.",
    }
