"""Owns what a campaign costs beyond its candidates, and how long a switch takes: for a forecast."""

from __future__ import annotations

import time
from collections.abc import Callable

from softclose.evaluate import draw
from softclose.propose.led import looks_of
from softclose.propose.plan import SEARCH, plan
from softclose.propose.prior import Prior, prior_config
from softclose.propose.protocol import Problem
from softclose.settings import CampaignConfig
from softclose.waveform import Waveform
from softclose_workflows.run.tasks import compute_block, rows_of

LEAST_S, MOST_SWITCHES = 0.2, 2048
"""A switch is timed on twice as many switches again, until they take so long [s], or are so many: a simulator that
takes a second a switch is asked for three."""


def prior_trajectories(config: CampaignConfig) -> int:
    """Trajectories on the prior, in every case that it has: those of its descents, what the process looks at, and those
    of a control variate; 0 without one."""
    if not config.has_prior:
        return 0
    cheap = prior_config(config)
    led = sum(w.size for w in plan(Problem(config)) if w.stage == SEARCH and w.index > 0)
    of_descents = sum(w.size * w.n_switches for w in plan(Problem(cheap)))
    of_looks = led * looks_of(config) * config.prior.n_switches
    control = config.prior.control
    of_control = sum(w.size * (w.n_switches + control) for w in plan(Problem(config))) if control else 0
    return cheap.n_cases * (of_descents + of_looks + of_control)


def switch_s(config: CampaignConfig, waveform: Waveform) -> float:
    """Time of one trajectory [s], sampled as the campaign stores it. Raises whatever the device model raises."""
    lot = draw(config, min(MOST_SWITCHES, config.n_switches_max), seed=config.campaign.seed)
    one = time_of_one(lambda n: compute_block(config, lot.rows(slice(n)), (rows_of(waveform),)), len(lot))
    return one / config.n_cases


def prior_switch_s(config: CampaignConfig, waveform: Waveform) -> float:
    """The same on the prior [s]; 0 without one."""
    if not config.has_prior:
        return 0.0
    prior = Prior.of(config)
    return time_of_one(lambda n: prior.values([waveform], n), len(prior.lot)) / prior.config.n_cases


def time_of_one(simulate: Callable[[int], object], most: int) -> float:
    """Time of one switch [s]; what is compiled or loaded by the first call does not count."""
    simulate(1)
    n = min(2, most)
    while True:
        began = time.perf_counter()
        simulate(n)
        took = time.perf_counter() - began
        if took >= LEAST_S or n >= most:
            return took / n
        n = min(2 * n, most)
