"""Claims about learning from contact times: what a few actuations tell, and how well the scales follow from it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ndtri

import by_hand
from softclose import Waveform, simulate
from softclose.conditions.learning import OVERDRIVE, TailoredByLearning, actuate
from softclose.conditions.streams import Ensemble
from softclose.device.device import Device
from softclose.evaluate import draw, evaluate, judge, respond
from softclose.evaluate.chain import chain_of
from softclose.evaluate.realise import actuations, draw_after, n_actuations
from softclose.population.population import index_uniforms
from softclose.settings import load_config


def config(*settings):
    return load_config("current-trim", ["trim.measured=contact times", *settings])


def learner(c):
    """What the campaign learns from contact times."""
    return next(found for found in chain_of(c).conditions if isinstance(found, TailoredByLearning))


def told_of(c, lot, seed):
    """What the actuations of a lot tell, with errors of timing of a seed."""
    return learner(c).told(lot, index_uniforms(len(lot), seed=seed, start=0, stream=0)[:, 0])


def touch(switches, volts):
    """Each switch's answer to its own step, simulated alone."""
    return np.array([first_contact(s, v) for s, v in zip(switches, volts, strict=True)])


def first_contact(switch, volts):
    """By a step of its own, without the scaling that the protocol uses."""
    drive = Waveform.from_rows([(0.0, 4.0, None, float(volts))])
    return simulate(switch[None], drive).first_contact_us[0]


def test_the_bisection_brackets_the_lowest_step_that_touches():
    c = config("trim.actuations=13", "trim.contact_time_error_us=0")
    lot = draw(load_config({}), 12, seed=2)
    for switch, (threshold, time) in zip(lot.switches, told_of(c, lot, 2), strict=True):
        assert np.isfinite(first_contact(switch, threshold * 1.001))
        assert np.isinf(first_contact(switch, threshold * 0.999))
        assert time == pytest.approx(first_contact(switch, OVERDRIVE * threshold), abs=1e-4)


@pytest.mark.parametrize("actuations", [2, 5, 10])
def test_no_switch_is_actuated_more_often_than_stated(actuations):
    c, calls = config(f"trim.actuations={actuations}"), []

    def counted(switches, volts):
        calls.append(len(switches))
        return touch(switches, volts)

    protocol = learner(c).learned.protocol
    actuate(counted, draw(load_config({}), 4, seed=1).switches, protocol, np.full(4, 0.5))
    assert len(calls) - 1 + protocol.timed == actuations


def relative_errors(c, n=3000):
    learned, lot = learner(c).learned, draw(load_config({}), n, seed=8)
    return learned.estimate(told_of(c, lot, 8)) / learned.trim.true(lot.switches) - 1.0


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
    whole = draw(c, 40, seed=3, ensemble=Ensemble.CERTIFICATE)
    later = draw(c, 15, seed=3, start=20, ensemble=Ensemble.CERTIFICATE)
    for name in whole:
        np.testing.assert_array_equal(later[name], whole[name][20:35], name)
    other = draw(c, 40, seed=3, ensemble=Ensemble.TAIL)
    assert (other["voltage_scale"] != whole["voltage_scale"]).all()


def test_a_lot_learned_from_contact_times_lands_softer_than_one_driven_alike():
    from softclose.baselines import deterministic_design

    c = config("trim.keep_limits=false")
    drive = deterministic_design(c.build_population(), hold_volts=75.0)
    lot = draw(c, 3000, seed=1)
    learned = evaluate(c, lot, drive, fresh=True)
    alike = judge(c, respond(c, lot, drive, for_everybody=True), fresh=True)
    measured = load_config("current-trim", ["trim.keep_limits=false"])
    instrument = evaluate(measured, draw(measured, 3000, seed=1), drive, fresh=True)
    assert learned.v_u_cm_s < 0.7 * alike.v_u_cm_s
    assert learned.v_u_cm_s < 1.1 * instrument.v_u_cm_s


def test_steps_keep_the_drive_s_limit(monkeypatch):
    """Every drive that reaches a switch while it is learned, as the device is asked for it."""
    c, highest = config("waveform.max_volts=110"), []
    respond_plainly = Device.respond

    def seen(self, lot, drives, **outputs):
        volts = np.ones(1) if drives.volts is None else drives.volts
        highest.append(drives.command.max_voltage(c.model.horizon_us) * float(volts.max()))
        return respond_plainly(self, lot, drives, **outputs)

    monkeypatch.setattr(Device, "respond", seen)
    assert learner(c).learned.protocol.highest_V <= 110.0
    lot = draw(c, 50, seed=1)
    assert all(np.isfinite(lot[name]).all() for name in ("threshold", "voltage_scale", "time_scale"))
    assert max(highest) == pytest.approx(110.0)
    assert len(highest) >= 2 * (c.trim.actuations - 2)


def test_a_switch_that_never_touches_still_gets_scales():
    c = config("waveform.max_volts=70")
    lot = draw(c, 200, seed=1)
    assert np.isinf(lot["contact_time"]).any()
    for name in ("voltage_scale", "time_scale"):
        assert np.isfinite(lot[name]).all()
        assert (lot[name] > 0.0).all()


def test_the_bisection_spans_the_lot_and_no_more():
    c = config()
    learned = learner(c).learned
    closing, protocol = learned.trim.true(draw(load_config({}), 4096, seed=1).switches)[:, 0], learned.protocol
    assert protocol.lowest_V < 0.8 * closing.min()
    assert protocol.lowest_V > 0.6 * closing.min()
    assert closing.max() < protocol.highest_V < 1.15 * closing.max()


def test_averaging_the_timed_contacts_shrinks_their_error():
    """Three timed contacts: an error of 0.9 µs of each is one of 0.9/√3 of their mean."""
    exact, noisy = config("trim.contact_time_error_us=0"), config("trim.contact_time_error_us=0.9")
    lot = draw(load_config({}), 4000, seed=5)
    told = [told_of(c, lot, 5) for c in (exact, noisy)]
    np.testing.assert_array_equal(told[0][:, 0], told[1][:, 0])
    assert (told[1] - told[0])[:, 1].std() == pytest.approx(0.9 / np.sqrt(3.0), rel=0.04)


def test_the_estimate_has_no_bend_left_over_the_lot():
    """A quadratic regression: what is left is not correlated with the square of what was told."""
    c = config("trim.contact_time_error_us=0")
    lot, learned = draw(load_config({}), 4000, seed=6), learner(c).learned
    told = told_of(c, lot, 6)
    left = np.log(learned.estimate(told) / learned.trim.true(lot.switches))
    x = np.log(told) - np.log(told).mean(axis=0)
    for column in left.T:
        for square in (x[:, 0] ** 2, x[:, 1] ** 2, x[:, 0] * x[:, 1]):
            assert abs(np.corrcoef(column, square)[0, 1]) < 0.08


@pytest.mark.parametrize("amplifier", [(), ("amplifier.offset_volts=3", "amplifier.slew_volts_per_us=60")])
def test_each_switch_is_learned_as_by_actuating_it_alone_through_its_amplifier(amplifier):
    """Also where an amplifier stands in between that is not linear: what is stepped is its command."""
    c = config("trim.actuations=6", *amplifier)
    lot, rows = draw(c, 8, seed=7), by_hand.rows(c, 8, seed=7)
    protocol = learner(c).learned.protocol
    z = ndtri(index_uniforms(8, seed=7, start=0, stream=by_hand.TIMING)[:, 0])
    told = np.array([by_hand.actuated(c, row, protocol, float(e)) for row, e in zip(rows, z, strict=True)])
    np.testing.assert_allclose(lot["threshold"], told[:, 0], rtol=1e-9)
    np.testing.assert_allclose(lot["contact_time"], told[:, 1], rtol=1e-6)
    np.testing.assert_allclose(lot["voltage_scale"], [row["a"] for row in rows], rtol=1e-6)
    np.testing.assert_allclose(lot["time_scale"], [row["b"] for row in rows], rtol=1e-6)


@pytest.mark.parametrize("sampling", ["monte-carlo", "sobol"])
def test_a_lot_after_its_actuations_is_the_lot_that_makes_them(sampling):
    """To the last bit, whatever is sampled of their motion; parts of the ensemble are put together."""
    c, how = config("trim.actuations=7", "amplifier.gain_error=0.01"), {"sampling": sampling}
    times = {"times_us": np.linspace(0.0, 250.0, 11), "dtype": np.float32}
    parts = [actuations(c, 20, seed=5, **start, **how, **times) for start in ({}, {"start": 20})]
    assert [len(part) for part in parts] == [n_actuations(c)] * 2
    assert n_actuations(load_config({})) == 0
    contacts = [np.concatenate([a.response.first_contact_us for a in each]) for each in zip(*parts, strict=True)]
    lot, after = draw(c, 40, seed=5, **how), draw_after(c, 40, contacts, seed=5, **how)
    assert list(lot) == list(after)
    for name in lot:
        assert lot[name].tobytes() == after[name].tobytes()
    others = [a.response.first_contact_us for a in actuations(c, 40, seed=6, **how)]
    assert (draw_after(c, 40, others, seed=5, **how)["threshold"] != lot["threshold"]).any(), "they are what it is told"
