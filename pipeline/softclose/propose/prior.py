"""Owns the prior: a cheap model of a campaign's lot on few switches, and g of waveforms on it.

Kennedy and O'Hagan (2000): a cheap code says most of what a costly one would, and a process learns the rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from softclose.conditions.streams import Ensemble
from softclose.device.protocol import is_own_word
from softclose.evaluate import draw, respond
from softclose.evaluate.judging import judge
from softclose.evaluate.scoring import objective_settings
from softclose.metrics.ranking import is_beyond
from softclose.metrics.value import objective_value
from softclose.plugins import REDUCED_ORDER, SINGLE_MODE
from softclose.population.lot import Lot
from softclose.propose.promises import PriorError, PriorValues
from softclose.settings import CampaignConfig
from softclose.settings.prior import NO_PRIOR
from softclose.waveform import Waveform

NOT_OF_G = ("limits_cm_s", "sampling", "max_open", "warn_open")
"""Settings of an assessment that its g does not depend on."""

BEYOND = 2.0
"""What a lot counts as that leaves too many open, in those of one that hardly touches: bounded, so that a process can
learn beside it."""

N_BASINS = 8
"""Basins that are tried again on all of the prior's switches."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prior:
    """The cheap model, ready to be asked."""

    config: CampaignConfig
    """Its configuration: the campaign's, but for the model, what is left out, and the switches."""
    lot: Lot
    """Its switches."""

    @classmethod
    def of(cls, config: CampaignConfig) -> Prior:
        """The prior of a campaign; the same every time."""
        cheap = prior_config(config)
        n = cheap.n_switches_max
        lot = draw(cheap, n, seed=config.campaign.seed, sampling="sobol", ensemble=Ensemble.PRIOR)
        return cls(config=cheap, lot=lot)

    def values(self, waveforms: Sequence[Waveform], n_switches: int | None = None) -> PriorValues:
        """g of each waveform, on the first `n_switches` or all of the prior's.

        A deterministic failure of the model makes it NaN. Raises PriorError for whatever else the model raises.
        """
        g = np.full(len(waveforms), np.nan)
        objective = self.config.objective
        settings = {name: v for name, v in objective_settings(self.config).items() if name not in NOT_OF_G}
        most = self.config.waveform.max_volts
        lot, failure = self.lot.rows(slice(n_switches)), ""
        for i, waveform in enumerate(waveforms):
            try:
                # float32 is what is kept of x and v, of which there is nothing here: the kernel of the blocks serves.
                response = respond(self.config, lot, waveform, max_volts=most, dtype=np.float32)
            except Exception as e:
                if not is_own_word(e):
                    raise PriorError(f"the prior could not be evaluated ({type(e).__name__}: {e})") from e
                failure = failure or f"{type(e).__name__}: {e}"
                continue
            if objective.weights or objective.quantity_limits:
                whole = judge(self.config, response)
                g[i], p_nc, beyond = whole.g_cm_s, whole.p_nc, bool(is_beyond(whole.rank_cm_s))
            else:
                g[i], p_nc = objective_value(response, **settings)
                beyond = p_nc > objective.max_open
            if beyond and np.isfinite(g[i]):
                g[i] = max(g[i], BEYOND * objective.undefined_v_u_cm_s) * (1.0 + p_nc)
            if not np.isfinite(g[i]):
                failure = failure or "too many switches could not be integrated"
        return PriorValues(g_cm_s=g, failure=failure)


def prior_config(config: CampaignConfig) -> CampaignConfig:
    """The campaign that the prior would be: descents on few switches of the cheap model, and nothing else.

    Which device is told from which lot stays the campaign's; of losses and conditions it has those that
    `prior.includes` names.
    """
    p = config.prior
    model = replace(config.model, name=p.model)
    if p.model != REDUCED_ORDER:
        model = replace(model, modes="")
    if "losses" not in p.includes or p.model not in (SINGLE_MODE, REDUCED_ORDER):
        model = replace(model, quality_factor=0.0, film_viscosity_uPa_s=0.0, adhesion_uN=0.0)
    left_out = {
        name: type(getattr(config, name))() for name in ("amplifier", "temperature", "trim") if name not in p.includes
    }
    return replace(
        config,
        campaign=replace(config.campaign, budget=0, extensions=()),
        population=replace(config.population, n_switches=min(p.n_exploring, p.n_switches), sampling="sobol"),
        model=model,
        reduced_order_model=config.reduced_order_model if p.model == REDUCED_ORDER else {},
        waveform=replace(config.waveform, initial=()),
        opening=type(config.opening)(),
        prior=replace(p, model=NO_PRIOR, control=0),
        explore=replace(config.explore, budget=p.budget, n_descents=p.n_descents, rounds=p.rounds, turns=1),
        finish=replace(
            config.finish,
            budget=p.polish,
            n_switches=p.n_switches,
            n_basins=min(N_BASINS, p.polish or 1),
            n_polished=2,
            method="cmaes",
            grows=False,
        ),
        **left_out,
    )
