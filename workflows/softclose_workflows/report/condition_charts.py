"""Owns the charts of the conditions of a lot: over temperature, and how it opens."""

from __future__ import annotations

import math

import numpy as np

from softclose.opening import Openings
from softclose_workflows.report.charts import DASHES, Chart, axis, band, layout, numbers, plain
from softclose_workflows.report.data import OverTemperature
from softclose_workflows.tell import labels


def temperature_speeds(found: OverTemperature) -> Chart:
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


def temperature_open(found: OverTemperature) -> Chart:
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


def opening(found: Openings) -> Chart:
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
