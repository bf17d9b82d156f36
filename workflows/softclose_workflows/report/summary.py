"""Owns the words and numbers of the report's tables: metrics of one candidate, rows of the table, provenance."""

from __future__ import annotations

import math
import time
from typing import Any

from softclose.evaluate.asked import asked
from softclose.evaluate.quantities import quantity
from softclose.propose.origins import label_of
from softclose_workflows.report.data import ReportData
from softclose_workflows.tell.labels import count, interval, number, percent, percent_interval


def front_words(data: ReportData) -> str:
    """`upper velocity and switches not closed`; empty without a front."""
    words = {"v_u": "upper velocity", "p_nc": "switches not closed", "closing": "closing time", "peak": "peak voltage"}
    named = (
        [words.get(name, quantity(name).long_name) for name in data.front.objectives] if data.front is not None else []
    )
    return " and ".join([", ".join(named[:-1]), *named[-1:]]) if named else ""


def metrics(data: ReportData, i: int) -> list[list[str]]:
    """(name, value, interval) of one candidate, as shown beside its waveform."""
    c = {name: float(values[i]) for name, values in data.candidates.columns.items()}
    rows = [
        ["objective g", f"{number(c['g_cm_s'], 2)} cm/s", interval(c["g_lower_cm_s"], c["g_upper_cm_s"], 2)],
        ["upper velocity", f"{number(c['v_u_cm_s'], 2)} cm/s", interval(c["v_u_lower_cm_s"], c["v_u_upper_cm_s"], 2)],
        ["mean V", f"{number(c['mean_cm_s'], 2)} cm/s", interval(c["mean_lower_cm_s"], c["mean_upper_cm_s"], 2)],
        [
            f"mean V of the fastest {100.0 * (1.0 - data.config.objective.level):g}\u202f%",
            f"{number(c['cvar_cm_s'], 2)} cm/s",
            interval(c["cvar_lower_cm_s"], c["cvar_upper_cm_s"], 2),
        ],
        ["largest V", f"{number(c['max_cm_s'], 2)} cm/s", ""],
        ["not closed", percent(c["p_nc"], 2), percent_interval(c["p_nc_wilson_lower"], c["p_nc_wilson_upper"], 2)],
        ["made contact", percent(c["p_contact"], 2), ""],
        [
            f"closing time of {100.0 * data.config.objective.level:g}\u202f%",
            f"{number(c['closing_us'])} µs",
            interval(c["closing_lower_us"], c["closing_upper_us"]),
        ],
    ]
    for limit in data.config.objective.limits_cm_s:
        name = f"{limit:g}"
        rows.append(
            [
                f"faster than {name} cm/s",
                percent(c[f"p_exceed_{name}"], 2),
                percent_interval(c[f"p_exceed_wilson_{name}_lower"], c[f"p_exceed_wilson_{name}_upper"], 2),
            ]
        )
    for q in asked(data.config):
        ends = interval(c[f"{q.name}_lower"], c[f"{q.name}_upper"])
        rows.append([q.long_name, f"{number(c[q.name])} {q.unit.removeprefix('1')}".rstrip(), ends])
    return [*rows, ["switches", f"{int(data.candidates.n_switches[i]):,}", ""]]


MOST_ROWS = 200
"""Candidates in the table: nobody reads more, and a browser is slow to sort thousands."""


def candidate_rows(data: ReportData) -> list[dict[str, Any]]:
    """Rows of the table, the best first, `MOST_ROWS` at most; each cell has its text and what it sorts by."""
    t, rows = data.candidates, []
    on_front = {*data.front.candidates} if data.is_front and data.front is not None else set()
    limit = f"{data.config.objective.limits_cm_s[0]:g}" if data.config.objective.limits_cm_s else ""
    order = sorted(t.ranked, key=lambda i: i not in on_front)  # stable: a front comes first where one is searched for
    for place, i in enumerate(order[:MOST_ROWS]):
        c = {name: float(values[i]) for name, values in t.columns.items()}
        cells = [
            _cell(c["g_cm_s"], number(c["g_cm_s"], 2), interval(c["g_lower_cm_s"], c["g_upper_cm_s"])),
            _cell(c["v_u_cm_s"], number(c["v_u_cm_s"], 2), interval(c["v_u_lower_cm_s"], c["v_u_upper_cm_s"])),
            _cell(c["mean_cm_s"], number(c["mean_cm_s"], 2)),
            _cell(
                c["p_nc"],
                number(100.0 * c["p_nc"], 1),
                percent_interval(c["p_nc_wilson_lower"], c["p_nc_wilson_upper"]).removesuffix("\u202f%"),
            ),
        ]
        if limit:
            cells.append(_cell(c[f"p_exceed_{limit}"], number(100.0 * c[f"p_exceed_{limit}"], 1)))
        cells.append(_cell(float(t.n_switches[i]), count(int(t.n_switches[i]))))
        rows.append(
            {
                "index": i,
                "origin": t.origin[i],
                "origin_label": label_of(t.origin[i]),
                "note": t.note[i],
                "failed": bool(t.failed[i]),
                "cells": cells,
                "switches": int(t.n_switches[i]),
                "best": i == data.best,
                "on_front": i in on_front,
                "beyond_print": place >= 30,
            }
        )
    return rows


def _cell(value: float, text: str, small: str = "") -> dict[str, str]:
    return {"sort": "" if math.isnan(value) else repr(value), "text": text, "small": small}


def provenance(data: ReportData) -> dict[str, Any]:
    """What this was computed from, with what, where and when."""
    config, runtime = data.config, data.runtime
    runs = runtime.get("runs") or [runtime]
    latest = runs[-1] if isinstance(runs[-1], dict) else runtime
    wall = data.candidates.columns.get("wall_simulate_s")
    facts = [
        ("Store", data.source),
        ("Fingerprint of the configuration", data.fingerprint),
        ("Seed", str(config.campaign.seed)),
        ("Population", f"{config.population.name}, {config.population.sampling} sampling"),
        ("Search space", config.waveform.space),
        ("Engine", config.optimiser.engine),
        ("Candidates", f"{data.n_committed} of {data.n_total}"),
        ("Runs", f"{len(runs)}, the last started {latest.get('started', 'at an unknown time')}"),
        ("Machine", ", ".join(str(latest[k]) for k in ("processor", "machine", "system") if latest.get(k))),
        ("Time spent proposing", _duration(data.candidates.columns.get("wall_propose_s"))),
        ("Time from proposal to result", _duration(wall)),
        ("Report written", time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime())),
    ]
    versions = latest.get("versions") or runtime.get("versions") or {}
    sections = [
        (name, [(key, _plain(value)) for key, value in table.items()])
        for name, table in config.to_dict().items()
        if isinstance(table, dict)
    ]
    return {"facts": facts, "versions": sorted((str(k), str(v)) for k, v in versions.items()), "sections": sections}


def _plain(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{k} {_plain(v)}" for k, v in value.items())
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _duration(seconds: Any) -> str:
    if seconds is None or not len(seconds):
        return "–"
    total = float(seconds[[math.isfinite(v) for v in seconds]].sum())
    return f"{total:.1f} s" if total < 120 else f"{total / 60:.1f} min"
