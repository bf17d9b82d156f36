"""Claims about sampled drives as polynomials: they meet the samples, join, and move switches as the samples do."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from examples import examples
from softclose import Pulse, Waveform, load_population, simulate
from softclose.kernel.pieces import flatten, voltage
from softclose.waveform import Fitted, Trace, WaveformError

SOFT = Waveform([Pulse(0, 4.4, 7.25, 111.6), Pulse(56.5, 19, math.inf, 75)])
T = np.arange(0.0, 250.05, 0.05)
STEPS = st.lists(st.tuples(st.floats(0.01, 3.0), st.floats(-120.0, 120.0)), min_size=2, max_size=60)


@settings(max_examples=examples(60), deadline=None, derandomize=True)
@given(steps=STEPS, tolerance=st.floats(1e-3, 5.0), horizon=st.floats(0.5, 250.0))
def test_every_sample_is_met_to_the_tolerance_and_the_pieces_join(
    steps: list[tuple[float, float]], tolerance: float, horizon: float
) -> None:
    trace = Trace(np.append(0.0, np.cumsum([s for s, _ in steps])), np.append(0.0, [u for _, u in steps]))
    fitted = Fitted.of(trace, tolerance)
    assert np.abs(fitted.voltage(trace.times_us) - trace.volts).max() <= tolerance + 1e-9
    np.testing.assert_allclose(fitted.voltage(fitted.knots), trace.voltage(fitted.knots), atol=1e-8)
    assert fitted.voltage(1e3) == pytest.approx(trace.volts[-1])
    flat = fitted.flat(horizon)
    pieces = flat[0]
    assert pieces[0, 0] == 0.0
    assert pieces[-1, 1] == horizon
    np.testing.assert_array_equal(pieces[1:, 0], pieces[:-1, 1])
    for i, (begin, end, _) in enumerate(pieces):
        for t in np.linspace(begin, end, 5):
            inside = np.clip(t, begin + 1e-9, end - 1e-9)
            assert voltage.py_func(*flat, i, inside) == pytest.approx(float(fitted.voltage(inside)), abs=1e-6)


def test_a_smooth_record_takes_tens_of_pieces_and_moves_switches_as_its_lines_do() -> None:
    trace = Trace(T, SOFT.voltage(T))
    fitted = Fitted.of(trace, 1e-3)
    assert len(flatten(fitted, 250.0)[0]) < 30
    switches = load_population("current").sample(40, seed=3)
    lines, ours = simulate(switches, trace, max_impacts=8), simulate(switches, fitted, max_impacts=8)
    np.testing.assert_allclose(ours.max_contact_speed, lines.max_contact_speed, atol=1e-4)
    np.testing.assert_array_equal(ours.closed, lines.closed)
    twin = simulate(switches, fitted, method="rk", rtol=1e-12, max_impacts=8)
    np.testing.assert_allclose(ours.max_contact_speed, twin.max_contact_speed, atol=1e-7)
    np.testing.assert_allclose(ours.impact_speed, twin.impact_speed, atol=1e-6)


def test_a_steep_record_is_as_its_samples_are() -> None:
    steps = np.where(T < 10.0, 0.0, np.where(T < 22.0, 110.0, np.where(T < 60.0, 5.0, 80.0)))
    fitted = Fitted.of(Trace(T, steps), 0.01)
    assert np.abs(fitted.voltage(T) - steps).max() < 0.01
    assert len(fitted.knots) < 20
    assert fitted.max_voltage() == pytest.approx(110.0, abs=0.02)
    with pytest.raises(WaveformError, match="reaches 110 V; 100 V are allowed"):
        fitted.check(100.0)
    with pytest.raises(WaveformError, match="tolerance_volts is 0"):
        Fitted.of(Trace(T, steps), 0.0)
