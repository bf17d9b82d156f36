"""Claims about the Taylor kernel of two modes: its twin, one mode as its limit, drives, columns, the series."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from examples import examples, is_whole
from modal_reference import bounces_agree
from rendered import functions_of
from softclose import Losses, Pulse, ReducedOrder, Waveform, load_population, simulate
from softclose.kernel import dispatch, generate_series
from softclose.switch.reduced_order import CompliantContact, Dielectric, Mode
from softclose.waveform import Delivered

HARD = Waveform([Pulse(0, 4, 11.5, 120), Pulse(24, 12, math.inf, 75)])
RELEASED = Waveform([Pulse(0, 4, 90, 125)])
PLATE = ReducedOrder(
    mode=(
        Mode(frequency_kHz=20.0, quality_factor=30.0),
        Mode(frequency_kHz=70.0, quality_factor=50.0, contact=0.2, electrode=0.2),
    )
)
TILTED = ReducedOrder(
    mode=(
        Mode(frequency_kHz=20.0, mass_ug=3.4, quality_factor=40.0, contact=2.0, electrode=1.8),
        Mode(frequency_kHz=70.0, mass_ug=1.0, quality_factor=25.0, contact=0.3, electrode=0.15),
    )
)
BEAM = ReducedOrder(
    mode=(
        Mode(frequency_kHz=20.0, mass_ug=3.4, quality_factor=40.0, contact=2.0, electrode=1.8),
        Mode(frequency_kHz=70.0, mass_ug=1.0, quality_factor=25.0, contact=-0.3, electrode=0.15),
    )
)


@st.composite
def models(draw: st.DrawFn) -> ReducedOrder:
    second = draw(st.floats(-0.4, 0.4))
    together = draw(st.booleans())
    return ReducedOrder(
        mode=(
            Mode(frequency_kHz=20.0, quality_factor=draw(st.sampled_from([0.0, 15.0]))),
            Mode(
                frequency_kHz=draw(st.floats(45.0, 130.0)),
                quality_factor=draw(st.floats(5.0, 80.0)),
                contact=second,
                electrode=second if together else draw(st.floats(-0.3, 0.3)),
            ),
        )
    )


@st.composite
def drives(draw: st.DrawFn) -> Waveform | Delivered:
    first = Pulse(0.0, draw(st.floats(4.0, 12.0)), draw(st.floats(2.0, 15.0)), draw(st.floats(80.0, 130.0)))
    second = Pulse(
        draw(st.floats(24.0, 60.0)), draw(st.floats(6.0, 20.0)), draw(st.sampled_from([math.inf, 50.0])), 75.0
    )
    command = Waveform([first, second])
    delivered = is_whole() and draw(st.booleans())  # further kernels to compile
    return Delivered(command=command, bandwidth_kHz=60.0) if delivered else command


@settings(max_examples=examples(15), deadline=None, derandomize=True)
@given(modes=models(), drive=drives(), seed=st.integers(0, 2**32 - 1), adhesion=st.sampled_from([0.0, 40.0]))
def test_the_kernel_agrees_with_its_twin(
    modes: ReducedOrder, drive: Waveform | Delivered, seed: int, adhesion: float
) -> None:
    table = np.random.default_rng(seed).uniform((1.8, 3.6, 45.0, 2.8), (2.8, 4.4, 90.0, 4.2), size=(6, 4))
    nudged = np.concatenate([table + shift * np.array([1e-6, 0.0, 0.0, 0.0]) for shift in (0, 1, -1)])
    common: dict[str, Any] = {
        "modes": modes,
        "losses": Losses(adhesion_uN=adhesion),
        "max_impacts": 128,
        "max_volts": 1e3,
        "times_us": [50.0, 200.0],
    }
    assert dispatch.in_series(modes, Losses()) or abs(modes.mode[1].contact - modes.mode[1].electrode) < 1e-3
    tight = simulate(nudged, drive, method="rk", rtol=1e-12, **common)
    fast = simulate(table, drive, **common)
    count, closed = tight.n_impacts.reshape(3, -1), tight.closed.reshape(3, -1)
    regular = (count == count[0]).all(axis=0) & (closed == closed[0]).all(axis=0)  # the others graze: SPEC §8
    regular &= tight.status[:6] == 0
    assert regular.mean() >= 0.3
    np.testing.assert_array_equal(fast.closed[regular], closed[0, regular])
    np.testing.assert_allclose(fast.max_contact_speed[regular], tight.max_contact_speed[:6][regular], atol=1e-5)
    bounces_agree(fast, tight, regular)


@pytest.mark.parametrize("modes", [PLATE, BEAM])
def test_a_held_switch_is_let_go_when_its_twin_is(modes: ReducedOrder) -> None:
    switches, times = load_population("current").sample(20, seed=8), np.linspace(0.0, 250.0, 501)
    common: dict[str, Any] = {"modes": modes, "times_us": times, "losses": Losses(adhesion_uN=25.0)}
    found, twin = (simulate(switches, RELEASED, method=m, rtol=1e-10, **common) for m in ("taylor", "rk"))
    held = (np.abs(twin.x - switches[:, :1]) < 1e-9).sum(axis=1) > 20
    assert held.sum() >= 3
    np.testing.assert_allclose(found.x[held], twin.x[held], atol=5e-5)
    assert found.mode_peak_um is not None
    assert twin.mode_peak_um is not None
    # The twin looks at the ends of its steps only.
    assert (found.mode_peak_um >= 0.99 * twin.mode_peak_um).all()
    np.testing.assert_allclose(found.mode_peak_um, twin.mode_peak_um, rtol=0.35)


def test_a_second_mode_that_nothing_moves_is_none() -> None:
    switches = load_population("current").sample(20, seed=8)
    still = ReducedOrder(mode=(Mode(frequency_kHz=20.0), Mode(frequency_kHz=90.0, contact=1e-9, electrode=1e-9)))
    assert dispatch.in_series(still, Losses())
    found, plain = simulate(switches, HARD, modes=still, max_impacts=12), simulate(switches, HARD, max_impacts=12)
    np.testing.assert_allclose(found.max_contact_speed, plain.max_contact_speed, atol=1e-7)
    np.testing.assert_allclose(found.impact_speed, plain.impact_speed, atol=1e-6)


@pytest.mark.parametrize("method", ["taylor", pytest.param("rk", marks=pytest.mark.long)])
@pytest.mark.parametrize("modes", [PLATE, TILTED])
@pytest.mark.parametrize(
    "drive", [HARD, RELEASED, pytest.param(Delivered(command=HARD, bandwidth_kHz=60.0), marks=pytest.mark.long)]
)
def test_parts_of_the_modes_sum_up_to_the_motion(modes: ReducedOrder, method: Any, drive: Any) -> None:
    """The same switches, told from their second mode on: what was the first mode's part is the further one's then."""
    table = np.random.default_rng(3).uniform((2.2, 3.6, 55.0, 3.0), (2.6, 3.9, 75.0, 3.8), size=(12, 4))
    mass, stiffness, _, contact, _, _ = modes.ratios()[1]
    mass /= contact**2  # as if it moved the contact by 1
    other = ReducedOrder(mode=modes.mode[::-1])
    turned = table * np.array([1.0, 1.0, mass * stiffness, mass])
    common: dict[str, Any] = {"times_us": np.linspace(0.0, 250.0, 501), "method": method, "max_volts": 1e3}
    one = simulate(table, drive, modes=modes, further_modes=True, **common)
    two = simulate(turned, drive, modes=other, further_modes=True, **common)
    assert one.mode_x is not None
    assert one.mode_v is not None
    assert two.mode_x is not None
    assert two.mode_v is not None
    assert one.mode_x.shape == (12, 1, 501)
    ok = (one.status == 0) & (two.status == 0) & (one.n_impacts == two.n_impacts)
    assert ok.sum() > 6
    for parts, whole in (
        ((one.mode_x, two.mode_x), one.x),
        ((one.mode_v, two.mode_v), one.v),
    ):
        assert np.abs(parts[0][ok]).max() > 1e-3
        off = np.abs(parts[0][ok, 0] + parts[1][ok, 0] - np.asarray(whole)[ok])
        assert np.quantile(off, 0.99) < 1e-6  # an instant beside an impact may lie before it in one of the two
        assert off.max() < 2e-3 if whole is one.x else True
    single = simulate(table, drive, modes=modes, further_modes=True, dtype=np.float32, **common)
    np.testing.assert_allclose(single.mode_x, one.mode_x, atol=1e-6)
    np.testing.assert_allclose(single.mode_v, one.mode_v, atol=1e-5)


def test_further_modes_are_told_where_they_are_asked_for_and_change_nothing() -> None:
    table = np.array([[2.43, 3.68, 65.3, 3.41], [2.5, 3.7, 60.0, 3.3]])
    common: dict[str, Any] = {"modes": BEAM, "times_us": np.linspace(0.0, 250.0, 101)}
    plain, asked = simulate(table, HARD, **common), simulate(table, HARD, further_modes=True, **common)
    assert plain.mode_x is None
    assert plain.mode_v is None
    assert np.asarray(plain.x).tobytes() == np.asarray(asked.x).tobytes()
    assert np.asarray(plain.v).tobytes() == np.asarray(asked.v).tobytes()
    assert simulate(table, HARD, modes=BEAM, further_modes=True).mode_x is None
    assert simulate(table, HARD, times_us=[1.0], further_modes=True).mode_x is None
    twice = {"drive_volts": np.array([1.0, 1.05]), "drive_times": np.array([1.0, 1.2])}
    scaled = simulate(table, HARD, further_modes=True, **twice, **common)
    slow = Waveform([Pulse(0, 4.8, 13.8, 126), Pulse(28.8, 14.4, math.inf, 78.75)])
    times = {**common, "times_us": 1.2 * common["times_us"], "horizon_us": 300.0}
    alone = simulate(table[1:], slow, further_modes=True, **times)
    np.testing.assert_allclose(scaled.mode_x[1], alone.mode_x[0], atol=1e-6)  # type: ignore[index]
    np.testing.assert_allclose(scaled.mode_v[1], alone.mode_v[0], atol=1e-5)  # type: ignore[index]
    labelled = asked.to_xarray()
    assert labelled["mode_v"].dims == ("switch", "further_mode", "time")


def test_scaled_commands_and_columns_are_those_of_each_switch() -> None:
    switches, rng = load_population("current").sample(5, seed=8), np.random.default_rng(3)
    a, b, eta, q = rng.uniform(0.95, 1.05, 5), rng.uniform(0.95, 1.05, 5), rng.uniform(0.3, 0.7, 5), np.full(5, 20.0)
    q[2:] = 35.0
    whole = simulate(
        switches, HARD, modes=BEAM, drive_volts=a, drive_times=b, restitution=eta, losses=Losses(quality_factor=q)
    )
    for i in range(5):
        own = Waveform(
            [Pulse(p.start_us * b[i], p.rise_us * b[i], p.peak_us * b[i], p.volts * a[i]) for p in HARD.pulses]
        )
        alone = simulate(
            switches[i : i + 1],
            own,
            modes=BEAM,
            restitution=float(eta[i]),
            losses=Losses(quality_factor=float(q[i])),
            horizon_us=250.0 * b[i],
        )
        np.testing.assert_allclose(whole.max_contact_speed[i], alone.max_contact_speed[0], rtol=1e-6)
        assert whole.n_impacts[i] == alone.n_impacts[0]


def test_what_has_no_series_goes_to_the_twin() -> None:
    for modes in (
        ReducedOrder(mode=PLATE.mode, contact=CompliantContact(force_at_1_um_uN=1e5)),
        ReducedOrder(mode=(*PLATE.mode, Mode(frequency_kHz=150.0, contact=0.1))),
        ReducedOrder(mode=(Mode(frequency_kHz=20.0, electrode=0.9),)),
        ReducedOrder(mode=(PLATE.mode[0], Mode(frequency_kHz=70.0, contact=0.2, electrode=0.2, cubic_per_um2=0.1))),
        ReducedOrder(mode=PLATE.mode, dielectric=Dielectric(thickness_um=0.2, permittivity=4.0)),
    ):
        assert not dispatch.in_series(modes, Losses())
    slipping = Losses(film_viscosity_uPa_s=1.0, film_mean_free_path_um=0.07)
    assert not dispatch.in_series(PLATE, slipping)
    assert dispatch.in_series(None, slipping)
    assert dispatch.in_series(ReducedOrder(mode=PLATE.mode[:1]), slipping)
    assert dispatch.in_series(PLATE, Losses(film_viscosity_uPa_s=1.0))
    # An electrode that is nearly the contact: its series would lose digits.
    nearly = ReducedOrder(mode=(PLATE.mode[0], Mode(frequency_kHz=70.0, contact=0.2, electrode=0.2 + 1e-6)))
    assert not dispatch.in_series(nearly, Losses())


@pytest.mark.parametrize("film", [False, True])
def test_the_series_solve_their_equations(film: bool) -> None:
    made = functions_of(generate_series.render(), generate_series.render_modes())
    u = made["drive"](made["constant"](50.0), 40.0 * np.cos(0.3), 40.0 * np.sin(0.3), 0.5)
    gap, ea, eb, ha, hb, ka, kb, da, db, fa, fb = 3.7, 1.0, 0.3, 2e-5, 1e-5, 0.019, 0.2, 0.01, 0.05, 3.0, 1.0
    extra = (fa, fb) if film else ()
    name = "two_film" if film else "two"
    found = made[name](0.5, 0.1, 0.2, -0.1, u, gap, ea, eb, ha, hb, ka, kb, da, db, *extra)
    a, b = (np.polynomial.Polynomial(s) for s in found)
    h = 0.1
    volts = 50.0 + 40.0 * math.cos(0.5 * h + 0.3)
    left, speed = gap - ea * a(h) - eb * b(h), ea * a.deriv()(h) + eb * b.deriv()(h)
    for mode, pull, k, d, thick in ((a, ha, ka, da, fa), (b, hb, kb, db, fb)):
        right = pull * (volts / left) ** 2 - k * mode(h) - d * mode.deriv()(h) - film * thick * speed / left**3
        assert mode.deriv(2)(h) == pytest.approx(right, abs=1e-12)
    c = np.polynomial.Polynomial(made["blend"](*found, 2.0, -3.0))
    assert c(h) == pytest.approx(2.0 * a(h) - 3.0 * b(h), abs=1e-14)
    pressed = np.polynomial.Polynomial(made["press"](found[0], 1.5, 0.7, -0.3, 0.1))
    assert pressed(h) == pytest.approx(-(1.5 * a.deriv(2)(h) + 0.7 * a.deriv()(h) - 0.3 * a(h) + 0.1), abs=1e-11)
    under = np.polynomial.Polynomial(made["press_under"](found[0], u, 0.7, -0.3, 0.1, 2e-4))
    assert under(h) == pytest.approx(-(2e-4 * volts**2 + 0.7 * a.deriv()(h) - 0.3 * a(h) + 0.1), abs=1e-11)
