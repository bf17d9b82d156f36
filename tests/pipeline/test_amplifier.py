"""Claims about the amplifier in the loop, against closed forms and scipy.signal, and that every path sees it."""

from __future__ import annotations

import math
from typing import Any
from unittest import mock

import numpy as np
import pytest
import scipy
from hypothesis import given
from hypothesis import strategies as st

import by_hand
from examples import in_turn
from reference import reference
from softclose import Pulse, Waveform, simulate
from softclose.conditions.amplifier import AmplifierSection, deliver
from softclose.evaluate import draw, respond
from softclose.kernel.pieces import flatten
from softclose.population.lot import LotError
from softclose.settings import CampaignConfig, ConfigError, load_config
from softclose.waveform import AnyDrive, Fitted, Trace, WaveformError, fewest

STEP = Waveform([Pulse(0.0, 0.0, math.inf, 100.0)])
DRIVE = Waveform([Pulse(0.0, 4.0, 3.1, 138.0), Pulse(20.0, 30.0, math.inf, 80.0)])
T = np.linspace(0.0, 250.0, 2501)


def _delivered(waveform: Waveform = DRIVE, **settings: Any) -> AnyDrive:
    return deliver(AmplifierSection(**settings), waveform, 250.0)


def test_a_first_order_answers_a_step_by_its_exponential() -> None:
    found = _delivered(STEP, bandwidth_kHz=50.0)
    tau = 1.0 / (2.0 * math.pi * 0.05)
    np.testing.assert_allclose(found.voltage(T), 100.0 * (1.0 - np.exp(-T / tau)), atol=2e-5)


@pytest.mark.parametrize("damping", [0.3, 0.7071, 1.5])
def test_both_orders_let_a_sine_of_their_bandwidth_through_at_minus_3_dB(damping: float) -> None:
    """Seen through the response to pulses: against scipy's own simulation of the transfer function."""
    for order in (1, 2):
        a = AmplifierSection(bandwidth_kHz=80.0, order=order, damping=damping)
        found = deliver(a, DRIVE, 250.0)
        corner = 2.0 * math.pi * 0.08
        if order == 1:
            system = scipy.signal.TransferFunction([corner], [1.0, corner])
        else:
            natural = corner / math.sqrt(1 - 2 * damping**2 + math.sqrt((1 - 2 * damping**2) ** 2 + 1))
            system = scipy.signal.TransferFunction([natural**2], [1.0, 2.0 * damping * natural, natural**2])
        _, magnitude = scipy.signal.freqresp(system, [corner])
        assert abs(magnitude[0]) == pytest.approx(math.sqrt(0.5), rel=1e-9)
        t = np.arange(0.0, 250.0, 0.01)
        _, exact, _ = scipy.signal.lsim(system, DRIVE.voltage(t), t)
        np.testing.assert_allclose(found.voltage(t), exact, atol=0.03)


def test_an_output_is_no_steeper_than_the_slew_limit_and_follows_where_it_can() -> None:
    found = _delivered(slew_volts_per_us=10.0)
    t = np.linspace(0.0, 250.0, 100_001)
    assert np.abs(np.diff(found.voltage(t))).max() <= 10.0 * t[1] * (1.0 + 1e-6)
    assert found.max_voltage() < 0.9 * DRIVE.max_voltage()
    np.testing.assert_allclose(found.voltage(T[T > 60.0]), DRIVE.voltage(T[T > 60.0]), atol=1e-9)
    ramp = _delivered(STEP, slew_volts_per_us=10.0)
    np.testing.assert_allclose(ramp.voltage(T), np.minimum(10.0 * T, 100.0), atol=1e-7)


def test_delay_gain_and_offset_are_what_they_say() -> None:
    found = _delivered(delay_us=7.0, gain=1.1, offset_volts=-2.0)
    later = np.where(T >= 7.0, 1.1 * DRIVE.voltage(np.maximum(T - 7.0, 0.0)), 0.0) - 2.0
    np.testing.assert_allclose(found.voltage(T), later, atol=1e-9)


def test_a_generator_gives_whole_steps_and_holds_each() -> None:
    found = _delivered(resolution_volts=0.5, resolution_us=2.0)
    middles = np.arange(1.0, 249.0, 2.0)
    u = found.voltage(middles)
    np.testing.assert_allclose(u, 0.5 * np.round(DRIVE.voltage(middles - 1.0) / 0.5), atol=1e-9)
    np.testing.assert_array_equal(found.voltage(middles + 0.8), u)


@given(st.floats(4.0, 40.0), st.floats(0.0, 60.0), st.floats(1.0, 150.0))
def test_a_fast_amplifier_delivers_what_is_commanded(rise: float, start: float, volts: float) -> None:
    waveform = Waveform([Pulse(start, rise, 5.0, volts)])
    found = deliver(AmplifierSection(bandwidth_kHz=1e5), waveform, 250.0)
    np.testing.assert_allclose(found.voltage(T), waveform.voltage(T), atol=2e-3 * volts)


def test_switches_get_what_is_delivered_and_a_trace_goes_past_the_amplifier() -> None:
    plain, config = load_config("current"), load_config("current", ["amplifier.bandwidth_kHz=60"])
    switches = plain.build_population().sample(200, seed=1)
    ours = respond(config, switches, DRIVE)
    t = np.linspace(0.0, 250.0, 10_001)
    trace = Trace(t, deliver(config.amplifier, DRIVE, config.model.horizon_us).voltage(t))
    theirs = respond(config, switches, trace)
    np.testing.assert_array_equal(respond(plain, switches, trace).max_contact_speed, theirs.max_contact_speed)
    apart = np.abs(ours.max_contact_speed - theirs.max_contact_speed) * 100.0
    assert np.nanquantile(apart, 0.95) < 0.01
    ideal = respond(plain, switches, DRIVE)
    assert np.nanmedian(np.abs(ours.max_contact_speed - ideal.max_contact_speed)) * 100.0 > 0.5


def test_the_limit_is_on_what_is_commanded() -> None:
    config = load_config("current", ["amplifier.gain=1.2", "waveform.max_volts=140"])
    switches = config.build_population().sample(5, seed=1)
    assert respond(config, switches, DRIVE, max_volts=140.0).closed.shape == (5,)  # 166 V reach the switch
    with pytest.raises(WaveformError, match="may not exceed 130 V"):
        respond(config, switches, DRIVE, max_volts=130.0)


def test_an_ideal_amplifier_changes_no_bit_and_no_campaign_without_one() -> None:
    config = load_config("current")
    assert config.amplifier.is_ideal
    assert AmplifierSection(order=2, damping=0.3, step_us=0.1).is_ideal
    assert CampaignConfig.from_dict(config.to_dict()) == config
    for setting in ("gain=1.01", "offset_volts=1", "delay_us=1", "slew_volts_per_us=9", "bandwidth_kHz=9"):
        assert not load_config("current", [f"amplifier.{setting}"]).amplifier.is_ideal


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ("gain=0", "amplifier.gain is 0; it must be a finite number above 0"),
        ("bandwidth_kHz=-1", "amplifier.bandwidth_kHz is -1"),
        ("order=3", "amplifier.order is 3"),
        ("step_us=0", "amplifier.step_us is 0"),
        ("bandwith_kHz=3", "did you mean"),
    ],
)
def test_what_no_amplifier_has_is_named(setting: str, said: str) -> None:
    with pytest.raises(ConfigError) as e:
        load_config("current", [f"amplifier.{setting}"])
    assert said in str(e.value)


def test_a_trimmed_command_is_what_the_amplifier_delivers() -> None:
    """Each switch's own scaled command goes through the filter, whose time constants are the same for all."""
    config = load_config("current-trim", ["amplifier.bandwidth_kHz=60", "amplifier.slew_volts_per_us=40"])
    lot = draw(config, 8, seed=5)
    found = respond(config, lot, DRIVE)
    alone = by_hand.respond(config, by_hand.rows(config, 8, seed=5), DRIVE)
    np.testing.assert_allclose(found.max_contact_speed, alone.max_contact_speed, rtol=1e-9)
    np.testing.assert_allclose(found.settling_us, alone.settling_us, rtol=1e-9)
    np.testing.assert_array_equal(found.closed, alone.closed)
    plain = respond(load_config("current-trim"), lot, DRIVE)
    assert (np.abs(found.max_contact_speed / plain.max_contact_speed - 1.0) > 1e-4).all()


SCATTER = ["amplifier.gain_error=0.01", "amplifier.time_error=0.005", "population.n_switches=300"]


def _clocked(clock: float, volts: float = 1.0) -> Waveform:
    """The command by a generator whose clock is that much slower."""
    return Waveform(
        [Pulse(p.start_us * clock, p.rise_us * clock, p.peak_us * clock, p.volts * volts) for p in DRIVE.pulses]
    )


def test_random_errors_of_the_drive_are_those_of_each_switch_s_own_waveform() -> None:
    config = load_config({}, SCATTER)
    lot = draw(config, 40, seed=5)
    found = respond(config, lot, DRIVE)
    plain = load_config({})
    for i in (0, 7, 39):
        own = _clocked(lot["clock"][i], lot["gain"][i])
        alone = respond(plain, lot.switches[i : i + 1], own)
        np.testing.assert_allclose(found.max_contact_speed[i], alone.max_contact_speed[0], rtol=1e-6, equal_nan=True)


def test_random_errors_are_common_to_all_candidates_and_keyed_by_the_switch() -> None:
    config = load_config({}, SCATTER)
    whole = draw(config, 3000, seed=5)
    later = draw(config, 10, seed=5, start=20)
    for name in whole:
        np.testing.assert_array_equal(later[name], whole[name][20:30])
    np.testing.assert_array_equal(draw(load_config({}), 3000, seed=5).switches, whole.switches)
    np.testing.assert_allclose([whole["gain"].std(), whole["clock"].std()], [0.01, 0.005], rtol=0.05)
    assert abs(np.corrcoef(whole["gain"], whole["K"])[0, 1]) < 0.06
    assert abs(np.corrcoef(whole["gain"], whole["clock"])[0, 1]) < 0.06


def test_random_errors_reach_a_delivered_drive_and_a_model_of_losses() -> None:
    lot = draw(load_config({}, SCATTER), 12, seed=5)
    filtered = load_config({}, [*SCATTER, "amplifier.bandwidth_kHz=80"])
    alone = respond(load_config({}, ["amplifier.bandwidth_kHz=80"]), lot.switches, DRIVE)
    scatter = respond(filtered, lot, DRIVE).max_contact_speed
    assert (np.abs(scatter / alone.max_contact_speed - 1.0) > 1e-4).all()
    damped = load_config({}, [*SCATTER, "model.quality_factor=30"])
    found = respond(damped, lot, DRIVE)
    a, b = lot["gain"][3], lot["clock"][3]
    slower = load_config({}, ["model.quality_factor=30", f"model.horizon_us={250 * b}"])
    one = respond(slower, lot.switches[3:4], _clocked(b, a))
    assert found.final_x[3] == pytest.approx(one.final_x[0], rel=1e-7)
    both = load_config({}, [*SCATTER, "model.quality_factor=30", "amplifier.bandwidth_kHz=80"])
    found = respond(both, lot, DRIVE)
    for i in (3, 8):
        a, b = lot["gain"][i], lot["clock"][i]
        slower = load_config({}, ["model.quality_factor=30", f"model.horizon_us={250 * b}"])
        one = respond(slower, lot.switches[i : i + 1], deliver(both.amplifier, _clocked(b), 250.0 * b, a))
        assert found.max_contact_speed[i] == pytest.approx(one.max_contact_speed[0], rel=1e-6)
        assert found.settling_us[i] == pytest.approx(one.settling_us[0], rel=1e-6)


@pytest.mark.parametrize(
    "setting", ["slew_volts_per_us=30", "offset_volts=2", "resolution_volts=1", "delay_us=4", "resolution_us=2"]
)
def test_a_clock_scales_the_command_and_no_time_of_the_amplifier_s(setting: str) -> None:
    """Delay, slew and steps of the output stay what they are; the gain of each comes where the amplifier's own is."""
    config = load_config({}, ["amplifier.gain_error=0.05", "amplifier.time_error=0.05", f"amplifier.{setting}"])
    lot = draw(config, 6, seed=5)
    found = respond(config, lot, DRIVE)
    for i in range(6):
        a, b = lot["gain"][i], lot["clock"][i]
        own = deliver(config.amplifier, _clocked(b), 250.0 * b, a)
        one = simulate(lot.switches[i : i + 1], own, horizon_us=250.0 * b, max_volts=math.inf)
        assert found.max_contact_speed[i] == pytest.approx(one.max_contact_speed[0], rel=1e-6)
        assert found.final_x[i] == pytest.approx(one.final_x[0], abs=1e-5)


def test_a_random_error_is_not_held_within_the_limits_of_the_command() -> None:
    """The search keeps waveform.max_volts; an amplifier whose gain is high delivers more."""
    config = load_config({}, [*SCATTER, "model.quality_factor=30", "waveform.max_volts=138"])
    lot = draw(config, 12, seed=5)
    i = int(lot["gain"].argmax())
    a, b = lot["gain"][i], lot["clock"][i]
    assert a > 1.005
    found = respond(config, lot, DRIVE)
    alone = respond(load_config({}, ["model.quality_factor=30"]), lot.switches[i : i + 1], _clocked(b, a))
    assert found.max_contact_speed[i] == pytest.approx(alone.max_contact_speed[0], rel=1e-9)


def test_random_errors_multiply_the_scales_of_a_trimmed_drive_after_its_limits() -> None:
    """Limits are kept by the command; what generator and amplifier do wrong comes on top of it."""
    config = load_config("current-trim", ["amplifier.gain_error=0.03", "amplifier.time_error=0.03"])
    lot = draw(config, 12, seed=5)
    rows = by_hand.rows(config, 12, seed=5)
    for name, ours in {"gain": "gain", "clock": "clock", "a": "voltage_scale", "b": "time_scale"}.items():
        np.testing.assert_allclose(lot[ours], [row[name] for row in rows], rtol=1e-12)
    found, alone = respond(config, lot, DRIVE), by_hand.respond(config, rows, DRIVE)
    np.testing.assert_allclose(found.max_contact_speed, alone.max_contact_speed, rtol=1e-5)
    np.testing.assert_allclose(found.settling_us, alone.settling_us, rtol=1e-5)
    everybody = respond(config, lot, DRIVE, for_everybody=True)
    alike = by_hand.respond(config, rows, DRIVE, tailored=False)
    np.testing.assert_allclose(everybody.max_contact_speed, alike.max_contact_speed, rtol=1e-5)
    assert (np.abs(everybody.max_contact_speed / found.max_contact_speed - 1.0) > 1e-3).all()


def test_a_lot_that_was_drawn_without_errors_has_none_to_be_driven_with() -> None:
    with pytest.raises(LotError, match="the lot has no column gain"):
        respond(load_config({}, SCATTER), draw(load_config({}), 3, seed=1), DRIVE)
    with pytest.raises(LotError, match="the lot has no column voltage_scale"):
        respond(load_config("current-trim"), draw(load_config({}), 3, seed=1), DRIVE)


@pytest.mark.parametrize("start", [0.0, 0.013, 33.337])
@pytest.mark.parametrize("late", [0.0, 1.23])
def test_a_slew_limit_answers_a_step_by_its_line(start: float, late: float) -> None:
    drive = Waveform([Pulse(start, 0.0, 30.0, 90.0)])
    found = deliver(AmplifierSection(slew_volts_per_us=7.0, delay_us=late), drive, 100.0)
    t = np.linspace(0.0, 100.0, 2001)
    since = t - start - late
    up, down = np.clip(7.0 * since, 0.0, 90.0), np.clip(90.0 - 7.0 * (since - 30.0), 0.0, 90.0)
    np.testing.assert_allclose(found.voltage(t), np.where(since < 30.0, up, down), atol=1e-6)


HARD = Waveform([Pulse(0.0, 6.0, 22.0, 125.0), Pulse(32.0, 8.0, math.inf, 75.0)])
LIMITS: list[dict[str, float]] = [
    {"slew_volts_per_us": 18.0},
    {"slew_volts_per_us": 18.0, "bandwidth_kHz": 60.0},
    {"slew_volts_per_us": 18.0, "bandwidth_kHz": 60.0, "order": 2, "damping": 0.5},
    {"resolution_us": 0.5, "resolution_volts": 2.0},
    {"resolution_us": 0.1, "bandwidth_kHz": 60.0},
    {"resolution_volts": 3.0, "bandwidth_kHz": 60.0, "order": 2},
    {"resolution_us": 0.2, "resolution_volts": 0.1, "slew_volts_per_us": 25.0, "bandwidth_kHz": 100.0},
]


def by_small_steps(a: AmplifierSection, waveform: Waveform, step: float, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Instants and voltages of what the section says, in the order of the signal's way, step by step."""
    middles = step * (np.arange(n) + 0.5)
    # A limiter is where its command is at the end of a step, as far as it gets.
    at = middles - a.delay_us + (0.4999 * step if a.slew_volts_per_us else 0.0)
    at = a.resolution_us * np.floor(at / a.resolution_us) if a.resolution_us else at
    u = np.where(at >= 0.0, waveform.voltage(np.maximum(at, 0.0)), 0.0)
    u = a.gain * (a.resolution_volts * np.round(u / a.resolution_volts) if a.resolution_volts else u)
    if a.slew_volts_per_us:
        most, y, found = a.slew_volts_per_us * step, 0.0, []
        for goal in u.tolist():
            before = y
            y += min(max(goal - y, -most), most)
            found.append(0.5 * (before + y))
        u = np.array(found)
    if not a.bandwidth_kHz:
        return middles, u + a.offset_volts
    corner = 2.0 * math.pi * 1e-3 * a.bandwidth_kHz
    if a.order == 1:
        system = scipy.signal.TransferFunction([corner], [1.0, corner])
    else:
        z = a.damping
        natural = corner / math.sqrt(1 - 2 * z**2 + math.sqrt((1 - 2 * z**2) ** 2 + 1))
        system = scipy.signal.TransferFunction([natural**2], [1.0, 2.0 * z * natural, natural**2])
    _, found, _ = scipy.signal.lsim(system, u, step * np.arange(n), interp=False)
    return step * np.arange(n), found + a.offset_volts


@pytest.mark.parametrize("limits", in_turn(LIMITS, 4), ids=str)
@pytest.mark.parametrize("others", [{}, {"gain": 1.03, "delay_us": 2.5, "offset_volts": -1.5}], ids=["", "gain"])
def test_what_is_delivered_has_the_area_of_what_the_section_says(
    limits: dict[str, float], others: dict[str, float]
) -> None:
    """At every instant, to the tolerance of a fit and what a grid of 1 ns misses of a limiter."""
    a = AmplifierSection(**limits, **others)  # type: ignore[arg-type]
    t, expected = by_small_steps(a, DRIVE, 0.001, 80_000)
    apart = np.cumsum(deliver(a, DRIVE, 80.0).voltage(t) - expected) * 0.001
    assert np.abs(apart).max() < 0.01


@pytest.mark.parametrize("limits", in_turn(LIMITS, 3), ids=str)
def test_switches_move_by_what_is_delivered_as_an_independent_integrator_says(limits: dict[str, float]) -> None:
    """DOP853 on the exact pieces: V within 1e-3 cm/s, polynomials or not."""
    a = AmplifierSection(**limits)  # type: ignore[arg-type]
    given = deliver(a, HARD, 27.0)
    with mock.patch.object(fewest, "MANY", 10**9):
        exact = deliver.__wrapped__(a, HARD, 27.0)
    assert not isinstance(exact, Fitted)
    switches = load_config("current").build_population().sample(2, seed=3)
    found = simulate(switches, given, horizon_us=27.0)
    for i in range(2):
        theirs = reference(switches[i], exact, horizon_us=27.0)  # type: ignore[arg-type]
        assert found.n_impacts[i] == theirs.n_impacts > 0
        assert found.max_contact_speed[i] == pytest.approx(theirs.max_contact_speed, abs=1e-5)


def test_many_steps_are_few_polynomials_where_an_amplifier_smooths_them() -> None:
    for limits in LIMITS[4:]:
        assert len(flatten(deliver(AmplifierSection(**limits), DRIVE, 250.0), 250.0)[0]) < 20  # type: ignore[arg-type]


@pytest.mark.parametrize("offset", [-4.0, 6.0])
@pytest.mark.parametrize(
    "limits",
    [
        {"slew_volts_per_us": 0.5},
        {"bandwidth_kHz": 20.0},
        {"bandwidth_kHz": 20.0, "resolution_volts": 0.5},
        {"bandwidth_kHz": 20.0, "slew_volts_per_us": 0.5},
    ],
    ids=" ".join,
)
def test_an_amplifier_at_rest_is_at_its_offset_from_the_first_instant(limits: dict[str, float], offset: float) -> None:
    """Before the first pulse nothing moves: there is no way from 0 V to the offset."""
    late = Waveform([Pulse(30.0, 4.0, 20.0, 100.0)])
    found = _delivered(late, offset_volts=offset, **limits)
    np.testing.assert_allclose(found.voltage(np.linspace(0.0, 29.9, 300)), offset, atol=1e-6)
