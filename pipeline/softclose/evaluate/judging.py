"""Owns judging: a response and the campaign's objective make an assessment (Eqs. 7-11, and what else is weighed)."""

from __future__ import annotations

import math

from numpy.typing import ArrayLike

from softclose.evaluate.asked import weighed
from softclose.evaluate.respond import respond
from softclose.evaluate.scoring import score
from softclose.metrics.control import Control
from softclose.metrics.objective import Assessment, Response
from softclose.population.lot import Lot
from softclose.settings import CampaignConfig
from softclose.waveform import Drive


def judge(config: CampaignConfig, response: Response, *, fresh: bool = False) -> Assessment:
    """Eqs. 7-11 of a response with the campaign's objective.

    Parameters
    ----------
    config : CampaignConfig
        The objective, and how the campaign samples its training ensemble.
    response : Response
        What switches did.
    fresh : bool
        They are independent random draws, whatever the campaign trains on, so that intervals hold.

    Returns
    -------
    Assessment

    Raises
    ------
    QuantityError
        Where the campaign weighs or limits a quantity that the response does not tell.
    """
    return weighed(config, response, score(config, response, fresh=fresh), fresh=fresh)


def judge_with(config: CampaignConfig, response: Response, control: Control) -> Assessment:
    """The same of a campaign's own switches, with what a cheap model says of them as control variate."""
    return weighed(config, response, score(config, response, fresh=False, control=control), control=control)


def evaluate(
    config: CampaignConfig,
    lot: Lot | ArrayLike,
    waveform: Drive,
    *,
    max_volts: float = math.inf,
    fresh: bool = False,
) -> Assessment:
    """Assess one waveform on a lot; see `respond` and `judge`."""
    return judge(config, respond(config, lot, waveform, max_volts=max_volts), fresh=fresh)
