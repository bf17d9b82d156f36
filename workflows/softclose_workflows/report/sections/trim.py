"""Owns the report's section about trim: what scaling each switch's drive brings."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from softclose.arrays import FloatArray
from softclose.device.protocol import ModelError
from softclose.evaluate import judge, respond
from softclose.evaluate.chain import chain_of, drives_of
from softclose_workflows.report.charts import Chart, axis, densities, layout, numbers, top_speed
from softclose_workflows.report.data import Design, ReportData
from softclose_workflows.report.section import Given, Section


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrimShown:
    """What scaling its drives does for the best candidate, on the training switches."""

    voltage: FloatArray
    """(n,) voltage scale of each switch's drive, within the limits."""
    time: FloatArray
    """(n,) time scale."""
    n_limited: int
    """Switches whose scales end at a limit of the drive."""
    untrimmed: Design
    """The same waveform where every switch gets it as it is."""


class ReportedTrim(Section[TrimShown]):
    """The best candidate with and without it, and the scales."""

    name = "trim"
    place = 20
    html = """
  <p>Each switch is driven by the waveform above, its volts and times scaled by what was measured on that switch
    ({{ data.config.trim.measured }}). {{ found.n_limited }} of {{ found.voltage|length }} scales end at a limit of the
    drive.</p>
  {{ figure(figures, "trim-speeds", "The best candidate on the training switches, scaled for each of them and as it is "
     ~ "for all of them. Ticks mark each upper velocity.") }}
  {{ figure(figures, "trim-scales", "What the drives of the training switches are scaled by.") }}
"""

    def find(self, given: Given) -> TrimShown | None:
        """On the training switches; None where nothing is scaled or the device model is missing."""
        config, best = given.config, given.designs[0]
        chain = chain_of(config)
        if not any(condition.tailored for condition in chain.conditions):
            return None
        lot = given.lot
        try:
            plain = respond(config, lot, best.waveform, for_everybody=True)
        except ModelError:
            return None
        drives = drives_of(chain, lot, best.waveform)
        clock = lot.get("clock", 1.0)
        voltage = np.ones(len(lot)) if drives.volts is None else drives.volts
        time = np.ones(len(lot)) if drives.times is None else drives.times / clock
        return TrimShown(
            voltage=voltage,
            time=time,
            n_limited=int((~np.isclose(voltage, lot["voltage_scale"]) | ~np.isclose(time, lot["time_scale"])).sum()),
            untrimmed=Design.of(
                plain, judge(config, plain), name="the same drive for all", role="unshaped", waveform=best.waveform
            ),
        )

    def headings(self, found: TrimShown) -> tuple[str, str]:
        """As every section has."""
        return "Trim", "Trim"

    def figures(self, found: TrimShown, data: ReportData) -> dict[str, Chart]:
        """Speeds with and without, and the scales of all drives."""
        pair = (replace(data.designs[0], name="each switch its own drive"), found.untrimmed)
        return {
            "trim-speeds": densities(pair, [d.role for d in pair], top_speed(pair)),
            "trim-scales": trim_scales(found),
        }


def trim_scales(trim: TrimShown, limit: int = 2000) -> Chart:
    """Time scale against voltage scale of each switch's drive."""
    a, b = trim.voltage[:limit], trim.time[:limit]
    return {
        "data": [
            {
                "x": numbers(a),
                "y": numbers(b),
                "mode": "markers",
                "marker": {"color": "@best/0.55", "size": 4},
                "customdata": list(range(len(a))),
                "hovertemplate": "switch %{customdata}<br>volts × %{x:.3f}<br>times × %{y:.3f}<extra></extra>",
            }
        ],
        "layout": layout(
            axis("Voltage scale of the drive"),
            axis("Time scale of the drive"),
            height=340,
        ),
        "alt": f"Time scale against voltage scale of {len(a)} drives: volts from {a.min():.2f} to {a.max():.2f}, times "
        f"from {b.min():.2f} to {b.max():.2f} of the common waveform's.",
    }
