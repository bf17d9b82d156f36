"""Claims about both integrators: the slow oracle, the closed forms of SPEC §8, contact and release."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from examples import examples, in_turn
from modal_reference import bounces_agree
from reference import EPS0_F_PER_M, reference
from softclose import Pulse, Waveform, simulate
from softclose.device.simulate import Status

AREA = 16700.0
MEAN = np.array([2.43, 3.68, 65.3, 3.41])
METHODS = pytest.mark.parametrize("method", ["taylor", "rk"])


def step(volts: float, start_us: float = 0.0) -> Waveform:
    return Waveform([Pulse(start_us, 0, math.inf, volts)])


def coefficients(switch: np.ndarray) -> tuple[float, float]:
    """c and k of Eq. 1 per mass."""
    return EPS0_F_PER_M * 1e6 * AREA / (2000.0 * switch[3]), switch[2] / (1000.0 * switch[3])


def pull_in_voltage(switch: np.ndarray) -> float:
    return math.sqrt(8.0 * switch[2] * switch[1] ** 3 / (27.0 * EPS0_F_PER_M * 1e6 * AREA))


switches = st.builds(
    lambda d, g, k, m: np.array([d, g, k, m]),
    st.floats(1.8, 2.8),
    st.floats(3.6, 4.4),
    st.floats(45.0, 90.0),
    st.floats(2.8, 4.2),
)


@st.composite
def waveforms(draw: st.DrawFn) -> Waveform:
    n_pulses = draw(st.integers(1, 3))
    start, pulses = 0.0, []
    for i in range(n_pulses):
        holds = i == n_pulses - 1 and draw(st.booleans())
        peak = math.inf if holds else draw(st.floats(0.0, 50.0))
        pulses.append(Pulse(start, draw(st.floats(4.0, 30.0)), peak, draw(st.floats(20.0, 150.0))))
        start += draw(st.floats(0.0, 80.0))
    waveform = Waveform(pulses)
    assume(waveform.max_voltage() <= 150.0)
    return waveform


@pytest.mark.slow
@METHODS
@settings(max_examples=examples(10), deadline=None, derandomize=True)
@given(switch=switches, waveform=waveforms())
def test_agrees_with_the_slow_oracle(method, switch, waveform):
    slow = reference(switch, waveform)
    assume(slow.closest_miss_um > 1e-6)
    assume(min(slow.impact_speed, default=1.0) > 1e-9)
    fast = simulate(switch[None], waveform, method=method, max_impacts=64)
    assert fast.status[0] == Status.OK
    assert fast.n_impacts[0] == slow.n_impacts
    assert fast.closed[0] == slow.closed
    n = min(slow.n_impacts, 64)
    np.testing.assert_allclose(fast.impact_speed[0, :n], slow.impact_speed[:n], rtol=1e-6, atol=1e-7)
    np.testing.assert_allclose(fast.impact_time_us[0, :n], slow.impact_time_us[:n], atol=1e-4)
    np.testing.assert_allclose(fast.settling_us[0], slow.settling_us, atol=1e-4)
    np.testing.assert_allclose(fast.final_x[0], slow.final_x, atol=1e-5)
    if n:
        assert abs(fast.max_contact_speed[0] - slow.max_contact_speed) < 1e-5
        assert fast.first_contact_us[0] == fast.impact_time_us[0, 0]


@settings(max_examples=examples(60), deadline=None, derandomize=True)
@given(waveform=waveforms(), seed=st.integers(0, 2**32 - 1))
def test_the_kernel_agrees_with_its_twin_at_a_thousand_times_its_tolerance(waveform, seed):
    rng = np.random.default_rng(seed)
    table = rng.uniform((1.8, 3.6, 45.0, 2.8), (2.8, 4.4, 90.0, 4.2), size=(20, 4))
    nudged = np.concatenate([table + shift * np.array([1e-6, 0.0, 0.0, 0.0]) for shift in (0, 1, -1)])
    tight = simulate(nudged, waveform, method="rk", rtol=1e-12, max_impacts=64)
    count, closed = tight.n_impacts.reshape(3, -1), tight.closed.reshape(3, -1)
    regular = (count == count[0]).all(axis=0) & (closed == closed[0]).all(axis=0)  # the others graze: SPEC §8
    assert regular.mean() >= 0.8
    fast = simulate(table, waveform, max_impacts=64)
    assert (fast.status == Status.OK).all()
    bounces_agree(fast, tight, regular)
    np.testing.assert_array_equal(fast.closed[regular], closed[0, regular])
    np.testing.assert_allclose(fast.max_contact_speed[regular], tight.max_contact_speed[:20][regular], atol=1e-5)


@METHODS
def test_impact_speed_under_a_step_is_that_of_energy_conservation(method):
    table = np.random.default_rng(5).uniform((2.3, 3.6, 50.0, 3.0), (2.7, 3.9, 80.0, 3.8), size=(200, 4))
    r = simulate(table, step(100.0), method=method, max_impacts=8)
    for switch, v, speeds in zip(table, r.max_contact_speed, r.impact_speed, strict=True):
        c, k = coefficients(switch)
        d, g = switch[:2]
        energy = c * 100.0**2 * (1.0 / (g - d) - 1.0 / g) - 0.5 * k * d * d
        assert v == pytest.approx(math.sqrt(2.0 * energy), rel=2e-8)
        # Each later bounce returns with exactly eta times the speed.
        np.testing.assert_allclose(speeds, v * 0.5 ** np.arange(8), rtol=1e-6)


@METHODS
def test_small_bounces_under_a_step_last_a_geometric_series(method):
    r = simulate(MEAN[None], step(100.0), method=method, max_impacts=20)
    n = int(r.n_impacts[0])
    times, speeds = r.impact_time_us[0, :n], r.impact_speed[0, :n]
    c, k = coefficients(MEAN)
    force = c * (100.0 / (MEAN[1] - MEAN[0])) ** 2 - k * MEAN[0]
    intervals = np.diff(times)
    np.testing.assert_allclose(intervals[8:], 2.0 * 0.5 * speeds[8:-1] / force, rtol=1e-5)
    np.testing.assert_allclose(intervals[9:] / intervals[8:-1], 0.5, rtol=1e-5)
    assert 0.5 * speeds[-1] < 1e-5 <= 0.5 * speeds[-2]
    assert r.settling_us[0] == times[-1]


@METHODS
def test_motion_without_voltage_is_harmonic(method):
    times = np.linspace(30.0, 250.0, 300)
    r = simulate(MEAN[None], Waveform([Pulse(0, 4, 4, 60)]), method=method, times_us=times)
    assert r.n_impacts[0] == 0
    omega = math.sqrt(coefficients(MEAN)[1])
    phase = omega * (times - 30.0)
    x0, v0 = r.x[0, 0], r.v[0, 0]
    np.testing.assert_allclose(r.x[0], x0 * np.cos(phase) + v0 / omega * np.sin(phase), atol=2e-6)
    np.testing.assert_allclose(r.v[0], v0 * np.cos(phase) - x0 * omega * np.sin(phase), atol=2e-6)


@METHODS
def test_energy_is_conserved_on_constant_voltage(method):
    times = np.linspace(60.0, 250.0, 400)
    r = simulate(MEAN[None], Waveform([Pulse(0, 20, math.inf, 50)]), method=method, times_us=times)
    c, k = coefficients(MEAN)
    energy = 0.5 * r.v[0] ** 2 + 0.5 * k * r.x[0] ** 2 - c * 50.0**2 / (MEAN[1] - r.x[0])
    assert r.n_impacts[0] == 0
    np.testing.assert_allclose(energy, energy[0], atol=1e-8)


@METHODS
def test_a_step_closes_the_switch_below_the_static_pull_in_voltage(method):
    # Dynamic pull-in: x = G/2 with v = 0 at sqrt(27/32) of the static voltage of Eq. 3, if the contact lies beyond G/2.
    dynamic = pull_in_voltage(MEAN) * math.sqrt(27.0 / 32.0)
    below = simulate(MEAN[None], step(0.999 * dynamic), method=method, horizon_us=2000.0)
    above = simulate(MEAN[None], step(1.001 * dynamic), method=method, horizon_us=2000.0)
    assert math.isnan(below.max_contact_speed[0])
    assert below.first_contact_us[0] == math.inf
    assert above.closed[0]


@METHODS
def test_a_slow_ramp_closes_the_switch_at_the_static_pull_in_voltage(method):
    v_pi = pull_in_voltage(MEAN)
    ramp = {"horizon_us": 40_000.0, "method": method}
    assert simulate(MEAN[None], Waveform([Pulse(0, 20_000, math.inf, 1.002 * v_pi)]), **ramp).n_impacts[0] > 0
    assert simulate(MEAN[None], Waveform([Pulse(0, 20_000, math.inf, 0.998 * v_pi)]), **ramp).n_impacts[0] == 0


@METHODS
@pytest.mark.parametrize("start_us", in_turn([96.0, 97.0, 98.0], 3))
def test_a_held_switch_is_released_in_a_dip_that_the_ends_of_its_piece_do_not_show(method, start_us):
    # One pulse falls while the next rises. Both ends of the overlap are above the hold voltage, its middle is below.
    waveform = Waveform([Pulse(0, 20, 70, 100), Pulse(start_us, 20, math.inf, 100)])
    c, k = coefficients(MEAN)
    hold = (MEAN[1] - MEAN[0]) * math.sqrt(k * MEAN[0] / c)
    t = np.linspace(start_us, 110.0, 100_001)
    u = waveform.voltage(t)
    assert min(u[0], u[-1]) > hold > u.min()
    first_below = float(t[u < hold][0])
    slow = reference(MEAN, waveform)
    times = np.array([first_below - 1e-3, first_below + 1.0])
    r = simulate(MEAN[None], waveform, method=method, times_us=times, max_impacts=64)
    assert r.x[0, 0] == MEAN[0]
    assert r.x[0, 1] < MEAN[0]
    assert r.n_impacts[0] == slow.n_impacts
    assert r.closed[0]
    np.testing.assert_allclose(r.impact_time_us[0, : slow.n_impacts], slow.impact_time_us, atol=1e-4)
    np.testing.assert_allclose(r.impact_speed[0, : slow.n_impacts], slow.impact_speed, rtol=1e-4, atol=1e-8)
    np.testing.assert_allclose(r.settling_us[0], slow.settling_us, atol=1e-4)


@METHODS
def test_an_ideal_step_down_releases_at_its_own_instant(method):
    waveform = Waveform([Pulse(0, 0, 100, 100)])
    times = np.array([99.0, 100.0, 100.1])
    r = simulate(MEAN[None], waveform, method=method, times_us=times)
    assert r.x[0, 1] == MEAN[0]
    assert r.x[0, 2] < MEAN[0]
    assert not r.closed[0]
    assert r.settling_us[0] == math.inf


@METHODS
def test_a_double_crossing_within_one_step_is_not_missed(method):
    # Switches that just reach the contact and turn round at once: x exceeds D by little between the ends of a step.
    waveform = Waveform([Pulse(0, 4, 8, 111.6)])
    free = simulate([[3.0, *MEAN[1:]]], waveform, method=method, times_us=np.linspace(0, 60, 60_001))
    top = float(free.x[0].max())
    assert free.n_impacts[0] == 0
    table = np.repeat(MEAN[None], 4, axis=0)
    table[:, 0] = top + np.array([-1e-3, -1e-5, -1e-7, 1e-6])
    r = simulate(table, waveform, method=method, times_us=[100.0])
    np.testing.assert_array_equal(r.n_impacts > 0, [True, True, True, False])


@METHODS
def test_perfect_restitution_bounces_until_the_horizon(method):
    r = simulate(MEAN[None], step(100.0), method=method, restitution=1.0, max_impacts=256)
    n = int(r.n_impacts[0])
    assert 4 < n < 256
    assert not r.closed[0]
    assert r.status[0] == Status.OK
    np.testing.assert_allclose(r.impact_speed[0, :n], r.max_contact_speed[0], rtol=1e-6)
    np.testing.assert_allclose(np.diff(r.impact_time_us[0, :n]), np.diff(r.impact_time_us[0, :2])[0], rtol=1e-5)


@METHODS
def test_too_much_work_is_a_status_and_not_a_hang(method):
    r = simulate(np.repeat(MEAN[None], 2, axis=0), step(100.0), method=method, max_steps=5, times_us=[0.0, 200.0])
    assert (r.status == Status.WORK_LIMIT).all()
    assert not r.closed.any()
    assert np.isnan(r.settling_us).all()
    assert np.isnan(r.final_x).all()
    assert np.isnan(r.x[:, 1]).all()


@METHODS
def test_a_switch_without_voltage_stays_at_rest(method):
    r = simulate(MEAN[None], Waveform([Pulse(0, 4, 10, 0)]), method=method, times_us=[0.0, 125.0, 250.0])
    assert (r.x == 0.0).all()
    assert r.first_contact_us[0] == math.inf
    assert r.status[0] == Status.OK


def test_the_error_falls_with_the_tolerance():
    table = np.random.default_rng(8).uniform((2.3, 3.6, 50.0, 3.0), (2.7, 3.9, 80.0, 3.8), size=(100, 4))
    waveform = Waveform([Pulse(0, 6, 5, 110), Pulse(50, 18, math.inf, 80)])
    tight = simulate(table, waveform, method="rk", rtol=1e-13)
    touched = tight.n_impacts > 0
    assert touched.mean() > 0.5
    errors = []
    for rtol in (1e-6, 1e-8, 1e-10, 1e-12):
        v = simulate(table, waveform, rtol=rtol).max_contact_speed
        errors.append(float(np.median(np.abs(v - tight.max_contact_speed)[touched])))
    assert errors[0] > 10 * errors[1] > 100 * errors[2] > 1000 * errors[3]
    assert errors[1] < 1e-7


def test_rows_as_a_store_keeps_them_are_a_waveform():
    drive = Waveform([Pulse(start_us=0.0, rise_us=4.0, peak_us=math.inf, volts=100.0)])
    switches = np.array([[2.43, 3.68, 65.3, 3.41], [2.5, 3.7, 60.0, 3.3]])
    speeds = simulate(switches, drive.rows()).max_contact_speed
    np.testing.assert_array_equal(speeds, simulate(switches, drive).max_contact_speed)
    assert (speeds > 0.1).all()
