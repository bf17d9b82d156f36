"""Intervals against closed forms, scipy, and coverage by exact enumeration or simulation."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from softclose.metrics import intervals


@settings(deadline=None)
@given(data=st.data(), n=st.integers(1, 3000), confidence=st.sampled_from([0.8, 0.95, 0.99]))
def test_wilson_and_clopper_pearson_agree_with_scipy(data: st.DataObject, n: int, confidence: float) -> None:
    count = data.draw(st.integers(0, n))
    test = stats.binomtest(count, n)
    for ours, method in ((intervals.wilson, "wilson"), (intervals.clopper_pearson, "exact")):
        theirs = test.proportion_ci(confidence, method=method)
        np.testing.assert_allclose(ours(count, n, confidence), (theirs.low, theirs.high), rtol=1e-9, atol=1e-12)
        assert ours(count, n, confidence)[0] <= count / n <= ours(count, n, confidence)[1]


def test_wald_is_eq_11() -> None:
    a = 1.96 * math.sqrt(0.125 * 0.875 / 200)
    assert intervals.wald(25, 200) == pytest.approx((0.125 - a, 0.125 + a), abs=2e-6)
    p = intervals.proportion(25, 200)
    assert p.estimate == 0.125
    assert p.half_width == pytest.approx(a, abs=2e-6)
    # The published interval of P(V > 19.7) is this one.
    assert (round(p.wald[0], 2), round(p.wald[1], 2)) == (0.08, 0.17)


def test_no_draws_give_nan_and_bad_counts_are_refused() -> None:
    p = intervals.proportion(0, 0)
    assert all(math.isnan(x) for x in (p.estimate, *p.wald, *p.wilson, *p.clopper_pearson))
    with pytest.raises(ValueError, match="count is 5 of n = 4"):
        intervals.wilson(5, 4)
    with pytest.raises(ValueError, match="confidence is 95"):
        intervals.wald(1, 4, 95.0)


def _coverage(interval: object, n: int, p: float) -> float:
    counts = np.arange(n + 1)
    inside = [interval(int(k), n)[0] <= p <= interval(int(k), n)[1] for k in counts]  # type: ignore[operator]
    return float(stats.binom.pmf(counts, n, p) @ np.array(inside))


def test_clopper_pearson_always_covers_where_wald_fails() -> None:
    probabilities = np.linspace(0.003, 0.5, 60)
    exact = [_coverage(intervals.clopper_pearson, 200, p) for p in probabilities]
    score = [_coverage(intervals.wilson, 200, p) for p in probabilities]
    assert min(exact) >= 0.95
    assert np.mean(score) == pytest.approx(0.95, abs=0.01)
    assert _coverage(intervals.wald, 200, 0.005) < 0.7


@pytest.mark.parametrize("n", [1, 7, 28, 29, 200, 2000, 100_000])
def test_order_statistic_ranks_are_the_tightest_with_half_the_risk_in_each_tail(n: int) -> None:
    lower, upper = intervals.order_statistic_ranks(n, 0.9)
    b = stats.binom(n, 0.9)
    assert b.cdf(lower - 1) <= 0.025 < b.cdf(lower)
    assert b.sf(upper - 1) <= 0.025 + 1e-12
    assert upper == 1 or b.sf(upper - 2) > 0.025
    assert (upper <= n) == (0.9**n <= 0.025)


@pytest.mark.parametrize(("level", "confidence", "least"), [(0.9, 0.95, 36), (0.5, 0.95, 6), (0.99, 0.9, 299)])
def test_the_fewest_draws_are_those_of_which_the_largest_bounds_the_quantile(
    level: float, confidence: float, least: int
) -> None:
    tail = 0.5 * (1.0 - confidence)
    assert level**least <= tail < level ** (least - 1)
    assert intervals.least_for_quantile_interval(level, confidence) == least


def test_order_statistic_interval_covers_the_quantile() -> None:
    rng = np.random.default_rng(4)
    draws = np.sort(rng.exponential(size=(4000, 200)), axis=1)
    truth = -math.log(0.1)
    inside = np.mean([lo <= truth <= hi for lo, hi in (intervals.quantile_interval(row, 0.9) for row in draws)])
    assert 0.945 < inside < 0.98
    few = intervals.quantile_interval(np.arange(20.0), 0.9)
    assert few[0] >= 0.0
    assert few[1] == math.inf


@given(n=st.integers(1, 400), level=st.sampled_from([0.5, 0.8, 0.9, 0.95]), seed=st.integers(0, 1000))
def test_quantile_rank_is_numpys_inverted_cdf(n: int, level: float, seed: int) -> None:
    ordered = np.sort(np.random.default_rng(seed).random(n))
    k = intervals.quantile_rank(n, level)
    assert k / n >= level - 1e-9
    assert k == 1 or (k - 1) / n < level
    if abs(n * level - round(n * level)) > 1e-6:  # there numpy has no such tolerance
        assert ordered[k - 1] == np.quantile(ordered, level, method="inverted_cdf")


def test_quantile_standard_error_is_the_bootstraps() -> None:
    rng = np.random.default_rng(8)
    ordered = np.sort(rng.gamma(4.0, size=300))
    resampled = np.sort(rng.choice(ordered, size=(20_000, 300)), axis=1)[:, intervals.quantile_rank(300, 0.9) - 1]
    assert intervals.quantile_standard_error(ordered, 0.9) == pytest.approx(resampled.std(), rel=0.02)
    assert math.isnan(intervals.quantile_standard_error(np.array([1.0]), 0.9))


def test_quantile_standard_error_of_few_draws_is_that_of_every_resample() -> None:
    ordered = np.array([1.0, 2.0, 4.0, 9.0])
    for level in (0.3, 0.5, 0.9):
        k = intervals.quantile_rank(4, level)
        resampled = [sorted(r)[k - 1] for r in itertools.product(ordered, repeat=4)]
        assert intervals.quantile_standard_error(ordered, level) == pytest.approx(np.std(resampled), rel=1e-12)


def test_ranks_of_few_draws_by_hand() -> None:
    # P(B <= 0) = P(B >= 2) = 1/4 of two draws about the median: just what either tail may have.
    assert intervals.order_statistic_ranks(2, 0.5, 0.5) == (1, 2)
    assert intervals.order_statistic_ranks(0, 0.9) == (0, 1)
    two = np.array([3.0, 8.0])
    assert intervals.quantile_interval(two, 0.5, 0.5) == (3.0, 8.0)
    assert intervals.quantile_interval(two, 0.5, 0.95) == (-math.inf, math.inf)
    assert intervals.quantile_rank(1, 1e-12) == 1


def test_student_interval_is_scipys() -> None:
    x = np.array([1.0, 2.0, 4.0, 7.0])
    theirs = stats.t.interval(0.95, 3, loc=x.mean(), scale=stats.sem(x))
    assert intervals.student_interval(x) == pytest.approx(theirs)
    assert all(math.isnan(v) for v in intervals.student_interval(np.array([1.0])))


@settings(deadline=None)
@given(
    st.lists(st.floats(-50.0, 50.0), min_size=3, max_size=60).filter(lambda x: np.std(x) > 1e-3),
    st.floats(0.1, 10.0),
    st.floats(-20.0, 20.0),
)
def test_mean_interval_holds_students_and_halls_and_moves_with_the_draws(
    draws: list[float], scale: float, shift: float
) -> None:
    """Hall's (1992): the ends are where the transformed t is at Student's quantile. Signs and units change none."""
    x = np.array(draws)
    n, mean = x.size, float(x.mean())
    low, high = intervals.mean_interval(x)
    t = stats.t.ppf(0.975, n - 1)
    se = stats.sem(x)
    skewness = float(stats.skew(x, bias=False))

    def transformed(mu: float) -> float:
        z, g = (mean - mu) / se, skewness / math.sqrt(n)
        return z + g * z**2 / 3.0 + g**2 * z**3 / 27.0 + g / 6.0

    assert low <= mean - t * se + 1e-9
    assert high >= mean + t * se - 1e-9
    assert transformed(low) >= t - 1e-6
    assert transformed(high) <= -t + 1e-6
    assert min(transformed(low) - t, (mean - t * se) - low) == pytest.approx(0.0, abs=1e-5)
    assert min(-t - transformed(high), high - (mean + t * se)) == pytest.approx(0.0, abs=1e-5)
    mirrored = intervals.mean_interval(-x)
    np.testing.assert_allclose((-mirrored[1], -mirrored[0]), (low, high), rtol=1e-7, atol=1e-7)
    moved = intervals.mean_interval(scale * x + shift)
    np.testing.assert_allclose(moved, (scale * low + shift, scale * high + shift), rtol=1e-6, atol=1e-6)


def test_mean_interval_of_few_or_equal_draws() -> None:
    assert all(math.isnan(v) for v in intervals.mean_interval(np.array([1.0])))
    two = np.array([1.0, 4.0])
    assert intervals.mean_interval(two) == intervals.student_interval(two)
    assert intervals.mean_interval(np.full(9, 2.0)) == (2.0, 2.0)


@pytest.mark.parametrize("n", [20, 300, 100_000])
def test_a_share_that_is_not_seen_is_missed_by_one_sample_in_twenty(n: int) -> None:
    assert (1.0 - intervals.unseen_share(n)) ** n == pytest.approx(0.05)
    assert intervals.unseen_share(n) == pytest.approx(3.0 / n, rel=0.1)
    assert intervals.unseen_share(0) == 1.0


def test_jumps_of_a_quantile_are_the_gaps_within_its_interval() -> None:
    smooth = np.arange(1000.0)
    assert intervals.quantile_jumps(smooth, 0.9) == (1.0, 1.0)
    gap = np.where(smooth >= 905, smooth + 500.0, smooth)
    assert intervals.quantile_jumps(gap, 0.9) == (1.0, 501.0)
    gap = np.where(smooth >= 895, smooth + 500.0, smooth)
    assert intervals.quantile_jumps(gap, 0.9) == (501.0, 1.0)
    assert intervals.quantile_jumps(np.array([3.0]), 0.9) == (0.0, 0.0)
