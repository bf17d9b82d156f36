"""Owns where a campaign stands: what `status` says, read from the committed part of a store alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from softclose_store import Best, open_campaign
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
    best: Best | None
    """The best committed candidate; None before the first usable one."""

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
            "best": None if self.best is None else best_to_json(self.best),
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
            "waveform": waveform_rows(best.waveform),
        }
    )
    return said


def read_standing(path: str) -> Standing:
    """Read the standing of the campaign at path, also while it is being written."""
    campaign = open_campaign(path)
    return Standing(
        store=path,
        name=str(campaign.config["campaign"]["name"]),
        committed=campaign.committed,
        budget=campaign.budget,
        failed=int(campaign.records()["failed"].sum()) if campaign.committed else 0,
        best=campaign.best(),
    )
