"""Owns the report's section about temperature: the lot at each of some temperatures of the campaign's range."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from softclose.arrays import FloatArray
from softclose.conditions.temperature import TemperatureSection, heated
from softclose.device.protocol import ModelError
from softclose.evaluate import draw, judge, respond
from softclose.metrics.objective import Assessment
from softclose_workflows.report.charts import DASHES, Chart, axis, band, layout, numbers, plain
from softclose_workflows.report.data import Design, ReportData
from softclose_workflows.report.section import MOST_SWITCHES, Given, Section
from softclose_workflows.tell import labels

N_TEMPERATURES = 9
"""Temperatures at which the lot is simulated for the report."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OverTemperature:
    """Designs on one lot at each of some temperatures of the campaign's range."""

    celsius: FloatArray
    """(k,) [°C]."""
    names: tuple[str, ...]
    """What charts call the designs."""
    roles: tuple[str, ...]
    """Their roles in the palette."""
    found: tuple[tuple[Assessment, ...], ...]
    """Of each design, one for each temperature."""


class ReportedTemperature(Section[OverTemperature]):
    """Every design over temperature."""

    name = "temperature"
    place = 30
    html = """
  {% set t = data.config.temperature %}
  <p>The campaign asks of one waveform to hold from {{ "%g"|format(t.low_C) }} to {{ "%g"|format(t.high_C) }} °C;
    {% if t.worst_of %}
    each switch counts at the worst of {{ t.worst_of }} temperatures, so the figures above are harder than those of any
    one temperature.
    {% else %}
    each switch has a temperature of its own in that range.
    {% endif %}
    Here the whole lot is at one temperature at a time.</p>
  <div class="grid2">
  {{ figure(figures, "temperature-speeds", "Upper velocity of the lot at each temperature.") }}
  {{ figure(figures, "temperature-open", "Switches that do not close.") }}
  </div>
"""

    def find(self, given: Given) -> OverTemperature | None:
        """None where the campaign has no range, or the device model is missing."""
        config, designs = given.config, given.designs
        tables = config.temperature
        if not tables.celsius:
            return None
        still = replace(config, temperature=TemperatureSection())
        n = min(MOST_SWITCHES, len(designs[0].speed_cm_s))
        lot = draw(still, n, seed=config.campaign.seed, sampling=config.population.sampling)
        celsius = np.linspace(tables.low_C, tables.high_C, N_TEMPERATURES)

        def at_each(design: Design) -> tuple[Assessment, ...]:
            plain = design.role != "best"  # reference designs are tailored to nobody
            return tuple(
                judge(still, respond(still, heated(tables, lot, c), design.waveform, for_everybody=plain))
                for c in celsius
            )

        try:
            assessments = tuple(at_each(design) for design in designs)
        except ModelError:  # the device model is not installed here
            return None
        return OverTemperature(
            celsius=celsius,
            names=tuple(d.name for d in designs),
            roles=tuple(d.role for d in designs),
            found=assessments,
        )

    def headings(self, found: OverTemperature) -> tuple[str, str]:
        """As every section has."""
        return "Temperature", "Temperature"

    def figures(self, found: OverTemperature, data: ReportData) -> dict[str, Chart]:
        """Upper velocity, and switches that do not close."""
        return {"temperature-speeds": speeds(found), "temperature-open": left_open(found)}


def speeds(found: OverTemperature) -> Chart:
    """v_u of each design over temperature, the first with its interval where one holds."""
    traces: list[Chart] = []
    for place, (name, role, at_each) in enumerate(zip(found.names, found.roles, found.found, strict=True)):
        ends = np.array([a.v_u_interval for a in at_each])
        if place == 0 and at_each[0].intervals_valid:
            traces.append(band(found.celsius, ends[:, 0], ends[:, 1], role, digits=4))
        traces.append(_line(found, name, role, place, [a.v_u_cm_s for a in at_each], "%{y:.1f} cm/s"))
    best = [a.v_u_cm_s for a in found.found[0]]
    return {
        "data": traces,
        "layout": _over(found, "Upper velocity (cm/s)"),
        "alt": f"Upper velocity over temperature; {found.names[0]}: "
        f"{labels.number(best[0])} cm/s at {found.celsius[0]:g} °C, {labels.number(best[-1])} at the other end.",
    }


def left_open(found: OverTemperature) -> Chart:
    """Switches that do not close over temperature, one line per design."""
    return {
        "data": [
            _line(found, name, role, place, [100.0 * a.p_nc for a in at_each], "%{y:.1f} %")
            for place, (name, role, at_each) in enumerate(zip(found.names, found.roles, found.found, strict=True))
        ],
        "layout": _over(found, "Not closed (%)"),
        "alt": f"Switches that do not close over temperature; {found.names[0]}: "
        f"{labels.percent(found.found[0][0].p_nc)} at {found.celsius[0]:g} °C, "
        f"{labels.percent(found.found[0][-1].p_nc)} at {found.celsius[-1]:g}.",
    }


def _over(found: OverTemperature, what: str) -> Chart:
    celsius = axis("Temperature (°C)", range=[float(found.celsius[0]), float(found.celsius[-1])])
    return layout(celsius, axis(what, rangemode="tozero"), showlegend=True, height=360)


def _line(found: OverTemperature, name: str, role: str, place: int, values: list[float], told: str) -> Chart:
    return {
        "name": plain(name),
        "x": numbers(found.celsius),
        "y": numbers(np.array(values)),
        "mode": "lines+markers",
        "line": {"color": f"@{role}", "width": 2.2, "dash": DASHES[place % len(DASHES)]},
        "marker": {"color": f"@{role}", "size": 6},
        "hovertemplate": "%{x:.0f} °C: " + told + "<extra>" + plain(name) + "</extra>",
    }
