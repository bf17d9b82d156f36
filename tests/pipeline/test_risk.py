"""Claims about risk: the tail's mean, the excess over a limit, their intervals, and closing in time."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from examples import examples
from softclose import Waveform, assess
from softclose.evaluate import draw, evaluate, judge, respond
from softclose.metrics.objective import Judged, ObjectiveError, in_time
from softclose.settings import ConfigError, load_config


def judged(v_cm_s, closed=None):
    v = np.asarray(v_cm_s, dtype=float) / 100.0
    closed = ~np.isnan(v) if closed is None else np.asarray(closed)
    return Judged(max_contact_speed=v, closed=closed, status=np.zeros(v.size, dtype=np.int8))


@settings(max_examples=examples(60), deadline=None)
@given(arrays(float, st.integers(5, 60), elements=st.floats(0.0, 80.0)), st.sampled_from([0.5, 0.8, 0.9, 0.99]))
def test_cvar_is_the_mean_of_the_worst_switches(v, level):
    """By the definition: the mean of the quantile function beyond the level, a step function of the sorted sample."""
    ordered = np.sort(v)
    edges = np.arange(v.size + 1) / v.size
    weight = np.clip(edges[1:] - np.maximum(edges[:-1], level), 0.0, None)
    expected = float(weight @ ordered / (1.0 - level))
    assert assess(judged(v), level=level).cvar_cm_s == pytest.approx(expected, abs=1e-9)


def test_cvar_of_the_exponential_distribution_and_the_coverage_of_its_interval():
    """Closed form: 1 - log(1 - level) means. Of 95 % intervals of 1,000 draws 92 to 97 % hold it."""
    rng = np.random.default_rng(1)
    truth = 10.0 * (1.0 - math.log(0.1))
    found = [assess(judged(rng.exponential(10.0, 1000))) for _ in range(800)]
    assert np.mean([a.cvar_cm_s for a in found]) == pytest.approx(truth, rel=0.01)
    inside = np.mean([a.cvar_interval[0] <= truth <= a.cvar_interval[1] for a in found])
    assert 0.92 < inside < 0.97


def test_the_excess_over_a_limit_and_the_coverage_of_its_interval():
    """Closed form for the exponential distribution: mean × exp(-limit / mean)."""
    rng = np.random.default_rng(2)
    truth = 10.0 * math.exp(-1.97)
    found = [assess(judged(rng.exponential(10.0, 1000))).p_exceed[0] for _ in range(800)]
    assert np.mean([e.excess_cm_s for e in found]) == pytest.approx(truth, rel=0.02)
    inside = np.mean([e.excess_interval[0] <= truth <= e.excess_interval[1] for e in found])
    assert 0.92 < inside < 0.97


def test_switches_that_never_touch_have_no_speed_to_exceed_anything():
    a = assess(judged([math.nan] * 5 + [30.0] * 5))
    assert a.p_exceed[0].excess_cm_s == pytest.approx(10.3)
    assert a.cvar_cm_s == pytest.approx(30.0)
    nothing = assess(judged([math.nan] * 5))
    assert math.isnan(nothing.p_exceed[0].excess_cm_s)
    assert math.isnan(nothing.cvar_cm_s)


def test_g_of_the_tail_is_its_mean_and_the_penalty():
    v = np.linspace(1.0, 20.0, 200)
    closed = np.ones(200, dtype=bool)
    closed[:10] = False
    plain, tail = (assess(judged(v, closed), risk=r) for r in ("quantile", "cvar"))
    assert plain.g_cm_s == plain.v_u_cm_s + 25.0 * 0.05
    assert tail.g_cm_s == pytest.approx(tail.cvar_cm_s + 25.0 * 0.05)
    assert tail.v_u_cm_s == plain.v_u_cm_s
    assert tail.cvar_cm_s > plain.v_u_cm_s


@pytest.mark.parametrize("sign", [-1.0, 0.0, 1.0])
def test_the_interval_of_g_of_the_tail_covers_it_whichever_switches_stay_open(sign):
    """Open switches among the fast, the slow or any: the two parts of g are estimated from the same switches."""
    rng = np.random.default_rng(3)

    def draws(n):
        v = rng.exponential(10.0, n)
        p = 0.1 + sign * 0.08 * np.tanh((v - 10.0) / 10.0)
        return v, rng.random(n) > p

    v, closed = draws(2_000_000)
    truth = assess(judged(v, closed), risk="cvar").g_cm_s
    found = [assess(judged(*draws(800)), risk="cvar") for _ in range(600)]
    inside = np.mean([a.g_interval[0] <= truth <= a.g_interval[1] for a in found])
    assert 0.915 < inside < 0.975
    spread = np.std([a.g_cm_s for a in found])
    assert np.mean([a.g_se_cm_s for a in found]) == pytest.approx(spread, rel=0.1)


def test_another_risk_is_refused():
    with pytest.raises(ObjectiveError, match="it must be one of quantile, cvar"):
        assess(judged([1.0, 2.0]), risk="worst")
    with pytest.raises(ConfigError, match=r"objective\.risk is"):
        load_config({"objective": {"risk": "worst"}})


def test_a_campaign_s_risk_is_what_it_is_judged_by():
    c = load_config({"objective": {"risk": "cvar", "level": 0.8}})
    v = np.linspace(1.0, 20.0, 200)
    assert judge(c, judged(v)).g_cm_s == assess(judged(v), risk="cvar", level=0.8).g_cm_s


def test_a_switch_that_is_held_too_late_counts_as_open():
    drive = Waveform.from_rows([(0.0, 4.0, 6.0, 150.0), (25.0, 20.0, None, 80.0)])
    plain = load_config({})
    lot = draw(plain, 300, seed=1)
    found = respond(plain, lot, drive)
    settled = np.sort(found.settling_us[found.closed])
    limit = float(settled[settled.size // 3]) + 1e-6
    strict = replace(plain, objective=replace(plain.objective, closed_by_us=limit))
    again = respond(strict, lot, drive)
    np.testing.assert_array_equal(again.closed, found.closed, "what a switch does is as it was")
    by_then = found.closed & (found.settling_us <= limit)
    np.testing.assert_array_equal(in_time(again, limit), by_then)
    np.testing.assert_array_equal(in_time(again, 0.0), found.closed)
    judged_strictly = judge(strict, found)
    assert judged_strictly.p_nc == np.mean(~by_then)
    assert (judged_strictly.closed_by_us, judge(plain, found).closed_by_us) == (limit, 0.0)
    assert evaluate(strict, lot, drive).p_nc > evaluate(plain, lot, drive).p_nc + 0.4
    np.testing.assert_array_equal(again.max_contact_speed, found.max_contact_speed)


def test_an_assured_limit_counts_what_p_nc_may_be():
    """With two of a thousand open the estimate keeps 0.3 %, the interval does not."""
    v = np.linspace(1.0, 20.0, 1000)
    closed = np.ones(1000, dtype=bool)
    closed[:2] = False
    asked = {"form": "chance", "p_max": 0.003, "chance_penalty_cm_s": 1000.0}
    plain, assured = assess(judged(v, closed), **asked), assess(judged(v, closed), **asked, assured=True)
    assert plain.g_cm_s == plain.v_u_cm_s
    upper = plain.p_nc_intervals.wilson[1]
    assert upper > 0.003
    assert assured.g_cm_s == pytest.approx(plain.v_u_cm_s + 1000.0 * (upper - 0.003))
    none_open = np.ones(100_000, dtype=bool)
    many = np.linspace(1.0, 20.0, 100_000)
    assert assess(judged(many, none_open), **asked, assured=True).g_cm_s == pytest.approx(18.1, abs=0.01)


def test_the_penalty_form_has_no_limit_to_assure():
    v = np.linspace(1.0, 20.0, 200)
    assert assess(judged(v), assured=True).g_cm_s == assess(judged(v)).g_cm_s


def test_a_campaign_hands_its_limit_on():
    asked = {"form": "chance", "p_max": 0.01, "assured": True, "chance_penalty_cm_s": 70.0}
    c = load_config({"objective": asked})
    v, closed = np.linspace(1.0, 20.0, 200), np.ones(200, dtype=bool)
    closed[:9] = False
    assert judge(c, judged(v, closed)).g_cm_s == assess(judged(v, closed), **asked).g_cm_s
