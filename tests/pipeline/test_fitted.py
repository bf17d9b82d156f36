"""Claims about sampled drives as polynomials: they have the area of the samples, and move switches as these do."""

from __future__ import annotations

import itertools
import math
from unittest import mock

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from examples import examples
from reference import reference
from softclose import Pulse, Waveform, load_population, simulate
from softclose.kernel import pieces
from softclose.kernel.pieces import flatten, voltage
from softclose.waveform import Fitted, Trace, WaveformError

SOFT = Waveform([Pulse(0, 4.4, 7.25, 111.6), Pulse(56.5, 19, math.inf, 75)])
T = np.arange(0.0, 250.05, 0.05)
STEPS = st.lists(st.tuples(st.floats(0.01, 3.0), st.floats(-120.0, 120.0)), min_size=2, max_size=60)


def areas(t: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Area from the first instant to each [V µs], u a line between them."""
    return np.append(0.0, np.cumsum(0.5 * (u[1:] + u[:-1]) * np.diff(t)))


@settings(max_examples=examples(60), deadline=None, derandomize=True)
@given(steps=STEPS, tolerance=st.floats(1e-3, 5.0), horizon=st.floats(0.5, 250.0))
def test_the_area_is_that_of_the_samples_to_the_tolerance(
    steps: list[tuple[float, float]], tolerance: float, horizon: float
) -> None:
    trace = Trace(np.append(0.0, np.cumsum([s for s, _ in steps])), np.append(0.0, [u for _, u in steps]))
    fitted = Fitted.of(trace, tolerance)
    assert set(fitted.knots) <= set(trace.times_us)
    for begin, end in itertools.pairwise(fitted.knots):
        t = np.unique(
            np.append(np.linspace(begin, end, 4001), trace.times_us[(trace.times_us > begin) & (trace.times_us < end)])
        )
        inside = np.clip(t, begin + 1e-12, end - 1e-12)
        apart = fitted.voltage(inside) - trace.voltage(inside)
        # A piece has the mean of u²: its level makes up for what swings about it.
        level = areas(t, apart)[-1] / (end - begin)
        assert np.abs(areas(t, apart - level)).max() <= 1.2 * tolerance + 1e-6
        swings = areas(t, (apart - level) ** 2)[-1]
        assert swings <= 1.5 * tolerance * max(np.abs(trace.volts).max(), 1.0) + 1e-6
    assert fitted.voltage(1e3) == trace.volts[-1]
    flat = fitted.flat(horizon)
    cut = flat[0]
    assert cut[0, 0] == 0.0
    assert cut[-1, 1] == horizon
    np.testing.assert_array_equal(cut[1:, 0], cut[:-1, 1])
    for i, (begin, end, _) in enumerate(cut):
        for t in np.linspace(begin, end, 5):
            at = np.clip(t, begin + 1e-9, end - 1e-9)
            assert voltage.py_func(*flat, i, at) == pytest.approx(float(fitted.voltage(at)), abs=1e-6)


def test_a_smooth_record_takes_tens_of_pieces_and_moves_switches_as_its_lines_do() -> None:
    trace = Trace(T, SOFT.voltage(T))
    fitted = Fitted.of(trace)
    assert len(flatten(fitted, 250.0)[0]) < 10
    np.testing.assert_array_equal(flatten(trace, 250.0)[0], flatten(fitted, 250.0)[0])
    switches = load_population("current").sample(40, seed=3)
    with mock.patch.object(pieces, "MANY", 10**6):  # as it is, line by line
        assert len(flatten(trace, 250.0)[0]) == 5000
        lines = simulate(switches, trace, max_impacts=8)
    ours = simulate(switches, fitted, max_impacts=8)
    np.testing.assert_allclose(ours.max_contact_speed, lines.max_contact_speed, atol=1e-5)
    np.testing.assert_array_equal(ours.closed, lines.closed)
    twin = simulate(switches, fitted, method="rk", rtol=1e-12, max_impacts=8)
    np.testing.assert_allclose(ours.max_contact_speed, twin.max_contact_speed, atol=1e-7)
    np.testing.assert_allclose(ours.impact_speed, twin.impact_speed, atol=1e-6)


def test_a_steep_record_is_as_its_samples_are() -> None:
    steps = np.where(T < 10.0, 0.0, np.where(T < 22.0, 110.0, np.where(T < 60.0, 5.0, 80.0)))
    fitted = Fitted.of(Trace(T, steps))
    assert len(fitted.knots) == 8
    np.testing.assert_allclose(fitted.voltage(T), steps, atol=1e-9)
    np.testing.assert_array_equal((fitted.flat(250.0)[1] > 0), [False, True] * 3 + [False])
    assert fitted.max_voltage() == pytest.approx(110.0)
    with pytest.raises(WaveformError, match="reaches 110 V; 100 V are allowed"):
        fitted.check(100.0)
    with pytest.raises(WaveformError, match="tolerance_volt_us is 0"):
        Fitted.of(Trace(T, steps), 0.0)


def test_noise_that_nothing_feels_leaves_its_mean_square() -> None:
    """A hundred times as fast as the switch: the force is that of the mean of u²."""
    t = np.arange(0.0, 250.0, 0.005)
    swinging = Trace(t, 70.0 + 0.2 * (-1.0) ** np.arange(len(t)))
    fitted = Fitted.of(swinging)
    assert len(fitted.knots) < 60
    middle = np.linspace(1.0, 249.0, 500)
    assert np.mean(fitted.voltage(middle) ** 2) - 70.0**2 == pytest.approx(0.2**2 / 3.0, rel=0.1)


def test_records_move_switches_as_an_independent_integrator_says() -> None:
    """DOP853 on the lines of a noisy record, whose polynomials the kernel takes: V within 1e-3 cm/s."""
    rng = np.random.default_rng(4)
    t = np.arange(0.0, 250.1, 0.1)
    hard = Waveform([Pulse(0.0, 6.0, 22.0, 125.0), Pulse(32.0, 8.0, math.inf, 75.0)])
    trace = Trace(t, hard.voltage(t) + 0.01 * rng.standard_normal(len(t)))
    assert len(flatten(trace, 250.0)[0]) < 0.1 * len(t)
    switches = load_population("current").sample(2, seed=9)
    found = simulate(switches, trace, horizon_us=27.0)
    for i in range(2):
        theirs = reference(switches[i], trace, horizon_us=27.0)  # type: ignore[arg-type]
        assert found.n_impacts[i] == theirs.n_impacts > 0
        assert found.max_contact_speed[i] == pytest.approx(theirs.max_contact_speed, abs=1e-5)
