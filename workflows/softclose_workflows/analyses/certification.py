"""Owns what a certification is: designs on new switches beside the campaign's own scores of them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

from softclose.evaluate import judge
from softclose.evaluate.asked import told
from softclose.evaluate.gathered import put_judged_aside
from softclose.evaluate.quantities import Value
from softclose.evaluate.touching import contacts
from softclose.metrics.objective import Assessment, Judged
from softclose.metrics.paired import Comparison, compare
from softclose.opening import Openings
from softclose.settings import CampaignConfig
from softclose.waveform import Waveform
from softclose_store import Campaign
from softclose_workflows.analyses.drive_off import DriveOff
from softclose_workflows.run.executors.placement import n_cores

AT_ONCE = 4
"""Designs that are assessed at the same time, at most: of a million switches each takes some 100 MB meanwhile."""


class CertifyError(ValueError):
    """A certification that cannot be made."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Training:
    """The campaign's own scores of a candidate."""

    g_cm_s: float
    """Objective on the training ensemble [cm/s]."""
    v_u_cm_s: float
    """Upper velocity there [cm/s]."""
    p_nc: float
    """Fraction not closed there."""
    n_switches: int
    """Size of that ensemble."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Certified:
    """One waveform on the new switches."""

    name: str
    """`candidate 17`, `unshaped`, `deterministic`, …"""
    candidate: int | None
    """Its index in the campaign; None for a reference design."""
    waveform: Waveform
    """What was applied."""
    response: Judged
    """V, closed and status of every new switch."""
    assessment: Assessment
    """Eqs. 7-11 on them."""
    training: Training | None
    """The campaign's own scores; None for a reference design."""
    values: Mapping[str, Value] = field(default_factory=dict)
    """Further quantities that the campaign asks for."""
    contacts: Mapping[str, Value] = field(default_factory=dict)
    """When the switches first touch, and how often they hit; {} where nobody has told."""

    @property
    def optimism_cm_s(self) -> float:
        """Certified g minus training g [cm/s]: the optimism of the training score. NaN for a reference."""
        return math.nan if self.training is None else self.assessment.g_cm_s - self.training.g_cm_s


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """All that a certification follows from, beside the campaign itself: kept in the attributes of its group."""

    n_switches: int
    """New switches."""
    seed: int
    """Seed of their stream."""
    top: int
    """Distinct candidates that were asked for."""
    committed: int
    """Candidates that the campaign had committed."""
    incumbent: int
    """Candidate that the campaign itself calls best."""
    candidates: tuple[int, ...]
    """Certified candidates, in the order of the campaign."""
    missing: Mapping[str, str]
    """Reference designs that do not exist for this campaign, and why."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Certification:
    """The certified designs of one campaign."""

    request: Request
    """What was asked."""
    candidates: tuple[Certified, ...]
    """Certified candidates, best first."""
    references: tuple[Certified, ...]
    """Reference designs on the same switches."""
    openings: Openings | None = None
    """How the best candidate opens, on the same switches; None where the campaign designs no opening."""
    drive_off: tuple[DriveOff, ...] = ()
    """The best candidate where the drive is too weak or too strong; () where nobody has told."""

    @property
    def is_whole(self) -> bool:
        """Whether everything is known that is certified today; older versions wrote less."""
        return bool(self.drive_off and self.best.contacts)

    @property
    def n_switches(self) -> int:
        """New switches."""
        return self.request.n_switches

    @property
    def seed(self) -> int:
        """Seed of their stream."""
        return self.request.seed

    @property
    def committed(self) -> int:
        """Candidates that the campaign had committed."""
        return self.request.committed

    @property
    def incumbent(self) -> int:
        """Candidate that the campaign itself calls best."""
        return self.request.incumbent

    @property
    def missing(self) -> Mapping[str, str]:
        """Reference designs that do not exist for this campaign, and why."""
        return self.request.missing

    @property
    def best(self) -> Certified:
        """The best certified candidate."""
        return self.candidates[0]

    def comparison(self, reference: Certified) -> Comparison:
        """The best candidate against another design, switch by switch."""
        best = self.best
        return compare(
            (best.response, best.assessment), (reference.response, reference.assessment), best.assessment.confidence
        )


def assess_fresh(response: Judged, config: CampaignConfig) -> Assessment:
    """The campaign's own objective, on independent random draws."""
    return judge(config, response, fresh=True)


def assemble(
    campaign: Campaign,
    config: CampaignConfig,
    waveforms: Mapping[str, Waveform],
    responses: Mapping[str, Judged],
    request: Request,
) -> Certification:
    """The certification of waveforms, by name, from their responses; candidates come out best first."""
    table = campaign.records()

    def certified(name: str) -> Certified:
        i, response = candidate_of(name), responses[name]
        training = None
        if i is not None:
            training = Training(
                g_cm_s=float(table["g_cm_s"][i]),
                v_u_cm_s=float(table["v_u_cm_s"][i]),
                p_nc=float(table["p_nc"][i]),
                n_switches=int(table["n_switches"][i]),
            )
        assessment = assess_fresh(response, config)
        found = Certified(
            name=name,
            candidate=i,
            waveform=waveforms[name],
            response=response,
            assessment=assessment,
            training=training,
            values=told(config, response, assessment, fresh=True),
            contacts=contacts(config, response, assessment, fresh=True),
        )
        put_judged_aside(response)
        return found

    with ThreadPoolExecutor(min(AT_ONCE, n_cores())) as pool:  # sorting a million values holds no lock
        designs = list(pool.map(certified, waveforms))
    candidates = [design for design in designs if design.candidate is not None]
    references = [design for design in designs if design.candidate is None]
    # Ties stay in the order of the campaign, so that the order depends on nothing but the candidates.
    candidates.sort(key=lambda d: (d.assessment.rank_cm_s, d.candidate))
    return Certification(request=request, candidates=tuple(candidates), references=tuple(references))


def candidate_name(i: int) -> str:
    """What candidate i is called among the designs."""
    return f"candidate {i}"


def candidate_of(name: str) -> int | None:
    """The inverse of `candidate_name`; None for a reference design."""
    kind, _, number = name.partition(" ")
    return int(number) if kind == "candidate" else None
