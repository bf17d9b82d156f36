"""Claims about statics: closed forms of one mode, slow ramps through the kernel for the others."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from examples import in_turn
from softclose import Lot, ReducedOrder, Trace, load_population, simulate
from softclose.conditions.trim import trim_of
from softclose.device.device import Device
from softclose.device.told import mean_switch, switches_of
from softclose.evaluate import draw
from softclose.evaluate.chain import chain_of
from softclose.population import PopulationError
from softclose.settings import load_config
from softclose.switch import plate, statics
from softclose.switch.losses import Losses
from softclose.switch.reduced_order import ONE_MODE, Capacitance, Dielectric, Mode

AREA = 16_700.0


def modes(*mode: Mode, capacitance: Capacitance | None = None) -> ReducedOrder:
    return ReducedOrder(mode=mode, capacitance=capacitance)


def switch(d: float, g: float, k: float = 65.0) -> np.ndarray:
    return np.array([[d, g, k, 3.4]])


@settings(deadline=None)
@given(ratio=st.floats(0.05, 0.99), g=st.floats(0.5, 10.0), k=st.floats(1.0, 500.0), adhesion=st.floats(0.0, 50.0))
def test_one_mode_that_moves_both_alike_is_the_ideal_plate(ratio: float, g: float, k: float, adhesion: float) -> None:
    s = switch(ratio * g, g, k)
    assert statics.closing_voltage(s, ONE_MODE, AREA)[0] == pytest.approx(plate.closing_voltage(s, AREA)[0], rel=2e-6)
    held = statics.holding_voltage(s, ONE_MODE, AREA)[0]
    assert held == pytest.approx(plate.holding_voltage(s, AREA)[0], rel=1e-9)
    # Force at the contact: what the plates pull less what the spring pulls back, by hand.
    volts = 1.3 * held
    by_hand = 0.5e6 * plate.EPSILON_0 * AREA * volts**2 / (g - ratio * g) ** 2 - k * ratio * g
    assert statics.contact_force(s, volts, ONE_MODE, AREA)[0] == pytest.approx(by_hand, rel=1e-6)
    assert statics.contact_force(s, held, ONE_MODE, AREA)[0] == pytest.approx(0.0, abs=1e-6 * k * g)
    stuck = statics.holding_voltage(s, ONE_MODE, AREA, adhesion)[0]
    let_go = -min(adhesion, k * ratio * g)
    assert statics.contact_force(s, stuck, ONE_MODE, AREA)[0] == pytest.approx(let_go, rel=1e-6, abs=1e-6)


@given(st.floats(0.6, 1.3))
def test_an_electrode_that_moves_less_pulls_in_later(e: float) -> None:
    """k q = e F and y = e q: Eq. 3 with the stiffness k / e²."""
    s = switch(2.43, 3.68)
    found = statics.closing_voltage(s, modes(Mode(frequency_kHz=20.0, electrode=e)), AREA)
    assert found[0] == pytest.approx(plate.pull_in_voltage(s, AREA)[0] / e, rel=1e-6)


@given(cubic=st.floats(0.01, 2.0), coat=st.floats(0.0, 0.5))
def test_stretching_and_a_dielectric_change_hold_and_force_as_by_hand(cubic: float, coat: float) -> None:
    """k (D + c D³) is what the spring pulls back with; the field crosses the coat as it does so much air."""
    s = switch(2.43, 3.68)
    dielectric = Dielectric(thickness_um=coat, permittivity=1.0) if coat >= 1e-4 else None
    model = ReducedOrder(mode=(Mode(frequency_kHz=20.0, cubic_per_um2=cubic),), dielectric=dielectric)
    back = 65.0 * 2.43 * (1.0 + cubic * 2.43**2)  # µN
    per_volt = 0.5e6 * plate.EPSILON_0 * AREA / (3.68 + (coat if dielectric else 0.0) - 2.43) ** 2
    assert statics.holding_voltage(s, model, AREA)[0] == pytest.approx(math.sqrt(back / per_volt), rel=1e-6)
    volts = 1.2 * math.sqrt(back / per_volt)
    assert statics.contact_force(s, volts, model, AREA)[0] == pytest.approx(per_volt * volts**2 - back, rel=1e-6)


@pytest.mark.parametrize("cubic", [0.0, 0.1])
def test_stiffness_that_does_not_change_is_looked_at_once(cubic: float, monkeypatch: pytest.MonkeyPatch) -> None:
    model, s = modes(Mode(frequency_kHz=20.0, cubic_per_um2=cubic), Mode(frequency_kHz=55.0)), switch(2.43, 3.68)
    held, rounds, looked = statics.holding_voltage(s, model, AREA), [0], statics.compliances

    def counted(*arguments: Any) -> Any:
        rounds[0] += 1
        return looked(*arguments)

    monkeypatch.setattr(statics, "compliances", counted)
    assert statics.holding_voltage(s, model, AREA) == held
    assert (rounds[0] > 1) == (cubic > 0.0)


TABLE = Capacitance(
    gap_um=3.68,
    travel_um=tuple(np.linspace(-2.5, 3.4, 60)),
    capacitance_fF=tuple(1e9 * plate.EPSILON_0 * AREA / (3.68 - np.linspace(-2.5, 3.4, 60)) * 1e0),
)


@pytest.mark.parametrize(
    "model",
    [
        modes(Mode(frequency_kHz=22.0, quality_factor=2.0, electrode=0.85)),
        modes(
            Mode(frequency_kHz=22.0, quality_factor=2.0),
            Mode(frequency_kHz=70.0, quality_factor=2.0, contact=0.2, electrode=0.3),
        ),
        modes(Mode(frequency_kHz=22.0, quality_factor=2.0), capacitance=TABLE),
        modes(Mode(frequency_kHz=22.0, quality_factor=2.0, cubic_per_um2=0.3)),
        modes(
            Mode(frequency_kHz=22.0, quality_factor=2.0, cubic_per_um2=0.2),
            Mode(frequency_kHz=70.0, quality_factor=2.0, contact=0.2, electrode=0.3, cubic_per_um2=1.0),
        ),
        ReducedOrder(
            mode=(Mode(frequency_kHz=22.0, quality_factor=2.0),),
            dielectric=Dielectric(thickness_um=0.4, permittivity=4.0),
        ),
    ],
)
def test_a_slow_ramp_closes_where_statics_say(model: ReducedOrder) -> None:
    """Inertia and damping delay it by some parts in a thousand."""
    s = load_population("current").sample(4, seed=1)
    wanted = statics.closing_voltage(s, model, AREA)
    found = closes(s, model, wanted)
    np.testing.assert_allclose(found, wanted, rtol=0.01)
    assert (found > wanted).all()


def beam(folder: Path) -> dict[str, str]:
    return {"name": "reduced-order", "modes": str(folder / "modes.toml")}


def closes(switches: np.ndarray, model: ReducedOrder | None, wanted: np.ndarray) -> np.ndarray:
    """Voltage of the first contact of each switch on a slow ramp that ends just above the wanted one [V]."""
    rise, found = 60_000.0, []
    for switch, volts in zip(switches, 1.02 * wanted, strict=True):
        ramp = Trace([0.0, rise], [0.0, volts])
        r = simulate(switch[None], ramp, modes=model, horizon_us=rise, rtol=1e-7, max_volts=math.inf)
        found.append(volts * r.first_contact_us[0] / rise)
    return np.array(found)


@pytest.fixture
def prober(tmp_path: Path) -> str:
    path = tmp_path / "prober.toml"
    path.write_text(
        'name = "as a prober sees it"\nplate_area_um2 = 16700.0\n'
        + "".join(
            f'[{v}]\ndistribution = "uniform"\nlower = {low}\nupper = {high}\n'
            for v, low, high in (("D", 2.4, 2.5), ("G", 3.6, 3.8), ("U_pi", 70.0, 90.0), ("f", 20.0, 24.0))
        )
    )
    (tmp_path / "modes.toml").write_text("[[mode]]\nfrequency_kHz = 22.0\nquality_factor = 3.0\nelectrode = 0.8\n")
    return str(path)


def test_a_lot_that_tells_its_pull_in_closes_there_in_the_model_that_it_has(prober: str, tmp_path: Path) -> None:
    c = load_config({"population": {"name": prober}, "model": beam(tmp_path)})
    lot = draw(c, 30, seed=1)
    device = chain_of(c).device
    np.testing.assert_allclose(device.closing_voltage(lot.switches), lot["U_pi"], rtol=1e-7)
    np.testing.assert_allclose(plate.resonance(lot.switches), lot["f"], rtol=1e-12)
    np.testing.assert_allclose(closes(lot.switches[:3], device.modes, lot["U_pi"][:3]), lot["U_pi"][:3], rtol=0.01)
    ideal = draw(load_config({"population": {"name": prober}}), 30, seed=1)
    assert (lot["K"] < 0.7 * ideal["K"]).all(), "an electrode that moves less needs a softer spring"
    mean = mean_switch(c.build_population(), device)
    assert device.closing_voltage(mean)[0] == pytest.approx(80.0, rel=0.01)


@pytest.mark.parametrize("measured", in_turn(["pull-in", "pull-in and resonance"], 2, 1))
def test_the_reference_of_a_trim_is_measured_in_its_own_model(prober: str, tmp_path: Path, measured: str) -> None:
    """The mean switch's own reading leaves its drive as it is, whatever its electrode does."""
    c = load_config({
        "model": beam(tmp_path),
        "trim": {"measured": measured, "pull_in_error": 1e-4, "resonance_error": 1e-4},
    })  # fmt: skip
    around = chain_of(c).around
    trim = trim_of(c.trim, around)
    mean = mean_switch(around.population, around.device)
    (reading,) = closes(mean[None], around.device.modes, np.array([trim.reference[0]]))
    assert reading == pytest.approx(trim.reference[0], rel=0.01)
    assert trim.scales([[reading, trim.reference[1]]]).volts[0] == pytest.approx(1.0, abs=0.012)


def test_a_model_of_somebody_else_s_is_asked_by_a_slow_ramp(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("softclose.device.device.load_model", lambda name: simulate)
    device = Device(
        name="theirs",
        horizon_us=250.0,
        restitution=0.5,
        plate_area_um2=AREA,
        rtol=1e-9,
        method="taylor",
        losses=Losses(),
    )
    s = load_population("current").sample(20, seed=2)
    late = device.closing_voltage(s) / plate.closing_voltage(s, AREA)
    np.testing.assert_allclose(late, 1.02, atol=0.01)  # inertia; alike for all, so that ratios are those of statics
    assert np.ptp(late) < 0.012
    assert np.isnan(device.holding_voltage(s)).all()
    assert Lot.of(s).rows(slice(2)).switches.shape == (2, 4)


def test_a_pull_in_that_no_stiffness_gives_is_refused(prober: str, tmp_path: Path) -> None:
    c = load_config({"population": {"name": prober}, "model": beam(tmp_path)})
    bad = modes(Mode(frequency_kHz=20.0), Mode(frequency_kHz=21.0, contact=-1.0, electrode=2.0))
    population = c.build_population()
    with pytest.raises(PopulationError, match="does not pull its contact"):
        switches_of(population, replace(chain_of(c).device, modes=bad), population.sample_parameters(4, seed=1))


def test_what_populations_prints_as_pull_in_is_the_model_s(prober: str, tmp_path: Path) -> None:
    from softclose.device.told import closing_summary
    from softclose.switch.reduced_order import read_reduced_order

    found = closing_summary(load_population(prober), read_reduced_order(tmp_path / "modes.toml"), AREA)
    assert found["U_pi_lower_V"] == pytest.approx(70.0, abs=0.1)
    assert found["U_pi_upper_V"] == pytest.approx(90.0, abs=0.1)
    plates = closing_summary(load_population("current"), modes(Mode(frequency_kHz=20.0, electrode=0.8)), AREA)
    ideal = load_population("current").summary()["U_pi_mean_switch_V"]
    assert plates["U_pi_mean_switch_V"] == pytest.approx(ideal / 0.8, rel=1e-4)
