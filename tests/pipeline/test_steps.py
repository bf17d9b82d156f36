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
from softclose.waveform.steps import FELT_VOLT_US, FINEST_US, stepped

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
    held = n_ramps == 0
    if clock:
        assert held.all()
    if clock or step:
        assert (np.diff(pieces[:, 2]) != 0.0)[held[1:] & held[:-1]].all()  # what is held is one piece
    t = np.linspace(0.0, 99.9, 5001) + 0.0123
    at = clock * np.floor(t / clock + 1e-9) + 1e-9 if clock else t
    u = waveform.voltage(at)
    expected = step * np.round(u / step) if step else u
    inside = ~jumps_of(flat, 1e-6, t)
    assert inside.mean() > 0.9
    # Of an extremum that is over a step's edge for less than it is looked at, nothing is told.
    grazes = np.abs(np.abs(u / step - np.floor(u / step)) - 0.5) < 1e-3 if step else np.zeros(len(t), dtype=bool)
    told = held[np.searchsorted(pieces[:, 0], t, side="right") - 1] if step else np.ones(len(t), dtype=bool)
    found = Pieced(*flat).voltage(t)
    np.testing.assert_allclose(found[inside & ~grazes & told], expected[inside & ~grazes & told], atol=1e-6)
    np.testing.assert_allclose(found[~told], u[~told], atol=1e-6)


def test_the_steps_of_a_ramp_lie_where_it_is_half_a_step_off() -> None:
    pieces, *_ = stepped(RAMP, 0.0, 2.0, 30.0)
    assert len(pieces) == 51
    edges = 10.0 / math.pi * np.arccos(1.0 - (2.0 * np.arange(50) + 1.0) / 50.0)
    np.testing.assert_allclose(pieces[1:, 0], edges, atol=1e-9)
    np.testing.assert_allclose(pieces[:, 2], 2.0 * np.arange(51), atol=1e-12)


@settings(max_examples=examples(12), deadline=None, derandomize=True)
@given(waveform=pulses(), step=st.floats(0.002, 0.5))
def test_steps_that_nothing_can_feel_leave_the_curve(waveform: Waveform, step: float) -> None:
    """Between both lies an area of less than twice what is allowed for one step: what is over of them telescopes."""
    flat = stepped(waveform, 0.0, step, 6.0)
    t = np.arange(0.5e-5, 6.0, 1e-5)
    off = Pieced(*flat).voltage(t) - step * np.round(waveform.voltage(t) / step)
    assert np.abs(np.cumsum(off)).max() * 1e-5 < 2.0 * FELT_VOLT_US + 5e-5


def test_a_dip_between_two_pulses_is_told_however_short_it_is() -> None:
    """The sum of a fall and a rise turns: for a few nanoseconds it is below the edge of a step of 3 V."""
    falling = Pulse(0.0, 4.0, 6.0, 60.0)
    dip = Waveform([falling, Pulse(11.0, 4.0, math.inf, 80.0)])
    t = np.linspace(11.0, 14.0, 300_001)
    u = dip.voltage(t)
    least = int(np.argmin(u))
    assert 0 < least < len(t) - 1
    number = round(u[least] / 3.0)
    step = (u[least] + 1e-6) / (number + 0.5)
    below = t[u < (number + 0.5) * step]
    assert 0.0 < below[-1] - below[0] < 0.005
    pieces, *_ = stepped(dip, 0.0, step, 30.0)
    (told,) = [piece for piece in pieces if piece[0] < t[least] < piece[1]]
    assert told == pytest.approx([below[0], below[-1], number * step], abs=2e-5)


@pytest.mark.parametrize("start", [0.0, 7.0])
def test_fine_steps_are_told_where_a_ramp_is_flat(start: float) -> None:
    """100 V in 10 µs, steps of 0.1 V: at 5 V/µs each is 20 ns long, which is what may be left out."""
    top = Waveform([Pulse(start, 10.0, math.inf, 100.04)])
    pieces, n_ramps, ramps = stepped(top, 0.0, 0.1, 30.0)
    (curve,) = np.flatnonzero(n_ramps)
    np.testing.assert_array_equal(ramps[curve, 0], flatten_pulses(top, 30.0)[2][1 if start else 0, 0])
    leaves = 10.0 / math.pi * math.asin(0.1**2 / (8.0 * FELT_VOLT_US) / (5.0 * math.pi))
    # Never where a step can be felt, and at the next of the points at which it is looked.
    late, early = pieces[curve, 0] - (start + leaves), start + 10.0 - leaves - pieces[curve, 1]
    assert 0.0 <= late < 0.05
    assert 0.0 <= early < 0.05
    assert len(pieces) < 70
    assert pieces[-1, 2] == pytest.approx(100.0, abs=1e-9)


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
