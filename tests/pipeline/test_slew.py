"""Claims about a slew limit in closed form: the limiter's own definition in small steps, and its pieces."""

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
from softclose.waveform.slew import limited
from softclose.waveform.steps import stepped

STEP_US = 0.002


def followed(volts: np.ndarray, most: float) -> np.ndarray:
    """From 0 V on, by at most so much a step."""
    y, found = 0.0, []
    for goal in volts.tolist():
        y += min(max(goal - y, -most), most)
        found.append(y)
    return np.array(found)


@settings(max_examples=examples(40), deadline=None, derandomize=True)
@given(waveform=pulses(), slew=st.floats(1.0, 60.0), clock=st.sampled_from([0.0, 0.0, 0.7]))
def test_a_limited_drive_follows_its_command_as_fast_as_it_may(waveform: Waveform, slew: float, clock: float) -> None:
    command = stepped(waveform, clock, 0.0, 100.0)
    flat = limited(*command, slew)
    pieces = flat[0]
    assert pieces[0, 0] == 0.0
    assert pieces[-1, 1] == 100.0
    np.testing.assert_array_equal(pieces[1:, 0], pieces[:-1, 1])
    t = np.arange(0.0, 100.0 - STEP_US, STEP_US)
    expected = followed(Pieced(*command).voltage(t + 0.5 * STEP_US), slew * STEP_US)
    found = Pieced(*flat).voltage(t + STEP_US)
    np.testing.assert_allclose(found, expected, atol=1.5 * slew * STEP_US)  # jumps lie within steps
    assert np.abs(np.diff(found)).max() <= slew * STEP_US * (1.0 + 1e-6) + 1e-9


def test_a_rise_is_a_cosine_a_line_and_a_cosine() -> None:
    """100 V in 10 µs, at 12 V/µs for 15.7 at most: it leaves where its slope is the limit."""
    command = flatten_pulses(Waveform([Pulse(0.0, 10.0, math.inf, 100.0)]), 60.0)
    pieces, n_ramps, ramps = limited(*command, 12.0)
    assert n_ramps.tolist() == [1, 1, 1, 0]
    leaves = 10.0 / math.pi * math.asin(12.0 / (5.0 * math.pi))
    assert pieces[0, 1] == pytest.approx(leaves, abs=1e-8)
    meets = pieces[1, 1]
    at = 50.0 - 50.0 * math.cos(math.pi * leaves / 10.0)
    assert at + 12.0 * (meets - leaves) == pytest.approx(50.0 - 50.0 * math.cos(math.pi * meets / 10.0), abs=1e-6)
    joins = Pieced(pieces, n_ramps, ramps)
    ends = pieces[:-1, 1]
    np.testing.assert_allclose(joins.voltage(ends - 1e-9), joins.voltage(ends), atol=1e-6)
    np.testing.assert_array_equal(ramps[0, 0], command[2][0, 0])
    assert pieces[3, 2] == 100.0


def test_a_limit_that_nothing_reaches_changes_nothing() -> None:
    command = flatten_pulses(Waveform([Pulse(0.0, 8.0, 5.0, 90.0), Pulse(30.0, 9.0, math.inf, 70.0)]), 120.0)
    pieces, n_ramps, ramps = limited(*command, 40.0)
    np.testing.assert_array_equal(pieces, command[0])
    np.testing.assert_array_equal(n_ramps, command[1])
    np.testing.assert_array_equal(ramps[:, 0], command[2][:, 0])


def test_a_step_takes_its_volts_over_the_limit() -> None:
    command = flatten_pulses(Waveform([Pulse(5.0, 0.0, 20.0, 90.0)]), 100.0)
    pieces, n_ramps, _ = limited(*command, 4.5)
    np.testing.assert_allclose(pieces[:, 0], [0.0, 5.0, 25.0, 45.0], atol=1e-9)
    assert n_ramps.tolist() == [0, 1, 1, 0]
    found = Pieced(*limited(*command, 4.5)).voltage([15.0, 24.999, 35.0])
    np.testing.assert_allclose(found, [45.0, 90.0, 45.0], atol=0.01)
