"""Owns whether a design keeps the limits that its campaign was given: decided by the interval, as on a sign-off."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from softclose.evaluate.asked import limited
from softclose.evaluate.quantities import Quantity, Value, quantity
from softclose.metrics.objective import Assessment, Response
from softclose.settings import CampaignConfig
from softclose_workflows.analyses.verdict import LineVerdict, verdict_of
from softclose_workflows.tell.labels import estimated_quantity


@dataclass(frozen=True, slots=True, kw_only=True)
class OwnLimit:
    """One limit of a campaign, and what the switches say of it."""

    setting: str
    """Where it was set: `objective.max_open`."""
    quantity: Quantity
    """What is limited."""
    value: Value
    """On the switches that the design is judged on."""
    limit: float
    """The most of it, or the least where more is better."""
    verdict: LineVerdict
    """pass or fail where the whole interval lies on that side of the limit."""

    @property
    def told(self) -> tuple[str, str, str]:
        """Value, interval and limit, in words: `("3.48 %", "3.37–3.60 %", "at most 10.00 %")`."""
        q = self.quantity
        limit, _ = estimated_quantity(q, self.limit)
        return *estimated_quantity(q, self.value.estimate, *self.value.interval), f"{q.bound} {limit}"

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "setting": self.setting,
            "quantity": self.quantity.name,
            "unit": self.quantity.unit,
            "value": self.value.estimate,
            "interval": list(self.value.interval),
            "limit": self.limit,
            "better": self.quantity.better,
            "verdict": self.verdict,
        }


def limit_lines(limits: Sequence[OwnLimit]) -> list[str]:
    """`limit objective.max_open, fraction of switches not closed at most 10.00 %: pass, 3.48 % (3.37–3.60 %)`."""
    lines = []
    for found in limits:
        value, bounds, limit = found.told
        what = f"limit {found.setting}, {found.quantity.long_name} {limit}"
        lines.append(f"{what}: {found.verdict}, {value}{f' ({bounds})' if bounds else ''}".replace("\u202f", " "))
    return lines


def own_limits(config: CampaignConfig, response: Response, a: Assessment, *, fresh: bool) -> list[OwnLimit]:
    """Every limit of a campaign; [] where it was given none.

    Parameters
    ----------
    config : CampaignConfig
        The campaign's.
    response : Response
        What n switches did.
    a : Assessment
        How that was judged.
    fresh : bool
        Whether they are new switches.

    Returns
    -------
    list of OwnLimit
    """
    o, p = config.objective, a.p_nc_intervals
    ends = p.clopper_pearson if a.limit is not None else p.wilson
    share = Value(estimate=a.p_nc, interval=ends, n=a.n)
    asked: list[tuple[str, str, Value, float]] = []
    if a.limit is not None:
        asked.append(("objective.p_max", "p_nc", share, o.p_max))
    if o.max_open < 1.0:
        asked.append(("objective.max_open", "p_nc", share, o.max_open))
    for name, value in limited(config, response, a, fresh=fresh).items():
        asked.append((f"objective.quantity_limits.{name}", name, value, o.quantity_limits[name]))
    return [
        OwnLimit(
            setting=setting,
            quantity=quantity(name),
            value=value,
            limit=limit,
            verdict=verdict_of(quantity(name), value, limit),
        )
        for setting, name, value, limit in asked
    ]
