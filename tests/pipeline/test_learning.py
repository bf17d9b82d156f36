"""Claims about learning from contact times: what a few actuations tell, and how well the scales follow from it."""

from __future__ import annotations

import numpy as np
import pytest

from softclose import Waveform, simulate
from softclose.conditions.learning import OVERDRIVE, actuate
from softclose.evaluate import draw, evaluate, learn, touch_of
from softclose.settings import load_config


def config(*settings):
    return load_config("current-trim", ["trim.measured=contact times", *settings])


def first_contact(switch, volts):
    """By a step of its own, without the scaling that the protocol uses."""
    drive = Waveform.from_rows([(0.0, 4.0, None, float(volts))])
    return simulate(switch[None], drive).first_contact_us[0]


def test_the_bisection_brackets_the_lowest_step_that_touches():
    c = config("trim.actuations=13", "trim.contact_time_error_us=0")
    switches = draw(load_config({}), 12, seed=2)
    told = actuate(touch_of(c), switches, learn(c).protocol, seed=2)
    for switch, (threshold, time) in zip(switches, told, strict=True):
        assert np.isfinite(first_contact(switch, threshold * 1.001))
        assert np.isinf(first_contact(switch, threshold * 0.999))
        assert time == pytest.approx(first_contact(switch, OVERDRIVE * threshold), abs=1e-4)


@pytest.mark.parametrize("actuations", [2, 5, 10])
def test_no_switch_is_actuated_more_often_than_stated(actuations):
    c, calls = config(f"trim.actuations={actuations}"), []
    touch = touch_of(c)

    def counted(switches, volts):
        calls.append(len(switches))
        return touch(switches, volts)

    protocol = learn(c).protocol
    actuate(counted, draw(load_config({}), 4, seed=1), protocol, seed=1)
    assert len(calls) - 1 + protocol.timed == actuations


def relative_errors(c, n=3000):
    learned, trim = learn(c), c.build_trim()
    switches = draw(load_config({}), n, seed=8)
    told = actuate(touch_of(c), switches, learned.protocol, seed=8)
    return learned.estimate(told) / trim.true(switches) - 1.0


def test_ten_actuations_know_a_switch_as_well_as_instruments_of_one_per_cent():
    errors = relative_errors(config())
    assert errors[:, 0].std() < 0.005
    assert errors[:, 1].std() < 0.018
    assert np.abs(errors.mean(axis=0)).max() < 0.002


def test_more_actuations_and_better_clocks_know_more():
    few, many = relative_errors(config("trim.actuations=4")), relative_errors(config())
    assert (few.std(axis=0) > 1.5 * many.std(axis=0))[0]
    assert few[:, 1].std() > 1.2 * many[:, 1].std()
    poor = relative_errors(config("trim.contact_time_error_us=3"))
    assert poor[:, 1].std() > 1.15 * many[:, 1].std()


def test_errors_of_timing_depend_on_the_switch_s_index_only():
    c = config()
    whole = draw(c, 40, seed=3, stream=1)
    np.testing.assert_array_equal(draw(c, 15, seed=3, start=20, stream=1), whole[20:35])
    assert (draw(c, 40, seed=3, stream=2)[:, 4] != whole[:, 4]).all()


def test_a_lot_learned_from_contact_times_lands_softer_than_one_driven_alike():
    from softclose.baselines import deterministic_design

    c = config("trim.keep_limits=false")
    drive = deterministic_design(c.build_population(), hold_volts=75.0)
    lot = draw(c, 3000, seed=1)
    learned = evaluate(c, lot, drive, fresh=True)
    alike = evaluate(c, lot[:, :4], drive, fresh=True)
    measured = load_config("current-trim", ["trim.keep_limits=false"])
    instrument = evaluate(measured, draw(measured, 3000, seed=1), drive, fresh=True)
    assert learned.v_u_cm_s < 0.7 * alike.v_u_cm_s
    assert learned.v_u_cm_s < 1.1 * instrument.v_u_cm_s


def test_steps_keep_the_drive_s_limit():
    c = config("waveform.max_volts=110")
    assert learn(c).protocol.highest_V <= 110.0
    highest = []

    def touch(switches, volts):
        highest.append(float(np.minimum(volts, c.waveform.max_volts).max()))
        return touch_of(c)(switches, volts)

    told = actuate(touch, draw(load_config({}), 50, seed=1), learn(c).protocol, seed=1)
    assert np.isfinite(learn(c).estimate(told)).all()
    assert max(highest) <= 110.0


def test_a_switch_that_never_touches_still_gets_scales():
    c = config("waveform.max_volts=70")
    lot = draw(c, 200, seed=1)
    assert np.isfinite(lot).all()
    assert (lot[:, 4:] > 0.0).all()


def test_the_bisection_spans_the_lot_and_no_more():
    c = config()
    closing = c.build_trim().true(draw(load_config({}), 4096, seed=1))[:, 0]
    protocol = learn(c).protocol
    assert protocol.lowest_V < 0.8 * closing.min()
    assert protocol.lowest_V > 0.6 * closing.min()
    assert closing.max() < protocol.highest_V < 1.15 * closing.max()


def test_averaging_the_timed_contacts_shrinks_their_error():
    """Three timed contacts: an error of 0.9 µs of each is one of 0.9/√3 of their mean."""
    exact, noisy = config("trim.contact_time_error_us=0"), config("trim.contact_time_error_us=0.9")
    switches = draw(load_config({}), 4000, seed=5)
    told = [actuate(touch_of(c), switches, learn(c).protocol, seed=5) for c in (exact, noisy)]
    np.testing.assert_array_equal(told[0][:, 0], told[1][:, 0])
    assert (told[1] - told[0])[:, 1].std() == pytest.approx(0.9 / np.sqrt(3.0), rel=0.04)


def test_the_estimate_has_no_bend_left_over_the_lot():
    """A quadratic regression: what is left is not correlated with the square of what was told."""
    c = config("trim.contact_time_error_us=0")
    switches = draw(load_config({}), 4000, seed=6)
    told = actuate(touch_of(c), switches, learn(c).protocol, seed=6)
    left = np.log(learn(c).estimate(told) / c.build_trim().true(switches))
    x = np.log(told) - np.log(told).mean(axis=0)
    for column in left.T:
        for square in (x[:, 0] ** 2, x[:, 1] ** 2, x[:, 0] * x[:, 1]):
            assert abs(np.corrcoef(column, square)[0, 1]) < 0.08
