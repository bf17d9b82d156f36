"""Claims about `simulate`: what it refuses, and what a row of its answer depends on."""

from __future__ import annotations

import math

import numpy as np
import pytest

from softclose import Pulse, Waveform, simulate
from softclose.ensemble import SimulationError, Status
from softclose.waveform import WaveformError

SWITCH = np.array([[2.43, 3.68, 65.3, 3.41]])
STEP = Waveform([Pulse(0, 0, math.inf, 100)])


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ([2.43, 2.43, 65.3, 3.41], r"row 1 is .*; the gap G must be wider than the travel D"),
        ([2.43, 3.68, -1.0, 3.41], r"row 1 is .*; the stiffness K must be above 0"),
        ([2.43, 3.68, 65.3, 0.0], r"row 1 is .*; the mass M must be above 0"),
        ([0.0, 3.68, 65.3, 3.41], r"row 1 is .*; the travel D must be above 0"),
        ([2.43, math.nan, 65.3, 3.41], r"row 1 is .*; every entry must be finite"),
    ],
)
def test_names_the_first_offending_switch(row, message):
    with pytest.raises(SimulationError, match=message):
        simulate(np.vstack([SWITCH, [row], [row]]), STEP)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"restitution": 0.0}, "restitution is 0; it must be above 0 and at most 1"),
        ({"restitution": 1.1}, "restitution is 1.1"),
        ({"rtol": 0.1}, "rtol is 0.1"),
        ({"rtol": 1e-15}, "rtol is 1e-15"),
        ({"horizon_us": math.inf}, "horizon_us is inf"),
        ({"horizon_us": "long"}, "horizon_us is 'long'; it must be a number"),
        ({"times_us": [0.0, 251.0]}, "times_us runs from 0 to 251"),
        ({"times_us": [2.0, 1.0]}, "must be sorted"),
        ({"times_us": [[1.0]]}, "one-dimensional"),
        ({"times_us": [math.nan]}, "times_us runs from nan"),
        ({"method": "euler"}, "method is 'euler'; it must be one of"),
        ({"threads": 0}, "threads is 0; it must be at least 1"),
        ({"max_impacts": 1.5}, "max_impacts is 1.5; it must be a whole number"),
        ({"dtype": np.int32}, "numpy.float32 or numpy.float64"),
        ({"v_stick": 0.0}, "v_stick is 0"),
    ],
)
def test_refuses_settings_outside_their_range(settings, message):
    with pytest.raises(SimulationError, match=message):
        simulate(SWITCH, STEP, **settings)


def test_refuses_a_table_of_the_wrong_shape():
    with pytest.raises(SimulationError, match=r"shape \(4,\); it must be \(n, 4\)"):
        simulate(SWITCH[0], STEP)
    with pytest.raises(SimulationError, match="waveform is a list"):
        simulate(SWITCH, [(0, 0, math.inf, 100)])


def test_refuses_a_waveform_above_the_voltage_limit():
    with pytest.raises(WaveformError, match="160 V"):
        simulate(SWITCH, Waveform([Pulse(0, 4, 10, 160)]))
    assert simulate(SWITCH, Waveform([Pulse(0, 4, 10, 160)]), max_volts=160.0).status[0] == Status.OK


def test_an_empty_ensemble_gives_empty_responses():
    response = simulate(np.zeros((0, 4)), STEP, times_us=[1.0, 2.0], max_impacts=3)
    assert response.max_contact_speed.shape == (0,)
    assert response.x is not None
    assert response.x.shape == (0, 2)
