"""Owns one row of the reproduction: a published case beside ours."""

from __future__ import annotations

from dataclasses import dataclass

from softclose.metrics.intervals import Interval
from softclose.settings import CampaignConfig
from softclose_workflows.analyses.certify import Certified
from softclose_workflows.studies.published import PublishedCase


@dataclass(frozen=True, slots=True, kw_only=True)
class ReproducedRow:
    """One case beside the study's figures."""

    case: PublishedCase
    """The case."""
    config: CampaignConfig
    """The campaign that it belongs to."""
    store: str
    """Name of that campaign's store."""
    certified: Certified
    """The waveform on new switches."""
    v_u_range: Interval
    """95 % of the estimates of v_u that ensembles of 200 switches would give [cm/s]."""
    mean_range: Interval
    """The same for mean V [cm/s]."""

    @property
    def verdict(self) -> str:
        """How the published v_u compares with what 200 switches would show of ours."""
        if self.case.published is None:
            return ""
        published, (lower, upper) = self.case.published.v_u_cm_s, self.v_u_range
        return "ours is softer" if published > upper else "ours is harder" if published < lower else "agrees"
