"""Claims about the steps of a generator: each instant's voltage is that of the sample before it, rounded."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drawn import pulses
from examples import examples
from softclose import Pulse, Waveform
from softclose.waveform import Pieced
from softclose.waveform.flat import flatten_pulses
from softclose.waveform.steps import FINEST_US, MOST_STEPS, stepped

RAMP = Waveform([Pulse(0.0, 10.0, math.inf, 100.0)])


def jumps_of(flat: tuple[np.ndarray, ...], near: float, t: np.ndarray) -> np.ndarray:
    """Which instants are within so much of one at which a voltage begins [µs]."""
    begins = flat[0][:, 0]
    after = np.clip(np.searchsorted(begins, t), 0, len(begins) - 1)
    before = np.clip(after - 1, 0, None)
    return np.minimum(np.abs(begins[after] - t), np.abs(begins[before] - t)) < near


@settings(max_examples=examples(60), deadline=None, derandomize=True)
@given(
    waveform=pulses(),
    clock=st.one_of(st.just(0.0), st.floats(0.02, 3.0)),
    step=st.one_of(st.just(0.0), st.floats(0.2, 5.0)),
)
def test_each_voltage_is_the_sample_before_it_rounded(waveform: Waveform, clock: float, step: float) -> None:
    flat = stepped(waveform, clock, step, 100.0)
    pieces, n_ramps, _ = flat
    assert pieces[0, 0] == 0.0
    assert pieces[-1, 1] == 100.0
    np.testing.assert_array_equal(pieces[1:, 0], pieces[:-1, 1])
    if clock or step:
        assert not n_ramps.any()
        assert (np.diff(pieces[:, 2]) != 0.0).all()  # what is held is one piece
    t = np.linspace(0.0, 99.9, 5001) + 0.0123
    at = clock * np.floor(t / clock + 1e-9) + 1e-9 if clock else t
    u = waveform.voltage(at)
    expected = step * np.round(u / step) if step else u
    inside = ~jumps_of(flat, 1e-6, t)
    assert inside.mean() > 0.9
    # Of an extremum that is over a step's edge for less than it is looked at, nothing is told.
    grazes = np.abs(np.abs(u / step - np.floor(u / step)) - 0.5) < 1e-3 if step else np.zeros(len(t), dtype=bool)
    np.testing.assert_allclose(Pieced(*flat).voltage(t)[inside & ~grazes], expected[inside & ~grazes], atol=1e-6)


def test_the_steps_of_a_ramp_lie_where_it_is_half_a_step_off() -> None:
    pieces, *_ = stepped(RAMP, 0.0, 2.0, 30.0)
    assert len(pieces) == 51
    edges = 10.0 / math.pi * np.arccos(1.0 - (2.0 * np.arange(50) + 1.0) / 50.0)
    np.testing.assert_allclose(pieces[1:, 0], edges, atol=1e-9)
    np.testing.assert_allclose(pieces[:, 2], 2.0 * np.arange(51), atol=1e-12)


def test_steps_that_are_too_many_leave_the_curve_and_round_what_is_held() -> None:
    fine = 100.0 / (2 * MOST_STEPS)
    top = Waveform([Pulse(0.0, 10.0, math.inf, 100.0 + 0.4 * fine)])
    pieces, n_ramps, ramps = stepped(top, 0.0, fine, 30.0)
    assert n_ramps.tolist() == [1, 0]
    np.testing.assert_array_equal(ramps[0], flatten_pulses(top, 30.0)[2][0])
    assert pieces[1, 2] == pytest.approx(100.0, abs=1e-9)


def test_a_clock_that_nothing_can_feel_is_its_mean_delay() -> None:
    clock = 0.8 * FINEST_US
    pieces, n_ramps, _ = found = stepped(RAMP, clock, 0.0, 30.0)
    assert n_ramps.tolist() == [0, 1, 0]
    assert pieces[1, 0] == pytest.approx(0.5 * clock)
    t = np.linspace(1.0, 9.0, 50)
    np.testing.assert_allclose(Pieced(*found).voltage(t + 0.5 * clock), RAMP.voltage(t), atol=1e-9)


def test_an_edge_on_a_sample_is_in_that_sample() -> None:
    for start in (0.3, 0.7, 2.9):
        pieces, *_ = stepped(Waveform([Pulse(start, 0.0, math.inf, 50.0)]), 0.1, 0.0, 10.0)
        np.testing.assert_allclose(pieces[:, 0], [0.0, start], atol=1e-12)
