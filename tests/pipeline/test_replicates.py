"""Claims about independent scramblings: which switch is of which, that intervals are from their spread, and hold."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from examples import examples
from softclose import load_population
from softclose.metrics import replicates
from softclose.metrics.intervals import clopper_pearson
from softclose.metrics.objective import Assessment, Judged, assess

R = replicates.REPLICATES
LOT = load_population("current")


def _judged(u: np.ndarray, open_below: float = 0.04) -> Judged:
    """V and closed as smooth functions of points of the unit cube, with a jump; settling too. (n, 4)."""
    v = 10.0 + 6.0 * u[:, 0] + 5.0 * u[:, 1] ** 2 + 2.0 * u[:, 2] * u[:, 3]
    closed = u[:, 0] + 0.3 * u[:, 3] > open_below
    return Judged(
        max_contact_speed=np.where(closed | (u[:, 1] > 0.5), v, math.nan) / 100.0,
        closed=closed,
        status=np.zeros(len(u), dtype=np.int8),
        settling_us=np.where(closed, 60.0 + 20.0 * u[:, 2], math.inf),
    )


def _points(n: int, seed: int, sampling: str) -> np.ndarray:
    from softclose.population.population import _uniforms

    return _uniforms(n, seed=seed, sampling=sampling, start=0, stream=0)


@settings(max_examples=examples(25), deadline=None)
@given(st.integers(1, 90), st.integers(0, 70), st.integers(0, 5))
def test_any_part_of_an_ensemble_is_that_of_the_whole(n: int, start: int, seed: int) -> None:
    whole = LOT.sample(start + n, seed=seed, sampling="replicated")
    part = LOT.sample(n, seed=seed, sampling="replicated", start=start)
    np.testing.assert_array_equal(part, whole[start:])


def test_switches_of_one_scrambling_are_a_net_and_scramblings_differ() -> None:
    """The first 64 of each fill 64 intervals of every coordinate, one each; no point is in two of them."""
    u = _points(64 * R, 3, "replicated")
    for r in range(R):
        assert all(len(np.unique(np.floor(64.0 * column))) == 64 for column in u[r::R].T)
    assert len(np.unique(u[:, 0])) == len(u)
    assert not np.array_equal(u, _points(64 * R, 4, "replicated"))


@settings(max_examples=examples(25), deadline=None)
@given(st.integers(R, 400), st.integers(0, 9))
def test_the_figures_of_a_scrambling_are_those_of_its_switches_alone(n: int, seed: int) -> None:
    response = _judged(np.random.default_rng(seed).random((n, 4)))
    speed = 100.0 * response.max_contact_speed
    found = replicates.sections(speed, response.closed, response.settling_us, level=0.9, limits=(19.7, 12.0))
    few = min((~np.isnan(speed[r::R])).sum() for r in range(R)) < replicates.FEWEST
    for r in range(R):
        own = Judged(
            max_contact_speed=response.max_contact_speed[r::R],
            closed=response.closed[r::R],
            status=response.status[r::R],
            settling_us=response.settling_us[r::R],
        )
        a = assess(own, limits_cm_s=(19.7, 12.0), min_contact=0.0)
        np.testing.assert_allclose((found.mean[r], found.p_nc[r]), (a.mean_cm_s, a.p_nc), rtol=1e-12)
        if few:
            assert np.isnan((found.v_u[r], found.cvar[r], found.closing[r])).all()
        else:
            np.testing.assert_allclose((found.v_u[r], found.cvar[r]), (a.v_u_cm_s, a.cvar_cm_s), rtol=1e-12)
        if not np.isnan(found.closing).all():
            assert found.closing[r] == pytest.approx(a.closing_us, rel=1e-12)
        np.testing.assert_allclose(found.excess[r], [e.excess_cm_s for e in a.p_exceed], rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(found.exceed[r], [e.probability.estimate for e in a.p_exceed], rtol=1e-12)


def test_an_interval_is_students_about_the_pooled_value() -> None:
    parts = np.random.default_rng(1).random(R)
    a = stats.t.ppf(0.975, R - 1) * math.sqrt(((parts - 0.7) ** 2).sum() / (R - 1) / R)
    assert replicates.about(0.7, parts) == pytest.approx((0.7 - a, 0.7 + a))
    parts[3] = math.nan
    assert all(map(math.isnan, replicates.about(0.7, parts)))
    assert replicates.about(0.7, parts, otherwise=(0.1, 0.9)) == (0.1, 0.9)


@pytest.mark.parametrize(("n", "open_below", "known"), [(4096, 0.04, True), (4096, 0.3, False), (320, 0.2, False)])
def test_a_closing_time_that_a_scrambling_may_not_have_is_that_of_independent_draws(
    n: int, open_below: float, known: bool
) -> None:
    """By the share of the lot that stays open, never by which scramblings were drawn."""
    response = _judged(_points(n, 1, "replicated"), open_below=open_below)
    a, plain = (assess(response, sampling=s) for s in ("replicated", "monte-carlo"))
    assert (a.closing_interval != plain.closing_interval) == known


def test_scramblings_that_all_close_say_what_independent_draws_would() -> None:
    """No discordance: a width of 0 would promise what 512 switches cannot know."""
    p = replicates.proportion(0, 512, np.zeros(R))
    assert p.wald == p.wilson == p.clopper_pearson == clopper_pearson(0, 512)
    a = assess(_judged(_points(512, 1, "replicated"), open_below=-1.0), sampling="replicated")
    assert a.p_nc_intervals.wilson[1] > 0.005
    assert a.g_interval[1] > a.v_u_interval[1]


ENDS = ("v_u_interval", "mean_interval", "cvar_interval", "g_interval", "closing_interval")


def test_one_quasi_random_sample_has_no_interval_anywhere() -> None:
    response = _judged(_points(512, 1, "sobol"))
    a, b = (assess(response, sampling=s) for s in ("sobol", "monte-carlo"))
    assert not a.intervals_valid
    for name in ENDS:
        assert all(map(math.isnan, getattr(a, name)))
    for p in (a.p_nc_intervals, a.p_exceed[0].probability):
        assert all(map(math.isnan, (*p.wald, *p.wilson, *p.clopper_pearson)))
    assert all(map(math.isnan, a.p_exceed[0].excess_interval))
    assert math.isnan(a.p_above_v_u_half_width)
    for name in ("g_cm_s", "g_se_cm_s", "v_u_cm_s", "p_nc", "cvar_cm_s", "mean_cm_s", "closing_us"):
        assert getattr(a, name) == getattr(b, name)


def test_sixteen_scramblings_hold_and_are_narrower_than_independent_draws() -> None:
    """Of 120 ensembles of 1,024 switches of an analytic lot; its truth from 2²⁰ points."""
    truth = assess(_judged(_points(2**20, 99, "sobol")), limits_cm_s=(20.0,))
    targets = {
        "v_u_interval": truth.v_u_cm_s,
        "mean_interval": truth.mean_cm_s,
        "cvar_interval": truth.cvar_cm_s,
        "g_interval": truth.g_cm_s,
        "closing_interval": truth.closing_us,
    }
    held: dict[str, list[bool]] = {name: [] for name in [*targets, "p_nc", "excess"]}
    narrower: dict[str, list[float]] = {name: [] for name in targets}

    def width(a: Assessment, name: str) -> float:
        low, high = getattr(a, name)
        return float(high - low)

    for seed in range(120):
        response = _judged(_points(1024, seed, "replicated"))
        a, plain = (assess(response, sampling=s, limits_cm_s=(20.0,)) for s in ("replicated", "monte-carlo"))
        assert a.intervals_valid
        for name, target in targets.items():
            low, high = getattr(a, name)
            held[name].append(low <= target <= high)
            narrower[name].append(width(a, name) / width(plain, name))
        low, high = a.p_nc_intervals.wilson
        held["p_nc"].append(low <= truth.p_nc <= high)
        low, high = a.p_exceed[0].excess_interval
        held["excess"].append(low <= truth.p_exceed[0].excess_cm_s <= high)
    assert all(np.mean(h) >= 0.89 for h in held.values()), {k: float(np.mean(h)) for k, h in held.items()}
    assert np.median(narrower["mean_interval"]) < 0.4
    assert np.median(narrower["v_u_interval"]) < 0.9
    assert np.median(narrower["g_interval"]) < 0.9


def test_a_limit_is_judged_by_the_scramblings() -> None:
    asked = {"form": "chance", "p_max": 0.05, "sampling": "replicated"}
    a = assess(_judged(_points(4096, 2, "replicated")), **asked)
    assert a.limit is not None
    assert a.limit.upper == a.p_nc_intervals.clopper_pearson[1]
    assert a.limit.verdict == "met"
    assert a.feasible


@pytest.mark.parametrize(("in_contact", "has_quantiles"), [(9, False), (10, True)])
def test_with_fewer_than_ten_in_contact_of_one_scrambling_no_quantile_is_told_of_any(
    in_contact: int, has_quantiles: bool
) -> None:
    speed = np.linspace(0.1, 0.3, 20 * R)
    speed[3 + R * in_contact :: R] = np.nan  # of the fourth scrambling that many touch
    found = replicates.sections(speed, np.isfinite(speed), None, level=0.95, limits=())
    assert np.isfinite(found.v_u).all() == has_quantiles
    assert np.isnan(found.v_u).all() != has_quantiles
    assert np.isfinite(found.mean).all()
    assert found.excess.shape == found.exceed.shape == (R, 0)


@pytest.mark.parametrize(("never", "has_times"), [(16, True), (24, False)])
def test_a_closing_time_is_told_where_no_scrambling_is_likely_to_lack_it(never: int, has_times: bool) -> None:
    """Of a hundred switches each: one of a hundred that never settles may be four of them, one and a half over five."""
    settling = np.linspace(50.0, 90.0, 100 * R)
    settling[:never] = np.inf  # one of each scrambling, then of the first half of them
    speed = np.full(settling.size, 0.2)
    found = replicates.sections(speed, np.isfinite(settling), settling, level=0.95, limits=())
    assert np.isfinite(found.closing).all() == has_times
    assert np.isnan(found.closing).all() != has_times


def test_a_proportion_is_its_count_with_an_interval_that_no_proportion_leaves() -> None:
    n, parts = 160, np.tile([0.25, 0.5], R // 2)
    found = replicates.proportion(60, n, parts)
    assert (found.count, found.n, found.estimate) == (60, n, 0.375)
    assert found.wald == found.wilson == found.clopper_pearson == replicates.about(0.375, parts)
    rare = replicates.proportion(12, 1200, np.tile([0.0, 0.08], R // 2))
    assert rare.wilson == (0.0, replicates.about(0.01, np.tile([0.0, 0.08], R // 2))[1])
    usual = replicates.proportion(1188, 1200, np.tile([1.0, 0.92], R // 2))
    assert usual.wilson == (replicates.about(0.99, np.tile([1.0, 0.92], R // 2))[0], 1.0)
    assert math.isnan(replicates.proportion(0, 0, np.full(R, np.nan)).estimate)
