"""Owns the sign-off as one page of paper."""

from __future__ import annotations

import math

from softclose.metrics.open_kinds import open_kinds
from softclose_workflows.analyses.signing import Line, Sheet, versions_of, waveform_digest
from softclose_workflows.report.drive_picture import drive_picture
from softclose_workflows.report.headline import off_rows, off_words
from softclose_workflows.report.page import render_plain
from softclose_workflows.tell.assumptions import assumptions
from softclose_workflows.tell.labels import count, estimated_quantity, pulse_lines

VERDICTS = {"pass": "Pass", "fail": "Fail", "not established": "Not established", "not judged": "–"}


def render_sign(sheet: Sheet) -> str:
    """The whole page."""
    from markupsafe import Markup

    best, config = sheet.best, sheet.config
    a = best.assessment
    return render_plain(
        "sign.html.j2",
        sheet=sheet,
        verdict=sheet.verdict,
        judged=judged(sheet),
        warnings=sheet.warnings,
        lines=[_cells(line, a.level) for line in sheet.lines],
        candidate=best.candidate,
        n=count(sheet.certification.n_switches),
        seed=sheet.certification.seed,
        confidence=100.0 * a.confidence,
        pulses=pulse_lines([tuple(row) for row in best.waveform.rows().tolist()]),
        picture=Markup(drive_picture(best.waveform, config.model.horizon_us, config.waveform.max_volts)),
        drive_off=off_rows(sheet.certification),
        off=off_words(sheet.certification),
        open=open_kinds(best.response, a.closed_by_us).sentence,
        digest=waveform_digest(best.waveform),
        assumed=assumptions(config),
        versions=versions_of(sheet),
    )


def judged(sheet: Sheet) -> str:
    """The verdict in words, and how many limits it rests on."""
    n, shown = sheet.n_limits, len(sheet.lines)
    if n == 0:
        return "No limits were given: nothing is judged"
    such = sum(line.verdict == sheet.verdict for line in sheet.lines)
    which = "The one limit" if n == 1 else f"All {n} limits" if such == n else f"{such} of the {n} limits"
    became = {"pass": "met", "fail": "missed"}.get(sheet.verdict, sheet.verdict)
    rest = f"; {shown - n} of the {shown} quantities below have no limit" if n < shown else ""
    return f"{which} given {'is' if such == 1 else 'are'} {became}{rest}"


def _cells(line: Line, level: float) -> dict[str, str]:
    q = line.quantity
    value, bounds = estimated_quantity(q, line.value.estimate, *line.value.interval)
    what = q.long_name
    if q.per == "switch":
        what += f", {100.0 * level:g} % of the switches {q.bound}"
    return {
        "what": _capital(what),
        "value": "not known" if math.isnan(line.value.estimate) else value,
        "interval": bounds,
        "limit": "–" if line.limit is None else f"{q.bound} {estimated_quantity(q, line.limit)[0]}",
        "verdict": VERDICTS[line.verdict],
        "kind": line.verdict.replace(" ", "-"),
    }


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
