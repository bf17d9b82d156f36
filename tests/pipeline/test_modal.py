"""Claims about switches of several modes, and about losses: an oracle of its own, closed forms, energy, orders."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import diags, eye, kron
from scipy.sparse.linalg import spsolve

from examples import examples
from modal_reference import EPS0, oracle
from softclose import Losses, Pulse, ReducedOrder, Waveform, load_population, read_reduced_order, simulate
from softclose.device.simulate import SimulationError
from softclose.kernel.dispatch import ONE_MODE
from softclose.switch.losses import LossesError, shape_factor
from softclose.switch.reduced_order import Capacitance, CompliantContact, Mode, ReducedOrderError

AREA = 16700.0
MEAN = np.array([2.43, 3.68, 65.3, 3.41])
SOFT = Waveform([Pulse(0, 4.4, 7.25, 111.6), Pulse(56.5, 19, math.inf, 75)])
HARD = Waveform([Pulse(0, 4, 11.5, 120), Pulse(24, 12, math.inf, 75)])
TWO = (
    Mode(frequency_kHz=20.0, mass_ug=3.4, quality_factor=40.0, contact=2.0, electrode=1.8),
    Mode(frequency_kHz=70.0, mass_ug=1.0, quality_factor=25.0, contact=-0.3, electrode=0.15),
)


@settings(max_examples=examples(15), deadline=None, derandomize=True)
@given(
    rise=st.floats(4.0, 20.0), peak=st.floats(0.0, 30.0), volts=st.floats(60.0, 150.0), seed=st.integers(0, 2**31 - 1)
)
def test_one_mode_without_losses_is_the_kernel(rise: float, peak: float, volts: float, seed: int) -> None:
    switches = load_population("current").sample(40, seed=seed)
    waveform = Waveform([Pulse(0, rise, peak, volts), Pulse(60, 10, math.inf, 70)])
    expected = simulate(switches, waveform, rtol=1e-11, times_us=np.linspace(0, 250, 60))
    found = simulate(switches, waveform, rtol=1e-11, times_us=np.linspace(0, 250, 60), modes=ONE_MODE)
    np.testing.assert_allclose(found.max_contact_speed, expected.max_contact_speed, atol=2e-8)
    np.testing.assert_allclose(found.first_contact_us, expected.first_contact_us, atol=2e-6)
    np.testing.assert_array_equal(found.closed, expected.closed)
    assert found.x is not None
    assert expected.x is not None
    np.testing.assert_allclose(found.x, expected.x, atol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("waveform", "film"),
    [
        (HARD, 0.0),
        *(pytest.param(w, film, marks=pytest.mark.long) for w, film in ((SOFT, 0.0), (SOFT, 3.0), (HARD, 3.0))),
    ],
)
def test_two_modes_agree_with_the_oracle(waveform: Waveform, film: float) -> None:
    modes = ReducedOrder(mode=TWO)
    losses = Losses(film_viscosity_uPa_s=film)
    switches = load_population("current").sample(5, seed=11)
    found = simulate(switches, waveform, modes=modes, losses=losses, max_impacts=4, rtol=1e-11, horizon_us=120.0)
    assert found.impact_time_us is not None
    assert found.impact_speed is not None
    compared = 0
    for i, switch in enumerate(switches):
        expected = oracle(modes, switch, film=losses.film(AREA)).run(waveform, 120.0)
        for j, (t, speed) in enumerate(expected.impacts[:3]):
            assert found.impact_time_us[i, j] == pytest.approx(t, abs=2e-5)
            assert found.impact_speed[i, j] == pytest.approx(speed, abs=2e-6)
            compared += 1
        if not expected.impacts:
            assert found.n_impacts[i] == 0
            assert found.final_x[i] == pytest.approx(expected.final, abs=1e-7)
    assert compared >= 3


@pytest.mark.slow
def test_a_compliant_contact_agrees_with_the_oracle() -> None:
    modes = ReducedOrder(mode=TWO, contact=CompliantContact(force_at_1_um_uN=2e5, exponent=1.5, loss_us_per_um=2.0))
    switches = load_population("current").sample(3, seed=4)
    found = simulate(switches, HARD, modes=modes, max_impacts=4, rtol=1e-11, horizon_us=110.0)
    assert found.impact_time_us is not None
    assert found.impact_speed is not None
    compared = 0
    for i, switch in enumerate(switches):
        expected = oracle(modes, switch, compliance=(200.0, 1.5, 2.0)).run(HARD, 110.0)
        compared += len(expected.impacts)
        for j, (t, speed) in enumerate(expected.impacts[:3]):
            assert found.impact_time_us[i, j] == pytest.approx(t, abs=1e-5)
            assert found.impact_speed[i, j] == pytest.approx(speed, abs=1e-6)
    assert compared >= 4


def test_a_stiff_compliant_contact_without_loss_rebounds_like_restitution_one() -> None:
    elastic = simulate([MEAN], HARD, modes=ONE_MODE, restitution=1.0, horizon_us=40.0, rtol=1e-10, max_impacts=3)
    contact = CompliantContact(force_at_1_um_uN=1e8, exponent=1.0)
    stiff = simulate(
        [MEAN],
        HARD,
        modes=ReducedOrder(mode=ONE_MODE.mode, contact=contact),
        horizon_us=40.0,
        rtol=1e-10,
        max_impacts=3,
    )
    assert elastic.impact_speed is not None
    assert stiff.impact_speed is not None
    np.testing.assert_allclose(stiff.impact_speed, elastic.impact_speed, rtol=2e-2)


def test_energy_is_lost_to_damping_and_film_and_nowhere_else() -> None:
    times = np.linspace(20.0, 55.0, 20001)  # constant voltage zero: the pulse is over
    losses = Losses(quality_factor=15.0, film_viscosity_uPa_s=20.0)
    found = simulate([MEAN], Waveform([Pulse(0, 4, 6, 90)]), losses=losses, rtol=1e-11, times_us=times)
    assert found.x is not None
    assert found.v is not None
    assert found.n_impacts[0] == 0
    _d, g, k, m = MEAN
    x, v = found.x[0], found.v[0]
    energy = 0.5 * m * v**2 + 0.5e-3 * k * x**2
    power = m * math.sqrt(1e-3 * k / m) / 15.0 * v**2 + losses.film(AREA) / (g - x) ** 3 * v**2
    lost = np.trapezoid(power, times)
    assert energy[0] - energy[-1] == pytest.approx(lost, rel=1e-6)
    assert lost > 0.2 * energy[0]


def test_free_oscillation_decays_as_its_quality_factor_says() -> None:
    q, (_d, _g, k, m) = 30.0, MEAN
    omega = math.sqrt(1e-3 * k / m)
    damped = omega * math.sqrt(1.0 - 0.25 / q**2)
    times = 60.0 + np.arange(4) * 2.0 * math.pi / damped
    found = simulate(
        [MEAN], Waveform([Pulse(0, 4, 6, 60)]), losses=Losses(quality_factor=q), rtol=1e-11, times_us=times
    )
    assert found.x is not None
    ratios = found.x[0, 1:] / found.x[0, :-1]
    np.testing.assert_allclose(ratios, math.exp(-math.pi / q * omega / damped), rtol=1e-7)


def test_adhesion_lowers_the_voltage_of_release() -> None:
    d, g, k, _m = MEAN
    fall = Waveform([Pulse(0, 4, 150, 100)])
    slow = Waveform([Pulse(0, 100, 100, 100)])  # falls over 100 µs from 200 on
    times = np.linspace(200.0, 300.0, 20001)
    for adhesion in (0.0, 60.0, 120.0):
        losses = Losses(quality_factor=5.0, adhesion_uN=adhesion)
        found = simulate([MEAN], slow, losses=losses, horizon_us=400.0, times_us=times)
        assert found.x is not None
        last = times[int(np.flatnonzero(found.x[0] >= d - 1e-9)[-1])]
        expected = (g - d) * math.sqrt(2e-6 * (k * d - adhesion) / (EPS0 * AREA))
        assert float(slow.voltage(np.array([last]))[0]) == pytest.approx(expected, abs=0.05)
    stuck = simulate([MEAN], fall, losses=Losses(adhesion_uN=1.01 * k * d), horizon_us=400.0)
    assert stuck.closed[0], "nothing opens a switch that sticks harder than its spring pulls"


@pytest.mark.parametrize("polynomial", [False, True])
def test_a_capacitance_of_parallel_plates_is_parallel_plates(polynomial: bool) -> None:
    gap = 3.7
    x = np.linspace(-3.0, 3.0, 241)  # a switch swings below its rest
    if polynomial:
        powers = range(60)
        c = Capacitance(
            gap_um=gap,
            polynomial_fF=tuple(1e9 * EPS0 * AREA / gap ** (j + 1) for j in powers),
            valid_um=(-3.0, 3.0),
        )
    else:
        c = Capacitance(
            gap_um=gap, travel_um=tuple(x.tolist()), capacitance_fF=tuple((1e9 * EPS0 * AREA / (gap - x)).tolist())
        )
    switches = load_population("current").sample(50, seed=2)
    plates = simulate(switches, HARD, modes=ONE_MODE)
    table = simulate(switches, HARD, modes=ReducedOrder(mode=ONE_MODE.mode, capacitance=c))
    touched = np.isfinite(plates.first_contact_us)
    np.testing.assert_allclose(
        table.max_contact_speed[touched], plates.max_contact_speed[touched], rtol=2e-4 if polynomial else 2e-5
    )


def test_tighter_tolerances_converge() -> None:
    modes = ReducedOrder(mode=TWO)
    best = simulate([MEAN], SOFT, modes=modes, rtol=1e-13)
    errors = [
        abs(float((simulate([MEAN], SOFT, modes=modes, rtol=r).final_x - best.final_x)[0])) for r in (1e-6, 1e-8, 1e-10)
    ]
    assert errors[0] > 10.0 * errors[1] > 100.0 * errors[2] or max(errors) < 1e-9


def test_the_normalisation_of_a_mode_shape_changes_nothing() -> None:
    halved = [
        Mode(
            frequency_kHz=m.frequency_kHz,
            mass_ug=m.mass_ug * s**2,
            quality_factor=m.quality_factor,
            contact=m.contact * s,
            electrode=m.electrode * s,
        )
        for m, s in zip(TWO, (0.5, -3.0), strict=True)
    ]
    a = simulate([MEAN], HARD, modes=ReducedOrder(mode=TWO))
    b = simulate([MEAN], HARD, modes=ReducedOrder(mode=tuple(halved)))
    assert a.max_contact_speed[0] == pytest.approx(b.max_contact_speed[0], rel=1e-7)


@pytest.mark.long
def test_each_further_mode_has_its_own_motion() -> None:
    modes = [Mode(frequency_kHz=20.0), *(Mode(frequency_kHz=f, contact=0.2, electrode=0.1) for f in (60.0, 110.0))]
    common: dict[str, Any] = {"times_us": np.linspace(0.0, 100.0, 101), "horizon_us": 100.0, "further_modes": True}
    table = MEAN * np.array([[1.0, 1.0, 1.0, 1.0], [1.02, 1.0, 0.95, 1.05]])
    one = simulate(table, HARD, method="rk", modes=ReducedOrder(mode=tuple(modes)), **common)
    two = simulate(table, HARD, method="rk", modes=ReducedOrder(mode=(modes[0], *modes[:0:-1])), **common)
    assert one.mode_x is not None
    assert one.mode_v is not None
    assert two.mode_x is not None
    early = common["times_us"] < np.nanmin(one.first_contact_us)
    np.testing.assert_allclose(one.mode_x[:, ::-1, early], two.mode_x[:, :, early], atol=1e-7)
    assert np.abs(one.mode_x[:, 0, early] - one.mode_x[:, 1, early]).max() > 1e-3
    # Speeds are slopes: of a smooth part, by central differences.
    slopes = np.gradient(one.mode_x[:, 0, early], common["times_us"][early], axis=-1)
    np.testing.assert_allclose(one.mode_v[:, 0, early][:, 2:-2], slopes[:, 2:-2], atol=5e-3)


def test_rows_depend_on_nothing_else() -> None:
    switches = load_population("current").sample(9, seed=5)
    modes = ReducedOrder(mode=TWO)
    whole = simulate(switches, HARD, modes=modes, threads=2, times_us=[10.0, 100.0], max_impacts=3)
    for i in (0, 8):
        alone = simulate(switches[i : i + 1], HARD, modes=modes)
        assert alone.max_contact_speed[0] == whole.max_contact_speed[i]
        assert alone.final_x[0] == whole.final_x[i]


def test_losses_of_nothing_are_the_same_bits() -> None:
    switches = load_population("current").sample(20, seed=5)
    plain = simulate(switches, HARD)
    np.testing.assert_array_equal(simulate(switches, HARD, losses=Losses()).final_x, plain.final_x)
    assert plain.mode_peak_um is None


def test_the_film_of_a_rectangle_solves_reynolds_equation() -> None:
    def second(n: int) -> Any:
        return diags([np.ones(n - 2), -2 * np.ones(n - 1), np.ones(n - 2)], [-1, 0, 1])

    for ratio in (1.0, 0.4):
        n_x, n_y = 160, round(160 * ratio)
        h = 1.0 / n_x
        laplace = (kron(second(n_x), eye(n_y - 1)) + kron(eye(n_x - 1), second(n_y))).tocsc() / h**2
        p = spsolve(laplace, -12.0 * np.ones((n_x - 1) * (n_y - 1)))
        width = n_y * h
        assert p.sum() * h * h == pytest.approx(width**3 * shape_factor(width), rel=2e-3)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "0 modes"),
        ("[[mode]]\nmass_ug = 1", "frequency_kHz is missing"),
        ("[[mode]]\nfrequency_kHz = -20", "frequency_kHz is -20"),
        ("[[mode]]\nfrequency_kHz = 20\nfrequncy = 1", "unknown key 'frequncy'"),
        ("[[mode]]\nfrequency_kHz = 20\ncontact = -1", "the sign that closes it"),
        ("[[mode]]\nfrequency_kHz = true", "finite number"),
        ("[[mode]]\nfrequency_kHz = 20\n[capacitance]\ngap_um = 4", "either polynomial_fF"),
        ("[[mode]]\nfrequency_kHz = 20\n[capacitance]\ngap_um = 4\npolynomial_fF = [40, -3]", "capacitance falls"),
        (
            "[[mode]]\nfrequency_kHz = 20\n[capacitance]\ngap_um = 4\npolynomial_fF = [40, 3]\nvalid_um = [1, 3]",
            "from rest \\(0\\) or before",
        ),
        ("[[mode]]\nfrequency_kHz = 20\n[contact]\nforce_at_1_um_uN = 0", "force_at_1_um_uN is 0"),
        ("[[mode", "not valid TOML"),
    ],
)
def test_a_bad_file_says_what_is_wrong(tmp_path, text: str, said: str) -> None:  # type: ignore[no-untyped-def]
    path = tmp_path / "modes.toml"
    path.write_text(text)
    with pytest.raises(ReducedOrderError, match=said):
        read_reduced_order(path)


def test_an_electrode_that_passes_its_gap_is_refused() -> None:
    far = ReducedOrder(mode=(Mode(frequency_kHz=20.0, electrode=2.0),))
    with pytest.raises(SimulationError, match="through its gap"):
        simulate([MEAN], HARD, modes=far)
    with pytest.raises(LossesError, match="quality_factor"):
        Losses(quality_factor=-1.0)
    with pytest.raises(LossesError, match="both film_length_um and film_width_um"):
        Losses(film_length_um=3.0)


def test_the_least_rise_leaves_the_second_mode_at_rest() -> None:
    modes = ReducedOrder(mode=(Mode(frequency_kHz=20.0), Mode(frequency_kHz=70.0, contact=0.2, electrode=0.2)))
    assert modes.least_rise_us == pytest.approx(26.73, abs=0.01)

    def excited(rise: float) -> float:
        volts = 20.0  # so little that the gap hardly moves: the force is that of the voltage squared
        times = np.linspace(150, 1150, 16001)
        drive = Waveform([Pulse(0, rise, math.inf, volts)])
        found = simulate([MEAN], drive, modes=modes, times_us=times, horizon_us=1200.0)
        assert found.x is not None
        spectrum = np.abs(np.fft.rfft((found.x[0] - found.x[0].mean()) * np.blackman(times.size)))
        f = np.fft.rfftfreq(times.size, 1000.0 / 16000) * 1e3
        return float(spectrum[(f > 70) & (f < 85)].max())

    assert excited(modes.least_rise_us) < 0.1 * excited(0.0) < 0.1 * 1.5 * excited(4.0)
