"""Claims about digits: a figure and its interval have the same, enough to tell the two ends apart, and no more."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from softclose.digits import LEAST, digits_of, least_digits
from softclose.glance import ranged


@pytest.mark.parametrize(
    ("value", "lower", "upper", "least", "digits"),
    [
        (14.35, 14.3, 14.4, 2, 2),
        (0.0, 0.0, 0.0038, 2, 3),  # 0.00 (0.00-0.00) claims that no switch can stay open
        (21.29, 21.27, 21.32, 1, 2),
        (15.0, 15.0, 15.0, 0, 0),  # a count that every draw has is no interval of rounding
        (0.0, -1e-19, 0.0038, 2, 3),  # Wilson's lower end may be a rounding error below 0
        (13.57, math.nan, math.nan, 2, 2),
        (0.00123, math.nan, math.nan, 2, 4),  # a value that is not 0 does not look like 0
        (-0.00123, math.nan, math.nan, 2, 4),
        (0.0, math.nan, math.nan, 2, 2),
        (math.nan, math.nan, math.nan, 2, 2),
        (math.inf, 67.1, math.inf, 1, 1),
        (1.0, 1.0, 1.0 + 1e-13, 2, 6),
    ],
)
def test_digits(value: float, lower: float, upper: float, least: int, digits: int) -> None:
    assert digits_of(value, lower, upper, least) == digits


@given(st.floats(-1e3, 1e3), st.floats(1e-4, 1e3))
def test_ends_that_differ_look_different_with_as_few_digits_as_that_takes(lower: float, width: float) -> None:
    digits = digits_of(lower + 0.5 * width, lower, lower + width)
    assert f"{lower:z.{digits}f}" != f"{lower + width:z.{digits}f}"
    fewer = digits - 1
    assert digits == LEAST or f"{lower:z.{fewer}f}" == f"{lower + width:z.{fewer}f}"


def test_times_have_one_digit_and_counts_none() -> None:
    assert [least_digits(unit) for unit in ("µs", "1", "cm/s", "V")] == [1, 0, LEAST, LEAST]


def test_what_is_seen_at_a_prompt_follows_the_same_rule() -> None:
    assert ranged(0.0, 0.0, 0.0038, "%") == "0.000 % (0.000–0.004)"
    assert ranged(17.9, 17.56, 18.31, "cm/s") == "17.90 cm/s (17.56–18.31)"
