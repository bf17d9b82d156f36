"""Claims about a limit on p_nc: the interval decides."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom

from softclose.metrics.intervals import least_for_quantile_interval, proportion, quantile_interval
from softclose.metrics.limit import least_for_limit, limit_on
from softclose.metrics.objective import assess


class Made:
    def __init__(self, n: int, n_open: int) -> None:
        self.max_contact_speed = np.full(n, 0.1)
        self.closed = np.arange(n) >= n_open


@pytest.mark.parametrize(
    ("n_open", "n", "verdict"),
    [
        (0, 200, "not established"),
        (0, 367, "not established"),
        (0, 368, "met"),
        (10, 200, "exceeded"),
        (3, 200, "not established"),
    ],
)
def test_the_interval_decides(n_open: int, n: int, verdict: str) -> None:
    a = assess(Made(n, n_open), form="chance", p_max=0.01)
    assert a.limit is not None
    assert a.limit.verdict == verdict
    assert a.feasible == (verdict == "met")
    assert a.limit.sentence.startswith(f"at most 1 % left open is {verdict}: {n_open} of {n} open")


def test_a_limit_is_hardly_ever_met_by_a_lot_that_breaks_it() -> None:
    # Exactly: the chance that a lot at the limit is called met is at most half of 5 %.
    for n in (100, 400, 2000):
        wrong = sum(
            binom.pmf(k, n, 0.01)
            for k in range(n // 20 + 1)
            if limit_on(proportion(k, n), 0.01, 0.95, valid=True).verdict == "met"
        )
        assert wrong <= 0.025


def test_the_least_ensemble_that_can_establish_a_limit() -> None:
    assert least_for_limit(0.01, 0.95) == 368
    assert least_for_limit(0.0, 0.95) is None
    assert "no ensemble can establish 0" in limit_on(proportion(0, 50), 0.0, 0.95, valid=True).sentence
    assert "at least 368 switches are needed" in limit_on(proportion(0, 50), 0.01, 0.95, valid=True).sentence


def test_quasi_random_switches_establish_nothing() -> None:
    a = assess(Made(5000, 0), form="chance", p_max=0.01, sampling="sobol")
    assert a.limit is not None
    assert (a.limit.verdict, a.feasible) == ("not established", False)
    assert "quasi-random" in a.limit.sentence


def test_the_penalty_form_has_no_limit() -> None:
    assert assess(Made(50, 20)).limit is None
    assert assess(Made(50, 20)).feasible


def test_the_least_that_bounds_a_quantile_from_above() -> None:
    assert least_for_quantile_interval(0.9) == 36
    assert np.isinf(quantile_interval(np.arange(35.0), 0.9)[1])
    assert np.isfinite(quantile_interval(np.arange(36.0), 0.9)[1])
