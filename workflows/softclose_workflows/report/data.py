"""Owns `ReportData`: everything that reports and figures show of one campaign, in the units they show."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softclose.arrays import FloatArray
from softclose.metrics.objective import CM_S, Assessment, Response, in_time
from softclose.metrics.paired import Comparison, compare
from softclose.propose.dependence import Dependence
from softclose.propose.origins import NSGA2
from softclose.settings import CampaignConfig
from softclose.waveform import Waveform
from softclose_workflows.analyses.certify import Certification
from softclose_workflows.analyses.front import Front
from softclose_workflows.analyses.references import UNSHAPED

BEST = "best candidate"
"""What charts call the best candidate."""


def reference_name(name: str, waveform: Waveform) -> str:
    """What charts call a reference design: `unshaped 100 V step`."""
    return f"unshaped {waveform.pulses[0].volts:g} V step" if name == UNSHAPED else f"{name} design"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Traces:
    """Sampled motion of some switches of an ensemble."""

    rows: NDArray[np.int64]
    """(k,) rows of the ensemble."""
    times_us: FloatArray
    """(n_time,) [µs]."""
    distance_um: FloatArray
    """(k, n_time) distance D - x from the closed position [µm]: 0 is closed."""
    velocity_cm_s: FloatArray
    """(k, n_time) velocity towards the contact [cm/s]."""
    closed: NDArray[np.bool_]
    """(k,) held in contact at the horizon."""
    impact_us: FloatArray
    """(k, n_impact) instants of the impacts [µs], padded with NaN."""
    impact_cm_s: FloatArray
    """(k, n_impact) speeds of the impacts [cm/s], padded with NaN."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Design:
    """One waveform on the training ensemble."""

    name: str
    """What charts call it."""
    role: str
    """Its role in the palette: best, unshaped or deterministic."""
    waveform: Waveform
    speed_cm_s: FloatArray
    """(n,) V of every switch [cm/s]; NaN where it never touched."""
    closed: NDArray[np.bool_]
    """(n,) which count as closed."""
    assessment: Assessment
    response: Response
    """What the switches did."""
    traces: Traces | None = None

    def against(self, other: Design) -> Comparison:
        """This design compared with another one, switch by switch, on the same switches."""
        return compare((self.response, self.assessment), (other.response, other.assessment), self.assessment.confidence)

    @classmethod
    def of(cls, response: Response, assessment: Assessment, **about: Any) -> Design:
        """What switches did, and how that was judged. about: name, role, waveform, and traces where there are any."""
        return cls(
            speed_cm_s=np.asarray(response.max_contact_speed) * CM_S,
            closed=in_time(response, assessment.closed_by_us),
            assessment=assessment,
            response=response,
            **about,
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Candidates:
    """The committed candidates, column by column; NaN where a number is undefined."""

    waveforms: tuple[Waveform | None, ...]
    origin: tuple[str, ...]
    note: tuple[str, ...]
    failed: NDArray[np.bool_]
    n_switches: NDArray[np.int64]
    columns: dict[str, FloatArray]
    """g_cm_s, v_u_cm_s, mean_cm_s, p_nc, … with their intervals, as the store names them; each (n,)."""
    surrogate: dict[str, FloatArray]
    """What the surrogate predicted before each candidate, by name; each (n,)."""

    def __len__(self) -> int:
        return len(self.origin)

    @property
    def ranked(self) -> list[int]:
        """All: the largest ensemble first, since scores on a small one are optimistic; then by rank, without g last."""
        rank = self.columns["rank_cm_s"]
        return sorted(range(len(self)), key=lambda i: (math.isnan(rank[i]), -int(self.n_switches[i]), rank[i]))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReportData:
    """One campaign, finished or growing."""

    source: str
    """Name of the store, without its folder."""
    config: CampaignConfig
    fingerprint: str
    runtime: dict[str, Any]
    """Versions, processor, who and when, as the store recorded them."""
    n_total: int
    """The whole budget."""
    candidates: Candidates
    best: int | None
    """The candidate that this is about: the certified best, else the campaign's own; None where none is usable."""
    parameters: dict[str, FloatArray]
    """D, G [µm], E [GPa], T [µm], K [N/m], M [µg] of the training ensemble, each (n,)."""
    designs: tuple[Design, ...]
    """On the training switches: the best candidate first (if any), then the designs that it is compared with."""
    edges_cm_s: FloatArray
    """Edges of the histograms of V, the same for every candidate [cm/s]."""
    places: tuple[int, ...]
    """The best candidate, then the best of each other place of the search, or places along the front."""
    shares: dict[int, FloatArray]
    """Histogram of V of each of these, in per cent of its ensemble, by index."""
    samples: dict[int, Traces]
    """A few switches of each of these, by index."""
    missing_references: dict[str, str]
    """Reference designs that there is nothing to show of on the training switches, and why."""
    sections: dict[str, Any]
    """What each section of `report/sections` found to show, by its name."""
    front: Front | None
    """None where no candidate has a result."""
    dependence: Dependence | None
    certification: Certification | None
    """What new switches say, if the store has a certification."""
    changes: tuple[str, ...] = ()
    """What was changed by hand, a sentence each."""

    @property
    def shown_parameters(self) -> tuple[str, ...]:
        """The four properties against which V is drawn: E and T of a plate, else what stands in their place."""
        return ("D", "G", "E", "T") if "E" in self.parameters else ("D", "G", "K", "M")

    @property
    def n_committed(self) -> int:
        """Candidates so far."""
        return len(self.candidates)

    @property
    def has_intervals(self) -> bool:
        """False for quasi-random ensembles, for which no interval holds."""
        return self.config.population.sampling != "sobol"

    @property
    def is_front(self) -> bool:
        """Whether the campaign searches for a front and not for one waveform."""
        return self.config.optimiser.engine == NSGA2

    @property
    def finished(self) -> bool:
        """True where the whole budget is committed."""
        return self.n_committed >= self.n_total

    @property
    def best_design(self) -> Design | None:
        """The best candidate on the training switches."""
        return self.designs[0] if self.best is not None else None

    @property
    def judged_missing(self) -> Mapping[str, str]:
        """Reference designs that are missing where designs are judged, and why."""
        return self.missing_references if self.certification is None else self.certification.missing

    @property
    def judged_designs(self) -> tuple[Design, ...]:
        """The same designs where they are best judged: on new switches where there are any."""
        c = self.certification
        if c is None:
            return self.designs
        best = c.best if self.best is None else next((d for d in c.candidates if d.candidate == self.best), c.best)
        return tuple(
            Design.of(
                d.response,
                d.assessment,
                name=BEST if d is best else reference_name(d.name, d.waveform),
                role="best" if d is best else d.name,
                waveform=d.waveform,
            )
            for d in (best, *reversed(c.references))
        )
