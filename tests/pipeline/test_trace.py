"""Claims about sampled drives: against pulses, an independent integrator and a convergence order."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from reference import reference
from softclose import Pulse, Waveform, load_population, simulate
from softclose.kernel.pieces import flatten
from softclose.kernel.pieces import voltage as voltage_on
from softclose.waveform import Trace, WaveformError, read_trace

DRIVE = Waveform([Pulse(0.0, 4.0, 3.1, 138.0), Pulse(20.0, 30.0, math.inf, 80.0)])


@pytest.fixture(scope="module")
def switches() -> np.ndarray:
    return load_population("current").sample(300, seed=1)


def _sampled(step_us: float) -> Trace:
    t = np.arange(0.0, 250.0 + step_us, step_us)
    return Trace(t, DRIVE.voltage(t))


def test_pulses_that_are_sampled_act_as_the_pulses_do_with_an_error_of_second_order(switches: np.ndarray) -> None:
    exact = simulate(switches, DRIVE)
    errors = []
    for step in (0.4, 0.2, 0.1):
        found = simulate(switches, _sampled(step))
        errors.append(float(np.nanmedian(np.abs(found.max_contact_speed - exact.max_contact_speed))))
        np.testing.assert_array_equal(found.closed, exact.closed)
    assert errors[-1] * 100.0 < 0.01  # cm/s
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)
    assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.1)


def test_both_kernels_agree_on_lines(switches: np.ndarray) -> None:
    rng = np.random.default_rng(7)
    trace = Trace(np.linspace(0.0, 250.0, 26), np.clip(80.0 + 30.0 * rng.standard_normal(26), 0.0, 150.0))
    fast, readable = (simulate(switches[:60], trace, method=m) for m in ("taylor", "rk"))
    for name in ("max_contact_speed", "final_x"):  # after twenty jolts some switches forget the ninth digit
        apart = np.abs(getattr(fast, name) - getattr(readable, name))
        assert np.nanmedian(apart) < 1e-8
        assert np.nanmax(apart) < 5e-3


def test_motion_and_impacts_under_lines_are_those_of_an_independent_integrator(switches: np.ndarray) -> None:
    trace = Trace([0.0, 6.0, 9.0, 22.0, 40.0, 90.0], [0.0, 120.0, 120.0, 20.0, 65.0, 90.0])
    ours = simulate(switches[:6], trace)
    for i in range(6):
        theirs = reference(switches[i], trace)  # type: ignore[arg-type]
        assert ours.n_impacts[i] == theirs.n_impacts
        assert bool(ours.closed[i]) == theirs.closed
        np.testing.assert_allclose(ours.max_contact_speed[i], theirs.max_contact_speed, rtol=1e-6)
        np.testing.assert_allclose(ours.first_contact_us[i], theirs.first_contact_us, atol=1e-6)


samples = st.lists(st.tuples(st.floats(0.05, 20.0), st.floats(-150.0, 150.0)), min_size=1, max_size=30)


@given(samples, st.floats(0.0, 150.0), st.floats(20.0, 400.0))
def test_the_kernels_see_the_voltage_of_the_trace(
    steps: list[tuple[float, float]], first: float, horizon: float
) -> None:
    t = np.concatenate([[0.0], np.cumsum([step for step, _ in steps])])
    trace = Trace(t, [first, *(u for _, u in steps)])
    pieces, n_ramps, ramps = flatten(trace, horizon)
    assert pieces[0, 0] == 0.0
    assert pieces[-1, 1] == horizon
    np.testing.assert_array_equal(pieces[1:, 0], pieces[:-1, 1])
    for i in range(len(pieces)):
        for at in np.linspace(pieces[i, 0], pieces[i, 1], 5):
            assert voltage_on(pieces, n_ramps, ramps, i, at) == pytest.approx(float(trace.voltage(at)), abs=1e-6)


@given(samples, st.floats(1e-6, 5.0))
def test_simplified_meets_every_sample_to_the_tolerance(steps: list[tuple[float, float]], tolerance: float) -> None:
    t = np.concatenate([[0.0], np.cumsum([step for step, _ in steps])])
    trace = Trace(t, [0.0, *(u for _, u in steps)])
    fewer = trace.simplified(tolerance)
    assert set(fewer.times_us) <= set(trace.times_us)
    assert np.abs(fewer.voltage(t) - trace.volts).max() <= tolerance * (1.0 + 1e-6) + 1e-9


def test_what_lines_meet_is_left_out() -> None:
    t = np.arange(0.0, 100.0, 0.1)
    assert Trace(t, np.where(t < 50.0, t, 50.0)).simplified(1e-9).times_us == pytest.approx([0.0, 50.0, 99.9], abs=0.11)


def test_the_force_does_not_tell_the_sign_and_the_limit_neither(switches: np.ndarray) -> None:
    trace = _sampled(0.5)
    mirrored = Trace(trace.times_us, -trace.volts)
    np.testing.assert_allclose(
        simulate(switches, trace).max_contact_speed, simulate(switches, mirrored).max_contact_speed, atol=1e-9
    )
    mirrored.check(mirrored.max_voltage())  # the limit itself is allowed
    with pytest.raises(WaveformError, match="reaches 138 V; 120 V are allowed"):
        simulate(switches, mirrored, max_volts=120.0)


@pytest.mark.parametrize(
    ("times", "volts", "said"),
    [
        ([0.0], [1.0], "two samples or more"),
        ([0.0, 1.0], [1.0], "shapes"),
        ([0.0, 1.0, 1.0], [0.0, 1.0, 2.0], "sample 3 is at 1 µs, not after sample 2"),
        ([0.0, math.nan], [0.0, 1.0], "the time of sample 2 is nan"),
        ([0.0, 1.0], [0.0, math.inf], "the voltage of sample 2 is inf"),
        ([3.0, 4.0], [0.0, 1.0], "the first sample is at 3 µs"),
        ([-3.0, 0.0], [0.0, 1.0], "nothing is applied from 0 on"),
        (["a", "b"], [0.0, 1.0], "cannot be read as numbers"),
    ],
)
def test_what_is_no_drive_is_named(times: list[float], volts: list[float], said: str) -> None:
    with pytest.raises(WaveformError) as e:
        Trace(times, volts)
    assert said in str(e.value)


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("time_us,volts\n0,0\n5,80\n250,80\n", None),
        ("# a scope\nTime (s);Channel 1 (V)\n0;0\n5e-6;80\n250e-6;80\n", None),
        ("Seconds,Volts\n0,0\n5e-6,80\n250e-6,80\n", None),
        ("t [ms]\tu [kV]\n0\t0\n0.005\t0.08\n0.25\t0.08\n", None),
        ("t,volts\n0,0\n5000,80\n250000,80\n", "ns"),
        ("time_us,volts\n-10,0\n0,0\n5,80\n250,80\n", None),
    ],
)
def test_records_of_many_makers_are_read(text: str, unit: str | None, tmp_path: Path) -> None:
    file = tmp_path / "a.csv"
    file.write_text(text)
    trace = read_trace(file, time_unit=unit)
    np.testing.assert_allclose(trace.times_us, [0.0, 5.0, 250.0], atol=1e-9)
    np.testing.assert_allclose(trace.volts, [0.0, 80.0, 80.0])
    doubled = read_trace(file, time_unit=unit, scale=1.5, shift_us=-2.5)
    np.testing.assert_allclose(doubled.volts, [60.0, 120.0, 120.0])
    np.testing.assert_allclose(doubled.times_us, [0.0, 2.5, 247.5], atol=1e-9)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("0,0\n5,80\n", "line 1: nothing says the unit of the instants (column 1)"),
        ("time_us,volts\n0,0\n5,eighty\n", "line 3: volts is 'eighty'; it must be a number"),
        ("time_us,volts\n0,0\n", "two samples or more"),
        ("", "has no table"),
    ],
)
def test_what_is_no_record_is_named_with_its_line(text: str, said: str, tmp_path: Path) -> None:
    file = tmp_path / "a.csv"
    file.write_text(text)
    with pytest.raises(WaveformError) as e:
        read_trace(file)
    assert said in str(e.value)
    assert "a.csv" in str(e.value)
