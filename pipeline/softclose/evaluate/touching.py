"""Owns when the switches of a lot first touch and how often: what every table of designs says beside speeds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

from softclose.evaluate.asked import value_of
from softclose.evaluate.quantities import Closing, Value, quantity
from softclose.metrics.objective import Assessment, Response
from softclose.plugins import MEASURED
from softclose.settings import CampaignConfig

CONTACTS = ("contact_time", "impacts")
"""The quantities."""


def contacts(config: CampaignConfig, response: Response, a: Assessment, *, fresh: bool = False) -> dict[str, Value]:
    """Instant of the first contact and number of impacts, of the switches that touch.

    Parameters
    ----------
    config : CampaignConfig
        The campaign's.
    response : Response
        What switches did.
    a : Assessment
        How it was judged.
    fresh : bool
        They are independent random draws, whatever the campaign trains on, so that intervals hold.

    Returns
    -------
    dict of str to Value
        By `CONTACTS`: what the level-quantile of the switches has at most. {} where the response does not tell them,
        as of devices of which only speeds are read.
    """
    known = (getattr(response, name, None) is not None for name in ("first_contact_us", "n_impacts"))
    if config.model.name == MEASURED or not all(known):
        return {}
    sampling = "monte-carlo" if fresh else config.population.sampling
    closing = cast(Closing, _Alone(response=response))
    return {name: value_of(q, q.values(closing), a, sampling) for name in CONTACTS for q in [quantity(name)]}


@dataclass(frozen=True, slots=True, kw_only=True)
class _Alone:
    """All that these quantities look at of a closing."""

    response: Any
