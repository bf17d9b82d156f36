"""Claims about paired comparisons, against the bootstrap and against brute force."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from softclose import assess
from softclose.metrics.intervals import proportion, quantile_standard_error
from softclose.metrics.paired import compare, spread_at


def _response(v_cm_s: Any, closed: Any) -> Any:
    return SimpleNamespace(max_contact_speed=np.asarray(v_cm_s) / 100.0, closed=np.asarray(closed))


def _pair(n: int, seed: int) -> tuple[Any, Any]:
    """Two waveforms on the same switches: correlated speeds, some switches never touch, some stay open."""
    rng = np.random.default_rng(seed)
    shared = rng.normal(size=n)
    speeds = []
    for mean in (15.0, 18.0):
        v = np.abs(mean + 3.0 * shared + 2.0 * rng.normal(size=n))
        v[(shared < -1.4) & (rng.random(n) < 0.8)] = math.nan
        speeds.append(v)
    return tuple(_response(v, ~np.isnan(v) & (rng.random(n) < 0.97)) for v in speeds)  # type: ignore[return-value]


def test_interval_of_v_u_difference_agrees_with_the_bootstrap() -> None:
    n = 4000
    a, b = _pair(n, 1)
    c = compare((a, assess(a)), (b, assess(b)))
    rng = np.random.default_rng(2)
    differences = []
    for _ in range(600):
        rows = rng.integers(n, size=n)
        x, y = (r.max_contact_speed[rows] for r in (a, b))
        x, y = np.sort(x[~np.isnan(x)]), np.sort(y[~np.isnan(y)])
        differences.append(x[math.ceil(0.9 * x.size) - 1] - y[math.ceil(0.9 * y.size) - 1])
    half = 100.0 * 1.96 * np.std(differences)
    assert c.v_u_interval[1] - c.v_u_cm_s == pytest.approx(half, rel=0.15)
    independent = math.hypot(
        assess(a).v_u_interval[1] - assess(a).v_u_cm_s, assess(b).v_u_interval[1] - assess(b).v_u_cm_s
    )
    assert half < 0.9 * independent  # what pairing is for


def test_v_u_difference_interval_covers_the_truth() -> None:
    big = _pair(200_000, 7)
    truth = assess(big[0]).v_u_cm_s - assess(big[1]).v_u_cm_s
    hits = 0
    for seed in range(200):
        a, b = _pair(500, 1000 + seed)
        lower, upper = compare((a, assess(a)), (b, assess(b))).v_u_interval
        hits += lower <= truth <= upper
    assert 0.90 <= hits / 200 <= 0.985


def test_counts_match_brute_force() -> None:
    a, b = _pair(700, 3)
    c = compare((a, assess(a)), (b, assess(b)))
    pairs = [
        (x, y)
        for x, y in zip(a.max_contact_speed, b.max_contact_speed, strict=True)
        if not math.isnan(x) and not math.isnan(y)
    ]
    assert (c.softer.count, c.softer.n) == (sum(x < y for x, y in pairs), len(pairs))
    assert c.mean_cm_s == pytest.approx(100.0 * sum(x - y for x, y in pairs) / len(pairs))
    assert c.p_nc == pytest.approx((~a.closed).mean() - (~b.closed).mean())
    assert c.p_nc_interval[0] < c.p_nc < c.p_nc_interval[1]


def test_interval_of_p_nc_counts_the_switches_that_close_under_one_waveform_only() -> None:
    v, everywhere = np.full(100, 15.0), np.arange(100)
    a, b = _response(v, everywhere >= 12), _response(v, (everywhere >= 8) & (everywhere < 99))
    c = compare((a, assess(a)), (b, assess(b)))  # 4 and 1 of a hundred
    assert c.p_nc == pytest.approx(0.03)
    half = 1.959964 * math.sqrt(7.0 - 9.0 / 102.0) / 102.0  # one more of each kind
    assert c.p_nc_interval == pytest.approx((3.0 / 102.0 - half, 3.0 / 102.0 + half), rel=1e-6)


def test_switches_that_touch_under_neither_waveform_do_not_couple_their_upper_velocities() -> None:
    n = 4000
    touches = np.arange(n) % 2 == 0
    a, b = (
        _response(np.where(touches, np.random.default_rng(seed).gamma(9.0, 2.0, n), math.nan), touches)
        for seed in (1, 2)
    )
    c = compare((a, assess(a)), (b, assess(b)))
    alone = [quantile_standard_error(np.sort(100.0 * r.max_contact_speed[touches]), 0.9) for r in (a, b)]
    assert c.v_u_interval[1] - c.v_u_cm_s == pytest.approx(1.96 * math.hypot(*alone), rel=0.05)


def test_one_switch_gives_a_difference_and_no_interval() -> None:
    a, b = _response([12.0], [True]), _response([15.0], [True])
    c = compare((a, assess(a)), (b, assess(b)))
    assert c.v_u_cm_s == pytest.approx(-3.0)
    assert c.v_u_interval == (-math.inf, math.inf)
    assert all(map(math.isnan, c.mean_interval))


def test_that_no_switch_differs_does_not_say_that_none_would() -> None:
    """Of 300 switches none differs: as many as 1.2 % of a lot may all the same (Clopper and Pearson)."""
    a, _ = _pair(300, 4)
    c = compare((a, assess(a)), (a, assess(a)))
    assert c.v_u_cm_s == c.p_nc == c.softer.count == 0
    assert c.p_nc_interval[1] == -c.p_nc_interval[0] > 0.5 * proportion(0, 300).clopper_pearson[1]
    low, high = c.v_u_interval
    own = assess(a).v_u_interval
    assert -0.5 * (own[1] - own[0]) < low < 0.0 < high < 0.5 * (own[1] - own[0])


def test_undefined_v_u_gives_an_undefined_difference() -> None:
    a, _ = _pair(300, 4)
    never = _response(np.full(300, math.nan), np.zeros(300, bool))
    c = compare((a, assess(a)), (never, assess(never)))
    assert math.isnan(c.v_u_cm_s)
    assert math.isnan(c.v_u_interval[0])
    assert c.softer.n == 0


def test_range_of_small_ensembles_is_the_range_that_small_ensembles_show() -> None:
    rng = np.random.default_rng(5)
    even = np.linspace(0.0, 1.0, 1_000_001)
    np.testing.assert_allclose(spread_at(even, 0.9, 20), stats.beta.ppf([0.025, 0.975], 18, 3), atol=2e-6)
    assert spread_at(np.array([5.0]), 0.9, 200) == (5.0, 5.0)
    assert all(map(math.isnan, spread_at(np.array([]), 0.9, 200)))
    population = np.sort(rng.gamma(5.0, 3.0, size=100_000))
    lower, upper = spread_at(population, 0.9, 200)
    estimates = np.sort(rng.choice(population, size=(4000, 200)), axis=1)[:, 179]
    assert np.quantile(estimates, 0.025) == pytest.approx(lower, rel=0.02)
    assert np.quantile(estimates, 0.975) == pytest.approx(upper, rel=0.02)
