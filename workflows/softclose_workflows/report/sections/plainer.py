"""Owns the report's section about further modes and losses: the best candidate on switches without them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from softclose.evaluate import judge, respond
from softclose.plugins import REDUCED_ORDER
from softclose_workflows.report.charts import Chart, densities, top_speed
from softclose_workflows.report.data import Design, ReportData
from softclose_workflows.report.section import MOST_SWITCHES, Given, Section


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plainer:
    """The best candidate on switches with and without what the device model adds to Eqs. 1-2."""

    kind: Literal["modes", "losses"]
    """What was left out."""
    own: Design
    """As the campaign simulates."""
    without: Design
    """Without it."""
    peaks_um: tuple[float, ...]
    """Of each further mode the level-quantile of its largest displacement of the contact until the first impact."""


class ReportedPlainer(Section[Plainer]):
    """The same switches with their first mode alone, or else without losses."""

    name = "plainer"
    place = 40
    html = """
  {% if found.kind == "modes" %}
  <p>Do higher modes matter for this waveform? Where both curves coincide, they do not.
    {% for peak in found.peaks_um %}
    Until the first impact, mode {{ loop.index + 1 }} moves the contact by at most {{ "%.3f"|format(peak) }} µm in
    {{ "%g"|format(100 * data.config.objective.level) }} % of the switches.
    {% endfor %}</p>
  {{ figure(figures, "plainer", "The best candidate on the same training switches, with all modes and with the first "
     ~ "alone. Ticks mark each upper velocity.") }}
  {% else %}
  <p>What damping, the film of gas and adhesion of the device model change for this waveform.</p>
  {{ figure(figures, "plainer", "The best candidate on the same training switches, with losses as simulated and "
     ~ "without. Ticks mark each upper velocity.") }}
  {% endif %}
"""

    def find(self, given: Given) -> Plainer | None:
        """None where switches have neither further modes nor losses."""
        config, best, lot = given.config, given.designs[0], given.lot
        modes = config.build_reduced_order() if config.model.name == REDUCED_ORDER else None
        kind: Literal["modes", "losses"]
        if modes is not None and len(modes.mode) > 1:
            kind, name = "modes", "the first mode alone"
            first = replace(modes, mode=modes.mode[:1]).to_dict()
            simple = replace(config, reduced_order_model=first)
        elif not config.model.build_losses().none:
            kind, name = "losses", "the same switches without losses"
            lossless = replace(config.model, quality_factor=0.0, film_viscosity_uPa_s=0.0, adhesion_uN=0.0)
            simple = replace(config, model=lossless)
        else:
            return None
        n = min(MOST_SWITCHES, len(best.speed_cm_s))
        found, without = (respond(c, lot.rows(slice(n)), best.waveform) for c in (config, simple))
        own, other = (
            Design.of(r, judge(config, r), name=called, role=role, waveform=best.waveform)
            for called, role, r in (
                ("all modes" if kind == "modes" else "as simulated", "best", found),
                (name, "unshaped", without),
            )
        )
        peaks = found.mode_peak_um
        level = config.objective.level
        return Plainer(
            kind=kind,
            own=own,
            without=other,
            peaks_um=() if peaks is None else tuple(np.quantile(peaks[:, 1:], level, axis=0).tolist()),
        )

    def headings(self, found: Plainer) -> tuple[str, str]:
        """As every section has."""
        return ("Further modes", "Modes") if found.kind == "modes" else ("Losses", "Losses")

    def figures(self, found: Plainer, data: ReportData) -> dict[str, Chart]:
        """Speeds with and without."""
        both = found.own, found.without
        return {"plainer": densities(both, [d.role for d in both], top_speed(both))}
