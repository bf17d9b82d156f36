"""Reference designs: the deterministic one lands the mean switch with no speed, by two integrators, on every design."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from softclose import Population, assess, load_population, simulate
from softclose.baselines import (
    SOFT_UM_PER_US,
    BaselineError,
    deterministic_design,
    largest_holding_voltage,
    unshaped,
)
from softclose.evaluate.chain import device_of
from softclose.population.distributions import Bounded, PopulationError
from softclose.settings import load_config
from softclose.switch.plate import EPSILON_0, PLATE_AREA_UM2, holding_voltage

PLATE = device_of(load_config({}))


@pytest.mark.parametrize("name", ["current", "modified", "process-improved", "paper-text"])
@pytest.mark.parametrize("max_volts", [150.0, 120.0])
def test_the_deterministic_design_lands_its_mean_switch_at_no_speed(name: str, max_volts: float) -> None:
    population = load_population(name)
    waveform = deterministic_design(population, max_volts=max_volts)
    waveform.check(max_volts)
    r = simulate(population.mean_switch[None], waveform)  # at the default tolerance, not the one it was solved with
    assert r.max_contact_speed[0] < SOFT_UM_PER_US
    assert r.closed[0]
    first, second = waveform.pulses
    assert (first.volts, first.rise_us) == (max_volts, 4.0)
    assert second.holds
    assert second.start_us > first.rise_us + first.peak_us  # at 120 V it rises while pulse 1 falls


def test_an_independent_integrator_arrives_at_the_contact_with_no_speed() -> None:
    population = load_population("current")
    waveform = deterministic_design(population)
    travel, gap, stiffness, mass = population.mean_switch
    c, k = EPSILON_0 * 1e3 * PLATE_AREA_UM2 / (2.0 * mass), stiffness / (1000.0 * mass)
    arrival = float(simulate(population.mean_switch[None], waveform).first_contact_us[0])
    state = np.zeros(2)
    for a, b in itertools.pairwise([*waveform.breakpoints(arrival), arrival]):
        state = solve_ivp(
            lambda t, y: [y[1], c * (waveform.voltage(t) / (gap - y[0])) ** 2 - k * y[0]],
            (a, b),
            state,
            method="DOP853",
            rtol=1e-11,
            atol=1e-13,
        ).y[:, -1]
    assert state[0] == pytest.approx(travel, abs=1e-7)
    assert abs(state[1]) < SOFT_UM_PER_US


def test_pulse_2_passes_the_holding_voltage_at_the_instant_of_arrival() -> None:
    population = load_population("current")
    waveform = deterministic_design(population)
    contact = simulate(population.mean_switch[None], waveform).first_contact_us
    u = waveform.voltage(contact)[0]
    assert u == pytest.approx(float(holding_voltage(population.mean_switch)), abs=0.5)


def test_the_default_hold_voltage_holds_every_switch() -> None:
    for name in ("current", "modified", "process-improved"):
        population = load_population(name)
        most = float(holding_voltage(population.sample(20_000, seed=1)).max())
        assert 0.85 * largest_holding_voltage(population, PLATE) < most < largest_holding_voltage(population, PLATE)
    assert 80.0 < largest_holding_voltage(load_population("current"), PLATE) < 90.0


def test_the_largest_holding_voltage_may_lie_inside_the_range_of_travel() -> None:
    fixed = load_population("current").to_dict()
    wide = Population.from_dict(fixed | {"D": Bounded(lower=0.5, upper=2.5).to_dict()})
    travel = np.linspace(0.5, 2.5, 2001)
    k = wide.summary()["K_upper_N_per_m"]
    every = holding_voltage(np.stack([travel, 0 * travel + wide.G.upper, 0 * travel + k, 1 + 0 * travel], axis=1))
    assert largest_holding_voltage(wide, PLATE) == pytest.approx(float(every.max()), rel=1e-6)


def test_baselines_on_the_ensemble_are_near_the_published_figures() -> None:
    population = load_population("current")
    switches = population.sample(2000, seed=20)
    step = assess(simulate(switches, unshaped()))
    assert step.v_u_cm_s == pytest.approx(40.7, abs=1.5)
    assert step.mean_cm_s == pytest.approx(34.1, abs=0.5)
    assert step.p_nc == 0.0
    deterministic = assess(simulate(switches, deterministic_design(population)))
    assert deterministic.v_u_cm_s == pytest.approx(42.6, abs=3.5)
    assert deterministic.mean_cm_s == pytest.approx(24.7, abs=2.0)
    assert 0.48 < deterministic.p_exceed[0].probability.estimate < 0.63


def test_a_design_that_cannot_exist_is_refused_with_the_reason() -> None:
    current = load_population("current")
    with pytest.raises(BaselineError, match=r"hold at 50 V; it must exceed 57\.91 V"):
        deterministic_design(current, hold_volts=50.0)
    with pytest.raises(BaselineError, match="and not 150 V"):
        deterministic_design(current, hold_volts=160.0)
    with pytest.raises(BaselineError, match="never bring the mean switch"):
        deterministic_design(current, max_volts=65.0)
    with pytest.raises(BaselineError, match="without any flat top already drives"):
        deterministic_design(current, rise_us=15.0)


def test_the_unshaped_drive_is_an_ideal_step() -> None:
    assert unshaped(80.0).voltage([0.0, 1e-9, 250.0]).tolist() == [80.0, 80.0, 80.0]


def test_a_fitted_population_is_designed_for_on_its_own_plate_area() -> None:
    current = load_population("current")
    fitted = replace(current, plate_area_um2=15000.0)
    smaller = replace(PLATE, plate_area_um2=15000.0)
    assert largest_holding_voltage(current, smaller) == pytest.approx(
        largest_holding_voltage(current, PLATE) * (PLATE.plate_area_um2 / 15000.0) ** 0.5
    )
    assert deterministic_design(fitted) == deterministic_design(current, plate_area_um2=15000.0)
    with pytest.raises(PopulationError, match="fitted with 15000 µm²"):
        deterministic_design(fitted, plate_area_um2=PLATE_AREA_UM2)
