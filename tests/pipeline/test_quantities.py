"""Claims about quantities: each against a closed form or a calculation of its own."""

from __future__ import annotations

import math

import numpy as np
import pytest

import by_hand
from conditions_of_campaigns import CONDITIONS, DRIVE, config
from softclose import Pulse, Waveform
from softclose.evaluate import draw, respond
from softclose.evaluate.chain import chain_of
from softclose.evaluate.quantities import QUANTITIES, Closing, QuantityError, held_voltages, quantity
from softclose.switch.plate import EPSILON_0, holding_voltage

STEP = Waveform([Pulse(0.0, 0.0, math.inf, 100.0)])
N = 60


def closing(drive: Waveform = STEP, *names: str, impacts: int = 400) -> Closing:
    c = config(*names)
    lot = draw(c, N, seed=1)
    return Closing.of(c, lot, drive, respond(c, lot, drive, max_impacts=impacts))


def test_under_a_step_every_impact_is_the_restitution_times_the_one_before() -> None:
    """A constant force: speeds v, ηv, η²v … so that energies add up to ½ M v² / (1 - η²), impulses alike."""
    c = closing()
    v = c.response.max_contact_speed
    mass, eta = c.lot["M"], 0.5
    np.testing.assert_allclose(QUANTITIES["impact_energy"].values(c), 0.5 * mass * v**2, rtol=1e-12)
    np.testing.assert_allclose(QUANTITIES["impact_energy_sum"].values(c), 0.5 * mass * v**2 / (1 - eta**2), rtol=1e-6)
    np.testing.assert_allclose(QUANTITIES["impulse"].values(c), 1.5 * mass * v, rtol=1e-12)
    np.testing.assert_allclose(QUANTITIES["impulse_sum"].values(c), 1.5 * mass * v / (1 - eta), rtol=1e-4)
    count = QUANTITIES["impacts"].values(c)
    np.testing.assert_allclose(count, 2 + np.floor(np.log(1e-5 / v) / np.log(eta)), atol=1.01)


def test_the_first_contact_is_where_the_travel_first_is_the_distance_to_the_contact() -> None:
    """By the sampled motion of one switch at a time."""
    c = closing()
    found = QUANTITIES["contact_time"].values(c)
    t = np.linspace(0.0, 60.0, 60_001)
    sampled = respond(config(), c.lot, c.waveform, times_us=t)
    assert sampled.x is not None
    at = t[
        np.argmax(np.asarray(sampled.x) >= c.lot["D"][:, None] - 1e-3, axis=1)
    ]  # a sample is 1 ns, 0.4 nm at contact
    np.testing.assert_allclose(found, at, atol=1e-2)


def test_bounces_end_after_the_time_of_their_geometric_series() -> None:
    """With a nearly constant net force f the flights last 2 η^k v / f."""
    c = closing()
    d, g, k, m = c.lot.switches.T
    force = 0.5e6 * EPSILON_0 * 16_700.0 * 100.0**2 / (g - d) ** 2 - k * d  # µN
    acceleration = 1e-3 * force / m  # µm/µs²: a µN on a µg is 1e3 m/s²
    flights = 2.0 * 0.5 * c.response.max_contact_speed / acceleration / (1.0 - 0.5)
    found = QUANTITIES["bounce_time"].values(c)
    assert np.isfinite(found).all()
    np.testing.assert_allclose(found, flights, rtol=0.35)  # the force grows as the gap closes: flights are longer
    assert (found > flights).all()


def test_hold_contact_and_release_are_statics() -> None:
    c = closing()
    d, g, k, _ = c.lot.switches.T
    np.testing.assert_allclose(QUANTITIES["hold_margin"].values(c), 100.0 - holding_voltage(c.lot.switches), rtol=1e-9)
    pulled = 0.5e6 * EPSILON_0 * 16_700.0 * 100.0**2 / (g - d) ** 2
    np.testing.assert_allclose(QUANTITIES["contact_force"].values(c), pulled - k * d, rtol=1e-7)
    np.testing.assert_allclose(QUANTITIES["release_force"].values(c), k * d, rtol=1e-7)
    np.testing.assert_allclose(
        QUANTITIES["stored_energy"].values(c), 1e6 * 0.5 * EPSILON_0 * 16_700.0 / (g - d) * 100.0**2, rtol=1e-12
    )


def test_a_drive_has_a_peak_a_slope_and_an_area() -> None:
    """A raised cosine of 100 V in 10 µs: π 100 / 20 V/µs at its steepest; half its volts over its rise."""
    drive = Waveform([Pulse(0.0, 10.0, 20.0, 100.0), Pulse(100.0, 10.0, math.inf, 60.0)])
    c = closing(drive)
    assert QUANTITIES["peak"].of(c).estimate == pytest.approx(100.0)
    assert QUANTITIES["slope"].of(c).estimate == pytest.approx(math.pi * 100.0 / 20.0, rel=1e-3)
    assert QUANTITIES["volt_time"].of(c).estimate == pytest.approx(100.0 * 30.0 + 60.0 * 145.0, rel=1e-6)
    slewed = closing(Waveform([Pulse(0.0, 4.0, math.inf, 100.0)]), "slew and resolution")  # 39 V/µs commanded
    assert QUANTITIES["slope"].of(slewed).estimate == pytest.approx(20.0, rel=1e-3)


def test_of_a_switch_s_quantity_the_bad_end_counts_with_its_interval() -> None:
    c = closing()
    margins = np.sort(QUANTITIES["hold_margin"].values(c))
    found = QUANTITIES["hold_margin"].of(c)
    assert found.estimate == margins[N - math.ceil(0.9 * N)], "nine in ten have as much or more"
    assert margins[0] <= found.interval[0] < found.estimate < found.interval[1] <= margins[-1]
    energies = np.sort(QUANTITIES["impact_energy"].values(c))
    assert QUANTITIES["impact_energy"].of(c).estimate == energies[math.ceil(0.9 * N) - 1]
    assert found.n == N


def test_quantities_of_the_lot_are_those_of_its_assessment() -> None:
    c = closing(DRIVE)
    a = c.assessment
    for name, value, interval in (
        ("v_u", a.v_u_cm_s, a.v_u_interval),
        ("p_nc", a.p_nc, a.p_nc_intervals.wilson),
        ("cvar", a.cvar_cm_s, a.cvar_interval),
        ("mean", a.mean_cm_s, a.mean_interval),
        ("closing", a.closing_us, a.closing_interval),
    ):
        found = QUANTITIES[name].of(c)
        np.testing.assert_equal((found.estimate, found.interval), (value, interval))


@pytest.mark.parametrize("name", CONDITIONS)
def test_the_voltage_that_holds_is_that_of_each_switch_s_own_drive(name: str) -> None:
    c = config(name)
    lot = draw(c, 12, seed=4)
    found = held_voltages(chain_of(c), lot, DRIVE)
    for i, row in enumerate(by_hand.rows(c, 12, seed=4)):
        own, b = by_hand.own_drive(c, row, DRIVE)
        assert found[i] == pytest.approx(float(own.voltage(250.0 * b)), rel=1e-6), i


@pytest.mark.parametrize("differing", ["gain errors", "clock errors", "trim by pull-in"])
def test_behind_an_amplifier_with_steps_each_switch_is_held_by_what_its_own_command_comes_out_as(
    differing: str,
) -> None:
    """Half a volt is the finest step: what holds is not in proportion to the common command."""
    c = config("slew and resolution", differing)
    lot = draw(c, 12, seed=4)
    found = held_voltages(chain_of(c), lot, DRIVE)
    expected = []
    for row in by_hand.rows(c, 12, seed=4):
        own, b = by_hand.own_drive(c, row, DRIVE)
        expected.append(float(own.voltage(250.0 * b)))
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_a_reference_drive_holds_every_switch_of_a_trimmed_lot_with_the_same_volts() -> None:
    c = config("trim by pull-in")
    lot = draw(c, N, seed=1)
    response = respond(c, lot, STEP)
    assert np.ptp(Closing.of(c, lot, STEP, response).held_V) > 1.0
    np.testing.assert_array_equal(Closing.of(c, lot, STEP, response, for_everybody=True).held_V, 100.0)


def test_of_all_quantities_the_open_switches_alone_are_a_share_of_the_lot() -> None:
    assert [name for name, q in QUANTITIES.items() if q.is_share] == ["p_nc"]


def test_a_switch_that_never_touches_or_never_closes_has_no_impacts_and_no_contact_force() -> None:
    c = closing(Waveform([Pulse(0.0, 4.0, math.inf, 20.0)]))
    for name in ("impact_energy", "impulse_sum", "impacts", "bounce_time", "contact_force", "stored_energy"):
        assert np.isnan(QUANTITIES[name].values(c)).all(), name
        found = QUANTITIES[name].of(c)
        assert math.isnan(found.estimate)
        assert found.n == 0, "it rests on no switch"


def test_impacts_that_were_not_kept_are_asked_for_and_an_unknown_name_is_told() -> None:
    with pytest.raises(QuantityError, match="does not keep every impact"):
        QUANTITIES["impulse_sum"].values(closing(impacts=3))
    with pytest.raises(QuantityError, match="'softness' is no quantity; there are v_u, p_nc"):
        quantity("softness")
    assert quantity("v_u") is QUANTITIES["v_u"]
    assert all(q.uses and q.unit and q.long_name for q in QUANTITIES.values())
