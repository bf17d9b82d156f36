"""Claims about proposals that a prior leads, each part by itself: basins first, what is known, a search, what fails."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from bowl import observation
from softclose.propose import led
from softclose.propose.led import GENERATION, PRIOR_G, _collect, _Search, looks_of, propose_led
from softclose.propose.promises import Basins, PriorValues
from softclose.propose.protocol import Problem, Wave
from softclose.settings import load_config

MIDDLES = np.array([[0.3] * 6, [0.5, 0.7, 0.5, 0.5, 0.4, 0.6], [0.7] * 6])


class Told:
    """A prior whose g is 10 cm/s and what the first coordinate is, in cm/s; it has no answer above 0.9."""

    def __init__(self, problem):
        self.space = problem.space
        self.asked = 0

    def values(self, waveforms, n_switches=None):
        self.asked += len(waveforms)
        first = self.space.coordinates_of_all(waveforms)[0][:, 0]
        return PriorValues(g_cm_s=np.where(first < 0.9, 10.0 + first, np.nan))


def problem_of(**changed):
    said = {
        "campaign": {"seed": 5, "budget": 40},
        "population": {"n_switches": 50},
        "waveform": {"space": "two-pulse-full"} | changed.pop("waveform", {}),
        "optimiser": {"n_regions": 3, "batch": 3, "rounds": 1},
        "prior": {"n_switches": 32, "n_exploring": 16, "budget": 120, "n_descents": 2, "polish": 20, "looks": 24},
    }
    config = load_config(said | changed)
    problem = Problem(config)
    return Problem(config, help=Told(problem))


def basins_of(problem):
    shapes = np.array([np.eye(6), np.diag([2.0, 0.5, 1.0, 1.0, 1.0, 1.0]), np.eye(6)])
    waveforms = tuple(problem.space.waveform(x) for x in MIDDLES)
    return Basins(waveforms=waveforms, g_cm_s=np.array([11.0, 12.0, math.nan]), shapes=shapes, n_tried=140)


def wave_of(start, size):
    return Wave(index=1, stage="search", start=start, size=size, n_switches=50, sees=1)


def known_at(problem, points, **others):
    """Evaluated candidates at these points, the first the worst."""
    return [observation(i, problem.space.waveform(x), 30.0 - i, **others) for i, x in enumerate(np.atleast_2d(points))]


@pytest.mark.parametrize("initial", [0, 1])
def test_the_basins_come_first_in_their_order_and_then_points_around_them(initial):
    """The user's own waveforms stand before them."""
    own = [[[0.0, 4.0, 4.0, 150.0], [16.0, 4.0, math.inf, 90.0]]]
    problem = problem_of(waveform={"initial": own} if initial else {})
    basins = basins_of(problem)
    found = propose_led(problem, basins, wave_of(initial + 1, 7), [], [])
    assert {p.origin for p in found} == {"prior-basin"}
    assert {p.n_switches for p in found} == {50}
    assert [p.surrogate["region"] for p in found] == [1, 2, 0, 1, 2, 0, 1]
    assert [p.waveform for p in found[:2]] == list(basins.waveforms[1:])
    points = problem.space.coordinates_of_all([p.waveform for p in found])[0]
    away = points[2:] - MIDDLES[[0, 1, 2, 0, 1]]
    assert (np.abs(away).max(axis=1) > 1e-4).all()
    assert (np.abs(away) < 0.1).all()
    assert [PRIOR_G in p.surrogate for p in found] == [True, False, True, True, True, True, True]
    assert found[0].surrogate[PRIOR_G] == found[0].surrogate["predicted_g_cm_s"] == 12.0
    np.testing.assert_allclose([p.surrogate[PRIOR_G] for p in found[2:]], 10.0 + points[2:, 0])
    assert problem._asked.asked == 5, "what a basin promises is known"


def test_what_is_known_is_of_the_nearest_basin_and_the_prior_is_asked_where_nobody_said():
    problem = problem_of()
    basins = basins_of(problem)
    at = [*(MIDDLES + 0.02), MIDDLES[0] - 0.02, [0.95, 0.5, 0.5, 0.5, 0.5, 0.5], MIDDLES[2]]
    history = known_at(problem, at)
    history[3] = replace(history[3], beliefs={PRIOR_G: 13.0, "region": 2.0})
    history[5] = replace(history[5], failed=True, g_cm_s=math.nan, rank_cm_s=math.nan)
    known, numbers, places = _collect(problem, basins, history)
    assert places == [0, 1, 2, 3], "neither what failed nor what the prior has no answer to"
    assert numbers == [0, 1, 2, 2]
    np.testing.assert_allclose(known.points, at[:4], atol=1e-9)
    np.testing.assert_allclose(known.prior_g_cm_s, [10.0 + at[0][0], 10.0 + at[1][0], 10.0 + at[2][0], 13.0])
    assert list(np.argsort(known.g_cm_s)) == [3, 2, 1, 0]
    assert len(known.inputs) == 4
    nothing, numbers, places = _collect(problem, basins, [])
    assert (len(nothing.points), len(nothing.inputs), numbers, places) == (0, 0, [], [])


def test_whole_generations_are_looked_at_and_one_at_least():
    for looks, said in ((24, 24), (120, 120), (100, 96), (12, 12)):
        assert looks_of(replaced_looks(looks)) == said


def replaced_looks(looks):
    config = problem_of().config
    return replace(config, prior=replace(config.prior, looks=looks))


def test_a_search_goes_downhill_from_its_incumbent_within_reach():
    """The process says what the prior says; its least is at 0.6 in every coordinate, half a length away."""
    problem, asked = problem_of(), []

    def screened(points, g):
        return SimpleNamespace(bound=lambda width: g - width, join=lambda other: asked.append(other))

    region, correction = SimpleNamespace(length=0.4), SimpleNamespace(screen=screened)
    search = _Search(problem, region, correction, np.eye(6), np.full(6, 0.45), 1.0, np.random.default_rng(1))
    generations = []
    for _ in range(40):
        points = search.ask()
        assert points.shape == (GENERATION, 6)
        generations.append(points)
        search.tell(200.0 * ((points - 0.6) ** 2).sum(axis=1))
    every = np.array(generations)
    assert np.abs(every[0].mean(axis=0) - 0.45).max() < 0.12, "it begins around the incumbent"
    assert 0.03 < every[0].std(axis=0).mean() < 0.25
    assert (np.abs(every - 0.45) <= 0.4 + 1e-9).all(), "no farther than a length"
    assert np.abs(every[-1].mean(axis=0) - 0.6).max() < 0.02
    assert len(asked) == 39, "all looks are kept, those of later generations beside the first"


def test_a_search_keeps_to_the_cube():
    problem = problem_of()
    region = SimpleNamespace(length=1.0)
    search = _Search(problem, region, None, np.eye(6), np.full(6, 0.98), 1.0, np.random.default_rng(1))
    points = search.ask()
    assert points.min() >= 0.0
    assert points.max() <= 1.0
    assert np.ptp(points, axis=0).max() > 0.1


def test_a_process_that_fails_is_said_and_the_best_of_all_is_stepped_away_from(monkeypatch):
    def fails(*_):
        raise np.linalg.LinAlgError("not positive " + 300 * "!")

    problem = problem_of()
    monkeypatch.setattr(led, "_search", fails)
    history = known_at(problem, MIDDLES)
    found = propose_led(problem, basins_of(problem), wave_of(3, 5), history, [])
    assert len(found) == 5
    assert {p.origin for p in found} == {"fallback"}
    assert found[0].note.startswith("process failed (LinAlgError: not positive")
    assert len(found[0].note) == 200
    away = problem.space.coordinates_of_all([p.waveform for p in found])[0] - MIDDLES[2]
    assert 0.0 < np.abs(away).max() < 0.06


def test_what_is_in_flight_counts_in_the_region_that_it_is_in(monkeypatch):
    """Beside which of the evaluated candidates it is decides."""
    problem, seen = problem_of(), []
    real = led.shares
    monkeypatch.setattr(led, "shares", lambda *a, **k: seen.append(k) or real(*a, **k))
    monkeypatch.setattr(led, "_search", lambda *a: [])
    flying = [problem.space.waveform(x) for x in (MIDDLES[1] + 0.03, MIDDLES[2] - 0.04, MIDDLES[0] - 0.05)]
    propose_led(problem, basins_of(problem), wave_of(3, 3), known_at(problem, MIDDLES), flying)
    (said,) = seen
    assert said["in_flight"] == [1, 2, 0]
    assert (said["start"], said["size"], said["numbers"], said["indices"]) == (3, 3, [0, 1, 2], [0, 1, 2])


def test_each_search_is_told_its_own_answers_and_none_of_its_looks_is_proposed_twice():
    problem = problem_of()
    near = np.clip(MIDDLES[0] + 0.1 * np.random.default_rng(2).standard_normal((12, 6)), 0.05, 0.85)
    history = known_at(problem, near)
    basins = basins_of(problem)
    found = propose_led(problem, basins, wave_of(12, 5), history, [])
    assert {p.origin for p in found} == {"trust-region"}
    points = problem.space.coordinates_of_all([p.waveform for p in found])[0]
    np.testing.assert_allclose([p.surrogate[PRIOR_G] for p in found], 10.0 + points[:, 0])
    apart = ((points[:, None] - points[None]) ** 2).sum(axis=2)[np.triu_indices(5, 1)]
    assert apart.min() > 1e-14
    again = propose_led(problem, basins, wave_of(12, 5), history, [p.waveform for p in found])
    assert not {p.waveform for p in again} & {p.waveform for p in found}
    (alone,) = propose_led(problem, basins, wave_of(12, 1), history, [])
    assert alone.origin == "trust-region"
    best = min(o.g_cm_s for o in history)
    for s in (p.surrogate for p in found):
        assert s["looks"] == 24.0
        # That of a normal g of this mean and deviation; what is bad counts less to the process, so it expects less.
        sd = s["predicted_sd_cm_s"] / s["deviation_factor"]
        z = (best - s["predicted_g_cm_s"]) / sd
        improvement = sd * (z * stats.norm.cdf(z) + stats.norm.pdf(z))
        assert 0.33 < s["expected_improvement_cm_s"] / improvement < 1.2
