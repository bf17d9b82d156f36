"""Owns where a campaign stands: what `status` says, read from the committed part of a store alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softclose.metrics.intervals import proportion
from softclose.metrics.limit import Limit, limit_on
from softclose.metrics.ranking import open_warning
from softclose.propose.origins import FALLBACK
from softclose_store import Best, Campaign, open_campaign
from softclose_workflows.tell.plain import finite, waveform_rows


@dataclass(frozen=True, slots=True, kw_only=True)
class Standing:
    """A campaign at one instant."""

    store: str
    """Path or URL."""
    name: str
    """The campaign's title."""
    committed: int
    """Candidates that are part of the campaign for good."""
    budget: int
    """Candidates in all, the finishing stage included."""
    failed: int
    """Committed candidates without a usable result."""
    fallbacks: int
    """Committed candidates that stand in for a proposal that failed."""
    reason: str
    """What the first failure, or else the first fallback, gave as its reason; empty where there is none."""
    best: Best | None
    """The best committed candidate; None before the first usable one."""
    limit: Limit | None = None
    """What its ensemble says of the limit on p_nc; None in the penalty form."""
    warning: str = ""
    """Where the best candidate leaves more than objective.warn_open of the switches open."""
    changes: tuple[str, ...] = ()
    """What was changed by hand, a sentence each."""

    @property
    def finished(self) -> bool:
        """True where the whole budget is committed."""
        return self.committed >= self.budget

    def to_json(self) -> dict[str, Any]:
        """Plain values; a number that is undefined is null, and so is the peak of a pulse that holds."""
        return {
            "store": self.store,
            "name": self.name,
            "committed": self.committed,
            "budget": self.budget,
            "finished": self.finished,
            "failed": self.failed,
            "fallbacks": self.fallbacks,
            "reason": self.reason,
            "best": None if self.best is None else best_to_json(self.best),
            "warning": self.warning,
            "limit": None if self.limit is None else asdict(self.limit),
            "changed_by_hand": list(self.changes),
        }


def best_to_json(best: Best) -> dict[str, Any]:
    """The best candidate as `status --json` prints it."""
    said: dict[str, Any] = finite(
        {
            "candidate": best.candidate,
            "g_cm_s": float(best.g_cm_s),
            "v_u_cm_s": float(best.v_u_cm_s),
            "mean_cm_s": float(best.mean_cm_s),
            "p_nc": float(best.p_nc),
            "n_switches": best.n_switches,
            "n_failed": max(int(best.record.get("n_failed_switches", 0)), 0),
            "waveform": waveform_rows(best.waveform),
        }
    )
    return said


def read_standing(path: str) -> Standing:
    """Read the standing of the campaign at path, also while it is being written."""
    return standing_of(open_campaign(path), path)


def standing_of(campaign: Campaign, store: str) -> Standing:
    """The standing of a campaign as last refreshed; store: what to call it."""
    best, records = campaign.best(), campaign.records()
    stands_in = np.array([origin == FALLBACK for origin in records["origin"]], dtype=np.bool_)
    reasons = [*records["failure"][records["failed"]], *records["note"][stands_in]]
    return Standing(
        store=store,
        name=str(campaign.config["campaign"]["name"]),
        committed=campaign.committed,
        budget=campaign.budget,
        failed=int(records["failed"].sum()),
        fallbacks=int(stands_in.sum()),
        reason=str(reasons[0]) if reasons else "",
        best=best,
        limit=None if best is None else _limit(campaign.config, best, records),
        warning="" if best is None else stored_open_warning(campaign.config, best.p_nc),
        changes=changes_of(campaign),
    )


def changes_of(campaign: Campaign) -> tuple[str, ...]:
    """What was changed by hand, a sentence each."""
    return tuple(f"candidate {change.candidate}: {change.note}" for change in campaign.by_hand)


def stored_open_warning(config: Mapping[str, Any], p_nc: float) -> str:
    """The warning of a candidate of a store, from the configuration that it keeps; "" where none is due."""
    objective = config["objective"]
    return open_warning(p_nc, max_open=objective["max_open"], warn_open=objective["warn_open"])


def _limit(config: Mapping[str, Any], best: Best, records: Mapping[str, NDArray[Any]]) -> Limit | None:
    """The chance-constrained form's limit, judged by the best candidate's own record."""
    objective = config["objective"]
    if objective["form"] != "chance":
        return None
    lower, upper = (float(records[f"p_nc_clopper_pearson_{end}"][best.candidate]) for end in ("lower", "upper"))
    confidence = objective["confidence"]
    p = proportion(round(best.p_nc * best.n_switches), best.n_switches, confidence)
    valid = config["population"]["sampling"] != "sobol"
    return limit_on(
        replace(p, clopper_pearson=(lower, upper)), objective["p_max"], objective["confidence"], valid=valid
    )
