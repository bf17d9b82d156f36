"""The objective: Eqs. 7-11 on made-up responses with known answers, and the coverage of its intervals."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from softclose import assess
from softclose.metrics import intervals
from softclose.metrics.joined import joint, reach
from softclose.metrics.objective import MAX_FAILED, Judged, ObjectiveError


@dataclass(frozen=True)
class Made:
    """A response that nobody simulated."""

    max_contact_speed: NDArray[np.float64]
    closed: NDArray[np.bool_]


@dataclass(frozen=True)
class MadeWithStatus(Made):
    """The same with status codes."""

    status: NDArray[np.int8]


def _made(speeds_cm_s: list[float], closed: list[bool] | None = None) -> Made:
    v = np.array(speeds_cm_s) / 100.0
    return Made(v, ~np.isnan(v) if closed is None else np.array(closed))


def test_eqs_7_to_10_on_ten_switches() -> None:
    a = assess(_made([*range(1, 11)], [True] * 9 + [False]), limits_cm_s=(5.0, 8.5))
    assert a.v_u_cm_s == 9.0  # smallest speed that 90 % do not exceed
    assert a.p_nc == 0.1
    assert a.g_cm_s == pytest.approx(9.0 + 25.0 * 0.1)
    assert a.mean_cm_s == 5.5
    assert a.max_cm_s == 10.0
    assert a.p_above_v_u == 0.1
    assert a.p_above_v_u_half_width == pytest.approx(1.959964 * math.sqrt(0.1 * 0.9 / 10), rel=1e-6)  # Eq. 11
    assert [e.probability.estimate for e in a.p_exceed] == [0.5, 0.2]
    assert a.feasible
    assert a.intervals_valid


def test_speeds_count_over_the_switches_in_contact_and_p_nc_over_all() -> None:
    a = assess(_made([10.0] * 8 + [20.0, 30.0] + [math.nan] * 10), limits_cm_s=(19.7,))
    assert (a.n, a.n_contact, a.n_closed) == (20, 10, 10)
    assert a.p_contact == a.p_nc == 0.5
    assert a.v_u_cm_s == 20.0
    assert a.mean_cm_s == 13.0
    assert (a.p_exceed[0].probability.count, a.p_exceed[0].probability.n) == (2, 10)


def test_without_contact_nothing_is_reported_and_g_is_still_a_number() -> None:
    a = assess(_made([math.nan] * 50))
    assert a.g_cm_s == 60.0 + 25.0
    assert all(map(math.isnan, (a.v_u_cm_s, a.mean_cm_s, a.p_above_v_u, *a.v_u_interval, *a.mean_interval)))
    assert 0.0 < a.g_se_cm_s < 2.0
    assert a.g_interval[0] <= a.g_cm_s <= a.g_interval[1]


def test_too_few_in_contact_leave_v_u_undefined() -> None:
    few = _made([5.0] * 9 + [math.nan] * 91)
    assert math.isnan(assess(few).v_u_cm_s)
    assert assess(few).g_cm_s == pytest.approx(60.0 + 25.0 * 0.91)
    assert assess(few).mean_cm_s == pytest.approx(5.0)
    assert assess(few, min_contact=0.05).v_u_cm_s == 5.0
    assert assess(few, undefined_v_u_cm_s=80.0).g_cm_s == pytest.approx(80.0 + 25.0 * 0.91)
    assert assess(few, min_contact=0.05).g_interval[1] == math.inf  # 9 draws bound no 90 % quantile from above


def test_failed_switches_count_as_open_without_contact() -> None:
    v = np.array([0.1, 0.2, 0.3, 9.0])
    a = assess(MadeWithStatus(v, np.ones(4, dtype=bool), np.array([0, 0, 0, 1], dtype=np.int8)))
    assert (a.n, a.n_failed, a.n_contact, a.n_closed) == (4, 1, 3, 3)
    assert a.max_cm_s == pytest.approx(30.0)


def test_the_chance_form_is_v_u_where_p_nc_is_allowed_and_penalised_beyond() -> None:
    response = _made([10.0] * 100, [True] * 97 + [False] * 3)
    inside = assess(response, form="chance", p_max=0.03)
    assert not inside.feasible  # the estimate meets the limit, the interval does not establish it: see test_limit.py
    assert inside.g_cm_s == inside.v_u_cm_s
    outside = assess(response, form="chance", p_max=0.01, chance_penalty_cm_s=500.0)
    assert not outside.feasible
    assert outside.g_cm_s == pytest.approx(outside.v_u_cm_s + 500.0 * 0.02)


def test_sobol_intervals_are_marked_as_not_holding() -> None:
    assert not assess(_made([1.0, 2.0]), sampling="sobol").intervals_valid


def test_an_assessment_is_plain_json() -> None:
    data = assess(_made([float(i) for i in range(1, 101)])).to_dict()
    assert json.loads(json.dumps(data))["p_nc_intervals"]["wilson"][0] == 0.0


@given(st.permutations(list(range(12))), st.integers(0, 12))
def test_the_order_of_the_switches_does_not_matter(order: list[int], n_open: int) -> None:
    v = np.linspace(0.1, 0.3, 12)
    closed = np.arange(12) >= n_open
    a, b = assess(Made(v, closed)), assess(Made(v[order], closed[order]))
    assert (a.g_cm_s, a.v_u_cm_s, a.p_nc) == (b.g_cm_s, b.v_u_cm_s, b.p_nc)
    assert a.g_se_cm_s == pytest.approx(b.g_se_cm_s)
    assert a.g_interval == pytest.approx(b.g_interval)


def _lot(rng: np.random.Generator, n: int) -> Made:
    """Fast switches stay open more often, so v_u and p_nc are correlated."""
    v = np.where(rng.random(n) < 0.03, np.nan, rng.gamma(9.0, 0.02, n))
    closed = ~np.isnan(v) & (rng.random(n) > 0.02 + 0.1 * (v > 0.2))
    return Made(v, closed)


@pytest.mark.parametrize("form", [{}, {"form": "chance", "p_max": 0.07}])
def test_intervals_and_standard_error_of_g_hold_in_simulation(form: dict[str, object]) -> None:
    rng = np.random.default_rng(12)
    truth = assess(_lot(rng, 2_000_000), **form)  # type: ignore[arg-type]
    lots = [assess(_lot(rng, 400), **form) for _ in range(1000)]  # type: ignore[arg-type]
    g = np.array([a.g_cm_s for a in lots])
    assert np.mean([a.g_interval[0] <= truth.g_cm_s <= a.g_interval[1] for a in lots]) > 0.93
    assert np.mean([a.v_u_interval[0] <= truth.v_u_cm_s <= a.v_u_interval[1] for a in lots]) > 0.93
    assert np.mean([a.mean_interval[0] <= truth.mean_cm_s <= a.mean_interval[1] for a in lots]) > 0.93
    assert np.mean([a.g_se_cm_s for a in lots]) == pytest.approx(g.std(), rel=0.1)


@pytest.mark.parametrize("open_", [slice(90, 96), slice(0, 30), slice(85, 100)])
def test_the_error_of_g_counts_that_v_u_and_p_nc_err_together(open_: slice) -> None:
    v = np.concatenate([np.linspace(5.0, 30.0, 100) ** 1.5, np.full(20, np.nan)])
    closed = ~np.isnan(v)
    closed[open_] = False
    a = assess(Made(v / 100.0, closed))
    # What one switch more does to either estimate; 90 of 100 are at most v_u, so both have mean 0.
    on_v_u = np.where(np.isnan(v), 0.0, 0.9 - (v <= a.v_u_cm_s + 1e-9))
    together = np.corrcoef(on_v_u, ~closed - a.p_nc)[0, 1]
    alone = intervals.quantile_standard_error(v[:100], 0.9)
    open_error = 25.0 * np.ptp(intervals.wilson(a.n - a.n_closed, a.n)) / (2.0 * 1.959964)
    expected = math.sqrt(alone**2 + open_error**2 + 2.0 * together * alone * open_error)
    assert a.g_se_cm_s == pytest.approx(expected, rel=1e-6)


def test_the_error_of_g_vanishes_at_most_where_the_slow_switches_stay_open() -> None:
    v = np.linspace(10.0, 20.0, 11)
    a = assess(Made(v / 100.0, np.arange(11) == 10))  # their influences would correlate below -1 at this small n
    open_error = 25.0 * np.ptp(intervals.wilson(10, 11)) / (2.0 * 1.959964)
    assert a.g_se_cm_s == pytest.approx(abs(intervals.quantile_standard_error(v, 0.9) - open_error), rel=1e-6)


def test_the_interval_of_g_is_v_us_widened_by_what_p_nc_may_be() -> None:
    v = np.linspace(3.0, 5.0, 200) ** 3  # skewed: the interval of v_u is not symmetric
    a = assess(_made(list(v)))  # all closed: p_nc can only be larger
    low, high = intervals.quantile_interval(v, 0.9)
    assert a.v_u_interval == pytest.approx((low, high))
    assert a.g_interval[0] == pytest.approx(low)
    surely = a.p_nc_intervals.clopper_pearson[1]  # below ten of a kind Wilson's is too short
    assert a.g_interval[1] - a.g_cm_s == pytest.approx(math.hypot(high - a.v_u_cm_s, 25.0 * surely))


def test_smooth_errors_join_in_quadrature_as_they_are_correlated() -> None:
    assert [joint(3.0, 4.0, r) for r in (0.0, 1.0, -1.0)] == pytest.approx([5.0, 7.0, 1.0])
    assert joint(0.1, 0.1, -1.0) == 0.0
    assert joint(math.inf, 4.0, 0.0) == math.inf


def test_the_reach_of_a_quantile_that_jumps_adds_up_whole() -> None:
    """Zou and Donner's joint interval where V has a density at the quantile; where it jumps, either end is likely."""
    assert [reach(3.0, 4.0, 0.0, share * 3.0) for share in (0.0, 0.5, 1.0)] == pytest.approx([5.0, 6.0, 7.0])
    assert reach(0.0, 4.0, 0.0, 0.0) == 4.0
    assert reach(math.inf, 4.0, 0.0, math.inf) == math.inf


def test_zero_bounds_a_speed_that_no_draw_bounds() -> None:
    assert assess(_made([5.0, 6.0]), level=0.1).v_u_interval[0] == 0.0


def test_one_switch_has_an_upper_velocity_and_no_error_of_it() -> None:
    a = assess(_made([12.0]))
    assert a.v_u_cm_s == pytest.approx(12.0)
    assert 0.0 < a.g_se_cm_s < 25.0


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"level": 90}, "level is 90; it must lie between 0 and 1"),
        ({"level": "0.9"}, "level is '0.9'"),
        ({"level": 0.0}, "level is 0"),
        ({"level": 1.0}, "level is 1"),
        ({"c1_cm_s": -0.5}, "c1_cm_s is -0.5"),
        ({"c1_cm_s": math.nan}, "c1_cm_s is nan"),
        ({"min_contact": 1.5}, "min_contact is 1.5"),
        ({"limits_cm_s": (-0.5,)}, "limits_cm_s has -0.5"),
        ({"form": "chanse"}, "one of penalty, chance"),
        ({"form": "chance"}, "needs p_max"),
        ({"form": "chance", "p_max": 5}, "p_max is 5"),
        ({"p_max": 0.1}, "use form 'chance'"),
        ({"confidence": 1.0}, "confidence is 1"),
    ],
)
def test_bad_settings_are_named(settings: dict[str, object], words: str) -> None:
    with pytest.raises(ObjectiveError, match=words):
        assess(_made([1.0, 2.0]), **settings)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("response", "words"),
    [
        (Made(np.zeros((2, 2)), np.zeros((2, 2), dtype=bool)), "must be .n,."),
        (Made(np.zeros(0), np.zeros(0, dtype=bool)), "one or more switches"),
        (Made(np.zeros(3), np.zeros(2, dtype=bool)), "max_contact_speed has shape .3,. and closed .2,."),
        (Made(np.array([0.1, -1.0]), np.array([True, True])), "infinite or negative"),
        (Made(np.array([0.1, math.inf]), np.array([True, True])), "infinite or negative"),
        (MadeWithStatus(np.ones(2), np.ones(2, dtype=bool), np.zeros(3, dtype=np.int8)), "status has shape"),
    ],
)
def test_a_response_that_cannot_be_assessed_is_refused(response: Made, words: str) -> None:
    with pytest.raises(ObjectiveError, match=words):
        assess(response)


def test_the_closing_time_is_a_quantile_over_all_switches() -> None:
    """Of ten switches, nine are held in time; the rank of 90 % is the ninth, that of 95 % nobody's."""
    settling = np.array([30.0, 10.0, np.inf, 20.0, 40.0, 50.0, 60.0, 70.0, 80.0, 90.0])
    closed = np.isfinite(settling)
    response = Judged(
        max_contact_speed=np.full(10, 0.2), closed=closed, status=np.zeros(10, dtype=np.int8), settling_us=settling
    )
    found = assess(response, level=0.9)
    assert found.closing_us == 90.0
    assert found.closing_interval[0] < 90.0
    assert found.closing_interval[1] == np.inf
    assert assess(response, level=0.95).closing_us == np.inf
    status = np.where(np.arange(10) == 1, 2, 0).astype(np.int8)  # what was not integrated never closes
    assert assess(replace(response, status=status), level=0.8).closing_us == 90.0
    assert np.isnan(assess(replace(response, settling_us=None)).closing_us)
    assert np.isnan(assess(replace(response, settling_us=settling * np.nan)).closing_us)
    with pytest.raises(ObjectiveError, match=r"settling_us has shape \(3,\)"):
        assess(replace(response, settling_us=settling[:3]))


@pytest.mark.parametrize("form", ["penalty", "chance"])
@pytest.mark.parametrize("risk", ["quantile", "cvar"])
def test_g_is_undefined_where_more_than_a_stated_share_could_not_be_integrated(form: Any, risk: Any) -> None:
    """What such switches would have done is not known, and they are not open for sure."""
    n = 200
    rng = np.random.default_rng(1)
    for n_failed in (0, int(MAX_FAILED * n), int(MAX_FAILED * n) + 1, n):
        status = (np.arange(n) < n_failed).astype(np.int8)
        response = Judged(
            max_contact_speed=np.where(status != 0, 2.8e7, rng.uniform(0.1, 0.2, n)),
            closed=np.ones(n, dtype=bool),
            status=status,
        )
        a = assess(response, form=form, risk=risk, p_max=0.1 if form == "chance" else None)
        assert a.n_failed == n_failed
        assert math.isnan(a.g_cm_s) == (n_failed > MAX_FAILED * n)
        assert math.isnan(a.g_interval[0]) == math.isnan(a.g_cm_s)
        assert a.p_nc == n_failed / n
        assert not a.max_cm_s > 21.0, "what a failed switch left behind is no speed"
