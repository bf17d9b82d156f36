"""Claims about drives behind a low-pass in closed form: the voltage against scipy, the motion against the twin."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy import signal

from examples import examples, in_turn
from modal_reference import bounces_agree
from softclose import Losses, Pulse, Waveform, load_population, simulate
from softclose.device.simulate import SimulationError
from softclose.kernel.pieces import flatten, tangent, voltage
from softclose.waveform import Delivered, WaveformError
from softclose.waveform.flat import flatten_pulses
from softclose.waveform.lowpass import CUT_VOLTS, N_PATH, REAL, deliver_flat, poles, room

LAST_BOUNCE = Delivered(command=Waveform([Pulse(0, 16, 0, 134), Pulse(32, 0, math.inf, 40)]), bandwidth_kHz=26.0)
"""Under it a switch's fifth bounce, of 4e-6 µm/µs, is counted by one of two integrators."""
SOFT = Waveform([Pulse(0, 4.4, 7.25, 111.6), Pulse(56.5, 19, math.inf, 75)])


@st.composite
def pulses(draw: st.DrawFn) -> Waveform:
    start, found = 0.0, []
    for _ in range(draw(st.integers(1, 3))):
        rise = draw(st.one_of(st.just(0.0), st.floats(4.0, 20.0)))
        peak = draw(st.one_of(st.just(math.inf), st.floats(0.0, 40.0)))
        found.append(Pulse(start, rise, peak, draw(st.floats(40.0, 150.0))))
        if math.isinf(peak):
            break
        start += draw(st.floats(0.0, 60.0))
    return Waveform(found)


@st.composite
def delivered(draw: st.DrawFn) -> Delivered:
    return Delivered(
        command=draw(pulses()),
        bandwidth_kHz=draw(st.floats(10.0, 400.0)),
        order=draw(st.sampled_from([1, 2])),
        damping=draw(st.one_of(st.floats(0.2, 2.0), st.just(1.0))),
        gain=draw(st.floats(0.8, 1.2)),
        offset_volts=draw(st.floats(-5.0, 5.0)),
        delay_us=draw(st.one_of(st.just(0.0), st.floats(0.0, 12.0))),
    )


def system(drive: Delivered) -> Any:
    corner = 2.0 * math.pi * 1e-3 * drive.bandwidth_kHz
    if drive.order == 1:
        return signal.StateSpace(signal.TransferFunction([corner], [1.0, corner]))
    z = drive.damping
    natural = corner / math.sqrt(1 - 2 * z**2 + math.sqrt((1 - 2 * z**2) ** 2 + 1))
    return signal.StateSpace(signal.TransferFunction([natural**2], [1.0, 2.0 * z * natural, natural**2]))


@settings(max_examples=examples(60), deadline=None, derandomize=True)
@given(drive=delivered())
def test_what_is_delivered_solves_the_low_pass(drive: Delivered) -> None:
    """Against scipy's matrix exponential on a fine grid, in which a command of lines is exact."""
    h = 0.005
    t = h * np.arange(int(120 / h))
    command = np.where(t >= drive.delay_us, drive.command.voltage(np.maximum(t - drive.delay_us, 0.0)), 0.0)
    _, filtered, _ = signal.lsim(system(drive), command, t)
    expected = drive.gain * filtered + drive.offset_volts
    # A jump between two samples is a line of that length to scipy; its ramps are lines to 1e-5 of their height.
    jumps = sum(p.volts for p in drive.command.pulses if p.rise_us == 0.0)
    corner = 2.0 * math.pi * 1e-3 * drive.bandwidth_kHz
    tolerance = 1e-3 + 2.0 * jumps * corner * h * (1.0 + 1.0 / drive.damping)
    np.testing.assert_allclose(drive.voltage(t), expected, atol=tolerance)
    assert len(drive.flat(120.0)[0]) <= 2 * len(flatten_pulses(drive.command, 120.0)[0]) + 1


@settings(max_examples=examples(60), deadline=None, derandomize=True)
@given(drive=delivered(), horizon=st.floats(5.0, 300.0))
def test_the_pieces_cover_the_horizon_and_join(drive: Delivered, horizon: float) -> None:
    flat = drive.flat(horizon)
    pieces = flat[0]
    assert pieces[0, 0] == 0.0
    assert pieces[-1, 1] == horizon
    np.testing.assert_array_equal(pieces[1:, 0], pieces[:-1, 1])
    assert (pieces[:, 1] > pieces[:, 0]).all()
    before = [voltage.py_func(*flat, i, pieces[i, 1]) for i in range(len(pieces) - 1)]
    after = [voltage.py_func(*flat, i + 1, pieces[i, 1]) for i in range(len(pieces) - 1)]
    np.testing.assert_allclose(before, after, atol=2.0 * CUT_VOLTS)


@settings(max_examples=examples(60), deadline=None, derandomize=True)
@given(drive=delivered(), part=st.floats(0.0, 1.0))
def test_the_tangent_and_its_bound_are_those_of_the_voltage(drive: Delivered, part: float) -> None:
    flat = flatten(drive, 250.0)
    for i, (begin, end, _) in enumerate(flat[0]):
        t = begin + part * (end - begin) * 0.999
        u, slope, bend = tangent.py_func(*flat, i, t)
        assert u == pytest.approx(voltage.py_func(*flat, i, t), abs=1e-9)
        h = 1e-4 * min(1.0, end - t)
        ahead = voltage.py_func(*flat, i, t + h)
        assert (ahead - u) / h == pytest.approx(slope, abs=0.51 * bend * h + 1e-7 / h * 1e-4 + 1e-6)
        for s in np.linspace(0.0, end - t, 9)[1:]:
            assert abs(voltage.py_func(*flat, i, t + s) - u - slope * s) <= 0.5 * bend * s * s * (1 + 1e-9) + 1e-9


@settings(max_examples=examples(40), deadline=None, derandomize=True)
@given(drive=delivered(), seed=st.integers(0, 2**32 - 1), restitution=st.floats(0.05, 0.9))
@example(drive=LAST_BOUNCE, seed=0, restitution=0.0625)
def test_the_kernel_agrees_with_its_twin(drive: Delivered, seed: int, restitution: float) -> None:
    table = np.random.default_rng(seed).uniform((1.8, 3.6, 45.0, 2.8), (2.8, 4.4, 90.0, 4.2), size=(8, 4))
    nudged = np.concatenate([table + shift * np.array([1e-6, 0.0, 0.0, 0.0]) for shift in (0, 1, -1)])
    common: dict[str, Any] = {"restitution": restitution, "max_volts": 1e3, "max_impacts": 300}
    tight = simulate(nudged, drive, method="rk", rtol=1e-12, **common)
    fast = simulate(table, drive, **common)
    count, closed = tight.n_impacts.reshape(3, -1), tight.closed.reshape(3, -1)
    regular = (count == count[0]).all(axis=0) & (closed == closed[0]).all(axis=0)  # the others graze: SPEC §8
    assert regular.mean() >= 0.5
    np.testing.assert_array_equal(fast.closed[regular], closed[0, regular])
    np.testing.assert_allclose(fast.max_contact_speed[regular], tight.max_contact_speed[:8][regular], atol=1e-5)
    bounces_agree(fast, tight, regular)


def test_a_fast_low_pass_is_hardly_one() -> None:
    switches = load_population("current").sample(60, seed=2)
    none = simulate(switches, SOFT, max_impacts=20)
    hardly = simulate(switches, Delivered(command=SOFT, bandwidth_kHz=2e6), max_impacts=20)
    np.testing.assert_allclose(hardly.max_contact_speed, none.max_contact_speed, atol=1e-4)
    np.testing.assert_array_equal(hardly.closed, none.closed)


@settings(max_examples=examples(25), deadline=None, derandomize=True)
@given(
    drive=delivered(),
    volts=st.floats(0.9, 1.1),
    times=st.floats(0.9, 1.1),
    losses=st.sampled_from([None, Losses(quality_factor=15.0), Losses(quality_factor=30.0, adhesion_uN=20.0)]),
)
def test_a_scaled_command_is_delivered_by_the_same_way(
    drive: Delivered, volts: float, times: float, losses: Losses | None
) -> None:
    switches = load_population("current").sample(6, seed=9)
    asked = np.linspace(0.0, 200.0, 21)
    a, b = np.array([1.0, volts, 1.0, volts, 0.97, volts]), np.array([1.0, 1.0, times, times, 1.03, times])
    common: dict[str, Any] = {"losses": losses, "max_volts": 1e3}
    whole = simulate(
        switches, drive, drive_volts=a, drive_times=b, horizon_us=200.0, times_us=asked, max_impacts=4, **common
    )
    for i in range(6):
        own = Delivered(
            command=Waveform(
                [
                    Pulse(p.start_us * b[i], p.rise_us * b[i], p.peak_us * b[i], p.volts * a[i])
                    for p in drive.command.pulses
                ]
            ),
            **{k: getattr(drive, k) for k in ("bandwidth_kHz", "order", "damping", "gain", "offset_volts", "delay_us")},
        )
        alone = simulate(
            switches[i : i + 1], own, horizon_us=200.0 * b[i], times_us=asked * b[i], max_impacts=4, **common
        )
        np.testing.assert_allclose(whole.max_contact_speed[i], alone.max_contact_speed[0], atol=2e-6)
        np.testing.assert_allclose(whole.impact_time_us[i], alone.impact_time_us[0], atol=1e-4)
        np.testing.assert_allclose(whole.impact_speed[i], alone.impact_speed[0], atol=1e-5)
        np.testing.assert_allclose(whole.x[i], alone.x[0], atol=1e-4)
        np.testing.assert_allclose(whole.v[i], alone.v[0], atol=1e-4)
        assert whole.closed[i] == alone.closed[0]


def test_pulses_are_scaled_too_and_one_drive_is_the_same_bits_as_no_scales() -> None:
    switches = load_population("current").sample(6, seed=9)
    ones = np.ones(6)
    for drive in (SOFT, Delivered(command=SOFT, bandwidth_kHz=60.0, order=2)):
        plain = simulate(switches, drive)
        scaled = simulate(switches, drive, drive_volts=ones, drive_times=ones)
        np.testing.assert_array_equal(plain.max_contact_speed, scaled.max_contact_speed)
        np.testing.assert_array_equal(plain.settling_us, scaled.settling_us)
    own = Waveform([Pulse(p.start_us * 1.1, p.rise_us * 1.1, p.peak_us * 1.1, p.volts * 0.95) for p in SOFT.pulses])
    found = simulate(switches, SOFT, drive_volts=0.95 * ones, drive_times=1.1 * ones)
    alone = simulate(switches, own, horizon_us=275.0)
    np.testing.assert_allclose(found.max_contact_speed, alone.max_contact_speed, rtol=1e-7)
    np.testing.assert_allclose(found.settling_us, alone.settling_us, rtol=1e-7)


def test_a_delay_is_a_later_command_and_an_offset_alone_stays() -> None:
    t = np.linspace(0.0, 100.0, 1001)
    base = Delivered(command=SOFT, bandwidth_kHz=70.0)
    late = Delivered(command=SOFT, bandwidth_kHz=70.0, delay_us=7.0, offset_volts=-2.0, gain=1.1)
    np.testing.assert_allclose(late.voltage(t + 7.0), 1.1 * base.voltage(t) - 2.0, atol=1e-4)
    np.testing.assert_array_equal(late.voltage(t[t < 6.9]), -2.0)


@pytest.mark.parametrize("damping", [0.05, 0.5, 1.0 - 1e-7, 1.0, 1.0 + 1e-7, 3.0])
def test_the_poles_have_their_corner_at_minus_3_dB(damping: float) -> None:
    for order in (1, 2):
        kind, first, second = poles(80.0, order, damping)
        s = 1j * 2.0 * math.pi * 0.08
        roots = {1.0: [-first], 2.0: [-first + 1j * second, -first - 1j * second], 3.0: [-first, -second]}[kind]
        gain = np.prod([root / (root - s) for root in roots])
        assert abs(gain) == pytest.approx(math.sqrt(0.5), rel=1e-5)
        if order == 1:
            assert (kind, second) == (REAL, 0.0), "one pole has one rate"
    assert Delivered(command=SOFT, bandwidth_kHz=80.0, damping=damping).path(250.0).shape == (N_PATH,)


def test_what_is_no_amplifier_or_scale_is_named() -> None:
    for wrong, said in (
        ({"bandwidth_kHz": 0.0}, "bandwidth_kHz is 0"),
        ({"bandwidth_kHz": 50.0, "order": 3}, "order is 3"),
        ({"bandwidth_kHz": 50.0, "gain": 0.0}, "gain 0"),
    ):
        with pytest.raises(WaveformError, match=said):
            Delivered(command=SOFT, **wrong)  # type: ignore[arg-type]
    with pytest.raises(WaveformError, match="V are delivered"):
        Delivered(command=SOFT, bandwidth_kHz=50.0, gain=1.5).check(120.0)
    switches = load_population("current").sample(3, seed=9)
    with pytest.raises(SimulationError, match="drive_times of switch 1 is -1"):
        simulate(switches, SOFT, drive_times=np.array([1.0, -1.0, 1.0]))
    with pytest.raises(SimulationError, match="drive_volts has shape"):
        simulate(switches, SOFT, drive_volts=np.ones(2))
    with pytest.raises(SimulationError, match="drive by drive"):
        simulate(switches, SOFT, drive_volts=np.ones(3), method="rk")


@pytest.mark.parametrize(
    "scales", in_turn([[[1.0, 1.0, 0.0]], [[0.9, 2.0, 1.0], [1.0, 1.0, 0.0], [1.1, 0.0, -1.0]]], 2, 1)
)
def test_the_compiled_and_the_plain_closed_form_are_one(scales: list[list[float]]) -> None:
    """Switch 1 is delivered by its own row of scales, or by the only one."""
    from softclose.kernel.pieces import deliver

    drive = Delivered(command=SOFT, bandwidth_kHz=60.0, order=2, delay_us=1.0)
    command, path = flatten_pulses(SOFT, 250.0), drive.path(250.0)
    compiled, plain = room(command[0], command[2]), room(command[0], command[2])
    n = deliver(1, *command, path, np.array(scales), *compiled)
    assert deliver_flat(*command, path, 1.0, 1.0, 0.0, *plain) == n
    for a, b in zip(compiled, plain, strict=True):
        np.testing.assert_allclose(a[:n], b[:n], rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(("delay", "gain", "offset"), [(0.0, 1.0, 0.0), (3.7, 1.1, -4.0)])
@pytest.mark.parametrize(("order", "damping"), [(1, 0.7), (2, 0.3), (2, 0.7071), (2, 1.0), (2, 1.8)])
def test_each_kind_of_low_pass_is_solved_with_and_without_delay_gain_and_offset(
    order: int, damping: float, delay: float, gain: float, offset: float
) -> None:
    """A command that rises, overlaps, jumps and is cut off; against scipy's matrix exponential."""
    command = Waveform([Pulse(0, 12, 5, 90), Pulse(14, 9, 8, 70), Pulse(60, 0, 1, 80), Pulse(61, 6, math.inf, 60)])
    drive = Delivered(
        command=command,
        bandwidth_kHz=45.0,
        order=order,
        damping=damping,
        gain=gain,
        offset_volts=offset,
        delay_us=delay,
    )
    h = 0.01
    t = h * np.arange(int(90 / h))
    late = np.where(t >= delay, command.voltage(np.maximum(t - delay, 0.0)), 0.0)
    expected = gain * signal.lsim(system(drive), late, t)[1] + offset
    np.testing.assert_allclose(drive.voltage(t), expected, atol=0.6)
    smooth = t < 60.0 + delay  # until it jumps, which is a line to scipy
    np.testing.assert_allclose(drive.voltage(t[smooth]), expected[smooth], atol=1e-3)
    # Long after its last pulse nothing but the command is left: what dies away is left out.
    pieces, n_ramps, _ = drive.flat(600.0)
    assert pieces[0, 0] == 0.0
    assert pieces[-1, 1] == 600.0
    np.testing.assert_array_equal(pieces[1:, 0], pieces[:-1, 1])
    assert n_ramps[-1] == 0
    assert pieces[-1, 2] == pytest.approx(gain * 60.0 + offset, rel=1e-12)
    ends = drive.voltage(pieces[1:, 0]) - drive.voltage(np.nextafter(pieces[1:, 0], 0.0))
    assert np.abs(ends).max() < 2.0 * CUT_VOLTS


def test_breakpoints_of_a_delivered_drive_are_those_of_its_command_so_much_later() -> None:
    drive = Delivered(command=SOFT, bandwidth_kHz=50.0, delay_us=3.0)
    np.testing.assert_allclose(drive.breakpoints(), [0.0, 3.0, 7.4, 14.65, 19.05, 59.5, 78.5])
    np.testing.assert_allclose(drive.breakpoints(59.5), [0.0, 3.0, 7.4, 14.65, 19.05, 59.5])
    np.testing.assert_allclose(drive.breakpoints(2.0), [0.0])


@pytest.mark.parametrize(("order", "damping"), [(1, 0.7), (2, 0.2), (2, 1.5)])
@pytest.mark.parametrize("offset", [0.0, -90.0])
def test_the_largest_voltage_of_a_delivered_drive_is_where_it_overshoots(
    order: int, damping: float, offset: float
) -> None:
    for command in (SOFT, *(Waveform([Pulse(5.0, 0.0, math.inf, volts)]) for volts in (80.0, 8.0))):
        drive = Delivered(command=command, bandwidth_kHz=90.0, order=order, damping=damping, offset_volts=offset)
        for horizon in (7.0, 60.0, 250.0):
            fine = np.abs(drive.voltage(np.linspace(0.0, horizon, 20_001))).max()
            assert drive.max_voltage(horizon) == pytest.approx(fine, rel=2e-3)


def test_unless_said_otherwise_250_us_of_a_delivered_drive_count() -> None:
    for start, peak in ((249.5, 90.0), (250.5, 0.0)):
        command = Waveform([Pulse(start, 0.0, math.inf, 90.0)])
        drive = Delivered(command=command, bandwidth_kHz=5000.0)
        assert drive.max_voltage() == pytest.approx(peak, abs=1e-3)
        if peak:
            with pytest.raises(WaveformError, match="90 V are delivered; 80 V are allowed"):
                drive.check(80.0)
        drive.check(80.0, 249.0)
        drive.check(90.0)
    drive.check(80.0)


def test_of_a_delivered_drive_any_instants_may_be_asked_for_and_none() -> None:
    drive = Delivered(command=SOFT, bandwidth_kHz=50.0)
    assert drive.voltage(np.zeros((0, 3))).shape == (0, 3)
    assert drive.voltage(12.0).shape == ()
    assert float(drive.voltage(0.5)) == pytest.approx(float(drive.voltage([0.5, 200.0])[0]), abs=1e-9)


def test_bandwidths_of_a_delivered_drive_are_above_0_and_finite() -> None:
    assert Delivered(command=SOFT, bandwidth_kHz=0.5).max_voltage() < 75.0
    for wrong in (0.0, -1.0, math.inf, math.nan):
        with pytest.raises(WaveformError, match="must be above 0 and finite"):
            Delivered(command=SOFT, bandwidth_kHz=wrong)
    for name in ("damping", "gain", "delay_us"):
        with pytest.raises(WaveformError, match="must be above 0, a delay 0 or more"):
            Delivered(command=SOFT, bandwidth_kHz=50.0, **{name: -0.5})  # type: ignore[arg-type]
