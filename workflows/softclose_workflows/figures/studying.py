"""Owns the figure of a study: what the certified optimum of each value is worth, beside other campaigns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from softclose.metrics.objective import Assessment
from softclose_store import open_campaign
from softclose_workflows.analyses.certify import CertifyError, read_certification
from softclose_workflows.figures.drawing import LINES
from softclose_workflows.figures.style import COLOURS, PAGE_IN, literal
from softclose_workflows.studies.study import StudyResult
from softclose_workflows.tell.labels import SERIES


@dataclass(frozen=True, slots=True, kw_only=True)
class Other:
    """A certified campaign that a study is compared with."""

    name: str
    assessment: Assessment


def other(path: str) -> Other:
    """The certified best of a store. Raises CertifyError where nothing is certified."""
    name = str(open_campaign(path).config["campaign"]["name"])
    found = read_certification(path)
    if found is None:
        raise CertifyError(f"{path} is not certified: softclose certify {path} first")
    return Other(name=name, assessment=found.best.assessment)


def draw_study(result: StudyResult, others: Sequence[Other] = ()) -> Figure:
    """Certified g, v_u and p_nc over the values, with their intervals; other campaigns as lines across."""
    figure = Figure(figsize=(PAGE_IN, 3.2))
    left, right = figure.subplots(1, 2)
    values = np.array(result.study.values, dtype=np.float64)
    order = np.argsort(values)
    assessments = [result.certifications[int(i)].best.assessment for i in order]
    x = np.arange(len(values))
    limits = [100.0 * a.limit.p_max for a in assessments if a.limit is not None]
    if not limits:  # with a limit on p_nc that is met, g is v_u
        _line(left, x, [a.g_cm_s for a in assessments], [a.g_interval for a in assessments], COLOURS["best"], "g")
    v_u = [a.v_u_cm_s for a in assessments]
    _line(left, x, v_u, [a.v_u_interval for a in assessments], COLOURS["deterministic"], "$v_u$")
    p_nc = [100.0 * a.p_nc for a in assessments]
    wilson = [(100.0 * a.p_nc_intervals.wilson[0], 100.0 * a.p_nc_intervals.wilson[1]) for a in assessments]
    _line(right, x, p_nc, wilson, COLOURS["best"], None)
    if limits:
        right.plot(x, limits, color=COLOURS["muted"], linestyle="dashed", label="limit")
        right.set_yscale("log")
    for place, campaign in enumerate(others):
        colour, line = COLOURS[SERIES[2:][place % 3]], LINES[1 + place % (len(LINES) - 1)]
        for axes, y in ((left, campaign.assessment.g_cm_s), (right, 100.0 * campaign.assessment.p_nc)):
            axes.axhline(
                y, color=colour, linestyle=line, linewidth=1.0, label=f"{campaign.name}: g" if axes is left else None
            )
    unit = f" ({result.study.unit})" if result.study.unit else ""
    for axes in (left, right):
        axes.set_xticks(x, [f"{values[i]:g}" for i in order])
        axes.set_xlabel(f"{result.study.parameter}{unit}")
    left.set_ylim(bottom=0.0)
    if not limits:
        right.set_ylim(bottom=0.0)
    left.set_ylabel("$v_u$, certified (cm/s)" if limits else "g and $v_u$, certified (cm/s)")
    right.set_ylabel("Not closed (%)")
    figure.suptitle(literal(result.study.title), fontsize=8.5)
    figure.legend(loc="outside lower center", ncols=2, fontsize=7)
    return figure


def _line(axes, x, estimate, interval, colour: str, label: str | None) -> None:  # type: ignore[no-untyped-def]
    y, ends = np.array(estimate), np.array(interval)
    axes.errorbar(x, y, yerr=np.abs(ends.T - y), color=colour, marker="o", markersize=3, capsize=2, label=label)
