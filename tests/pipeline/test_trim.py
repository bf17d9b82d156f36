"""Claims about trim: scaled drives are equal switches, scales follow from measurements, limits are kept."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import by_hand
from examples import examples
from softclose import Pulse, Waveform, simulate
from softclose.conditions.streams import Ensemble
from softclose.conditions.trim import Tailored, Trim, TrimError, limited, trim_of
from softclose.device.drives import scaled
from softclose.device.scaled import effective
from softclose.evaluate import draw, evaluate, respond
from softclose.evaluate.chain import chain_of
from softclose.evaluate.respond import drives_of
from softclose.population.population import index_uniforms
from softclose.settings import ConfigError, load_config
from softclose.switch.plate import closing_voltage, holding_voltage, pull_in_voltage, resonance
from softclose.waveform.scales import Scales

DRIVE = Waveform([Pulse(0.0, 5.0, 12.0, 100.0), Pulse(30.0, 6.0, 8.0, 130.0), Pulse(60.0, 7.0, math.inf, 90.0)])
PRECISE = {"pull_in_error": 0.0, "resonance_error": 0.0}


def config(**trim):
    return load_config({"trim": {"measured": "pull-in and resonance"} | trim})


def trim(**changes):
    c = config(**changes)
    return trim_of(c.trim, chain_of(c).around)


def measured(t, switches, *, seed):
    """What is measured on switches, with errors of a seed."""
    return t.measured_of(switches, index_uniforms(len(switches), seed=seed, start=0, stream=by_hand.MEASUREMENT)[:, :2])


SCALES = ("voltage_scale", "time_scale")


# A scaled drive.


@settings(max_examples=examples(30), deadline=None)
@given(
    a=st.floats(0.7, 1.4),
    b=st.floats(0.7, 1.4),
    row=st.integers(0, 199),
    volts=st.floats(40.0, 140.0),
    rise=st.floats(6.0, 20.0),
    peak=st.floats(0.0, 30.0),
)
def test_a_scaled_drive_moves_a_switch_as_the_drive_itself_moves_an_equal_one(a, b, row, volts, rise, peak):
    """x(t) of the scaled drive, simulated as it is, against the substitution t = b s in Eq. 1."""
    switch = load_config({}).build_population().sample(200, seed=3)[row : row + 1]
    drive = Waveform([Pulse(0.0, rise, peak, volts), Pulse(40.0, rise, math.inf, 80.0)])
    t = np.linspace(0.0, 39.0, 40)
    own = simulate(switch, scaled(drive, a, b), horizon_us=250.0 * b, times_us=t * b, max_volts=math.inf)
    equal = simulate(
        effective(switch, Scales(volts=np.array([a]), times=np.array([b]))), drive, times_us=t, max_volts=math.inf
    )
    until = np.nan_to_num(equal.first_contact_us, nan=math.inf)[0]
    before = t < until - 1e-6
    np.testing.assert_allclose(own.x[0, before], equal.x[0, before], atol=1e-6)
    np.testing.assert_allclose(own.v[0, before] * b, equal.v[0, before], atol=1e-7)
    if until < 250.0 - 1e-3:
        assert own.first_contact_us[0] == pytest.approx(until * b, abs=1e-3)


def through_model(settings, lot, **outputs):
    """The same campaign with the kernel behind a stranger's name: it is given each drive by itself."""
    calls = []

    def model(switches, waveform, **options):
        calls.append(waveform)
        return simulate(switches, waveform, **options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("softclose.device.device.load_model", lambda name: model)
        patch.setattr("softclose.device.device.SINGLE_MODE", "another")
        return respond(settings, lot, DRIVE, **outputs), calls


@pytest.mark.parametrize("bins", [0, 3])
def test_any_device_model_is_given_the_scaled_drives_and_gives_what_the_kernel_gives(bins):
    c = config(bins=bins)
    lot = draw(c, 120, seed=1)
    outputs = {"times_us": np.linspace(0.0, 250.0, 6), "max_impacts": 3}
    fast = respond(c, lot, DRIVE, **outputs)
    slow, calls = through_model(c, lot, **outputs)
    assert len(calls) == (120 if not bins else len(np.unique([lot[name] for name in SCALES], axis=1).T))
    for name in ("max_contact_speed", "first_contact_us", "impact_time_us", "impact_speed", "x", "v", "final_x"):
        np.testing.assert_allclose(getattr(fast, name), getattr(slow, name), atol=2e-6, err_msg=name)
    np.testing.assert_allclose(fast.settling_us, slow.settling_us, atol=2e-3)
    np.testing.assert_array_equal(fast.closed, slow.closed)
    np.testing.assert_array_equal(fast.times_us, slow.times_us)


def test_without_trim_scales_are_nothing_and_the_bits_are_those_of_before():
    c = load_config({})
    plain = draw(c, 50, seed=1)
    assert [*plain] == ["D", "G", "E", "T", "K", "M"]
    np.testing.assert_array_equal(plain.switches, c.build_population().sample(50, seed=1))
    with_scales = plain.with_columns(voltage_scale=np.full(50, 1.3), time_scale=np.full(50, 1.3))
    a, b = respond(c, plain, DRIVE), respond(c, with_scales, DRIVE)
    np.testing.assert_array_equal(a.max_contact_speed, b.max_contact_speed)
    by_numbers = respond(c, plain.switches, DRIVE)
    np.testing.assert_array_equal(a.max_contact_speed, by_numbers.max_contact_speed)


def test_a_drive_for_everybody_is_that_of_the_lot_without_trim():
    c = config()
    lot = draw(c, 50, seed=4)
    found, plain = respond(c, lot, DRIVE, for_everybody=True), respond(load_config({}), lot.switches, DRIVE)
    np.testing.assert_array_equal(found.max_contact_speed, plain.max_contact_speed)
    assert (respond(c, lot, DRIVE).max_contact_speed != plain.max_contact_speed).all()


def test_trim_draws_the_very_switches_of_the_untrimmed_campaign():
    plain, trimmed = draw(load_config({}), 50, seed=4), draw(config(), 50, seed=4)
    for name in plain:
        np.testing.assert_array_equal(trimmed[name], plain[name], name)
    assert {*trimmed} - {*plain} == {"measured_pull_in", "measured_resonance", *SCALES}


def test_the_columns_are_what_was_measured_and_the_scales_of_it():
    c = config()
    lot, t = draw(c, 40, seed=4), trim()
    u = index_uniforms(40, seed=4, start=0, stream=by_hand.MEASUREMENT)[:, :2]
    read = np.stack([lot["measured_pull_in"], lot["measured_resonance"]], axis=1)
    np.testing.assert_array_equal(read, t.measured_of(lot.switches, u))
    scales = t.scales(read)
    np.testing.assert_array_equal(lot["voltage_scale"], scales.volts)
    np.testing.assert_array_equal(lot["time_scale"], scales.times)


# What follows from the measurements.


def test_the_mean_switch_is_driven_by_the_waveform_itself():
    t = trim(**PRECISE)
    mean = np.asarray(t.population.mean_switch)[None]
    found = t.scales(t.true(mean))
    assert found.volts[0] == pytest.approx(1.0, abs=0.003)
    assert found.times[0] == pytest.approx(1.0, abs=0.003)


def test_perfect_measurements_leave_every_switch_with_the_mean_pull_in_voltage_and_frequency():
    t = trim(**PRECISE)
    switches = t.population.sample(300, seed=2)
    equal = effective(switches, t.scales(t.true(switches)))
    np.testing.assert_allclose(closing_voltage(equal, load_config({}).model.plate_area_um2), t.reference[0], rtol=1e-7)
    np.testing.assert_allclose(resonance(equal), t.reference[1], rtol=1e-7)


def test_the_quantities_that_are_measured():
    """Eq. 3 and √(K/M)/2π, by hand: 1 N/m and 1 µg are 1 kg/s² and 1e-9 kg."""
    switch = np.array([2.0, 4.0, 50.0, 3.0])
    assert resonance(switch) == pytest.approx(math.sqrt(50.0 / 3e-9) / (2.0 * math.pi) / 1e3)
    assert closing_voltage(switch) == pytest.approx(pull_in_voltage(switch))
    shallow = np.array([1.0, 4.0, 50.0, 3.0])
    assert closing_voltage(shallow) == pytest.approx(holding_voltage(shallow))
    assert closing_voltage(shallow) < pull_in_voltage(shallow)


def test_what_is_not_measured_is_followed_as_far_as_it_goes_with_what_is():
    """In this lot pull-in voltage and frequency hang together; a voltage says nothing where nothing is scaled by it."""
    t = trim(measured="pull-in", pull_in_error=0.0)
    switches = t.population.sample(4000, seed=5)
    true = np.log(t.true(switches) / t.reference)
    b = np.log(t.scales(t.true(switches)).times)
    slope = np.polyfit(true[:, 0], true[:, 1], 1)[0]
    left = true[:, 1] + b
    assert left.std() < 0.3 * true[:, 1].std()
    assert abs(np.corrcoef(left, true[:, 0])[0, 1]) < 0.05
    assert t.coefficients[1, 1] == pytest.approx(slope, rel=0.02)
    assert (trim(measured="pull-in", scaled="voltage").scales(t.true(switches)).times == 1.0).all()
    assert (trim(measured="pull-in", scaled="time").scales(t.true(switches)).volts == 1.0).all()


def test_what_is_known_badly_is_followed_less():
    """Of one measured quantity the slope is var / (var + error²): regression to the mean."""
    t = trim(measured="pull-in", pull_in_error=0.1)
    spread = np.log(t.true(t.population.sample(20_000, seed=5))[:, 0]).std()
    assert t.coefficients[0, 1] == pytest.approx(spread**2 / (spread**2 + 0.1**2), rel=0.05)


def test_errors_of_measurement_are_as_large_as_stated_and_independent():
    t = trim(pull_in_error=0.02, resonance_error=0.005)
    switches = t.population.sample(40_000, seed=6)
    relative = measured(t, switches, seed=6) / t.true(switches) - 1.0
    np.testing.assert_allclose(relative.std(axis=0), [0.02, 0.005], rtol=0.02)
    np.testing.assert_allclose(relative.mean(axis=0), 0.0, atol=4e-4)
    others = [*switches.T, *measured(t, switches, seed=7).T / t.true(switches).T]
    for column in relative.T:
        for other in others:
            assert abs(np.corrcoef(column, other)[0, 1]) < 0.02
    assert abs(np.corrcoef(relative.T)[0, 1]) < 0.02


def test_a_switch_s_scales_depend_on_seed_stream_and_index_only():
    c = config()
    whole = draw(c, 60, seed=9, ensemble=Ensemble.TAIL)
    later = draw(c, 25, seed=9, ensemble=Ensemble.TAIL, start=20)
    for name in whole:
        np.testing.assert_array_equal(later[name], whole[name][20:45], name)
    for other in (draw(c, 60, seed=9), draw(c, 60, seed=8, ensemble=Ensemble.TAIL)):
        assert (other["voltage_scale"] != whole["voltage_scale"]).all()


def test_bins_are_equally_likely_and_their_switches_share_a_drive():
    t = trim(measured="pull-in", bins=5)
    switches = t.population.sample(20_000, seed=1)
    values, counts = np.unique(t.scales(measured(t, switches, seed=1)).volts, return_counts=True)
    assert len(values) == 5
    np.testing.assert_allclose(counts / 20_000, 0.2, atol=0.012)
    edges, middles = t.bins_of(0)
    assert (np.diff(np.concatenate([middles[:1], *zip(edges, middles[1:], strict=True)])) > 0.0).all()
    np.testing.assert_allclose(
        np.interp(middles, np.sort(measured(t, switches, seed=1)[:, 0]), np.linspace(0, 1, 20_000)),
        [0.1, 0.3, 0.5, 0.7, 0.9],
        atol=0.012,
    )
    single = trim(measured="pull-in", bins=1)
    assert len(np.unique(single.scales(measured(single, switches, seed=1)).volts)) == 1


# Limits.


def test_no_scaled_drive_exceeds_the_limits():
    c = load_config(
        {"trim": {"measured": "pull-in and resonance"}, "waveform": {"max_volts": 140.0, "min_rise_us": 5.5}}
    )
    lot = draw(c, 400, seed=1)
    drive = Waveform([Pulse(0.0, 5.5, 12.0, 139.0), Pulse(40.0, 6.0, math.inf, 90.0)])
    found = drives_of(chain_of(c), lot, drive)
    for a, b in zip(found.volts, found.times, strict=True):
        own = scaled(drive, a, b)
        own.check(140.0 * (1 + 1e-12), 250.0 * b)
        assert min(p.rise_us for p in own.pulses) >= 5.5 * (1 - 1e-12)
    assert 0.2 < (found.volts < lot["voltage_scale"]).mean() < 0.8
    assert 0.2 < (found.times > lot["time_scale"]).mean() < 0.8
    free = replace(c, trim=replace(c.trim, keep_limits=False))
    unlimited = drives_of(chain_of(free), lot, drive)
    np.testing.assert_array_equal(unlimited.volts, lot["voltage_scale"])
    np.testing.assert_array_equal(unlimited.times, lot["time_scale"])


def test_a_drive_without_volts_or_without_rise_has_no_limit_to_keep():
    asked = Scales(volts=np.array([1.2]), times=np.array([0.8]))
    found = limited(asked, peak_V=0.0, max_volts=100.0, shortest_rise_us=0.0, min_rise_us=4.0)
    assert (found.volts[0], found.times[0]) == (1.2, 0.8)


def test_a_rise_that_is_too_short_already_is_stretched_as_far_as_is_allowed():
    asked = Scales(volts=np.array([1.2]), times=np.array([0.8]))
    found = limited(asked, peak_V=100.0, max_volts=110.0, shortest_rise_us=0.5, min_rise_us=4.0)
    assert (found.volts[0], found.times[0]) == (1.1, 8.0)


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"measured": "pull-in", "pull_in_error": 0.02}, ["one measurement a part: its pull-in voltage, to 2 %"]),
        ({"measured": "resonance", "resonance_error": 0.03}, ["one measurement a part: its resonance, to 3 %"]),
        (
            {"measured": "pull-in and resonance", "pull_in_error": 0.02, "resonance_error": 0.005, "bins": 16},
            ["its pull-in voltage, to 2 %, and its resonance, to 0.5 %", "of the same of 16 bins share a drive"],
        ),
    ],
)
def test_what_each_switch_s_own_drive_rests_on_is_said(settings, said):
    (line,) = Tailored.assumed(load_config({"trim": settings}).trim)
    assert all(words in line for words in said)
    assert ("bins" in line) == ("bins" in settings)
    assert Tailored.assumed(load_config({}).trim) == []


# What it is for.


def test_measuring_each_switch_makes_a_lot_land_softer():
    """A drive that lands the mean switch softly: the better each switch is known, the softer the lot."""
    from softclose.baselines import deterministic_design

    base = config()
    drive = deterministic_design(base.build_population(), hold_volts=75.0)
    v_u = {}
    for name, error in (("exact", 0.0), ("good", 0.01), ("poor", 0.1)):
        c = replace(base, trim=replace(base.trim, pull_in_error=error, resonance_error=error, keep_limits=False))
        v_u[name] = evaluate(c, draw(c, 4000, seed=1), drive, fresh=True).v_u_cm_s
    plain = load_config({})
    untrimmed = evaluate(plain, draw(plain, 4000, seed=1), drive, fresh=True).v_u_cm_s
    assert v_u["exact"] < v_u["good"] < v_u["poor"] < untrimmed
    assert v_u["good"] < 0.7 * untrimmed


def test_the_engines_know_the_trimmed_lot():
    """What the free swing sees of a trimmed lot scatters less."""
    from softclose.propose.protocol import Problem

    def spread(c):
        devices = Problem(c).lot.devices
        return (devices[:, 3].std() / devices[:, 3].mean(), Problem(c).lot.strong_hold_volts)

    plain, trimmed = spread(load_config({})), spread(config())
    assert trimmed[0] < 0.1 * plain[0]
    assert trimmed[1] < plain[1]


# Bad input.


@pytest.mark.parametrize(
    ("values", "said"),
    [([[50.0]], r"shape \(1, 1\); give \(n, 2\)"), ([[-1.0, 50.0]], "pull-in voltage is -1; it must be above 0"),
     ([[50.0, math.nan]], "resonance is nan"),
     ([[0.08, 22.0]], "pull-in voltage is 0.08, but the mean switch of 'current' has .* V: what unit"),
        ([[60.0, 21857.0]], r"resonance is 21857, but the mean switch of 'current' has 22 kHz: what unit")],
)  # fmt: skip
def test_measured_values_that_cannot_be_are_refused(values, said):
    with pytest.raises(TrimError, match=said):
        trim().scales(values)


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [("measured", "weight", "trim.measured is 'weight'"), ("pull_in_error", 0.5, "trim.pull_in_error is 0.5"),
     ("bins", -1, "trim.bins is -1"), ("bins", 2.5, "trim.bins is 2.5"), ("scaled", "mass", "trim.scaled is 'mass'"),
     ("errors", 0.1, "trim.errors")],
)  # fmt: skip
def test_settings_that_cannot_be_are_refused(key, value, said):
    with pytest.raises(ConfigError, match=said):
        load_config({"trim": {key: value}})


def test_an_unused_quantity_may_be_unknown():
    t = trim(measured="pull-in")
    assert np.isfinite(t.scales([[60.0, math.nan]]).volts).all()


def test_a_trim_is_made_of_what_the_configuration_says():
    t = trim(bins=4, scaled="voltage", pull_in_error=0.02)
    assert isinstance(t, Trim)
    assert (t.bins, t.scaled, t.pull_in_error, t.resonance_error) == (4, "voltage", 0.02, 0.01)
    kinds = [[type(condition) for condition in chain_of(c).conditions] for c in (config(), load_config({}))]
    assert [Tailored in kind for kind in kinds] == [True, False]


def test_estimates_from_contact_times_are_followed_as_they_are():
    t = trim(measured="contact times")
    volts, khz = t.reference
    found = t.scales([[1.1 * volts, 0.9 * khz], [volts, khz]])
    np.testing.assert_allclose(found.volts, [1.1, 1.0])
    np.testing.assert_allclose(found.times, [1.0 / 0.9, 1.0])


def test_one_bad_device_among_good_ones_is_named():
    with pytest.raises(TrimError, match="row 1: the pull-in voltage is 0; it must be above 0"):
        trim().scales([[80.0, 22.0], [0.0, 22.0]])
    with pytest.raises(TrimError, match="row 2: the resonance is 99, but"):
        trim().scales([[80.0, 22.0], [81.0, 22.0], [82.0, 99.0]])
    assert np.isfinite(trim().scales([[80.0 / 2.5, 22.0 * 2.5]]).volts).all()
