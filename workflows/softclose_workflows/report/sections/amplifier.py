"""Owns the report's section about the amplifier: what it delivers of the waveform that is commanded."""

from __future__ import annotations

import math

import numpy as np

from softclose.conditions.amplifier import deliver
from softclose.settings import CampaignConfig
from softclose_workflows.report.charts import Chart, axis, layout, numbers
from softclose_workflows.report.data import Design, ReportData
from softclose_workflows.report.section import Given, Section


class ReportedAmplifier(Section[Design]):
    """Commanded and delivered voltage."""

    name = "amplifier"
    place = 10
    html = """
  <p>The waveform above is the commanded one, as it is exported. The switches were simulated under what the campaign’s
    amplifier delivers of it.</p>
  {{ figure(figures, "amplifier", "Commanded and delivered voltage of the best candidate.") }}
"""

    def find(self, given: Given) -> Design | None:
        """The best candidate; None behind an ideal amplifier."""
        return None if given.config.amplifier.is_ideal else given.designs[0]

    def headings(self, found: Design) -> tuple[str, str]:
        """As every section has."""
        return "Amplifier", "Amplifier"

    def figures(self, found: Design, data: ReportData) -> dict[str, Chart]:
        """Both voltages over time."""
        return {"amplifier": delivered_chart(found, data.config)}


def delivered_chart(design: Design, config: CampaignConfig) -> Chart:
    """The commanded waveform and what the amplifier delivers of it."""
    horizon = _until_of(design, config)
    t = np.linspace(0.0, horizon, 601)
    delivered = deliver(config.amplifier, design.waveform, config.model.horizon_us).voltage(t)
    commanded = design.waveform.voltage(t)
    apart = float(np.abs(delivered - commanded).max())
    return {
        "data": [
            {
                "name": name,
                "x": numbers(t),
                "y": numbers(u),
                "mode": "lines",
                "line": {"color": colour, "width": 2, "dash": dash},
                "hovertemplate": "%{y:.1f} V<extra>" + name + "</extra>",
            }
            for name, u, colour, dash in (
                ("commanded", commanded, "@unshaped", "dash"),
                ("delivered", delivered, "@best", "solid"),
            )
        ],
        "layout": layout(
            axis("Time (µs)", range=[0, horizon], unifiedhovertitle={"text": "%{x:.1f} µs"}),
            axis("Voltage (V)"),
            showlegend=True,
            hovermode="x unified",
        ),
        "alt": f"The commanded voltage and what the amplifier delivers of it, up to {apart:.1f} V apart.",
    }


def _until_of(design: Design, config: CampaignConfig) -> float:
    """End of the axis: a little after the last change of the waveform."""
    last = float(design.waveform.breakpoints(config.model.horizon_us)[-1])
    return min(config.model.horizon_us, 10.0 * math.ceil((last + 30.0) / 10.0))
