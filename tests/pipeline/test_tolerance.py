"""Drive tolerance: what each error does to a waveform, and that shifts are against the perfect drive."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import by_hand
from examples import in_turn
from softclose import Pulse, Trace, Waveform, load_population, simulate
from softclose.baselines import deterministic_design
from softclose.evaluate import draw
from softclose.settings import load_config
from softclose.uncertainty.tolerance import (
    DEFAULT_ERRORS,
    DriveError,
    ToleranceError,
    _drives,
    drive_tolerance,
    driven,
    jittered,
)
from softclose.waveform import Drive

TWO = Waveform([Pulse(0.0, 4.0, 4.5, 150.0), Pulse(14.0, 8.0, math.inf, 85.0)])


def scaled(waveform: Waveform, gain: float) -> Waveform:
    return Waveform([replace(p, volts=p.volts * gain) for p in waveform.pulses])


def by_itself(switches: np.ndarray, drive: Drive) -> np.ndarray:
    """V [cm/s] of switches under a drive that is delivered as it is."""
    return np.asarray(simulate(switches, drive, max_volts=math.inf).max_contact_speed) * 100.0


def test_gain_multiplies_the_voltage() -> None:
    switches = load_population("current").sample(50, seed=3)
    row = drive_tolerance(switches, TWO, errors=[DriveError(gain=0.03)])[1]
    assert row.assessment.mean_cm_s == pytest.approx(by_itself(switches, scaled(TWO, 1.03)).mean(), rel=1e-6)


def test_a_gain_comes_on_top_of_that_of_each_switch_s_own_drive() -> None:
    config = load_config({}, ["amplifier.gain_error=0.02"])
    lot = draw(config, 20, seed=3)
    np.testing.assert_allclose(driven(lot, 0.03)["gain"], 1.03 * lot["gain"])
    np.testing.assert_array_equal(driven(draw(load_config({}), 20, seed=3), 0.03)["gain"], 1.03)
    row = drive_tolerance(lot, TWO, errors=[DriveError(gain=0.03)], config=config)[1]
    each = [by_itself(s[None], scaled(TWO, 1.03 * g))[0] for s, g in zip(lot.switches, lot["gain"], strict=True)]
    assert row.assessment.mean_cm_s == pytest.approx(np.mean(each), rel=1e-5)


def test_a_generator_that_is_fast_enough_changes_nothing_but_what_is_sampled() -> None:
    """The steepest slope of a pulse of volts U that rises in t is pi U / 2 t; the first also falls in 4 µs."""
    switches = load_population("current").sample(200, seed=3)
    fast = drive_tolerance(switches, TWO, errors=[DriveError(slew_volts_per_us=math.pi * 150.0 / 8.0 * 1.001)])[1]
    assert fast.v_u_shift_cm_s == pytest.approx(0.0, abs=0.05)
    slow = drive_tolerance(switches, TWO, errors=[DriveError(slew_volts_per_us=30.0)])[1]
    assert abs(slow.v_u_shift_cm_s) > 1.0


@pytest.mark.parametrize("slew", in_turn([50.0, 30.0, 20.0, 5.0, 1e9], 2))
def test_a_slew_limits_the_slope_of_what_is_delivered_and_stretches_no_pulse(slew: float) -> None:
    """A slew limiter follows its command as fast as it can: here in steps of 1 ns, by hand."""
    switches = load_population("current").sample(100, seed=3)
    t = np.arange(0.0, 250.0 + 1e-9, 1e-3)
    wanted = TWO.voltage(t)
    u = np.empty_like(wanted)
    at = 0.0
    for i, goal in enumerate(wanted.tolist()):
        at += min(max(goal - at, -slew * 1e-3), slew * 1e-3)
        u[i] = at
    delivered = Trace(t, u).simplified(1e-3)
    found = drive_tolerance(switches, TWO, errors=[DriveError(slew_volts_per_us=slew)])[1]
    v = np.sort(by_itself(switches, delivered))
    v = v[~np.isnan(v)]
    assert found.assessment.n_contact == len(v) > 20
    assert found.assessment.mean_cm_s == pytest.approx(v.mean(), abs=0.05)
    assert found.assessment.v_u_cm_s == pytest.approx(v[math.ceil(0.9 * len(v)) - 1], abs=0.2)


def test_a_slew_limits_an_amplifier_that_is_faster_and_no_other() -> None:
    """It is the slower of the two that counts."""
    switches = load_population("current").sample(100, seed=3)
    errors = [DriveError(slew_volts_per_us=s) for s in (20.0, 40.0)]
    slow = load_config({}, ["amplifier.slew_volts_per_us=30"])
    own, slower, faster = drive_tolerance(switches, TWO, errors=errors, config=slow)
    plain = drive_tolerance(switches, TWO, errors=errors)
    assert slower.assessment == plain[1].assessment
    assert faster.assessment == own.assessment != plain[2].assessment


def test_jitter_moves_later_pulses_only_and_never_before_zero() -> None:
    moved = jittered(TWO, [-0.5])
    assert moved.pulses[0] == TWO.pulses[0]
    assert moved.pulses[1].start_us == 13.5
    assert jittered(TWO, [-20.0]).pulses[1].start_us == 0.0


def test_every_condition_of_the_campaign_holds_under_errors_of_its_drives() -> None:
    """Trimmed, with an amplifier: the error's pulses are scaled for each, and its gain multiplies the delivered one."""
    config = load_config("current-trim", ["amplifier.bandwidth_kHz=80", "amplifier.gain_error=0.01"])
    lot, rows = draw(config, 6, seed=5), by_hand.rows(config, 6, seed=5)
    perfect, faulty = drive_tolerance(lot, TWO, errors=[DriveError(gain=0.03)], config=config)
    for row, gain in ((perfect, 1.0), (faulty, 1.03)):
        alone = by_hand.respond(config, [r | {"gain": r["gain"] * gain} for r in rows], TWO)
        assert row.assessment.mean_cm_s == pytest.approx(100.0 * np.nanmean(alone.max_contact_speed), abs=0.003)


def test_rows_are_measured_against_the_perfect_drive_on_the_same_switches() -> None:
    population = load_population("current")
    switches = population.sample(200, seed=3)
    waveform = deterministic_design(population)
    errors = (DriveError(), DriveError(gain=0.05), DriveError(gain_sd=0.02, jitter_us=0.3))
    rows = drive_tolerance(switches, waveform, errors=errors, n_generators=8)
    assert [r.error for r in rows] == [DriveError(), *errors]
    assert rows[1].v_u_shift_cm_s == rows[1].p_nc_shift == 0.0
    assert rows[2].assessment.mean_cm_s == pytest.approx(np.nanmean(by_itself(switches, scaled(waveform, 1.05))))
    assert rows[2].v_u_shift_cm_s > 1.0
    assert rows == drive_tolerance(switches, waveform, errors=errors, n_generators=8)


def test_every_switch_is_driven_once_also_with_more_generators_than_switches() -> None:
    switches = load_population("current").sample(5, seed=3)
    row = drive_tolerance(switches, TWO, errors=[DriveError(jitter_us=0.1)], n_generators=64)[1]
    assert row.assessment.n == 5


def _lot_of_generators(error: DriveError, n: int = 2000, waveform: Waveform = TWO) -> list[tuple[Waveform, float]]:
    """What each generator commands, and its relative error of gain."""
    return [(drive, gain) for _, drive, gain in _drives(n, waveform, error, n, 5)]


@pytest.mark.parametrize(("n", "generators"), [(10, 3), (5, 64), (64, 64), (7, 1)])
def test_generators_share_the_switches_evenly_and_leave_none_out(n: int, generators: int) -> None:
    shares = [range(n)[share] for share, *_ in _drives(n, TWO, DriveError(jitter_us=0.1), generators, 0)]
    assert [i for share in shares for i in share] == list(range(n))
    assert len(shares) == min(n, generators)
    assert max(map(len, shares)) - min(map(len, shares)) <= 1


def test_a_systematic_gain_stays_where_gains_scatter_about_it() -> None:
    generators = _lot_of_generators(DriveError(gain=0.03, gain_sd=0.01))
    assert {drive for drive, _ in generators} == {TWO}
    gains = np.array([gain for _, gain in generators])
    assert gains.mean() == pytest.approx(0.03, abs=5e-4)
    assert gains.std() == pytest.approx(0.01, rel=0.05)
    waveform = Waveform([Pulse(0.0, 0.0, math.inf, 100.0)])
    switches = load_population("current").sample(60, seed=3)
    errors = (DriveError(gain=0.03), DriveError(gain=0.03, gain_sd=1e-9))
    _, fixed, scattered = drive_tolerance(switches, waveform, errors=errors)
    assert fixed.v_u_shift_cm_s > 0.5
    assert scattered.v_u_shift_cm_s == pytest.approx(fixed.v_u_shift_cm_s, abs=1e-4)


def test_jitter_is_drawn_for_each_later_pulse_and_apart_from_the_gain() -> None:
    three = Waveform([Pulse(0.0, 4.0, 4.5, 150.0), Pulse(30.0, 8.0, 5.0, 85.0), Pulse(60.0, 8.0, math.inf, 85.0)])
    drives = _lot_of_generators(DriveError(gain_sd=0.01, jitter_us=0.3), waveform=three)
    draws = np.array([[gain, *(p.start_us for p in d.pulses[1:])] for d, gain in drives])
    np.testing.assert_allclose(draws.mean(axis=0), [0.0, 30.0, 60.0], atol=0.02)
    np.testing.assert_allclose(draws.std(axis=0), [0.01, 0.3, 0.3], rtol=0.05)
    assert np.abs(np.corrcoef(draws.T) - np.eye(3)).max() < 0.06
    assert {d.pulses[0] for d, _ in drives} == {three.pulses[0]}


def test_scenarios_of_different_size_draw_the_same_generators() -> None:
    small, large = (
        np.array([gain for _, gain in _lot_of_generators(DriveError(gain_sd=sd), 50)]) for sd in (0.01, 0.02)
    )
    np.testing.assert_allclose(large, 2.0 * small, rtol=1e-9)
    other = [gain for *_, gain in _drives(50, TWO, DriveError(gain_sd=0.01), 50, 6)]
    assert not set(small) & set(other)


def test_no_generator_drives_below_zero() -> None:
    gains = [gain for _, gain in _lot_of_generators(DriveError(gain=-1.0, gain_sd=0.5), 50)]
    assert min(gains) == -1.0 < max(gains)
    row = drive_tolerance(load_population("current").sample(3, seed=3), TWO, errors=[DriveError(gain=-1.0)])[1]
    assert row.assessment.n_contact == 0


def test_one_generator_may_drive_the_whole_lot_and_64_do_where_nothing_is_said() -> None:
    switches = load_population("current").sample(130, seed=3)
    errors = [DriveError(gain_sd=0.2)]
    (_, unsaid), (_, said), (_, one) = (
        drive_tolerance(switches, TWO, errors=errors, **n) for n in ({}, {"n_generators": 64}, {"n_generators": 1})
    )
    assert unsaid == said != one


def test_its_intervals_are_those_of_random_draws_whatever_the_campaign_samples() -> None:
    config = load_config({"population": {"sampling": "sobol"}})
    rows = drive_tolerance(load_population("current").sample(5, seed=3), TWO, errors=[], config=config)
    assert rows[0].assessment.intervals_valid
    assert (rows[0].v_u_shift_cm_s, rows[0].p_nc_shift) == (0.0, 0.0)


def test_default_gains_are_symmetric_and_all_scenarios_are_of_some_per_cent_or_a_fraction_of_a_pulse() -> None:
    gains = [e.gain for e in DEFAULT_ERRORS if e.gain]
    assert gains == [-g for g in reversed(gains)] == sorted(gains)
    assert max(gains) == 0.05
    for spreads in ([e.gain_sd for e in DEFAULT_ERRORS if e.gain_sd], [e.jitter_us for e in DEFAULT_ERRORS]):
        rising = [s for s in spreads if s]
        assert rising == sorted(rising)
    assert 0.0 < max(e.gain_sd for e in DEFAULT_ERRORS) < 0.05
    assert max(e.jitter_us for e in DEFAULT_ERRORS) == 1.0


def test_default_scenarios_change_one_thing_each() -> None:
    perfect = DriveError()
    for e in DEFAULT_ERRORS:
        changed = [
            f for f in ("gain", "gain_sd", "jitter_us", "slew_volts_per_us") if getattr(e, f) != getattr(perfect, f)
        ]
        assert len(changed) == 1


@pytest.mark.parametrize(
    ("error", "words"),
    [
        ({"gain": -1.01}, "gain is -1.01"),
        ({"gain_sd": math.nan}, "gain_sd is nan"),
        ({"jitter_us": -0.5}, "jitter_us is -0.5"),
        ({"slew_volts_per_us": 0.0}, "above 0"),
        ({"slew_volts_per_us": -0.5}, "above 0"),
    ],
)
def test_errors_out_of_range_are_refused(error: dict[str, float], words: str) -> None:
    with pytest.raises(ToleranceError, match=words):
        DriveError(**error)
    with pytest.raises(ToleranceError, match="n_generators is 0"):
        drive_tolerance(np.zeros((1, 4)), TWO, n_generators=0)
