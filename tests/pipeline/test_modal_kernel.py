"""Claims about the kernel of any modes and contacts, on single switches: motion, contacts, endings, steps, outputs."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from modal_reference import oracle
from softclose import Losses, Pulse, ReducedOrder, Waveform, simulate
from softclose.device.simulate import Responses, Status
from softclose.switch.collapse import collapse_voltage
from softclose.switch.plate import pull_in_voltage
from softclose.switch.reduced_order import Capacitance, CompliantContact, Dielectric, Mode
from softclose.waveform import Trace

AREA = 16700.0
MEAN = np.array([2.43, 3.68, 65.3, 3.41])
TRAVEL, GAP, STIFFNESS, MASS = MEAN
HARD = Waveform([Pulse(0.0, 4.0, 11.5, 120.0), Pulse(24.0, 12.0, math.inf, 75.0)])
STRONG = Waveform([Pulse(0.0, 4.0, 14.0, 150.0), Pulse(26.0, 6.0, math.inf, 110.0)])
STEPPED = Waveform([Pulse(0.0, 0.0, 12.0, 140.0), Pulse(26.0, 0.0, math.inf, 110.0)])
"""Edges of no length: two pieces of a drive that do not join."""
FIRST = Mode(frequency_kHz=20.0, mass_ug=3.4, quality_factor=40.0, contact=2.0, electrode=1.8)
SECOND = Mode(frequency_kHz=70.0, mass_ug=1.0, quality_factor=25.0, contact=-0.3, electrode=0.15)
PLATE = Mode(frequency_kHz=20.0)
OPEN = np.array([3.3, GAP, STIFFNESS, MASS])
"""So far to go that it swings freely."""


def capacitance(begin: float, end: float, *, polynomial: bool) -> Capacitance:
    """Roughly that of plates, from begin to end."""
    if polynomial:
        return Capacitance(gap_um=3.7, polynomial_fF=(40.0, 11.0, 2.8, 0.9, 0.3), valid_um=(begin, end))
    x = np.linspace(begin, end, 60)
    return Capacitance(gap_um=3.7, travel_um=tuple(x.tolist()), capacitance_fF=tuple((145.0 / (3.6 - x)).tolist()))


def scaled_slope(table: Capacitance) -> Callable[[float], float]:
    """dC/dx of a device of another gap, C(x; G) = (G0 / G) C0(x G0 / G)."""
    s = table.gap_um / GAP
    joined: Callable[[float], Any]
    if table.polynomial_fF:
        joined = np.polynomial.Polynomial(table.polynomial_fF).deriv()
    else:
        joined = CubicSpline(table.travel_um, table.capacitance_fF).derivative()
    return lambda x: s * s * float(joined(s * x))


TABLE, POLYNOMIAL = (capacitance(-3.4, 3.2, polynomial=p) for p in (False, True))
AIR = Losses(film_viscosity_uPa_s=18.0)
THIN = Losses(film_viscosity_uPa_s=18.0, film_mean_free_path_um=0.07, film_pressure_kPa=20.0)
SOFT = CompliantContact(force_at_1_um_uN=2e5, exponent=1.5, loss_us_per_um=2.0, dashpot_uN_s_per_m=900.0)
FLIGHTS: dict[str, tuple[ReducedOrder, Losses, Waveform, float, dict[str, Any]]] = {
    "film": (ReducedOrder(mode=(FIRST, SECOND)), AIR, STRONG, 17.0, {"film": AIR.film(AREA)}),
    "slipping film, three modes that stretch": (
        ReducedOrder(
            mode=(
                Mode(frequency_kHz=20.0, cubic_per_um2=0.04),
                Mode(
                    frequency_kHz=55.0, mass_ug=0.7, contact=0.2, electrode=0.3, cubic_per_um2=0.5, quality_factor=9.0
                ),
                Mode(frequency_kHz=90.0, mass_ug=0.9, contact=-0.3, electrode=0.1),
            )
        ),
        THIN,
        HARD,
        30.0,
        {"film": THIN.film(AREA), "free_path": THIN.free_path_um, "cubic": np.array([0.04, 0.5, 0.0])},
    ),
    "dielectric": (
        ReducedOrder(mode=(FIRST, SECOND), dielectric=Dielectric(thickness_um=0.8, permittivity=4.0)),
        Losses(),
        STEPPED,
        40.0,
        {"coat": 0.2},
    ),
    "table": (
        ReducedOrder(mode=(FIRST, SECOND), capacitance=TABLE),
        Losses(),
        STRONG,
        17.9,
        {"slope": scaled_slope(TABLE)},
    ),
    "polynomial": (
        ReducedOrder(mode=(PLATE,), capacitance=POLYNOMIAL),
        Losses(),
        STEPPED,
        40.0,
        {"slope": scaled_slope(POLYNOMIAL)},
    ),
    "compliant contact that sticks": (
        ReducedOrder(mode=(FIRST, SECOND), contact=SOFT),
        Losses(adhesion_uN=80.0),
        STRONG,
        46.0,
        {"compliance": (200.0, 1.5, 2.0), "dashpot": 0.9, "adhesion": 0.08},
    ),
}
"""Models, losses and drives, an instant after the first impact, and the same for the other integrator."""

THREE_MODES = pytest.param("slipping film, three modes that stretch", marks=pytest.mark.long)
"""They have a kernel of their own to compile."""


def run(modes: ReducedOrder, drive: Any, switch: np.ndarray = MEAN, **more: Any) -> Responses:
    """One switch by this kernel, whatever series there are."""
    given = {"rtol": 1e-11, "max_impacts": 400, "max_volts": math.inf, "plate_area_um2": AREA, "max_steps": 1000}
    return simulate([switch], drive, modes=modes, method="rk", **(given | more))


@pytest.mark.parametrize("name", [THREE_MODES, *(name for name in FLIGHTS if name != THREE_MODES.values[0])])
def test_a_switch_moves_as_another_integrator_says(name: str) -> None:
    """Its impacts and, between them, the motion of contact and further modes at an instant within a step."""
    modes, losses, drive, until, others = FLIGHTS[name]
    expected = oracle(modes, MEAN, **others).run(drive, until, least_speed=0.0)
    n = len(modes.mode)
    times = np.array([0.0, 0.37, 0.5 * until, until])
    found = run(modes, drive, horizon_us=until + 3.0, times_us=times, losses=losses, further_modes=n > 1)
    assert found.impact_time_us is not None
    assert found.impact_speed is not None
    seen = found.impact_time_us[0] < until
    assert len(expected.impacts) == seen.sum() >= 1
    np.testing.assert_allclose(found.impact_time_us[0][seen], [t for t, _ in expected.impacts], atol=1e-6)
    np.testing.assert_allclose(found.impact_speed[0][seen], [v for _, v in expected.impacts], atol=1e-7)
    assert found.first_contact_us[0] == pytest.approx(expected.impacts[0][0], abs=1e-6)
    assert found.max_contact_speed[0] == pytest.approx(float(np.nanmax(found.impact_speed[0])), abs=1e-12)
    assert found.n_impacts[0] == np.isfinite(found.impact_time_us[0]).sum()
    assert found.x is not None
    assert found.v is not None
    assert found.x[0, 0] == found.v[0, 0] == 0.0
    contact = np.array([m.contact for m in modes.mode])
    q, p = expected.motion[:n], expected.motion[n:]
    assert found.x[0, -1] == pytest.approx(float(contact @ q), abs=1e-6)
    assert found.v[0, -1] == pytest.approx(float(contact @ p), abs=1e-6)
    if n > 1:
        assert found.mode_x is not None
        assert found.mode_v is not None
        np.testing.assert_allclose(found.mode_x[0, :, -1], (contact * q)[1:], atol=1e-6)
        np.testing.assert_allclose(found.mode_v[0, :, -1], (contact * p)[1:], atol=1e-6)


@pytest.mark.parametrize("name", [THREE_MODES, "compliant contact that sticks"])
def test_what_is_told_of_an_instant_is_where_a_motion_ends_that_ends_then(name: str) -> None:
    """At instants close to each other, so that some lie anywhere in a step, with contacts among them."""
    modes, losses, drive, _, _ = FLIGHTS[name]
    times = np.linspace(0.5, 40.0, 9)
    found = run(modes, drive, horizon_us=41.0, times_us=times, losses=losses, rtol=1e-10)
    assert found.x is not None
    assert found.v is not None
    for j, t in enumerate(times):
        end = run(modes, drive, horizon_us=float(t), losses=losses, rtol=1e-12)
        assert found.x[0, j] == pytest.approx(end.final_x[0], abs=1e-7)
        assert found.v[0, j] == pytest.approx(end.final_v[0], abs=1e-7)


RELEASED = Waveform([Pulse(0.0, 4.0, 45.0, 110.0)])
BEAM = ReducedOrder(
    mode=(
        Mode(frequency_kHz=18.0, mass_ug=2.1, quality_factor=12.0, electrode=0.8),
        Mode(frequency_kHz=96.0, mass_ug=2.4, quality_factor=30.0, contact=-0.6, electrode=0.25),
    )
)


@pytest.mark.parametrize(("adhesion", "until"), [(0.0, 48.0), (0.0, 60.0), (60.0, 60.0)])
def test_chatter_holding_and_letting_go_are_those_of_the_constraint(adhesion: float, until: float) -> None:
    """And a switch that sticks is held by as much longer as the constraint's force may pull."""
    expected = oracle(BEAM, MEAN, adhesion=1e-3 * adhesion).follow(RELEASED, until)
    found = run(BEAM, RELEASED, horizon_us=until, losses=Losses(adhesion_uN=adhesion))
    assert found.impact_speed is not None
    assert found.impact_time_us is not None
    assert found.status[0] == Status.OK
    assert expected.ending == ("held" if until < 50.0 else "free")
    assert bool(found.closed[0]) == (expected.ending == "held")
    assert found.final_x[0] == pytest.approx(expected.final, abs=2e-6)
    assert found.settling_us[0] == pytest.approx(expected.held_us, abs=1e-3)
    hard = np.array([impact for impact in expected.impacts if impact[1] > 1e-3])
    same = found.impact_speed[0] > 1e-3
    assert same.sum() == len(hard) >= 3
    np.testing.assert_allclose(found.impact_time_us[0][same], hard[:, 0], atol=2e-5)
    np.testing.assert_allclose(found.impact_speed[0][same], hard[:, 1], atol=5e-6)
    assert not (found.impact_speed[0] < 1e-9).any(), "letting go is no impact"


def test_a_switch_is_let_go_when_the_spring_pulls_more_than_voltage_and_adhesion() -> None:
    """At 1 mV more it is held; statics say where."""
    damped = ReducedOrder(mode=(Mode(frequency_kHz=20.0, quality_factor=2.0),))
    for adhesion in (0.0, 70.0):
        release = (GAP - TRAVEL) * math.sqrt(2e-6 * (STIFFNESS * TRAVEL - adhesion) / (8.8541878128e-12 * AREA))
        held = []
        for volts in (release - 1e-3, release + 1e-3):
            slow = Trace([0.0, 4.0, 80.0, 300.0], [0.0, 105.0, 105.0, volts])
            held.append(bool(run(damped, slow, losses=Losses(adhesion_uN=adhesion), horizon_us=330.0).closed[0]))
        assert held == [False, True]


def test_a_switch_that_arrives_without_voltage_stays_where_it_sticks_harder_than_its_spring_pulls() -> None:
    flung = Waveform([Pulse(0.0, 4.0, 8.0, 125.0)])
    stays = []
    for part in (0.0, 0.98, 1.02):
        losses = Losses(adhesion_uN=part * STIFFNESS * TRAVEL)
        found = run(ReducedOrder(mode=(PLATE,)), flung, losses=losses, restitution=1e-6, horizon_us=40.0, rtol=1e-9)
        assert found.first_contact_us[0] > 16.0, "the pulse is over"
        stays.append(bool(found.closed[0]))
    assert stays == [False, False, True]


def test_a_compliant_contact_that_holds_is_closed_since_it_last_touched() -> None:
    modes, losses, drive, _, _ = FLIGHTS["compliant contact that sticks"]
    found = run(modes, drive, losses=losses, horizon_us=80.0)
    assert found.impact_time_us is not None
    last = float(np.nanmax(found.impact_time_us))
    assert found.closed[0]
    assert found.settling_us[0] == last
    assert found.final_x[0] > TRAVEL, "the contact is pressed in"
    before, after = (run(modes, drive, losses=losses, horizon_us=last + d) for d in (-0.05, 0.05))
    assert (before.closed[0], after.closed[0]) == (False, True)
    assert np.isinf(before.settling_us[0])


def test_a_compliant_contact_pushes_and_never_pulls() -> None:
    """A dashpot alone would hold what leaves: from the instant that it would, the plate flies off by its spring."""
    sticky = CompliantContact(force_at_1_um_uN=1e4, exponent=1.0, dashpot_uN_s_per_m=6e4)
    drop = Waveform([Pulse(0.0, 0.0, 80.0, 110.0)])
    times = np.linspace(80.0, 84.0, 401)
    found = run(ReducedOrder(mode=(PLATE,), contact=sticky), drop, times_us=times, horizon_us=84.0, rtol=1e-9)
    assert found.x is not None
    assert found.v is not None
    x, v = np.asarray(found.x)[0], np.asarray(found.v)[0]
    omega2 = 1e-3 * STIFFNESS / MASS
    assert x[0] > TRAVEL, "held, with the contact pressed in"
    inwards = np.gradient(v, times) + omega2 * x
    assert inwards[1:-1].max() < 0.02 * omega2 * TRAVEL, "nothing pulls it back"
    assert x[-1] < 0.95 * TRAVEL


@lru_cache
def swing() -> tuple[float, float, float, float]:
    """Of a free swing of OPEN: its highest point and the instant, its lowest point and the instant."""
    times = np.linspace(0.0, 60.0, 12001)
    found = run(ReducedOrder(mode=(FIRST, SECOND)), PUSH, OPEN, times_us=times, horizon_us=60.0, rtol=1e-12)
    assert found.x is not None
    x = np.asarray(found.x)[0]
    return float(x.max()), float(times[x.argmax()]), float(x.min()), float(times[x.argmin()])


PUSH = Waveform([Pulse(0.0, 4.0, 9.0, 105.0)])


def test_a_graze_is_seen_wherever_within_a_step_it_falls() -> None:
    """A contact at a millionth of a micrometre before the turn is one impact, at as much behind it none."""
    highest, at, _, _ = swing()
    for rtol in (1e-7, 1e-8, 1e-9, 1e-10, 1e-12):
        near = [OPEN * [d / OPEN[0], 1.0, 1.0, 1.0] for d in (highest - 3e-6, highest + 3e-6)]
        graze, none = (run(ReducedOrder(mode=(FIRST, SECOND)), PUSH, s, rtol=rtol, horizon_us=at + 3.0) for s in near)
        assert graze.n_impacts[0] == 1
        assert graze.first_contact_us[0] == pytest.approx(at, abs=0.05)
        assert none.n_impacts[0] == 0
        assert none.status[0] == Status.OK


@pytest.mark.parametrize(("polynomial", "rtol", "margin"), [(False, 1e-9, 1e-4), (True, 1e-7, 5e-4)])
def test_a_capacitance_ends_where_it_says_also_between_the_ends_of_a_step(
    polynomial: bool, rtol: float, margin: float
) -> None:
    """A swing that goes a little beyond either end has left it, one that ends as much before has not."""
    contact = CompliantContact(force_at_1_um_uN=1500.0, exponent=1.0)
    drive = Waveform([Pulse(0.0, 4.0, 14.0, 100.0)])

    def swung(low: float, high: float, **more: Any) -> Responses:
        table = capacitance(low, high, polynomial=polynomial)
        modes = ReducedOrder(mode=(PLATE,), contact=contact, capacitance=table)
        return run(modes, drive, **({"horizon_us": 60.0, "rtol": rtol} | more))

    times = np.linspace(0.0, 60.0, 3001)
    found = swung(-3.4, 3.4, times_us=times, rtol=1e-11)
    assert found.x is not None
    x = 3.7 / GAP * np.asarray(found.x)[0]
    low, high = float(x.min()), float(x.max())
    assert low < -2.0
    assert high > 1.05 * TRAVEL
    assert swung(low - margin, high + margin).status[0] == Status.OK
    assert swung(low + margin, high + margin).status[0] == Status.LEFT_TABLE
    assert swung(low - margin, high - margin).status[0] == Status.LEFT_TABLE
    # On its way, at the end of the simulated time.
    for ends, beyond in (((low + 0.5, 3.4), x < low + 0.4), ((-3.4, high - 0.06), x > high - 0.05)):
        assert swung(*ends, horizon_us=float(times[beyond.argmax()])).status[0] == Status.LEFT_TABLE


def test_an_electrode_behind_a_soft_contact_collapses_where_statics_say_so() -> None:
    soft = ReducedOrder(
        mode=(Mode(frequency_kHz=20.0, quality_factor=1.0),),
        contact=CompliantContact(force_at_1_um_uN=4000.0, exponent=1.0, loss_us_per_um=2.0),
    )
    (limit,) = collapse_voltage(MEAN[None], soft, AREA)
    pull_in = float(pull_in_voltage(MEAN, AREA))
    for share, status in ((0.98, Status.OK), (1.02, Status.COLLAPSED)):
        slow = Trace([0.0, 60.0, 500.0], [0.0, 1.1 * pull_in, share * limit])
        found = run(soft, slow, horizon_us=560.0, rtol=1e-7, max_steps=3000)
        assert found.status[0] == status
        assert bool(found.closed[0]) == (status == Status.OK)
        assert math.isnan(found.final_x[0]) == (status == Status.COLLAPSED)


@pytest.mark.parametrize("dielectric", [None, Dielectric(thickness_um=2.0, permittivity=2.0)])
def test_an_electrode_that_has_crossed_its_gap_has_collapsed(dielectric: Dielectric | None) -> None:
    """Onto metal or onto a layer, which it does not enter; what was sampled before stands, and later there is none."""
    soft = ReducedOrder(
        mode=(PLATE,), dielectric=dielectric, contact=CompliantContact(force_at_1_um_uN=300.0, exponent=1.0)
    )
    times = np.linspace(0.0, 40.0, 401)
    drive = Waveform([Pulse(0.0, 4.0, math.inf, 220.0)])
    found = run(soft, drive, times_us=times, horizon_us=40.0, rtol=1e-8, max_steps=2000)
    assert found.status[0] == Status.COLLAPSED
    assert found.x is not None
    x = np.asarray(found.x)[0]
    assert 0.9 * GAP < np.nanmax(x) <= GAP
    assert np.isfinite(x[:100]).all()
    assert np.isnan(x[-1])
    assert math.isnan(found.max_contact_speed[0])


@pytest.mark.parametrize(("rtol", "steps", "error"), [(1e-6, (38, 44), 1e-6), (1e-9, (84, 96), 1e-9)])
def test_a_flight_takes_as_many_steps_as_its_tolerance_asks_for(
    rtol: float, steps: tuple[int, int], error: float
) -> None:
    """A wrong estimate of the error costs time or accuracy, and no result looks wrong for it."""
    modes = ReducedOrder(mode=(FIRST, SECOND))
    exact = run(modes, PUSH, OPEN, horizon_us=100.0, rtol=1e-13).final_x[0]
    done = run(modes, PUSH, OPEN, horizon_us=100.0, rtol=rtol, max_steps=steps[1])
    assert done.status[0] == Status.OK
    assert abs(done.final_x[0] - exact) < error
    early = run(modes, PUSH, OPEN, horizon_us=100.0, rtol=rtol, max_steps=steps[0])
    assert early.status[0] == Status.WORK_LIMIT


def test_the_parts_of_the_modes_are_told_at_their_greatest_before_the_first_impact() -> None:
    modes = ReducedOrder(mode=(FIRST, SECOND))
    first = float(run(modes, HARD, horizon_us=30.0).first_contact_us[0])
    times = np.linspace(0.0, first, 400)
    found = run(modes, HARD, horizon_us=60.0, times_us=times, further_modes=True, rtol=1e-12)
    assert found.mode_peak_um is not None
    assert found.mode_x is not None
    assert found.x is not None
    parts = np.vstack([found.x[0] - found.mode_x[0, 0], found.mode_x[0, 0]])
    np.testing.assert_allclose(found.mode_peak_um[0], np.abs(parts).max(axis=1), rtol=2e-2)


def test_rows_and_outputs_change_no_bit() -> None:
    """Of two switches, each with all outputs and with none, and by itself."""
    modes = ReducedOrder(mode=(FIRST, SECOND))
    pair = np.array([MEAN, MEAN * [1.02, 1.01, 0.95, 1.05]])
    losses = Losses(film_viscosity_uPa_s=AIR.film_viscosity_uPa_s, adhesion_uN=40.0)
    common: dict[str, Any] = {"modes": modes, "method": "rk", "horizon_us": 40.0, "losses": losses}
    times = [3.0, 20.0, 37.0]
    whole = simulate(pair, STRONG, **common, times_us=times, max_impacts=2, further_modes=True)
    bare = simulate(pair, STRONG, **common)
    np.testing.assert_array_equal(whole.final_x, bare.final_x)
    np.testing.assert_array_equal(whole.max_contact_speed, bare.max_contact_speed)
    for i in (0, 1):
        alone = simulate(pair[i : i + 1], STRONG, **common, times_us=times, max_impacts=2, further_modes=True)
        for name in ("final_x", "final_v", "x", "v", "mode_x", "mode_v", "impact_speed", "impact_time_us", "n_impacts"):
            np.testing.assert_array_equal(getattr(alone, name)[0], getattr(whole, name)[i], err_msg=name)
    assert whole.impact_speed is not None
    assert whole.impact_speed[0, 0] != whole.impact_speed[1, 0]
    assert whole.n_impacts.max() > 2, "more impacts than there is room for are counted"


def test_a_step_that_would_pass_through_the_gap_is_taken_again_and_shorter() -> None:
    """Of a voltage so high that the first trial lies behind the counter-electrode; energy says the speed at contact."""
    volts = 5e4
    found = run(ReducedOrder(mode=(PLATE,)), Waveform([Pulse(0.0, 0.0, math.inf, volts)]), horizon_us=0.05)
    assert found.status[0] == Status.OK
    assert found.impact_speed is not None
    work = 0.5e3 * 8.8541878128e-12 * AREA * volts**2 * (1.0 / (GAP - TRAVEL) - 1.0 / GAP)
    expected = math.sqrt(2.0 * (work - 0.5e-3 * STIFFNESS * TRAVEL**2) / MASS)
    assert found.impact_speed[0, 0] == pytest.approx(expected, rel=1e-6)
