"""Drive tolerance: what each error does to a waveform, and that shifts are against the perfect drive."""

from __future__ import annotations

import math

import numpy as np
import pytest

from softclose import Pulse, Waveform, load_population, simulate
from softclose.baselines import deterministic_design
from softclose.settings import load_config
from softclose.uncertainty.tolerance import (
    DEFAULT_ERRORS,
    DriveError,
    ToleranceError,
    _drives,
    distorted,
    drive_tolerance,
)

TWO = Waveform([Pulse(0.0, 4.0, 4.5, 150.0), Pulse(14.0, 8.0, math.inf, 85.0)])


def test_gain_multiplies_the_voltage() -> None:
    t = np.linspace(0.0, 60.0, 601)
    np.testing.assert_allclose(distorted(TWO, DriveError(gain=0.03)).voltage(t), 1.03 * TWO.voltage(t), rtol=1e-12)


def test_a_generator_that_is_fast_enough_changes_nothing() -> None:
    steepest = math.pi * 150.0 / 8.0
    assert distorted(TWO, DriveError(slew_V_per_us=steepest * (1.0 + 1e-12))) == TWO


@pytest.mark.parametrize("slew", [50.0, 30.0, 20.0, 5.0])
def test_a_slewed_waveform_is_no_steeper_than_the_slew_and_begins_to_fall_on_time(slew: float) -> None:
    t = np.linspace(0.0, 100.0, 100_001)
    drive = distorted(TWO, DriveError(slew_V_per_us=slew))
    assert np.abs(np.diff(drive.voltage(t))).max() <= 2.0 * slew * (t[1] - t[0])  # two pulses may add up
    first, wanted = drive.pulses[0], TWO.pulses[0]
    assert first.rise_us + first.peak_us == pytest.approx(wanted.rise_us + wanted.peak_us)
    if slew > 30.0:
        assert np.trapezoid(first.voltage(t), t) == pytest.approx(np.trapezoid(wanted.voltage(t), t))
    else:
        assert first.volts <= wanted.volts


def test_a_slewed_ideal_step_is_a_ramp() -> None:
    step = Waveform([Pulse(0.0, 0.0, math.inf, 100.0)])
    (pulse,) = distorted(step, DriveError(slew_V_per_us=20.0)).pulses
    assert pulse.rise_us == pytest.approx(math.pi * 100.0 / 40.0)
    assert pulse.holds


def test_jitter_moves_later_pulses_only_and_never_before_zero() -> None:
    moved = distorted(TWO, DriveError(), [-0.5])
    assert moved.pulses[0] == TWO.pulses[0]
    assert moved.pulses[1].start_us == 13.5
    assert distorted(TWO, DriveError(), [-20.0]).pulses[1].start_us == 0.0


def test_rows_are_measured_against_the_perfect_drive_on_the_same_switches() -> None:
    population = load_population("current")
    switches = population.sample(200, seed=3)
    waveform = deterministic_design(population)
    errors = (DriveError(), DriveError(gain=0.05), DriveError(gain_sd=0.02, jitter_us=0.3))
    rows = drive_tolerance(switches, waveform, errors=errors, n_generators=8)
    assert [r.error for r in rows] == [DriveError(), *errors]
    assert rows[1].v_u_shift_cm_s == rows[1].p_nc_shift == 0.0
    direct = simulate(switches, distorted(waveform, errors[1]), max_volts=math.inf).max_contact_speed
    assert rows[2].assessment.mean_cm_s == pytest.approx(100.0 * np.nanmean(direct))
    assert rows[2].v_u_shift_cm_s > 1.0
    assert rows == drive_tolerance(switches, waveform, errors=errors, n_generators=8)


def test_every_switch_is_driven_once_also_with_more_generators_than_switches() -> None:
    switches = load_population("current").sample(5, seed=3)
    row = drive_tolerance(switches, TWO, errors=[DriveError(jitter_us=0.1)], n_generators=64)[1]
    assert row.assessment.n == 5


def _lot_of_generators(error: DriveError, n: int = 2000, waveform: Waveform = TWO) -> list[Waveform]:
    return [drive for _, drive in _drives(n, waveform, error, n, 5)]


@pytest.mark.parametrize(("n", "generators"), [(10, 3), (5, 64), (64, 64), (7, 1)])
def test_generators_share_the_switches_evenly_and_leave_none_out(n: int, generators: int) -> None:
    shares = [range(n)[share] for share, _ in _drives(n, TWO, DriveError(jitter_us=0.1), generators, 0)]
    assert [i for share in shares for i in share] == list(range(n))
    assert len(shares) == min(n, generators)
    assert max(map(len, shares)) - min(map(len, shares)) <= 1


def test_a_systematic_gain_stays_where_gains_scatter_about_it() -> None:
    gains = np.array([d.pulses[0].volts / 150.0 - 1.0 for d in _lot_of_generators(DriveError(gain=0.03, gain_sd=0.01))])
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
    draws = np.array([[d.pulses[0].volts / 150.0 - 1.0, *(p.start_us for p in d.pulses[1:])] for d in drives])
    np.testing.assert_allclose(draws.mean(axis=0), [0.0, 30.0, 60.0], atol=0.02)
    np.testing.assert_allclose(draws.std(axis=0), [0.01, 0.3, 0.3], rtol=0.05)
    assert np.abs(np.corrcoef(draws.T) - np.eye(3)).max() < 0.06
    assert all(d.pulses[0].start_us == 0.0 for d in drives)


def test_scenarios_of_different_size_draw_the_same_generators() -> None:
    small, large = (
        np.array([d.pulses[0].volts for d in _lot_of_generators(DriveError(gain_sd=sd), 50)]) for sd in (0.01, 0.02)
    )
    np.testing.assert_allclose(large - 150.0, 2.0 * (small - 150.0), rtol=1e-9)
    other = [d.pulses[0].volts for _, d in _drives(50, TWO, DriveError(gain_sd=0.01), 50, 6)]
    assert not set(small) & set(other)


def test_no_generator_drives_below_zero() -> None:
    volts = [d.pulses[0].volts for d in _lot_of_generators(DriveError(gain=-1.0, gain_sd=0.5), 50)]
    assert min(volts) == 0.0 < max(volts)


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
        changed = [f for f in ("gain", "gain_sd", "jitter_us", "slew_V_per_us") if getattr(e, f) != getattr(perfect, f)]
        assert len(changed) == 1


@pytest.mark.parametrize(
    ("error", "words"),
    [
        ({"gain": -1.01}, "gain is -1.01"),
        ({"gain_sd": math.nan}, "gain_sd is nan"),
        ({"jitter_us": -0.5}, "jitter_us is -0.5"),
        ({"slew_V_per_us": 0.0}, "above 0"),
        ({"slew_V_per_us": -0.5}, "above 0"),
    ],
)
def test_errors_out_of_range_are_refused(error: dict[str, float], words: str) -> None:
    with pytest.raises(ToleranceError, match=words):
        DriveError(**error)
    with pytest.raises(ToleranceError, match="n_generators is 0"):
        drive_tolerance(np.zeros((1, 4)), TWO, n_generators=0)
