"""Claims about the presets: every interval of every candidate of every one of them holds."""

from __future__ import annotations

import math

import numpy as np
import pytest

from softclose.baselines import deterministic_design, unshaped
from softclose.evaluate import draw, evaluate
from softclose.metrics.objective import Assessment
from softclose.presets import preset_names
from softclose.settings import CampaignConfig, load_config

PUBLISHED = {name for name in preset_names() if name.endswith("-paper")} | {"current-direct"}
"""Procedures as published, on independent draws."""


def _intervals(a: Assessment) -> list[tuple[float, float]]:
    p = [a.p_nc_intervals, *(e.probability for e in a.p_exceed)]
    proportions = [ends for each in p for ends in (each.wald, each.wilson, each.clopper_pearson)]
    excess = [e.excess_interval for e in a.p_exceed]
    return [a.g_interval, a.v_u_interval, a.mean_interval, a.cvar_interval, a.closing_interval, *excess, *proportions]


def _judged(config: CampaignConfig, n: int) -> Assessment:
    """The step that closes every switch, on the first n switches that the campaign trains on."""
    lot = draw(config, n, seed=config.campaign.seed, sampling=config.population.sampling)
    return evaluate(config, lot, unshaped(config.waveform.max_volts))


@pytest.mark.parametrize("name", preset_names())
def test_intervals_of_every_preset_hold_in_every_stage(name: str) -> None:
    """Sampled so that they do (for how often: docs/measurements/coverage.md), and none is missing."""
    config = load_config(name)
    assert config.population.sampling == ("monte-carlo" if name in PUBLISHED else "replicated")
    for n in {min(config.population.n_switches, 256), 40}:  # a part of an ensemble is one of the same kind
        a = _judged(config, n)
        assert a.intervals_valid
        for low, high in _intervals(a):
            assert low <= high
            assert math.isfinite(low)


def test_a_campaign_that_does_not_say_has_intervals() -> None:
    assert load_config("current").population.sampling == "replicated"


@pytest.mark.parametrize("n", [5, 16, 40, 100, 170])
def test_where_scramblings_are_too_small_to_say_intervals_are_those_of_independent_draws(n: int) -> None:
    config = load_config("current")
    lot = draw(config, n, seed=3, sampling="replicated")
    wave = deterministic_design(config.build_population())
    a, plain = (
        evaluate(load_config("current", [f"population.sampling={s}"]), lot, wave) for s in ("replicated", "monte-carlo")
    )
    few = n < 160
    assert (a.v_u_interval == plain.v_u_interval) == few
    assert (a.g_interval == plain.g_interval) == few
    assert np.isfinite(a.g_se_cm_s)
