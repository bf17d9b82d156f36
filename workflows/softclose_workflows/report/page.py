"""Owns the report's page: `ReportData` in, one self-contained HTML text out, with no network.

Names and notes in a store are strangers' text: the template escapes everything, data for the script is JSON without
`<`, and a content security policy lets nothing run but the two scripts whose digests it names.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
import math
from functools import lru_cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any

import numpy as np

from softclose import __version__
from softclose.propose.origins import label_of
from softclose_workflows.report import charts, front_charts, packed, shapes
from softclose_workflows.report.data import ReportData
from softclose_workflows.report.glossary import glossary
from softclose_workflows.report.headline import headline
from softclose_workflows.report.sections import all_sections
from softclose_workflows.report.summary import candidate_rows, front_words, metrics, provenance
from softclose_workflows.tell import labels

if TYPE_CHECKING:
    from jinja2 import Environment


def render_report(data: ReportData) -> str:
    """The whole page."""
    from markupsafe import Markup

    figures, picks = _figures(data), _picks(data)
    shown = _sections(data, figures)
    return render(
        "report.html.j2",
        payload={
            "palettes": labels.PALETTE,
            "figures": {name: _drawn(chart) for name, chart in figures.items()},
            "picks": picks,
            "metrics": [] if data.best is None else [row[0] for row in metrics(data, data.best)],
            "best": data.best,
            "horizon": data.config.model.horizon_us,
        },
        data=data,
        figures=figures,
        picks=picks,
        sections=shown,
        metrics=[] if data.best is None else metrics(data, data.best),
        headline=(top := headline(data)),
        words=glossary(data),
        picture=Markup(top.get("picture", "")),
        places_g=[labels.number(data.candidates.columns["g_cm_s"][i], 2) for i in data.places],
        candidates=candidate_rows(data),
        provenance=provenance(data),
        dependence=data.dependence,
        lengths=[name for name in figures if name.startswith("length-")],
        labels=labels,
        pairs=_pair_names(data),
        best=data.best_design,
        has_notes=any(data.candidates.note),
        front_words=front_words(data),
    )


def render(template: str, *, payload: dict[str, Any], **context: Any) -> str:
    """One of the page templates, with the scripts, the style and the data inlined."""
    from markupsafe import Markup

    scripts = {"library": _library(), "script": _asset("page.js")}
    return _filled(template, scripts, payload=Markup(_json(payload)), **context)


def render_plain(template: str, **context: Any) -> str:
    """One of the page templates that need no script."""
    return _filled(template, {}, **context)


def render_live() -> str:
    """The page of `softclose serve`, which asks its server, and nobody else, for what it shows."""
    return _filled("live.html.j2", {"script": _asset("live.js")})


def _filled(template: str, scripts: dict[str, str], **context: Any) -> str:
    """A template with the style and its scripts, which the policy lets run by their digests; all else is escaped."""
    from markupsafe import Markup

    return (
        _environment()
        .get_template(template)
        .render(
            **{name: Markup(script) for name, script in scripts.items()},
            script_digests=[_digest(script) for script in scripts.values()],
            style=Markup(_roles() + _asset("page.css")),
            version=__version__,
            **context,
        )
    )


@lru_cache(maxsize=1)
def _environment() -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("softclose_workflows.report", "assets"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["count"] = labels.count
    return environment


@lru_cache(maxsize=1)
def _library() -> str:
    """plotly.js, its bundle of charts with two axes: a third of the whole (ADR 060)."""
    asset = files("softclose_workflows.report").joinpath("assets", "plotly-cartesian.min.js.gz")
    text = gzip.decompress(asset.read_bytes()).decode("utf-8")
    return "\n" + text.replace("</script", "<\\/script")


def _asset(name: str) -> str:
    return "\n" + files("softclose_workflows.report").joinpath("assets", name).read_text(encoding="utf-8")


def _digest(script: str) -> str:
    return base64.b64encode(hashlib.sha256(script.encode()).digest()).decode("ascii")


def _roles() -> str:
    """The palette as CSS variables, light and dark."""

    def block(theme: str) -> str:
        return "".join(f"--{role}:{colour};" for role, colour in labels.PALETTE[theme].items())

    return f":root{{{block('light')}}}\n@media screen and (prefers-color-scheme: dark){{:root{{{block('dark')}}}}}\n"


def _json(value: Any) -> str:
    """JSON that cannot end its script element, whatever it holds."""
    text = json.dumps(value, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


def _drawn(chart: charts.Chart) -> dict[str, Any]:
    return {"data": chart["data"], "layout": chart["layout"]}


def _figures(data: ReportData) -> dict[str, charts.Chart]:
    """Every chart that this store has something to show in, by the id of its place on the page."""
    figures: dict[str, charts.Chart] = {}
    if data.best_design is not None:
        figures["response"] = charts.response(data)
        figures["histogram"] = charts.histogram(data)
        judged = data.judged_designs
        figures["densities"] = charts.densities(judged, [d.role for d in judged], charts.top_speed(judged))
        figures["exceedance"] = charts.exceedance(judged, data.config.objective.limits_cm_s, charts.top_speed(judged))
        for name in data.shown_parameters:
            figures[f"switches-{name}"] = charts.switches(data, data.best_design, name)
    if data.front is not None and len(data.front.candidates) > 1:
        figures["front"] = front_charts.front(data.front, data.candidates)
        if np.isfinite(data.front.values).all(axis=1).mean() > 0.5:  # else most of it was on smaller ensembles
            figures["front-growth"] = front_charts.growth(data.front)
    for name in data.parameters:
        figures[f"population-{name}"] = charts.population(data, name)
    if data.n_committed:
        figures["convergence"] = charts.convergence(data)
    figures |= {f"length-{name}": chart for name, chart in charts.length_scales(data).items()}
    if data.dependence is not None:
        span = shapes.dependence_span(data.dependence)
        for i, name in enumerate(data.dependence.names):
            figures[f"dependence-{name}"] = charts.dependence(data.dependence, i, span)
        for place in range(len(data.dependence.pairs)):
            figures[f"pair-{place}"] = charts.pair(data.dependence, place)
    return figures


def _sections(data: ReportData, figures: dict[str, charts.Chart]) -> list[dict[str, Any]]:
    """Every section that found something, its charts among the figures of the page."""
    from markupsafe import Markup

    shown = []
    for section in all_sections():
        found = data.sections.get(section.name)
        if found is None:
            continue
        figures |= section.figures(found, data)
        template = _environment().from_string('{% from "figure.html.j2" import figure %}' + section.html)
        html = Markup(template.render(found=found, data=data, figures=figures, **section.told(found, data)))
        heading, link = section.headings(found)
        shown.append({"name": section.name, "heading": heading, "link": link, "html": html})
    return shown


def _pair_names(data: ReportData) -> list[str]:
    if data.dependence is None:
        return []
    names = [labels.coordinate_label(name, unit=False) for name in data.dependence.names]
    return [f"{names[i]} × {names[j]}" for i, j in data.dependence.pairs]


MOST_PICKS = 5000
"""Candidates that a page can show one by one: a megabyte of it. Of a longer campaign these are the first in rank."""


def _picks(data: ReportData) -> dict[int, dict[str, Any]]:
    """What the page can show of each candidate: of all their waveform and metrics, of the places their switches too."""
    if data.best is None:
        return {}
    best = data.designs[0].traces
    columns, picks = data.candidates.columns, {}
    for i in sorted({*data.candidates.ranked[:MOST_PICKS], *data.places}):
        waveform = data.candidates.waveforms[i]
        if waveform is None or data.candidates.failed[i]:
            continue
        picks[i] = pick = {
            "rows": [[None if math.isinf(v) else round(v, 5) for v in row] for row in waveform.rows().tolist()],
            "pulses": [
                list(line.values()) for line in labels.pulse_lines([tuple(r) for r in waveform.rows().tolist()])
            ],
            "origin": label_of(data.candidates.origin[i]),
            "values": [row[1:] for row in metrics(data, i)],
        }
        if i in data.shares:
            traces = best if i == data.best and best is not None else data.samples.get(i)
            pick |= {
                "traces": packed.pack_traces(traces) if traces is not None else None,
                "shares": charts.numbers(data.shares[i], 3),
                "v_u": charts.numbers(columns["v_u_cm_s"][i : i + 1], 5)[0],
                "mean": charts.numbers(columns["mean_cm_s"][i : i + 1], 5)[0],
            }
    return picks
