"""Every analysis under every condition: no answer forgets one. Each is held against switches simulated by hand."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import by_hand
from conditions_of_campaigns import CONDITIONS, DRIVE, compatible, config
from examples import examples, in_turn, is_whole
from softclose import Trace
from softclose.conditions.streams import BRAKE, Draw, Ensemble, Stream, StreamError, check
from softclose.device.device import Device
from softclose.evaluate import coordinates, draw, evaluate, realise, respond, uniforms
from softclose.evaluate.chain import CONDITIONS as KINDS
from softclose.evaluate.chain import chain_of
from softclose.evaluate.pieces import here
from softclose.evaluate.realise import column_names
from softclose.metrics.objective import in_time
from softclose.opening import assess_opening, let_go, opened
from softclose.population import load_population
from softclose.population.lot import LotError
from softclose.uncertainty import tails
from softclose.uncertainty.devices import propagate
from softclose.uncertainty.drift import drift
from softclose.uncertainty.sensitivity import sensitivity
from softclose.uncertainty.tolerance import DriveError, drive_tolerance

N = 16
SHARE = 4
"""Each analysis is tried under one condition in so many in `make test`, each under others; under all in `make long`."""


def each(first: int) -> pytest.MarkDecorator:
    """Every condition; long but for each fourth from `first` on."""
    return pytest.mark.parametrize("name", in_turn(CONDITIONS, SHARE, first))


SAME_AS_PLAIN = {"closed in time"}
"""Conditions under which the motion is the plain one, only how it is judged is not."""


def close(found, wanted) -> None:  # type: ignore[no-untyped-def]
    """Speeds to 1e-3 cm/s but for switches that graze, of which there is one at most; closing alike."""
    v, w = np.asarray(found.max_contact_speed) * 100.0, np.asarray(wanted.max_contact_speed) * 100.0
    apart = ~((np.abs(v - w) < 1e-3 * np.maximum(1.0, w)) | (np.isnan(v) & np.isnan(w)))
    assert apart.sum() <= len(v) // 16, (v[apart], w[apart])
    assert (np.asarray(found.closed) != wanted.closed).sum() <= len(v) // 16
    same = ~apart & np.isfinite(wanted.settling_us) & np.isfinite(found.settling_us)
    np.testing.assert_allclose(np.asarray(found.settling_us)[same], wanted.settling_us[same], atol=0.3)


def differs(a, b) -> bool:  # type: ignore[no-untyped-def]
    """Whether speeds or closing differ."""
    x, y = np.nan_to_num(a.max_contact_speed), np.nan_to_num(b.max_contact_speed)
    return bool((np.abs(x - y) > 1e-5).sum() > len(x) // 4)


@each(0)
def test_a_response_is_that_of_each_switch_under_its_own_drive(name: str) -> None:
    c = config(name)
    lot = draw(c, N, seed=3)
    found = respond(c, lot, DRIVE)
    close(found, by_hand.respond(c, by_hand.rows(c, N, seed=3), DRIVE))
    plain = config()
    assert name in SAME_AS_PLAIN or differs(found, respond(plain, draw(plain, N, seed=3), DRIVE))


@each(3)
def test_a_recorded_drive_reaches_every_switch_scaled_as_its_own(name: str) -> None:
    t = np.linspace(0.0, 250.0, 501)
    trace = Trace(t, DRIVE.voltage(t))
    c = config(name)
    close(respond(c, draw(c, 8, seed=3), trace), by_hand.respond(c, by_hand.rows(c, 8, seed=3), trace))


@each(2)
def test_a_drive_for_everybody_is_tailored_to_no_switch_and_keeps_its_errors(name: str) -> None:
    c = config(name)
    found = respond(c, draw(c, 8, seed=3), DRIVE, for_everybody=True)
    close(found, by_hand.respond(c, by_hand.rows(c, 8, seed=3), DRIVE, tailored=False))


def is_short(names: tuple[str, ...]) -> bool:
    """Whether they are tried here: not where they have a kernel that nothing else needs."""
    delivered = {"bandwidth", "slew and resolution"}.intersection(names)
    return is_whole() or not (delivered and {"film", "two modes"}.intersection(names))


TOGETHER = [
    names for n in (2, 3) for names in itertools.combinations(CONDITIONS, n) if compatible(names) and is_short(names)
]


@settings(max_examples=examples(25), deadline=None)
@given(st.sampled_from(TOGETHER), st.integers(0, 2**16))
def test_conditions_compose(names: tuple[str, ...], seed: int) -> None:
    c = config(*names)
    close(respond(c, draw(c, 4, seed=seed), DRIVE), by_hand.respond(c, by_hand.rows(c, 4, seed=seed), DRIVE))


@each(3)
def test_an_assessment_is_that_of_the_switches_by_hand(name: str) -> None:
    from softclose.evaluate import judge

    c = config(name)
    a = evaluate(c, draw(c, N, seed=5), DRIVE, fresh=True)
    wanted = judge(c, by_hand.respond(c, by_hand.rows(c, N, seed=5), DRIVE), fresh=True)
    assert a.p_nc == pytest.approx(wanted.p_nc, abs=1.01 / N)
    assert a.mean_cm_s == pytest.approx(wanted.mean_cm_s, rel=0.02)


@each(4)
def test_tolerance_starts_from_the_lot_under_its_conditions_and_a_gain_reaches_every_drive(name: str) -> None:
    c = config(name)
    lot = draw(c, N, seed=2)
    perfect, high = drive_tolerance(lot, DRIVE, errors=[DriveError(gain=0.03)], config=c)
    assert perfect.assessment == evaluate(c, lot, DRIVE, fresh=True)
    rows = [row | {"gain": row.get("gain", 1.0) * 1.03} for row in by_hand.rows(c, N, seed=2)]
    wanted = by_hand.respond(c, rows, DRIVE)
    assert high.assessment.mean_cm_s == pytest.approx(100.0 * np.nanmean(wanted.max_contact_speed), rel=0.01)


@each(5)
def test_a_slew_rate_of_a_tolerance_is_the_amplifier_s(name: str) -> None:
    c = config(name)
    lot = draw(c, 8, seed=2)
    row = drive_tolerance(lot, DRIVE, errors=[DriveError(slew_volts_per_us=10.0)], config=c)[1]
    slower = replace(c, amplifier=replace(c.amplifier, slew_volts_per_us=10.0))
    assert row.assessment == evaluate(slower, lot, DRIVE, fresh=True)


@each(6)
@pytest.mark.parametrize("kind", ["stiffness", "charge"])
def test_drift_moves_the_lot_under_its_conditions(name: str, kind: str) -> None:
    c = config(name)
    lot = draw(c, 8, seed=2)
    value = 0.05 if kind == "stiffness" else 3.0
    found = drift(c, lot, DRIVE, kind, [value]).rows[-1].assessment  # type: ignore[arg-type]
    rows = by_hand.rows(c, 8, seed=2)
    if kind == "stiffness":
        rows = [row | {"K": row["K"] * 1.05**2} for row in rows]
    else:
        c = replace(c, amplifier=replace(c.amplifier, offset_volts=c.amplifier.offset_volts - 3.0))
    wanted = by_hand.respond(c, rows, DRIVE)
    assert found.mean_cm_s == pytest.approx(100.0 * np.nanmean(wanted.max_contact_speed), rel=0.02)


@each(7)
def test_the_space_of_rare_failures_is_the_lot_with_all_that_its_conditions_draw(name: str) -> None:
    c = config(name)
    u = uniforms(c, N, seed=4)
    from scipy.special import ndtri

    space = tails._Space(c, DRIVE, "fast", 19.7, here)
    normal = np.hstack([ndtri(u[x.name]) for x in coordinates(c)])
    found, wanted = tails._lot_at(c, normal), realise(c, u)
    assert list(found) == list(wanted)
    for column in found:
        np.testing.assert_allclose(found[column], wanted[column], rtol=1e-6)
    speeds = 100.0 * np.nan_to_num(by_hand.respond(c, by_hand.rows(c, N, seed=4), DRIVE).max_contact_speed)
    assert (np.abs(space(normal)[:, 0] - speeds) > 0.05).sum() <= 1


@pytest.mark.parametrize(
    ("name", "method"),
    in_turn(
        (
            pytest.param(name, method)
            for name in ("trim by both", "gain errors", "clock errors", "temperature")
            for method in ("importance", "subset")
        ),
        3,
    ),
)
def test_reliability_methods_agree_with_brute_force(name: str, method: str) -> None:
    c = config(name)
    limit = {"trim by both": 20.0, "temperature": 27.0}.get(name, 32.0)
    brute, other = tails.tail(
        c, DRIVE, "fast", limit_cm_s=limit, methods=["brute", method], n_switches=40_000, relative_error=0.1
    )  # type: ignore[arg-type]
    assert other.probability == pytest.approx(brute.probability, rel=0.4)


@each(8)
def test_sensitivity_has_an_index_for_everything_that_is_drawn(name: str) -> None:
    c = config(name)
    n = 16
    found = sensitivity(c.build_population(), DRIVE, n=n, n_replicates=2, config=c)
    names = [part for x in coordinates(c) for part in x.parts]
    assert [i.variable for i in found.indices if i.output == "v_cm_s"] == names
    assert found.n_simulated == 2 * n * (len(names) + 2)
    lot = draw(c, 400, seed=1)
    r = respond(c, lot, DRIVE)
    assert found.p_closed == pytest.approx(in_time(r, c.objective.closed_by_us).mean(), abs=0.12)


@each(9)
def test_propagation_keeps_the_conditions_of_the_lot_that_is_believed(name: str) -> None:
    c = config(name)
    population = c.build_population()
    found = propagate(c, DRIVE, population, 12, n_lots=20, n_switches=N, seed=3)
    u = {
        0: population.uniforms(N, seed=3, stream=int(Ensemble.DEVICES)),
        **{
            int(s): by_hand.index_uniforms(N, seed=3, start=0, stream=int(Ensemble.DEVICES) + int(s))
            for s in Stream
            if s is not Stream.LOT
        },
    }
    wanted = by_hand.respond(c, by_hand.at(c, u), DRIVE)
    assert found.assessment.mean_cm_s == pytest.approx(100.0 * np.nanmean(wanted.max_contact_speed), rel=0.02)


@each(10)
def test_a_lot_opens_under_its_conditions(name: str) -> None:
    """Held and stuck by hand: where a switch is when its own drive lets go."""
    c = config(name, opening={"release_us": 300.0, "watch_us": 120.0})
    drive = opened(DRIVE, 300.0)
    lot = draw(c, N, seed=6)
    found = let_go(c, lot, drive, at_us=300.0)
    for i, row in enumerate(by_hand.rows(c, N, seed=6)):
        own, b = by_hand.own_drive(c, row, drive, horizon_us=420.0)
        held, overshoot = True, 0.0
        for switch in by_hand.cases(c, row):
            times = b * np.linspace(300.0, 420.0, 801)
            r = by_hand.model(c, switch, own, 420.0 * b, times_us=times)
            x = r.x[0] / switch["D"]
            held = held and abs(x[0] - 1.0) < 1e-6 and r.status[0] == 0
            overshoot = max(overshoot, -float(x.min()))
        assert found.held[i] == held, i
        if held:
            assert found.overshoot[i] == pytest.approx(overshoot, abs=2e-3), i
    if found.held.sum() >= 10:
        assert math.isfinite(assess_opening(c, found).overshoot)


def test_a_lot_without_what_a_condition_needs_is_refused() -> None:
    switches = load_population("current").sample(4, seed=1)
    for name, column in (("trim by both", "voltage_scale"), ("gain errors", "gain"), ("learned trim", "voltage_scale")):
        with pytest.raises(LotError, match=f"no column {column}"):
            respond(config(name), switches, DRIVE)


def test_a_design_moves_nominal_values_and_the_conditions_believe_in_it() -> None:
    c = config("trim by both")
    u = uniforms(c, 2000, seed=1)
    plain, thicker = realise(c, u), realise(c, u, design={"T": 7.5, "D": 2.0})
    assert thicker["T"].mean() == pytest.approx(7.5, rel=0.01)
    assert thicker["D"].mean() == pytest.approx(2.0, rel=0.01)
    np.testing.assert_allclose(thicker["D"] / plain["D"], 2.0 / c.build_population().D.mean)
    assert thicker["voltage_scale"].mean() == pytest.approx(1.0, abs=0.01), "the mean switch of the design has scale 1"


def test_every_lot_is_made_piece_by_piece_as_in_one() -> None:
    for c in (config("trim by both", "gain errors"), config("learned trim"), config("temperature")):
        whole = draw(c, 40, seed=7, ensemble=Ensemble.CERTIFICATE)
        part = draw(c, 11, seed=7, start=20, ensemble=Ensemble.CERTIFICATE)
        for column in whole:
            np.testing.assert_array_equal(part[column], whole[column][20:31])


def test_what_fills_the_unit_cube_are_a_switch_s_own_variables_and_conditions_draw_at_random() -> None:
    c = config("gain errors", "trim by both")
    plain, even = (draw(c, 32, seed=3, sampling=how) for how in ("monte-carlo", "sobol"))
    np.testing.assert_array_equal(even.switches, c.build_population().sample(32, seed=3, sampling="sobol"))
    np.testing.assert_array_equal(even["gain"], plain["gain"])
    assert (even["D"] != plain["D"]).all()
    other = draw(c, 32, seed=3, sampling="sobol", ensemble=Ensemble.CERTIFICATE)
    assert all((other[name] != even[name]).all() for name in ("D", "gain"))


def test_the_chain_of_a_configuration_is_made_once() -> None:
    one, other = config("trim by both"), config("trim by both")
    assert chain_of(one) is chain_of(one)
    assert chain_of(one) is not chain_of(other)


def test_another_end_of_a_simulation_is_that_of_a_campaign_with_that_horizon() -> None:
    c = config("gain errors")
    lot = draw(c, 8, seed=3)
    shorter = replace(c, model=replace(c.model, horizon_us=60.0))
    cut = respond(c, lot, DRIVE, horizon_us=60.0)
    np.testing.assert_array_equal(cut.final_x, respond(shorter, lot, DRIVE).final_x)
    assert (cut.final_x != respond(c, lot, DRIVE).final_x).any()


def test_streams_keep_the_numbers_that_stores_were_written_with() -> None:
    """A store is a function of its configuration, today as when it was begun: no number of a stream ever changes."""
    assert {s.name: int(s) for kind in (Ensemble, Stream, Draw) for s in kind} == {
        "TRAINING": 0,
        "CERTIFICATE": 1,
        "TAIL": 2,
        "DEVICES": 7_400_000,
        "PRIOR": 7_650_000,
        "CONTROL": 7_920_000,
        "LOT": 0,
        "MEASUREMENT": 7_100_000,
        "DRIVE": 7_200_000,
        "TEMPERATURE": 7_300_000,
        "TIMING": 7_500_000,
        "MODEL_ERROR": 7_600_000,
        "TOLERANCE": 8_000_001,
        "SENSITIVITY": 8_000_002,
    }
    assert BRAKE == 19


def test_two_streams_that_are_equal_are_an_error() -> None:
    import enum

    class One(enum.IntEnum):
        A = 0
        B = 7_300_000

    class Two(enum.IntEnum):
        LOT = 0
        TEMPERATURE = 7_300_000

    with pytest.raises(StreamError, match="both 7300000"):
        check(One, Two)
    check(Ensemble, Stream)
    assert len(KINDS) == len({kind.__name__ for kind in KINDS})


@pytest.mark.parametrize("name", CONDITIONS)
def test_the_columns_of_a_lot_are_known_before_it_is_drawn(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = config(name)
    with monkeypatch.context() as patch:
        patch.setattr(Device, "respond", lambda *_, **__: pytest.fail("a simulation names no column"))
        names = column_names(asked)
    assert names == tuple(draw(asked, 3, seed=1))
