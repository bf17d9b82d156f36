"""Owns the words and numbers of the report's tables: metrics of one candidate, rows of the table, provenance."""

from __future__ import annotations

import math
import time
from typing import Any

from softclose.digits import least_digits
from softclose.evaluate.asked import asked
from softclose.evaluate.quantities import quantity
from softclose.propose.origins import label_of
from softclose_workflows.report.data import ReportData
from softclose_workflows.tell.labels import count, estimated, estimated_share, number, percent


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
    level = 100.0 * data.config.objective.level

    def speed(name: str) -> tuple[str, str]:
        return estimated(c[f"{name}_cm_s"], c[f"{name}_lower_cm_s"], c[f"{name}_upper_cm_s"], "cm/s")

    def share(name: str, ends: str) -> tuple[str, str]:
        return estimated_share(c[name], c[f"{ends}_lower"], c[f"{ends}_upper"])

    rows = [
        ["objective g", *speed("g")],
        ["upper velocity v_u", *speed("v_u")],
        ["mean V", *speed("mean")],
        [f"mean V of the fastest {100.0 - level:g}\u202f%", *speed("cvar")],
        ["largest V", f"{number(c['max_cm_s'], 2)} cm/s", ""],
        ["left open", *share("p_nc", "p_nc_wilson")],
        ["made contact", percent(c["p_contact"], 2), ""],
        [
            f"closing time of {level:g}\u202f%",
            *estimated(c["closing_us"], c["closing_lower_us"], c["closing_upper_us"], "µs", least_digits("µs")),
        ],
    ]
    for limit in data.config.objective.limits_cm_s:
        cells = share(f"p_exceed_{limit:g}", f"p_exceed_wilson_{limit:g}")
        rows.append([f"faster than {limit:g} cm/s, of those that touch", *cells])
    for q in asked(data.config):
        ends = c[f"{q.name}_lower"], c[f"{q.name}_upper"]
        rows.append([q.long_name, *estimated(c[q.name], *ends, q.unit.removeprefix("1"), least_digits(q.unit))])
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
            _cell(c["g_cm_s"], *estimated(c["g_cm_s"], c["g_lower_cm_s"], c["g_upper_cm_s"])),
            _cell(c["v_u_cm_s"], *estimated(c["v_u_cm_s"], c["v_u_lower_cm_s"], c["v_u_upper_cm_s"])),
            _cell(c["mean_cm_s"], *estimated(c["mean_cm_s"], c["mean_lower_cm_s"], c["mean_upper_cm_s"])),
            _cell(c["p_nc"], *_in_percent(c, "p_nc", "p_nc_wilson")),
        ]
        if limit:
            cells.append(
                _cell(c[f"p_exceed_{limit}"], *_in_percent(c, f"p_exceed_{limit}", f"p_exceed_wilson_{limit}"))
            )
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


def _in_percent(c: dict[str, float], name: str, ends: str) -> tuple[str, str]:
    """A share and its interval under a heading that says %."""
    value, bounds = estimated_share(c[name], c[f"{ends}_lower"], c[f"{ends}_upper"])
    return value.removesuffix("\u202f%"), bounds.removesuffix("\u202f%")


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
