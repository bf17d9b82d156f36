"""Owns what a section of the report is: what it finds in a store, its charts, its words. Each is a file of `sections`.

The page lists all in the order of their places, between the contact speeds and the switches that hit hardest. A section
needs a best candidate.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar

from softclose.population.lot import Lot
from softclose.settings import CampaignConfig
from softclose_workflows.analyses.certify import Certification
from softclose_workflows.report.charts import Chart
from softclose_workflows.report.data import Design, ReportData

if TYPE_CHECKING:
    from softclose_store import Campaign

Shown = TypeVar("Shown")

MOST_SWITCHES = 2000
"""Switches that a section simulates beside the campaign's own, at each temperature or on a plainer model."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Given:
    """What a section may look at."""

    path: str
    """Path or URL of the store."""
    campaign: Campaign
    config: CampaignConfig
    best: int
    """The candidate that the report is about."""
    designs: tuple[Design, ...]
    """On the training switches: that candidate first, then the designs that it is compared with."""
    certification: Certification | None

    @property
    def lot(self) -> Lot:
        """The training switches of the best candidate."""
        return Lot(self.campaign.population()).rows(slice(len(self.designs[0].speed_cm_s)))


class Section(ABC, Generic[Shown]):
    """One section of the page."""

    name: ClassVar[str]
    """Its anchor; figures begin with it."""
    place: ClassVar[int]
    """Order on the page, smallest first."""
    html: ClassVar[str]
    """Its words, as a template of `found`, `data`, `figures` and whatever `told` adds; `figure(figures, id, caption)`
    places a chart. What a store says is escaped."""

    @abstractmethod
    def find(self, given: Given) -> Shown | None:
        """What there is to show; None where there is nothing. Looked for once a report."""

    @abstractmethod
    def headings(self, found: Shown) -> tuple[str, str]:
        """Its heading, and its name in the list of sections."""

    def figures(self, found: Shown, data: ReportData) -> dict[str, Chart]:
        """Its charts by their ids."""
        return {}

    def told(self, found: Shown, data: ReportData) -> dict[str, Any]:
        """What else its words need."""
        return {}
