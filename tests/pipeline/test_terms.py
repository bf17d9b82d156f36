"""Claims about what other switches have besides: stretching, a dielectric, films that slip, low Q, a dashpot."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from modal_reference import EPS0, oracle
from softclose import Losses, Pulse, ReducedOrder, Waveform, simulate
from softclose.device.simulate import SimulationError, Status
from softclose.switch.losses import LEAST_Q, LossesError, shape_factor
from softclose.switch.plate import pull_in_voltage
from softclose.switch.reduced_order import Capacitance, CompliantContact, Dielectric, Mode, ReducedOrderError
from softclose.waveform import Trace

AREA = 16700.0
MEAN = np.array([2.43, 3.68, 65.3, 3.41])
HARD = Waveform([Pulse(0, 4, 11.5, 120), Pulse(24, 12, math.inf, 75)])
OMEGA = math.sqrt(1e-3 * MEAN[2] / MEAN[3])


def one(**mode: Any) -> ReducedOrder:
    return ReducedOrder(mode=(Mode(frequency_kHz=20.0, **mode),))


@pytest.mark.parametrize(
    ("modes", "losses", "also"),
    [
        (one(cubic_per_um2=0.2), Losses(), {"cubic": 0.2}),
        (
            ReducedOrder(
                mode=(
                    Mode(frequency_kHz=20.0, mass_ug=3.4, contact=2.0, electrode=1.8, cubic_per_um2=0.1),
                    Mode(frequency_kHz=70.0, quality_factor=25.0, contact=-0.3, electrode=0.15, cubic_per_um2=3.0),
                )
            ),
            Losses(),
            {"cubic": np.array([0.1, 3.0])},
        ),
        (
            ReducedOrder(mode=one().mode, dielectric=Dielectric(thickness_um=0.6, permittivity=3.9)),
            Losses(film_viscosity_uPa_s=3.0),
            {"coat": 0.6 / 3.9},
        ),
        (one(), Losses(film_viscosity_uPa_s=30.0, film_mean_free_path_um=0.4, film_count=2.0), {"free_path": 0.4}),
        (
            one(),
            Losses(film_viscosity_uPa_s=60.0, film_mean_free_path_um=0.065, film_pressure_kPa=2.0),
            {"free_path": 0.065 * 101.325 / 2.0},
        ),
        (
            ReducedOrder(
                mode=one().mode,
                contact=CompliantContact(force_at_1_um_uN=2e5, exponent=1.0, dashpot_uN_s_per_m=3000.0),
            ),
            Losses(),
            {"compliance": (200.0, 1.0, 0.0), "dashpot": 3.0},
        ),
    ],
)
def test_every_impact_is_that_of_another_integrator(modes: ReducedOrder, losses: Losses, also: dict[str, Any]) -> None:
    found = simulate([MEAN], HARD, modes=modes, losses=losses, max_impacts=6, rtol=1e-11, horizon_us=90.0)
    expected = oracle(modes, MEAN, film=losses.film(AREA), **also).run(HARD, 90.0)
    assert len(expected.impacts) >= 2
    assert found.impact_time_us is not None
    assert found.impact_speed is not None
    for j, (t, speed) in enumerate(expected.impacts[:4]):
        assert found.impact_time_us[0, j] == pytest.approx(t, abs=2e-5)
        assert found.impact_speed[0, j] == pytest.approx(speed, abs=2e-6)


def test_stretching_raises_the_pull_in_voltage_as_its_statics_say() -> None:
    d, g, k, _m = MEAN
    for cubic in (0.0, 0.1, 0.5):
        x = np.linspace(0.0, d, 200_001)
        borne = 2e-3 * k * (x + cubic * x**3) * (g - x) ** 2 / (1e3 * EPS0 * AREA)
        expected = math.sqrt(float(borne.max()))
        touched = []
        for share in (0.998, 1.002):
            slow = Trace([0.0, 6000.0, 9000.0], [0.0, share * expected, share * expected])
            found = simulate([MEAN], slow, modes=one(quality_factor=2.0, cubic_per_um2=cubic), horizon_us=9000.0)
            touched.append(bool(found.n_impacts[0] > 0))
        assert touched == [False, True]


def test_the_period_of_a_stretched_beam_is_duffings() -> None:
    """Let go at rest from A, it swings with the period 4 int_0^A dx / sqrt(2 (E(A) - E(x)))."""
    cubic, volts = 0.3, 60.0
    times = np.linspace(0.0, 400.0, 400_001)
    drive = Waveform([Pulse(0.0, 4.0, 6.0, volts)])
    found = simulate([MEAN], drive, modes=one(cubic_per_um2=cubic), horizon_us=400.0, times_us=times, rtol=1e-12)
    assert found.x is not None
    assert found.n_impacts[0] == 0
    x = np.asarray(found.x)[0][times > 20.0]
    amplitude = float(x.max())

    def below(angle: float) -> float:  # x = A sin(angle) takes the singularity out
        s = math.sin(angle)
        return 1.0 / math.sqrt(1.0 + 0.5 * cubic * amplitude**2 * (1.0 + s * s))

    period = 4.0 / OMEGA * quad(below, 0.0, 0.5 * math.pi)[0]
    up = np.flatnonzero((x[:-1] < 0.0) & (x[1:] >= 0.0))
    crossings = times[times > 20.0][up] - x[up] / (x[up + 1] - x[up]) * 0.001
    np.testing.assert_allclose(np.diff(crossings), period, rtol=1e-5)
    assert period < 0.99 * 2.0 * math.pi / OMEGA


def test_a_dielectric_is_a_gap_that_never_closes() -> None:
    """Without a film nothing tells it from a wider gap; with one, the gas is squeezed in the air alone."""
    layer = Dielectric(thickness_um=0.8, permittivity=4.0)
    coated = ReducedOrder(mode=one().mode, dielectric=layer)
    wider = np.add(MEAN, [0.0, layer.gap_um, 0.0, 0.0])
    a = simulate([MEAN], HARD, modes=coated, rtol=1e-11, max_impacts=5)
    b = simulate([wider], HARD, rtol=1e-11, max_impacts=5)
    np.testing.assert_allclose(a.impact_speed, b.impact_speed, atol=1e-8)
    film = Losses(film_viscosity_uPa_s=4.0)
    assert (
        simulate([MEAN], HARD, modes=coated, losses=film).max_contact_speed[0]
        < simulate([wider], HARD, losses=film).max_contact_speed[0] - 1e-3
    )
    limit = float(pull_in_voltage(wider, AREA))
    for share, touches in ((0.998, False), (1.002, True)):
        slow = Trace([0.0, 6000.0, 9000.0], [0.0, share * limit, share * limit])
        damped = ReducedOrder(mode=one(quality_factor=2.0).mode, dielectric=layer)
        found = simulate([MEAN], slow, modes=damped, horizon_us=9000.0)
        assert bool(found.n_impacts[0] > 0) == touches


def test_a_plate_that_lies_down_on_its_dielectric_needs_no_gap_behind_it() -> None:
    """The travel of a capacitive switch is the whole gap but for the surfaces' roughness."""
    flat = np.array([[2.0, 2.001, 20.0, 3.0]])
    modes = ReducedOrder(mode=one(quality_factor=3.0).mode, dielectric=Dielectric(thickness_um=0.2, permittivity=7.6))
    volts = 1.4 * float(pull_in_voltage(flat[0] + [0, 0.2 / 7.6, 0, 0], AREA))
    found = simulate(flat, Trace([0.0, 0.1, 400.0], [0.0, volts, volts]), modes=modes, horizon_us=400.0)
    assert found.status[0] == Status.OK
    assert found.closed[0]


@pytest.mark.parametrize("pressure", [101.325, 10.0, 1.0])
def test_a_film_that_slips_damps_as_its_knudsen_number_says(pressure: float) -> None:
    """A small swing decays as exp(-b t / 2 M), b that of the film at rest over 1 + 9.638 Kn^1.159."""
    losses = Losses(film_viscosity_uPa_s=18.0, film_mean_free_path_um=0.065, film_pressure_kPa=pressure)
    _d, g, _k, m = MEAN
    kn = 0.065 * 101.325 / pressure / g
    b = float(losses.film(AREA)) / g**3 / (1.0 + 9.638 * kn**1.159)
    rate = 0.5 * b / m
    damped = math.sqrt(OMEGA**2 - rate**2)
    times = 30.0 + np.arange(4) * 2.0 * math.pi / damped
    found = simulate(
        [MEAN], Waveform([Pulse(0.0, 4.0, 4.0, 6.0)]), losses=losses, times_us=times, rtol=1e-12, horizon_us=400.0
    )
    assert found.x is not None
    x = np.asarray(found.x)[0]
    np.testing.assert_allclose(x[1:] / x[:-1], math.exp(-rate * 2.0 * math.pi / damped), rtol=2e-3)


def test_several_films_are_one_of_as_much_more_gas() -> None:
    many = simulate([MEAN], HARD, losses=Losses(film_viscosity_uPa_s=0.5, film_count=8.0))
    thick = simulate([MEAN], HARD, losses=Losses(film_viscosity_uPa_s=4.0))
    assert many.max_contact_speed[0] == pytest.approx(thick.max_contact_speed[0], rel=1e-12)
    long_path = simulate([MEAN], HARD, losses=Losses(film_viscosity_uPa_s=4.0, film_mean_free_path_um=1e-12))
    assert long_path.max_contact_speed[0] == pytest.approx(thick.max_contact_speed[0], abs=1e-8)


@pytest.mark.parametrize("q", [0.002, 0.02, 0.08])
@pytest.mark.parametrize("by_mode", [False, True])
def test_below_a_tenth_q_is_a_creep(q: float, by_mode: bool) -> None:
    """A small step of force: x = F/k (1 - (a e^(-bt) - b e^(-at)) / (a - b)), a and b the two rates."""
    volts, (_d, g, k, _m) = 3.0, MEAN
    force = 0.5e3 * EPS0 * AREA * (volts / g) ** 2
    times = np.array([20.0, 80.0, 200.0])
    drive = Trace([0.0, 1e-6, 250.0], [0.0, volts, volts])
    settings: dict[str, Any] = {"modes": one(quality_factor=q)} if by_mode else {"losses": Losses(quality_factor=q)}
    found = simulate([MEAN], drive, times_us=times, rtol=1e-11, **settings)
    assert found.status[0] == Status.OK
    root = math.sqrt(0.25 / q**2 - 1.0) * OMEGA
    a, b = 0.5 * OMEGA / q + root, OMEGA**2 / (0.5 * OMEGA / q + root)
    exact = force / (1e-3 * k) * (1.0 - (a * np.exp(-b * times) - b * np.exp(-a * times)) / (a - b))
    assert found.x is not None
    np.testing.assert_allclose(np.asarray(found.x)[0], exact, rtol=2e-3)  # the force grows by x / G


def test_a_linear_contact_loses_what_its_damping_ratio_says() -> None:
    """A hard linear contact, no load to speak of: the rebound over the impact is that of half a damped swing."""
    d, _g, _k, m = MEAN
    zeta, stiffness = 0.2, 4e6
    dashpot = 2.0 * zeta * math.sqrt(stiffness * m * 1e-9) * 1e6
    contact = CompliantContact(force_at_1_um_uN=stiffness, exponent=1.0, dashpot_uN_s_per_m=dashpot)
    modes = ReducedOrder(mode=one().mode, contact=contact)
    times = np.linspace(0.0, 40.0, 400_001)
    found = simulate([MEAN], HARD, modes=modes, times_us=times, horizon_us=40.0, max_impacts=2, rtol=1e-11)
    assert found.v is not None
    assert found.impact_time_us is not None
    assert found.impact_speed is not None
    x, v = np.asarray(found.x)[0], np.asarray(found.v)[0]
    left = int(np.flatnonzero((times > found.impact_time_us[0, 0]) & (x < d))[0])
    # Pushing ends where k x + c v = 0, before x does: v there over v0, of x'' + 2 zeta x' + x = 0 from 0 with 1.
    wd = math.sqrt(1.0 - zeta**2)

    def state(t: float) -> tuple[float, float]:
        e = math.exp(-zeta * t)
        return e * math.sin(wd * t) / wd, e * (math.cos(wd * t) - zeta * math.sin(wd * t) / wd)

    end = brentq(lambda t: state(t)[0] + 2.0 * zeta * state(t)[1], 1.0, math.pi / wd)
    assert -v[left] / found.impact_speed[0, 0] == pytest.approx(-state(end)[1], rel=2e-2)


def test_what_does_not_go_together_is_refused() -> None:
    with pytest.raises(LossesError, match="film_count is 0"):
        Losses(film_count=0.0)
    with pytest.raises(LossesError, match=r"quality_factor is 0\.0005"):
        Losses(quality_factor=5e-4)
    assert Losses(quality_factor=LEAST_Q).damping_ratio == pytest.approx(1.0 / LEAST_Q)
    c = Capacitance(gap_um=3.7, polynomial_fF=(40.0, 11.0))
    with pytest.raises(ReducedOrderError, match="no place beside"):
        ReducedOrder(mode=one().mode, capacitance=c, dielectric=Dielectric(thickness_um=0.2, permittivity=4.0))
    with pytest.raises(ReducedOrderError, match=r"permittivity is 0\.5"):
        ReducedOrder(mode=one().mode, dielectric=Dielectric(thickness_um=0.2, permittivity=0.5))
    slips = Losses(film_viscosity_uPa_s=18.0, film_mean_free_path_um=0.065)
    two = ReducedOrder(mode=(Mode(frequency_kHz=20.0), Mode(frequency_kHz=70.0, contact=0.2, electrode=0.2)))
    with pytest.raises(SimulationError, match="no film that slips"):
        simulate([MEAN], HARD, modes=two, losses=slips, drive_volts=np.array([1.1]), drive_times=np.array([1.0]))


def test_a_model_with_every_term_is_stored_and_read_back() -> None:
    model = ReducedOrder(
        mode=one(cubic_per_um2=0.3).mode,
        dielectric=Dielectric(thickness_um=0.2, permittivity=7.6),
        contact=CompliantContact(force_at_1_um_uN=1e5, dashpot_uN_s_per_m=20.0),
    )
    assert ReducedOrder.from_dict(model.to_dict()) == model


def test_a_film_s_length_and_width_are_the_longer_and_the_shorter_side() -> None:
    found = [
        Losses(film_viscosity_uPa_s=18.0, film_length_um=a, film_width_um=b).film(AREA)
        for a, b in ((200.0, 50.0), (50.0, 200.0))
    ]
    assert found[0] == found[1] == pytest.approx(1e-9 * 18.0 * 200.0 * 50.0**3 * shape_factor(0.25))


def test_damping_at_rest_adds_up() -> None:
    """Against the formula, for switches of which no two columns are alike."""
    losses = Losses(quality_factor=5.0, film_viscosity_uPa_s=18.0, film_mean_free_path_um=0.07, film_pressure_kPa=50.0)
    switches = np.array([[2.4, 3.7, 65.0, 3.4], [1.9, 2.9, 91.0, 5.2]])
    free = 0.07 * 101.325 / 50.0
    for (_, gap, k, m), found in zip(switches, losses.damping_at_rest(switches, AREA), strict=True):
        force = 1e-9 * 18.0 * AREA**2 * shape_factor(1.0) / gap**3 / (1.0 + 9.638 * (free / gap) ** 1.159)
        assert found == pytest.approx(1.0 / 5.0 + force / math.sqrt(1e-3 * k * m))


def test_a_switch_that_only_sticks_loses_something() -> None:
    assert Losses().none
    assert not any(
        x.none for x in (Losses(quality_factor=9.0), Losses(film_viscosity_uPa_s=1.0), Losses(adhesion_uN=1.0))
    )
    assert not Losses(adhesion_uN=1.0).moving


@pytest.mark.parametrize("bad", [-1.0, math.inf, math.nan])
def test_of_a_lot_the_switch_is_named_whose_loss_cannot_be(bad: float) -> None:
    with pytest.raises(LossesError, match=r"adhesion_uN of switch 2 is .*; it must be a number, 0 or more"):
        Losses(adhesion_uN=np.array([0.0, bad, bad]))
    with pytest.raises(LossesError, match=r"film_viscosity_uPa_s is .*; it must be a number, 0 or more"):
        Losses(film_viscosity_uPa_s=bad)


@pytest.mark.parametrize("name", ["quality_factor", "film_viscosity_uPa_s", "adhesion_uN"])
def test_a_lot_of_which_one_switch_loses_something_loses_something(name: str) -> None:
    lot = Losses(**{name: np.array([0.0, 4.0, 0.0])})
    assert not lot.none
    assert lot.moving == (name != "adhesion_uN")
    assert Losses(**{name: np.zeros(3)}).none
    gas = Losses(film_mean_free_path_um=0.07, **{name: np.array([0.0, 4.0, 0.0])})
    assert gas.slips == (name == "film_viscosity_uPa_s")
