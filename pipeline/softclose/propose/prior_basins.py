"""Owns the basins of a prior: descents on the cheap model before a campaign's first candidate, and where they end.

A pure function of the configuration. The descents are those of `explore`; only what they are told is the prior's.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property, partial

import numpy as np

from softclose.arrays import FloatArray
from softclose.propose.asked_ahead import AskedAhead
from softclose.propose.basins import distinct_basins
from softclose.propose.descents import Descent
from softclose.propose.plan import plan
from softclose.propose.prior import Prior, prior_config
from softclose.propose.promises import Ask, Basins, PriorValues
from softclose.propose.proposer import Proposer
from softclose.propose.protocol import Observation, Problem, Proposal, Wave
from softclose.propose.stretches import Asking
from softclose.settings import CampaignConfig
from softclose.waveform import Waveform


def find_basins(config: CampaignConfig, ask: Ask | Asking) -> Basins:
    """Descend on the campaign's prior, and keep the best basins: `optimiser.n_regions` of them at most.

    Whoever can be asked without waiting is asked ahead (`AskedAhead`).
    """
    problem = Problem(prior_config(config))
    proposer, history, failure = Proposer(problem), list[Observation](), ""
    ahead = AskedAhead(problem, ask) if isinstance(ask, Asking) else None
    for wave in plan(problem):
        proposals = proposer.from_history(wave, history)
        records = partial(_records, wave)
        if ahead is not None:
            told, failed = ahead.wave(wave, proposals, history, records)
        else:
            assert callable(ask)
            found = ask([p.waveform for p in proposals], wave.n_switches)
            told, failed = records(0, proposals, found), found.failure
        history += told
        failure = failure or failed
        if wave.index == 0 and not any(o.usable for o in history):
            break  # not one of the design's points has an answer: no other will
    most = max((o.n_switches for o in history if o.usable), default=0)
    judged = [o for o in history if o.n_switches == most]
    best = distinct_basins(problem, judged, config.optimiser.n_regions, config.finish.distance)
    dim = problem.space.dim
    return Basins(
        waveforms=tuple(o.waveform for o in best),
        g_cm_s=np.array([o.g_cm_s for o in best]),
        shapes=np.array([_shape(problem, o.waveform) for o in best]).reshape(-1, dim, dim),
        n_tried=len(history),
        failure="" if best else failure or "no waveform has a value on the prior",
    )


def _records(wave: Wave, first: int, proposals: Sequence[Proposal], found: PriorValues) -> list[Observation]:
    """What is told of the proposals of a wave from place `first` on."""
    return [
        _told(wave.start + first + i, wave.index, p.waveform, p.origin, wave.n_switches, float(g))
        for i, (p, g) in enumerate(zip(proposals, found.g_cm_s, strict=True))
    ]


def _shape(problem: Problem, basin: Waveform) -> FloatArray:
    """That of the descent that ended nearest to a basin."""
    point = problem.space.unit(basin, clip=True)
    runs: list[Descent] = list(problem.descents.values())
    nearest = min(runs, key=lambda run: float(((run.mean - point) ** 2).sum()), default=None)
    return np.eye(problem.space.dim) if nearest is None else nearest.shape


def _told(index: int, wave: int, waveform: Waveform, origin: str, n_switches: int, g_cm_s: float) -> Observation:
    return Observation(
        index=index,
        wave=wave,
        waveform=waveform,
        origin=origin,
        n_switches=n_switches,
        g_cm_s=g_cm_s,
        rank_cm_s=g_cm_s,
        g_se_cm_s=np.nan,
        v_u_cm_s=np.nan,
        mean_cm_s=np.nan,
        p_nc=np.nan,
        p_contact=np.nan,
        failed=not np.isfinite(g_cm_s),
    )


class InProcess:
    """The prior of a campaign, found and asked in this process."""

    def __init__(self, config: CampaignConfig) -> None:
        self._config = config

    @cached_property
    def _prior(self) -> Prior:
        return Prior.of(self._config)

    def basins(self) -> Basins:
        """Found anew."""
        return find_basins(self._config, self.values)

    def values(self, waveforms: Sequence[Waveform], n_switches: int | None = None) -> PriorValues:
        """g of each waveform."""
        return self._prior.values(waveforms, n_switches)
