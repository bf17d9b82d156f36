"""Claims about the fast kernel of stretching, dielectrics and films that slip: its twin, an oracle, scaled drives."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from examples import examples, is_whole
from modal_reference import ModalSwitch, agree, impacts_agree
from rendered import functions_of
from softclose import Losses, Pulse, ReducedOrder, Waveform, load_config, load_population, simulate
from softclose.evaluate import draw, respond
from softclose.kernel import dispatch, generate_series
from softclose.switch.losses import SLIP, SLIP_EXPONENT
from softclose.switch.reduced_order import Dielectric, Mode
from softclose.waveform import Delivered

AREA = 16700.0
HARD = Waveform([Pulse(0, 4, 11.5, 120), Pulse(24, 12, math.inf, 75)])


def beam(cubic: float = 0.0, coat: float = 0.0, quality: float = 0.0) -> ReducedOrder:
    layer = Dielectric(thickness_um=2.0 * coat, permittivity=2.0) if coat else None
    return ReducedOrder(mode=(Mode(frequency_kHz=20.0, cubic_per_um2=cubic, quality_factor=quality),), dielectric=layer)


@st.composite
def shapes(draw: st.DrawFn) -> tuple[ReducedOrder | None, Losses]:
    """Any of the terms, from none to strong."""
    film = draw(st.one_of(st.just(0.0), st.floats(0.05, 20.0)))
    losses = Losses(
        film_viscosity_uPa_s=film,
        film_mean_free_path_um=draw(st.one_of(st.just(0.0), st.floats(0.01, 1.0))),
        film_pressure_kPa=draw(st.sampled_from([101.325, 10.0])),
        adhesion_uN=draw(st.one_of(st.just(0.0), st.floats(1.0, 100.0))),
    )
    if losses.slips and draw(st.booleans()):
        return None, losses
    coat, quality = draw(st.sampled_from([0.0, 0.15, 0.6])), draw(st.one_of(st.just(0.0), st.floats(0.5, 100.0)))
    return beam(draw(st.one_of(st.just(0.0), st.floats(0.001, 0.3))), coat, quality), losses


@st.composite
def drives(draw: st.DrawFn) -> Waveform | Delivered:
    rise = draw(st.one_of(st.just(0.0), st.floats(4.0, 20.0)))
    first = Pulse(0.0, rise, draw(st.floats(2.0, 30.0)), draw(st.floats(60.0, 170.0)))
    command = Waveform([first, Pulse(draw(st.floats(10.0, 50.0)), 8.0, math.inf, draw(st.floats(60.0, 170.0)))])
    delivered = is_whole() and draw(st.booleans())  # further kernels to compile
    return Delivered(command=command, bandwidth_kHz=60.0) if delivered else command


@settings(max_examples=examples(15), deadline=None, derandomize=True)
@given(shape=shapes(), drive=drives(), seed=st.integers(0, 2**32 - 1), restitution=st.floats(0.05, 0.9))
def test_the_kernel_agrees_with_its_twin(
    shape: tuple[ReducedOrder | None, Losses], drive: Waveform | Delivered, seed: int, restitution: float
) -> None:
    modes, losses = shape
    table = np.random.default_rng(seed).uniform((1.8, 3.6, 45.0, 2.8), (2.8, 4.4, 90.0, 4.2), size=(6, 4))
    nudged = np.concatenate([table + shift * np.array([1e-6, 0.0, 0.0, 0.0]) for shift in (0, 1, -1)])
    common: dict[str, Any] = {
        "modes": modes, "losses": losses, "restitution": restitution, "max_volts": 1e3, "max_impacts": 256,
        "times_us": [20.0, 60.0, 200.0],
    }  # fmt: skip
    assert dispatch.in_series(modes, losses)
    tight = simulate(nudged, drive, method="rk", rtol=1e-12, **common)
    fast = simulate(table, drive, **common)
    assert (fast.status == 0).all()
    agree(fast, tight)


@pytest.mark.sampled
def test_the_kernel_agrees_with_the_oracle() -> None:
    """DOP853 of scipy, with events of its own, on random switches with random terms."""
    rng, compared = np.random.default_rng(12), 0
    n = 6 if is_whole() else 3
    switches = load_population("current").sample(6, seed=29)[:n]
    for i, (d, g, k, m) in enumerate(switches):
        cubic, coat, path = rng.uniform(0.0, 0.2), rng.uniform(0.05, 0.3), rng.uniform(0.02, 0.5)
        losses = Losses(film_viscosity_uPa_s=rng.uniform(0.1, 3.0), film_mean_free_path_um=path)
        found = simulate([switches[i]], HARD, modes=beam(cubic, coat, 25.0), losses=losses, max_impacts=6)
        one, rate = np.ones(1), np.array([math.sqrt(1e-3 * k / m) / 25.0])
        oracle = ModalSwitch(
            d, g, np.array([m]), np.array([1e-3 * k]), rate, one, one,
            film=float(losses.film(AREA)), cubic=cubic, coat=coat, free_path=path,
        ).run(HARD, 120.0)  # fmt: skip
        compared += impacts_agree(found, oracle)
    assert compared >= (2 * n if is_whole() else n)


@pytest.mark.parametrize("order", [9, 16])
@pytest.mark.parametrize("film", [False, True])
@pytest.mark.parametrize("driven", [False, True])
def test_the_series_solve_their_equation(driven: bool, film: bool, order: int) -> None:
    made = functions_of(generate_series.render(order), generate_series.render_shaped(order))
    x0, v0, gap, c, k, d, f, omega = 0.7, 0.1, 3.7, 2.2e-5, 0.019, 0.2, 3.0, 0.5
    cubic, coat, path = 0.003, 0.15, 0.4
    u = made["drive"](made["constant"](50.0), 40.0 * np.cos(0.3), 40.0 * np.sin(0.3), omega) if driven else 50.0
    name = ("shaped_film" if film else "shaped") + ("_driven" if driven else "_constant")
    more = (f, SLIP * path**SLIP_EXPONENT) if film else ()
    x = np.polynomial.Polynomial(made[name](x0, v0, u, gap, c, k, d, cubic, coat, *more))
    for h in (0.05, 0.1):
        volts = 50.0 + (40.0 * math.cos(omega * h + 0.3) if driven else 0.0)
        left, v = gap - x(h), x.deriv()(h)
        right = c * (volts / (left + coat)) ** 2 - k * x(h) - cubic * x(h) ** 3 - d * v
        right -= f * v / left**3 / (1.0 + SLIP * (path / left) ** SLIP_EXPONENT) if film else 0.0
        assert x.deriv(2)(h) == pytest.approx(right, abs=1e-6 if order == 9 else 1e-13)


def test_scaled_commands_and_columns_are_those_of_each_switch() -> None:
    switches, rng = load_population("current").sample(5, seed=8), np.random.default_rng(3)
    a, b, eta, film = (rng.uniform(*ends, 5) for ends in ((0.95, 1.05), (0.95, 1.05), (0.3, 0.7), (0.1, 2.0)))
    modes = beam(0.1, 0.2, 30.0)
    path = {"film_mean_free_path_um": 0.2}
    lot = Losses(film_viscosity_uPa_s=film, **path)
    whole = simulate(switches, HARD, modes=modes, drive_volts=a, drive_times=b, restitution=eta, losses=lot)
    for i in range(5):
        own = Waveform(
            [Pulse(p.start_us * b[i], p.rise_us * b[i], p.peak_us * b[i], p.volts * a[i]) for p in HARD.pulses]
        )
        losses = Losses(film_viscosity_uPa_s=float(film[i]), **path)
        alone = simulate(
            switches[i : i + 1], own, modes=modes, restitution=float(eta[i]), losses=losses, horizon_us=250.0 * b[i]
        )
        np.testing.assert_allclose(whole.max_contact_speed[i], alone.max_contact_speed[0], rtol=1e-6)
        assert whole.n_impacts[i] == alone.n_impacts[0]


@pytest.mark.parametrize("volts", [60.0, 120.0])
def test_what_the_mode_moved_until_the_first_impact_is_told(volts: float) -> None:
    """The largest sample where it does not touch, the travel where it does."""
    switches, times = load_population("current").sample(10, seed=4), np.linspace(0.0, 250.0, 5001)
    drive = Waveform([Pulse(0.0, 4.0, math.inf, volts)])
    found = simulate(switches, drive, modes=beam(0.1, 0.1), times_us=times)
    assert found.mode_peak_um is not None
    assert found.x is not None
    touched = found.n_impacts > 0
    assert touched.all() == (volts == 120.0)
    expected = np.where(touched, switches[:, 0], np.abs(found.x).max(axis=1))
    np.testing.assert_allclose(found.mode_peak_um[:, 0], expected, rtol=1e-3)


@pytest.mark.sampled
def test_no_bridge_on_its_last_film_is_lost() -> None:
    """Its film is stiff: an explicit method that cuts its steps badly runs into the electrode (the twin at rtol 1e-6
    did, of one in sixty)."""
    config, n = load_config("capacitive"), 40 if is_whole() else 10
    lot = draw(config, n, seed=5)
    drive = Waveform([Pulse(0.0, 4.0, 60.0, 39.0), Pulse(70.0, 8.0, math.inf, 45.0)])
    found = respond(config, lot, drive)
    assert (found.status == 0).all()
    twin = respond(config.revised(['compute.method="rk"', "compute.rtol=1e-9"]), lot, drive)
    known = twin.status == 0
    assert known.sum() >= n - 2
    np.testing.assert_allclose(found.max_contact_speed[known], twin.max_contact_speed[known], atol=1e-5)
    np.testing.assert_array_equal(found.closed[known], twin.closed[known])


def test_neighbours_and_outputs_change_no_bit() -> None:
    switches = load_population("current").sample(12, seed=2)
    losses = Losses(film_viscosity_uPa_s=1.0, film_mean_free_path_um=0.1)
    plain = simulate(switches, HARD, modes=beam(0.1, 0.2), losses=losses)
    order = np.random.default_rng(1).permutation(12)
    other = simulate(
        switches[order], HARD, modes=beam(0.1, 0.2), losses=losses, times_us=[30.0, 90.0], max_impacts=20, threads=3
    )
    for name in ("max_contact_speed", "first_contact_us", "settling_us", "final_x", "final_v"):
        np.testing.assert_array_equal(getattr(other, name), getattr(plain, name)[order])
