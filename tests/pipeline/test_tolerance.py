"""Drive tolerance: what each error does to a waveform, and that shifts are against the perfect drive."""

from __future__ import annotations

import math

import numpy as np
import pytest

from softclose import Pulse, Waveform, load_population, simulate
from softclose.baselines import deterministic_design
from softclose.uncertainty.tolerance import DEFAULT_ERRORS, DriveError, ToleranceError, distorted, drive_tolerance

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


def test_default_scenarios_change_one_thing_each() -> None:
    perfect = DriveError()
    for e in DEFAULT_ERRORS:
        changed = [f for f in ("gain", "gain_sd", "jitter_us", "slew_V_per_us") if getattr(e, f) != getattr(perfect, f)]
        assert len(changed) == 1


@pytest.mark.parametrize(
    ("error", "words"),
    [({"gain": -2.0}, "gain is -2"), ({"jitter_us": -1.0}, "jitter_us is -1"), ({"slew_V_per_us": 0.0}, "above 0")],
)
def test_errors_out_of_range_are_refused(error: dict[str, float], words: str) -> None:
    with pytest.raises(ToleranceError, match=words):
        DriveError(**error)
    with pytest.raises(ToleranceError, match="n_generators is 0"):
        drive_tolerance(np.zeros((1, 4)), TWO, n_generators=0)
