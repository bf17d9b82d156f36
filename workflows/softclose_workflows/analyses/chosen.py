"""Owns which waveform of a store a later question is about: the best certified one, the best one, or one asked for."""

from __future__ import annotations

from dataclasses import dataclass

from softclose.settings import CampaignConfig
from softclose.waveform import Waveform
from softclose_store import open_campaign
from softclose_workflows.analyses.certify import CertifyError, read_certification
from softclose_workflows.tell.standing import stored_open_warning


@dataclass(frozen=True, slots=True, kw_only=True)
class Chosen:
    """A waveform of a store."""

    config: CampaignConfig
    """The campaign's configuration."""
    candidate: int
    """The candidate that it is."""
    waveform: Waveform
    """The waveform."""
    why: str
    """`best certified`, `best` or `asked for`."""
    seed: int
    """Seed of the new switches to ask it on: the certification's, where there is one."""
    warning: str
    """Where it leaves more than objective.warn_open of the switches open, certified where it is; else ""."""


def choose(path: str, candidate: int | None = None) -> Chosen:
    """The waveform to ask about. Raises CertifyError where the campaign has no usable candidate yet."""
    campaign = open_campaign(path)
    config = CampaignConfig.from_dict(campaign.config)
    certification = read_certification(path)
    seed = config.campaign.seed if certification is None else certification.seed
    why = "asked for"
    if candidate is None and certification is not None:
        candidate, why = certification.best.candidate, "best certified"
    if candidate is None:
        best = campaign.best()
        if best is None:
            raise CertifyError(f"{path} has no usable candidate yet: let the campaign run first")
        candidate, why = best.candidate, "best"
    waveform = Waveform.from_rows(campaign.waveform(candidate))
    certified = () if certification is None else certification.candidates
    p_nc = [d.assessment.p_nc for d in certified if d.candidate == candidate]
    warning = stored_open_warning(campaign.config, *p_nc[:1] or [float(campaign.records()["p_nc"][candidate])])
    return Chosen(config=config, candidate=candidate, waveform=waveform, why=why, seed=seed, warning=warning)
