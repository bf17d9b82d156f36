"""Claims about `simulate`: what it refuses, and what a row of its answer depends on."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from softclose import Pulse, Waveform, simulate
from softclose.device.simulate import SimulationError, Status
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


def mixed_ensemble() -> tuple[np.ndarray, Waveform]:
    """Switches that stay open, bounce, close and are released, under overlapping pulses."""
    table = np.random.default_rng(11).uniform((1.8, 3.6, 45.0, 2.8), (2.8, 4.4, 90.0, 4.2), size=(97, 4))
    return table, Waveform([Pulse(0, 5, 9, 118), Pulse(40, 20, 60, 70), Pulse(125, 9, math.inf, 60)])


def assert_same_bits(a, b, rows=slice(None)):
    for name in (
        "max_contact_speed",
        "first_contact_us",
        "settling_us",
        "closed",
        "n_impacts",
        "final_x",
        "final_v",
        "status",
    ):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name)[rows], err_msg=name)


TIMES = np.linspace(0.0, 250.0, 501)
SINGLE = {"times_us": TIMES, "dtype": np.float32}
MORE = ({"times_us": TIMES}, {"max_impacts": 40}, {"times_us": TIMES[::7], "max_impacts": 3, "threads": 2})


@pytest.mark.parametrize(
    ("method", "asked"),
    [
        pytest.param("taylor", (*MORE, SINGLE), id="taylor"),
        pytest.param("rk", MORE, id="rk"),
        pytest.param("rk", (SINGLE,), id="rk, single precision", marks=pytest.mark.long),  # a kernel of its own
    ],
)
def test_a_switch_gives_the_same_bits_whatever_else_is_asked(method, asked):
    table, waveform = mixed_ensemble()
    plain = simulate(table, waveform, method=method)
    assert 0.1 < plain.closed.mean() < 0.9
    for extra in asked:
        assert_same_bits(simulate(table, waveform, method=method, **extra), plain)


@pytest.mark.parametrize("method", ["taylor", "rk"])
def test_a_switch_gives_the_same_bits_in_any_chunk_and_on_any_number_of_threads(method):
    table, waveform = mixed_ensemble()
    wanted = {"method": method, "times_us": np.linspace(0.0, 250.0, 101), "max_impacts": 16}
    whole = simulate(table, waveform, **wanted)
    for start, stop in ((0, 1), (1, 8), (8, 97), (50, 51)):
        part = simulate(table[start:stop], waveform, **wanted)
        assert_same_bits(part, whole, slice(start, stop))
        for name in ("x", "v", "impact_time_us", "impact_speed"):
            np.testing.assert_array_equal(getattr(part, name), getattr(whole, name)[start:stop], err_msg=name)
    threaded = simulate(table[::-1], waveform, threads=3, **wanted)
    assert_same_bits(threaded, whole, slice(None, None, -1))
    np.testing.assert_array_equal(threaded.x, whole.x[::-1])


def test_samples_pass_through_the_impacts_and_agree_with_the_twin():
    table, waveform = mixed_ensemble()
    times = np.linspace(0.0, 250.0, 1001)
    a = simulate(table, waveform, times_us=times, max_impacts=64, rtol=1e-11)
    b = simulate(table, waveform, times_us=times, method="rk", rtol=1e-11)
    assert (a.x <= table[:, :1] + 1e-7).all()
    np.testing.assert_array_equal(a.n_impacts, b.n_impacts)
    np.testing.assert_allclose(a.x, b.x, atol=1e-6)
    # Right at an impact a shift of 1e-9 µs exchanges the velocities before and after.
    near = np.abs(a.impact_time_us[:, :, None] - times) < 1e-6
    far = ~np.nan_to_num(near).any(axis=1)
    np.testing.assert_allclose(np.where(far, a.v, 0.0), np.where(far, b.v, 0.0), atol=1e-6)
    held = times >= a.settling_us[:, None]
    assert (a.x[held] == np.broadcast_to(table[:, :1], a.x.shape)[held]).all()
    assert (a.v[held & far] == 0.0).all()
    np.testing.assert_allclose(a.x[:, -1], a.final_x, atol=1e-12)


def test_samples_in_float32_are_the_float64_ones_to_single_precision():
    table, waveform = mixed_ensemble()
    times = np.linspace(0.0, 250.0, 251)
    fine = simulate(table, waveform, times_us=times)
    coarse = simulate(table, waveform, times_us=times, dtype=np.float32)
    assert coarse.x.dtype == np.float32
    np.testing.assert_allclose(coarse.x, fine.x, atol=1e-6)
    np.testing.assert_allclose(coarse.v, fine.v, atol=2e-7)


def test_impacts_beyond_max_impacts_are_counted_but_not_kept():
    r = simulate(SWITCH, STEP, max_impacts=3)
    many = simulate(SWITCH, STEP, max_impacts=40)
    n = int(many.n_impacts[0])
    assert 3 < n < 40
    assert r.n_impacts[0] == n
    np.testing.assert_array_equal(r.impact_time_us[0], many.impact_time_us[0, :3])
    assert np.isnan(many.impact_time_us[0, n:]).all()
    assert simulate(SWITCH, STEP).impact_time_us is None


def test_responses_label_themselves():
    times = np.linspace(0.0, 100.0, 11)
    found = simulate(np.vstack([SWITCH] * 3), STEP, times_us=times, max_impacts=2)
    labelled = found.to_xarray()
    assert dict(labelled.sizes) == {"switch": 3, "impact": 2, "time": 11}
    for name, variable in labelled.data_vars.items():
        np.testing.assert_array_equal(variable, getattr(found, name))
        assert variable.attrs["units"]
    untold = {"times_us", "mode_peak_um", "asked", "mode_x", "mode_v"}
    assert {f.name for f in dataclasses.fields(found)} - untold == set(labelled.data_vars)
    np.testing.assert_array_equal(labelled.time, times)
    assert labelled.x.attrs["units"] == "µm"
    bare = simulate(SWITCH, STEP).to_xarray()
    assert dict(bare.sizes) == {"switch": 1}
    assert "x" not in bare
