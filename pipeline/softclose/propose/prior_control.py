"""Owns the prior as control variate: what it says of a candidate's own switches, and of many more of the same lot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softclose.conditions.streams import Ensemble
from softclose.device.protocol import is_own_word
from softclose.evaluate import draw, respond
from softclose.metrics.control import Control
from softclose.population.lot import Lot
from softclose.propose.prior import prior_config
from softclose.propose.promises import PriorError
from softclose.settings import CampaignConfig
from softclose.waveform import Drive


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PriorControl:
    """The cheap model on the switches of a campaign and on many more, ready to be asked."""

    cheap: CampaignConfig
    """The prior's configuration."""
    own: Lot
    """The campaign's ensemble, of which candidates have the first switches."""
    many: Lot
    """Further switches: Sobol points of the same lot."""

    @classmethod
    def of(cls, config: CampaignConfig, own: Lot) -> PriorControl:
        """That of a campaign; own: its ensemble."""
        seed = config.campaign.seed
        many = draw(config, config.prior.control, seed=seed, sampling="sobol", ensemble=Ensemble.CONTROL)
        return cls(cheap=prior_config(config), own=own, many=many)

    def under(self, drive: Drive, n_switches: int, *, for_everybody: bool = False) -> Control | None:
        """What the cheap model says of the first `n_switches` and of the many; None where it has no answer.

        for_everybody: no drive is tailored to its switch, as under reference designs. Raises PriorError for whatever
        the model raises that is no deterministic failure.
        """
        try:
            same, many = (
                respond(self.cheap, lot, drive, for_everybody=for_everybody, dtype=np.float32)
                for lot in (self.own.rows(slice(n_switches)), self.many)
            )
        except Exception as e:
            if is_own_word(e):
                return None
            raise PriorError(f"the prior could not be evaluated ({type(e).__name__}: {e})") from e
        return Control(same=same, many=many)
