"""Owns the first screen of the report: the drive, its figures beside both references, what they rest on, its health."""

from __future__ import annotations

import math
from typing import Any

from softclose.evaluate.touching import contacts
from softclose.metrics.objective import Assessment
from softclose.metrics.paired import Comparison
from softclose.propose.origins import ORIGINS, label_of
from softclose_workflows.analyses.certify import Certification
from softclose_workflows.analyses.hold import Hold, hold_line, hold_warning, holds_of
from softclose_workflows.analyses.references import beaten_lines, missing_lines
from softclose_workflows.report.data import Design, ReportData
from softclose_workflows.report.drive_picture import drive_picture
from softclose_workflows.report.health import health
from softclose_workflows.tell.assumptions import assumptions
from softclose_workflows.tell.labels import (
    count,
    interval,
    number,
    percent,
    percent_interval,
    points,
    pulse_lines,
    signed,
)
from softclose_workflows.tell.tables import beside


def headline(data: ReportData) -> dict[str, Any]:
    """Everything that the first screen says, certified figures where there are any; empty without a candidate."""
    designs, certification = data.judged_designs, data.certification
    if not designs or data.best is None:
        return {"rows": [], "certified": None, "n": "0", "valid": True, "confidence": 95.0}
    best, a = designs[0], designs[0].assessment
    holds = _held(data)
    return {
        "candidate": data.best,
        "pulses": pulse_lines([tuple(row) for row in best.waveform.rows().tolist()])
        if hasattr(best.waveform, "rows")
        else [],
        "picture": drive_picture(best.waveform, data.config.model.horizon_us, data.config.waveform.max_volts),
        "rows": _rows(data, designs),
        "closing": _closing(data, designs),
        "drive_off": off_rows(certification),
        "n_off": count(certification.drive_off[0].assessment.n) if certification and certification.drive_off else "",
        "limit": a.p_exceed[0].limit_cm_s if a.p_exceed else None,
        "level": 100.0 * a.level,
        "horizon": data.config.model.horizon_us,
        "valid": a.intervals_valid,
        "n": count(a.n),
        "confidence": 100.0 * a.confidence,
        "said": [*filter(None, [a.limit and a.limit.sentence, *_failed(a), hold_line(holds, a.level)])],
        "warnings": [
            *filter(None, [a.open_warning, hold_warning(holds)]),
            *beaten_lines(a, {d.name: d.assessment for d in designs[1:]}),
            *missing_lines(data.judged_missing),
        ],
        "assumed": assumptions(data.config),
        "found": found_by(data),
        "health": health(data),
        "certified": None if certification is None else _certified(data, certification),
    }


def _held(data: ReportData) -> tuple[Hold, ...]:
    """How the certified design and the references hold their lot."""
    return () if data.certification is None else holds_of(data.config, data.certification)


def found_by(data: ReportData) -> str:
    """`Candidate 242 of 300, proposed in the search: Gaussian process, trust region.`"""
    i = data.best
    assert i is not None
    origin = data.candidates.origin[i]
    known = ORIGINS.get(origin.partition(":")[0])
    stage = {"search": "in the search", "explore": "while exploring", "finish": "in the finishing stage"}.get(
        "" if known is None else known.stage, ""
    )
    return (
        f"Candidate {i} of {count(data.n_committed)}, proposed{' ' * bool(stage)}{stage} by: {label_of(origin)}. "
        f"It was tuned on {count(int(data.candidates.n_switches[i]))} training switches." + promised(data, i)
    )


def promised(data: ReportData, i: int) -> str:
    """What the prior had promised of a candidate, and what the process expected of it; empty where neither spoke."""
    said = data.candidates.surrogate
    prior, expected, deviation = (
        float(said[name][i]) if name in said else math.nan
        for name in ("prior_g_cm_s", "predicted_g_cm_s", "predicted_sd_cm_s")
    )
    if math.isnan(prior):
        return ""
    settings, came = data.config.prior, float(data.candidates.columns["g_cm_s"][i])
    text = (
        f" The prior ({settings.model} on {count(settings.n_switches)} switches) had promised g = {number(prior, 2)} "
        "cm/s of it"
    )
    if not math.isnan(deviation):
        text += f", the process expected {number(expected, 2)} ± {number(deviation, 2)} cm/s"
    return f"{text}; it came to {number(came, 2)} cm/s on the training switches."


def _failed(a: Assessment) -> list[str]:
    said = beside(a.n_failed, a.n).removeprefix("; ")
    return [said] if said else []


def _rows(data: ReportData, designs: tuple[Design, ...]) -> list[dict[str, Any]]:
    """The drive, then each reference and the difference from it."""
    best, rows = designs[0], [_row("This drive", designs[0].assessment, "best")]
    paired = data.certification is not None or data.config.population.sampling == "monte-carlo"
    for other in designs[1:]:
        rows += [_row(_capital(other.name), other.assessment, "reference"), _difference(best.against(other), paired)]
    return rows


def _closing(data: ReportData, designs: tuple[Design, ...]) -> list[list[tuple[str, str]]]:
    """A row a design: its name, then first contact, closing time and impacts, each with its interval; [] where nobody
    has told of contacts."""
    fresh = data.certification is not None
    rows: list[list[tuple[str, str]]] = []
    for design in designs:
        a = design.assessment
        found = contacts(data.config, design.response, a, fresh=fresh)
        if not found:
            return []
        times = (found["contact_time"].estimate, found["contact_time"].interval), (a.closing_us, a.closing_interval)
        impacts = found["impacts"]
        name = "This drive" if not rows else _capital(design.name)
        rows.append(
            [
                (name, ""),
                *((f"{number(value)} µs", interval(*ends)) for value, ends in times),
                (number(impacts.estimate, 0), interval(*impacts.interval, 0)),
            ]
        )
    return rows


def off_rows(certification: Certification | None) -> list[list[tuple[str, str]]]:
    """A row for each error of the drive: its name, v_u and share left open with their intervals; [] where none is
    certified."""
    return [
        [
            (_capital(row.name), ""),
            (f"{number(a.v_u_cm_s, 2)} cm/s", interval(*a.v_u_interval, 2)),
            (percent(a.p_nc, 2), percent_interval(*a.p_nc_intervals.wilson, 2)),
        ]
        for row in (() if certification is None else certification.drive_off)
        for a in [row.assessment]
    ]


def _row(name: str, a: Assessment, kind: str) -> dict[str, Any]:
    digits = 2 if a.n >= 20_000 else 1

    def bounds(text: str) -> str:
        return text if a.intervals_valid else ""

    cells = [
        (f"{number(a.v_u_cm_s, digits)} cm/s", bounds(interval(*a.v_u_interval, digits))),
        (percent(a.p_nc, digits), bounds(percent_interval(*a.p_nc_intervals.wilson, digits))),
        (f"{number(a.mean_cm_s, digits)} cm/s", bounds(interval(*a.mean_interval, digits))),
    ]
    for e in a.p_exceed[:1]:
        p = e.probability
        cells.append((percent(p.estimate, digits), bounds(percent_interval(*p.wilson, digits))))
    return {"name": name, "kind": kind, "cells": cells}


def _difference(c: Comparison, valid: bool) -> dict[str, Any]:
    """The drive minus the reference above it, switch by switch."""

    def bounds(text: str) -> str:
        return text if valid else ""

    softer = "" if math.isnan(c.softer.estimate) else f"softer on {percent(c.softer.estimate)} of the switches"
    cells = [
        (f"{signed(c.v_u_cm_s, 2)} cm/s", bounds(interval(*c.v_u_interval, 2))),
        (points(c.p_nc), bounds(interval(100.0 * c.p_nc_interval[0], 100.0 * c.p_nc_interval[1], 2))),
        (f"{signed(c.mean_cm_s, 2)} cm/s", bounds(interval(*c.mean_interval, 2))),
    ]
    return {"name": "this drive against it", "kind": "difference", "cells": cells, "softer": softer}


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _certified(data: ReportData, c: Certification) -> dict[str, Any]:
    """The certified designs, best first, then the references; and whether the campaign went on since."""
    rows = [
        {
            "name": d.name,
            "training": number(d.training.g_cm_s, 2) if d.training is not None else "–",
            "g": number(d.assessment.g_cm_s, 2),
            "g_interval": interval(*d.assessment.g_interval, 2),
            "optimism": signed(d.optimism_cm_s, 2),
            "v_u": number(d.assessment.v_u_cm_s, 2),
            "v_u_interval": interval(*d.assessment.v_u_interval, 2),
            "mean": number(d.assessment.mean_cm_s, 2),
            "p_nc": percent(d.assessment.p_nc, 2) + beside(d.assessment.n_failed, d.assessment.n),
        }
        for d in (*c.candidates, *c.references)
    ]
    return {
        "rows": rows,
        "best": c.best.candidate,
        "incumbent": c.incumbent,
        "stale": data.n_committed - c.committed,
        "seed": c.seed,
    }
