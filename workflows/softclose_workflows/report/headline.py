"""Owns the first screen of the report: the drive, its figures beside both references, what they rest on, its health."""

from __future__ import annotations

import math
from typing import Any

from softclose.digits import least_digits
from softclose.evaluate.touching import contacts
from softclose.metrics.objective import Assessment
from softclose.metrics.open_kinds import open_kinds
from softclose.metrics.paired import Comparison
from softclose.propose.origins import ORIGINS, label_of
from softclose_workflows.analyses.certify import Certification
from softclose_workflows.analyses.drive_off import ALIKE, few_lines, on_switches
from softclose_workflows.analyses.hold import Hold, hold_line, hold_warning, holds_of
from softclose_workflows.analyses.own_limits import OwnLimit, own_limits
from softclose_workflows.analyses.references import REFERENCES, beaten_lines, missing_lines
from softclose_workflows.report.data import Design, ReportData
from softclose_workflows.report.drive_picture import drive_picture
from softclose_workflows.report.glossary import objective_words
from softclose_workflows.report.health import health
from softclose_workflows.tell.assumptions import assumptions
from softclose_workflows.tell.labels import (
    count,
    estimated,
    estimated_difference,
    estimated_share,
    number,
    percent,
    pulse_lines,
    signed,
)
from softclose_workflows.tell.tables import beside, share, with_interval


def headline(data: ReportData) -> dict[str, Any]:
    """Everything that the first screen says, certified figures where there are any; empty without a candidate."""
    designs, certification = data.judged_designs, data.certification
    if not designs or data.best is None:
        return {}
    best, a = designs[0], designs[0].assessment
    holds = _held(data)
    return {
        "candidate": data.best,
        "pulses": pulse_lines([tuple(row) for row in best.waveform.rows().tolist()])
        if hasattr(best.waveform, "rows")
        else [],
        "picture": drive_picture(best.waveform, data.config.model.horizon_us, data.config.waveform.max_volts),
        "rows": (rows := _rows(data, designs)),
        "paired": any(row["pairs"] for row in rows),
        "closing": _closing(data, designs),
        "open": open_kinds(best.response, a.closed_by_us).sentence,
        "limits": limit_rows(own_limits(data.config, best.response, a, fresh=certification is not None)),
        "references": _reference_pulses(designs[1:]),
        "drive_off": off_rows(certification),
        "off": off_words(certification),
        "limit": a.p_exceed[0].limit_cm_s if a.p_exceed else None,
        "level": 100.0 * a.level,
        "horizon": data.config.model.horizon_us,
        "valid": a.intervals_valid,
        "n": count(a.n),
        "confidence": 100.0 * a.confidence,
        "said": [*filter(None, [a.limit and a.limit.sentence, *_failed(a), hold_line(holds, a.level)])],
        "warnings": [
            *filter(None, [a.open_warning, hold_warning(holds)]),
            *beaten_lines(a, {d.role: d.assessment for d in designs[1:]}),
            *missing_lines(data.judged_missing),
        ],
        "assumed": assumptions(data.config),
        "objective": objective_words(data.config),
        "found": found_by(data),
        "health": health(data),
        "certified": None if certification is None else _certified(data, certification),
        "ranked": ranked(data),
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
        f" The prior, a search on a cheap model ({settings.model} on {count(settings.n_switches)} switches), had "
        f"promised g = {number(prior, 2)} cm/s of it"
    )
    if not math.isnan(deviation):
        said_before = f"{number(expected, 2)} ± {number(deviation, 2)} cm/s"
        text += f", the Gaussian process, which proposes candidates, expected {said_before}"
    return f"{text}; it came to {number(came, 2)} cm/s on the training switches."


def _failed(a: Assessment) -> list[str]:
    said = beside(a.n_failed, a.n).removeprefix("; ")
    return [said] if said else []


def _rows(data: ReportData, designs: tuple[Design, ...]) -> list[dict[str, Any]]:
    """The drive, then each reference and the difference from it."""
    best, rows = designs[0], [_row("This drive", designs[0].assessment, "best")]
    paired = data.certification is not None or data.config.population.sampling == "monte-carlo"
    for other in designs[1:]:
        rows += [
            _row(_capital(other.name), other.assessment, "reference"),
            _difference(best.against(other), best.assessment.n, paired),
        ]
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
        touch, impacts = found["contact_time"], found["impacts"]
        name = "This drive" if not rows else _capital(design.name)
        rows.append(
            [
                (name, ""),
                estimated(touch.estimate, *touch.interval, "µs", least_digits("µs")),
                estimated(a.closing_us, *a.closing_interval, "µs", least_digits("µs")),
                estimated(impacts.estimate, *impacts.interval, least=least_digits("1")),
            ]
        )
    return rows


def _reference_pulses(designs: tuple[Design, ...]) -> list[dict[str, Any]]:
    """What the reference designs are, and their pulses; a recorded trace has none."""
    return [
        {
            "name": _capital(design.name),
            "role": design.role,
            "what": REFERENCES.get(design.role, ""),
            "pulses": pulse_lines([tuple(row) for row in design.waveform.rows().tolist()]),
        }
        for design in designs
        if hasattr(design.waveform, "rows")
    ]


def limit_rows(limits: list[OwnLimit]) -> list[dict[str, str]]:
    """A row for each limit of the campaign: what, value, interval, limit, and pass or fail."""
    rows = []
    for found in limits:
        value, bounds, limit = found.told
        rows.append(
            {
                "what": _capital(found.quantity.long_name),
                "setting": found.setting,
                "value": value,
                "interval": bounds,
                "limit": limit,
                "verdict": found.verdict,
            }
        )
    return rows


def off_rows(certification: Certification | None) -> list[list[tuple[str, str]]]:
    """A row for each error of the drive: its name, v_u and share left open with their intervals; [] where none is
    certified."""
    return [
        [
            (_capital(row.name), ""),
            estimated(a.v_u_cm_s, *a.v_u_interval, "cm/s"),
            estimated_share(a.p_nc, *a.p_nc_intervals.wilson),
        ]
        for row in (() if certification is None else certification.drive_off)
        for a in [row.assessment]
    ]


def off_words(certification: Certification | None) -> dict[str, Any]:
    """On which of the new switches the rows of `off_rows` are, and what a reader has to know of them."""
    if certification is None or not certification.drive_off:
        return {}
    n, n_switches = certification.drive_off[0].assessment.n, certification.n_switches
    return {"switches": on_switches(n, n_switches), "said": [*few_lines(n, n_switches), ALIKE]}


def ranked(data: ReportData) -> str:
    """Why the best of the page is not the first of the table of candidates; empty where it is."""
    order = data.candidates.ranked
    if data.best is None or data.certification is None or not order or order[0] == data.best:
        return ""
    first = order[0]
    g = data.candidates.columns["g_cm_s"]
    certified = {d.candidate: d.assessment for d in data.certification.candidates}
    of_best, n = certified[data.best].g_cm_s, count(data.certification.n_switches)
    said = (
        f"This table ranks by training score, in which candidate {first} is first (g = {number(float(g[first]), 2)} "
        f"cm/s); candidate {data.best} is the best on the {n} new switches (g = {number(of_best, 2)}"
    )
    if first in certified:
        said += f" against {number(certified[first].g_cm_s, 2)} cm/s). Their order there counts"
    else:
        said += f" cm/s; candidate {first} was not among those certified). That order counts"
    return f"{said}: a training score is optimistic."


def _row(name: str, a: Assessment, kind: str) -> dict[str, Any]:
    def bounded(cells: tuple[str, str]) -> tuple[str, str]:
        return cells[0], cells[1] if a.intervals_valid else ""

    cells = [
        bounded(estimated(a.v_u_cm_s, *a.v_u_interval, "cm/s")),
        bounded(estimated_share(a.p_nc, *a.p_nc_intervals.wilson)),
        bounded(estimated(a.mean_cm_s, *a.mean_interval, "cm/s")),
    ]
    cells += [bounded(estimated_share(e.probability.estimate, *e.probability.wilson)) for e in a.p_exceed[:1]]
    return {"name": name, "kind": kind, "cells": cells, "pairs": ""}


def _difference(c: Comparison, n: int, valid: bool) -> dict[str, Any]:
    """The drive minus the reference above it, switch by switch. n: switches that both were judged on."""

    def bounded(cells: tuple[str, str]) -> tuple[str, str]:
        return cells[0], cells[1] if valid else ""

    both, softer = count(c.softer.n), ""
    if c.softer.n:
        softer = f"softer on {percent(c.softer.estimate)} of these {both} switches"
    ends = 100.0 * c.p_nc_interval[0], 100.0 * c.p_nc_interval[1]
    cells = [
        bounded(estimated_difference(c.v_u_cm_s, *c.v_u_interval, "cm/s")),
        bounded(estimated_difference(100.0 * c.p_nc, *ends, "points")),
        bounded(estimated_difference(c.mean_cm_s, *c.mean_interval, "cm/s")),
    ]
    # The means above are each of those that touch under one drive: they do not subtract where these are not the same.
    pairs = f"of the {both} that touch under both" if 0 < c.softer.n < n else ""
    return {"name": "this drive against it", "kind": "difference", "cells": cells, "softer": softer, "pairs": pairs}


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _certified(data: ReportData, c: Certification) -> dict[str, Any]:
    """The certified designs, best first, then the references; and whether the campaign went on since."""
    rows = [
        {
            "name": d.name,
            "training": number(d.training.g_cm_s, 2) if d.training is not None else "–",
            "g": with_interval(d.assessment.g_cm_s, *d.assessment.g_interval),
            "optimism": signed(d.optimism_cm_s, 2),
            "v_u": with_interval(d.assessment.v_u_cm_s, *d.assessment.v_u_interval),
            "mean": with_interval(d.assessment.mean_cm_s, *d.assessment.mean_interval),
            "p_nc": share(d.assessment.p_nc, *d.assessment.p_nc_intervals.wilson)
            + beside(d.assessment.n_failed, d.assessment.n),
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
