"""Owns the records of a campaign whose prior is a control variate: whether that pays, by the candidates of its first
wave, and the figures of every candidate with it where it does.

A pure function of the configuration and of what the first wave's switches did: a resume and a repair find the same.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softclose.evaluate import judge
from softclose.evaluate.judging import judge_with
from softclose.metrics.control import gain, pays
from softclose.metrics.objective import Assessment, Response
from softclose.population.lot import Lot
from softclose.propose.plan import plan
from softclose.propose.prior_control import PriorControl
from softclose.propose.promises import PriorError
from softclose.propose.protocol import Problem
from softclose.settings import CampaignConfig
from softclose.waveform import Drive
from softclose_store import Campaign
from softclose_workflows.errors import Stopped

GAIN = "control_gain"
"""Name of a field of the records."""
GAIN_IN_WORDS = "standard error of g with the prior as control variate over that without; NaN: not tried"

Answered = tuple[Drive, Response]
"""A candidate's waveform, and what its switches did."""


@dataclass(slots=True, eq=False)
class Controlling:
    """Who judges the candidates of a campaign by its prior too."""

    control: PriorControl
    campaign: CampaignConfig
    is_used: bool | None = None
    """Whether it pays; None: not known before the first wave is back."""

    def decide(self, first_wave: Sequence[Answered]) -> None:
        """See by the candidates of the first wave whether it pays."""
        self.decide_by([self._tried(*told)[1] for told in first_wave])

    def decide_by(self, gains: Sequence[float]) -> None:
        """The same by what is stored of them."""
        self.is_used = pays(gains)

    def judged(
        self, drive: Drive, response: Response, *, is_first: bool = False, for_everybody: bool = False
    ) -> tuple[Assessment, float]:
        """The assessment that counts, and the gain where it was tried: always in the first wave.

        for_everybody: the drive is a reference design.
        """
        if not (self.is_used or is_first):
            return judge(self.campaign, response), math.nan
        with_control, gained = self._tried(drive, response, for_everybody=for_everybody)
        return (with_control if self.is_used else judge(self.campaign, response)), gained

    def _tried(self, drive: Drive, response: Response, *, for_everybody: bool = False) -> tuple[Assessment, float]:
        plain = judge(self.campaign, response)
        control = self.control.under(drive, np.size(response.closed), for_everybody=for_everybody)
        if control is None:
            return plain, math.nan
        found = judge_with(self.campaign, response, control)
        return found, gain(plain, found)


def controlling_of(config: CampaignConfig, own: Lot, stored: Mapping[str, NDArray[Any]]) -> Controlling | None:
    """That of a campaign; None where it has none.

    own: its ensemble; stored: the records that it has, by which it has decided where the first wave is among them.
    """
    if not config.prior.control:
        return None
    found = Controlling(control=PriorControl.of(config, own), campaign=config)
    if len(stored[GAIN]):
        found.decide_by(stored[GAIN][: first_wave(config)].tolist())
    return found


def first_wave(config: CampaignConfig) -> int:
    """Candidates of the first wave."""
    return plan(Problem(config))[0].size


def judge_as(campaign: Campaign, drive: Drive, response: Response, *, for_everybody: bool = False) -> Assessment:
    """The assessment of a response of a stored campaign's switches by what its candidates are judged by.

    for_everybody: the drive is a reference design. Raises Stopped where the prior cannot be asked.
    """
    config = CampaignConfig.from_dict(campaign.config)
    controlling = controlling_of(config, Lot(campaign.population()), campaign.records())
    if controlling is None:
        return judge(config, response)
    try:
        return controlling.judged(drive, response, for_everybody=for_everybody)[0]
    except PriorError as e:
        raise Stopped(str(e)) from e
