"""Owns the report's section about opening: how the lot falls back, with a brake and without."""

from __future__ import annotations

import math
from typing import Any

from softclose.digits import least_digits
from softclose.opening import Opening, Openings
from softclose_workflows.report.charts import Chart, axis, band, layout, numbers
from softclose_workflows.report.data import ReportData
from softclose_workflows.report.section import Given, Section
from softclose_workflows.run.opening import read_opening
from softclose_workflows.tell.labels import estimated, estimated_share, pulse_lines


class ReportedOpening(Section[Openings]):
    """The lot after the drop."""

    name = "opening"
    place = 50
    html = """
  <p>The holding pulse begins to fall at {{ "%g"|format(found.at_us) }} µs. This is based
    on the {{ found.plain.n|count }}
    {{ "new" if data.certification else "training" }} switches that were still closed then.</p>
  <div class="wide" tabindex="0" role="region" aria-label="Opening"><table class="plain">
    <thead><tr><th scope="col">Release</th>
      <th scope="col" class="n">Overshoot of {{ "%g"|format(100 * data.config.objective.level) }} % (travels)</th>
      <th scope="col" class="n">Touch again</th><th scope="col" class="n">Stuck closed</th>
      <th scope="col" class="n">At rest after (µs)</th></tr></thead>
    <tbody>{% for row in openings %}
      <tr><th scope="row">{{ row.name }}</th>
      {% for name in ["overshoot", "rebound", "stuck", "rest"] %}
      <td class="n">{{ row[name] }}
        {%- if row[name ~ "_interval"] %} <span class="small">({{ row[name ~ "_interval"] }})</span>{% endif %}</td>
      {% endfor %}</tr>{% endfor %}
    </tbody></table></div>
  {{ figure(figures, "opening", "How the lot falls back, in travels from rest, over the drive: lines are medians, "
     ~ "bands hold 90 % of the switches. 1 is the contact, 0 is rest.") }}
"""

    def find(self, given: Given) -> Openings | None:
        """How the best candidate opens, on new switches where it is certified; None where none is designed."""
        if given.certification is not None and given.certification.openings is not None:
            return given.certification.openings
        return read_opening(given.path, given.best)

    def headings(self, found: Openings) -> tuple[str, str]:
        """As every section has."""
        return "Opening", "Opening"

    def figures(self, found: Openings, data: ReportData) -> dict[str, Chart]:
        """The motion."""
        return {"opening": motion(found)}

    def told(self, found: Openings, data: ReportData) -> dict[str, Any]:
        """The rows of the table."""
        return {"openings": rows_of(found)}


def rows_of(found: Openings) -> list[dict[str, str]]:
    """One row without, one with a brake."""

    def row(name: str, o: Opening) -> dict[str, str]:
        watched = f"not within the {o.released.times_us[-1]:g} µs simulated (opening.watch_us)"
        rest = estimated(o.rest_us, *o.rest_interval, least=least_digits("µs"))
        rest = (watched, "") if math.isinf(o.rest_us) else rest
        overshoot = estimated(o.overshoot, *o.overshoot_interval, least=3)
        rebound = estimated_share(o.p_rebound.estimate, *o.p_rebound.wilson)
        stuck = estimated_share(o.p_stuck.estimate, *o.p_stuck.wilson)
        return {
            "name": name,
            "overshoot": overshoot[0],
            "overshoot_interval": overshoot[1],
            "rebound": rebound[0],
            "rebound_interval": rebound[1],
            "stuck": stuck[0],
            "stuck_interval": stuck[1],
            "rest": rest[0],
            "rest_interval": rest[1],
        }

    rows = [row("the holding pulse falls", found.plain)]
    if found.braked is not None:
        p = pulse_lines([tuple(r) for r in found.braked.released.waveform.rows()[-1:].tolist()])[0]
        name = f"with a brake: {p['volts']} V from {p['start']} µs, rise {p['rise']} µs, flat top {p['top']} µs"
        rows.append(row(name, found.braked))
    return rows


def motion(found: Openings) -> Chart:
    """The motion of the lot after the drop, over the drive: median, and from 5 to 95 %."""
    traces: list[Chart] = []
    for o, role, name in ((found.plain, "open", "the holding pulse falls"), (found.braked, "best", "with a brake")):
        if o is None:
            continue
        r = o.released
        step = max(1, math.ceil(r.times_us.size / 400))
        t, (low, middle, high) = r.times_us[::step], r.quantiles[:, ::step]
        traces += [
            band(t, low, high, role),
            {
                "name": name,
                "x": numbers(t),
                "y": numbers(middle, 3),
                "mode": "lines",
                "line": {"color": f"@{role}", "width": 2, "dash": "dash" if role == "open" else "solid"},
                "hovertemplate": "%{x:.1f} µs: median %{y:.2f} travels<extra>" + name + "</extra>",
            },
            {
                "x": numbers(t),
                "y": numbers(r.waveform.voltage(found.at_us + t)),
                "yaxis": "y2",
                "mode": "lines",
                "line": {"color": f"@{role}", "width": 1.6, "dash": "dash" if role == "open" else "solid"},
                "hovertemplate": "%{x:.1f} µs: %{y:.1f} V<extra>" + name + "</extra>",
                "showlegend": False,
            },
        ]
    braked = "" if found.braked is None else f", {found.braked.overshoot:.2f} with a brake"
    return {
        "data": traces,
        "layout": layout(
            axis("Time from the begin of the fall (µs)", anchor="y2"),
            axis("x / D", domain=[0.36, 1.0]),
            yaxis2=axis("u (V)", domain=[0.0, 0.26], rangemode="tozero"),
            showlegend=True,
            height=440,
        ),
        "alt": f"Motion of the lot after the drop: beyond rest by {found.plain.overshoot:.2f} travels{braked}.",
    }
