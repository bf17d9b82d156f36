"""Claims about the first contact on one Taylor polynomial, against its roots. Plain numbers: no switch, no waveform."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from softclose.kernel.contact import NONE, UNDECIDED, first_contact

NEAR = 1e-6
ORDER = 16


def contact(
    coefficients: list[float], h: float, travel: float, *, launched: bool = False, bend: float | None = None
) -> tuple[float, float]:
    """First contact of the polynomial with these leading coefficients within h."""
    x = np.polynomial.Polynomial(coefficients)
    if bend is None:
        bend = 1.001 * float(np.abs(x.deriv(2)(np.linspace(0.0, h, 2001))).max())
    series = tuple(map(float, [*coefficients, *[0.0] * (ORDER + 1 - len(coefficients))]))
    v_end = float(x.deriv()(h))
    found: Any = first_contact(series, float(h), float(travel - coefficients[0]), launched, v_end, float(bend), NEAR)
    return float(found[0]), float(found[1])


def roots(coefficients: list[float], travel: float) -> np.ndarray:
    """Positive instants at which the polynomial is at the travel, ascending."""
    found = (np.polynomial.Polynomial(coefficients) - travel).roots()
    return np.sort(found[np.isreal(found)].real[found[np.isreal(found)].real > 1e-9])


def test_it_is_the_first_root_or_there_is_none() -> None:
    rng = np.random.default_rng(3)
    found = 0
    for _ in range(300):
        coefficients = [float(rng.uniform(-1.0, 0.99)), *rng.uniform(-0.5, 0.5, rng.integers(2, 6)).tolist()]
        h = float(rng.uniform(0.5, 4.0))
        crossings = roots(coefficients, 1.0)
        slope = np.polynomial.Polynomial(coefficients).deriv()
        assert all(abs(slope(c)) > 1e-4 for c in crossings)  # grazing has a test of its own
        tau, speed = contact(coefficients, h, 1.0)
        inside = crossings[crossings < h]
        found += inside.size > 0
        if inside.size == 0:
            assert (tau, speed) == (NONE, 0.0)
        else:
            assert tau == pytest.approx(inside[0], abs=1e-9)
            assert speed == pytest.approx(slope(inside[0]), abs=1e-9)
    assert 50 < found < 250


@pytest.mark.parametrize("above", [1e-3, 1e-8])
def test_a_contact_between_two_ends_that_are_both_below_is_found(above: float) -> None:
    peak = [1.0 + above - 0.25, 0.5, -0.25]  # 1 + above at 1
    tau, speed = contact(peak, 2.0, 1.0)
    assert tau == pytest.approx(1.0 - 2.0 * math.sqrt(above), abs=1e-9)
    assert speed == pytest.approx(math.sqrt(above), rel=1e-5)
    assert contact([1.0 - above - 0.25, 0.5, -0.25], 2.0, 1.0) == (NONE, 0.0)


@pytest.mark.parametrize(("speed", "force"), [(1e-4, 0.01), (0.5, 0.01), (1e-4, 1.0), (0.5, 1.0), (0.03, 0.2)])
def test_a_bounce_under_constant_force_returns_with_its_speed(speed: float, force: float) -> None:
    tau, back = contact([1.0, -speed, 0.5 * force], 200.0 * speed / force, 1.0, launched=True, bend=force)
    assert tau == pytest.approx(2.0 * speed / force, rel=1e-9)
    assert back == pytest.approx(speed, rel=1e-9)


def test_a_bounce_under_varying_force_returns_at_its_first_root() -> None:
    flight = [1.0, -0.3, 0.1, 0.02]
    tau, speed = contact(flight, 5.0, 1.0, launched=True)
    (expected,) = roots(flight, 1.0)
    assert tau == pytest.approx(expected, abs=1e-9)
    assert speed == pytest.approx(np.polynomial.Polynomial(flight).deriv()(expected), abs=1e-9)
    assert contact(flight, 0.9 * expected, 1.0, launched=True) == (NONE, 0.0)


@pytest.mark.parametrize("a", [1e-2, 1e-7])
def test_a_switch_released_at_rest_comes_back_at_the_root_of_its_cubic(a: float) -> None:
    away_and_back = [1.0, 0.0, 0.0, -a, a / 3.0]  # leaves like t³, turns at 9/4, is back at 3
    tau, speed = contact(away_and_back, 4.0, 1.0, launched=True)
    assert tau == pytest.approx(3.0, abs=1e-9)
    assert speed == pytest.approx(9.0 * a, rel=1e-9)
    assert contact(away_and_back, 3.0 - 1e-6, 1.0, launched=True) == (NONE, 0.0)
    assert contact(away_and_back, 2.0, 1.0, launched=True) == (NONE, 0.0)
    assert contact([1.0, 0.0, 0.0, -a], 4.0, 1.0, launched=True) == (NONE, 0.0)


def test_what_is_no_instant_cannot_be_taken_for_one() -> None:
    assert NONE < 0.0
    assert UNDECIDED < 0.0
    assert NONE != UNDECIDED


def test_moving_away_from_just_below_the_contact_loses_no_digits() -> None:
    # v and the root of v² + 2 bend f agree in all their digits here: their difference must not be taken.
    tau, speed = contact([1.0 - 2.0**-52, -0.5, 0.25], 4.0, 1.0)
    assert (tau, speed) == (pytest.approx(2.0), pytest.approx(0.5))


def test_an_arrival_at_the_very_end_of_the_step_is_one() -> None:
    assert contact([0.0, 1.0], 1.0, 1.0, bend=0.0) == (1.0, 1.0)
    back = [1.0, 0.0, 0.0, -0.375, 0.125]  # exact in binary, at 3 too
    tau, speed = contact(back, 3.0, 1.0, launched=True)
    assert (tau, speed) == (3.0, pytest.approx(3.375))


@pytest.mark.parametrize(("h", "tau"), [(1.0, 1.0), (0.999, NONE), (1e9, 1.0)])
def test_the_end_of_the_step_belongs_to_it(h: float, tau: float) -> None:
    assert contact([0.0, 1.0], h, 1.0, bend=1e-12)[0] == pytest.approx(tau)


def test_a_switch_at_rest_without_force_never_arrives() -> None:
    assert contact([0.5], 10.0, 1.0, bend=0.0) == (NONE, 0.0)


def test_a_bound_too_wide_to_march_through_the_step_says_how_far_it_is_sure() -> None:
    state, until = contact([0.0, 0.0, 0.5], 10.0, 1.0, bend=1e6)
    assert state == UNDECIDED
    # Sixty steps of about sqrt(2 f / bend), with f near 1.
    assert 50 * math.sqrt(2e-6) < until < 70 * math.sqrt(2e-6)


def test_starting_in_contact_and_moving_away_is_a_contact_without_speed() -> None:
    assert contact([1.0, -0.1], 1.0, 1.0) == (0.0, 0.0)
    assert contact([1.0, 0.1], 1.0, 1.0) == (0.0, 0.1)
