"""Claims about the fast kernel with losses: its twin, an oracle of its own, the limit of none, columns of a lot."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from examples import examples
from modal_reference import ModalSwitch
from rendered import functions_of
from softclose import Losses, Pulse, Waveform, load_population, simulate
from softclose.device.simulate import SimulationError
from softclose.kernel import bounces, generate_series
from softclose.switch.losses import LossesError

AREA = 16700.0
HARD = Waveform([Pulse(0, 4, 11.5, 120), Pulse(24, 12, math.inf, 75)])


@st.composite
def lossy(draw: st.DrawFn) -> Losses:
    """Any of the three, from hardly any to overdamped."""
    q = draw(st.one_of(st.just(0.0), st.floats(0.3, 100.0)))
    film = draw(st.one_of(st.just(0.0), st.floats(0.01, 30.0)))
    adhesion = draw(st.one_of(st.just(0.0), st.floats(1.0, 200.0)))
    return Losses(quality_factor=q, film_viscosity_uPa_s=film, adhesion_uN=adhesion)


@st.composite
def waveforms(draw: st.DrawFn) -> Waveform:
    start, pulses = 0.0, []
    for _ in range(draw(st.integers(1, 3))):
        rise = draw(st.one_of(st.just(0.0), st.floats(4.0, 20.0)))
        peak = draw(st.one_of(st.just(math.inf), st.floats(0.0, 40.0)))
        pulses.append(Pulse(start, rise, peak, draw(st.floats(40.0, 150.0))))
        if math.isinf(peak):
            break
        start += draw(st.floats(5.0, 60.0))
    return Waveform(pulses)


@settings(max_examples=examples(40), deadline=None, derandomize=True)
@given(losses=lossy(), waveform=waveforms(), seed=st.integers(0, 2**32 - 1), restitution=st.floats(0.05, 0.95))
def test_the_kernel_agrees_with_its_twin(losses: Losses, waveform: Waveform, seed: int, restitution: float) -> None:
    table = np.random.default_rng(seed).uniform((1.8, 3.6, 45.0, 2.8), (2.8, 4.4, 90.0, 4.2), size=(8, 4))
    nudged = np.concatenate([table + shift * np.array([1e-6, 0.0, 0.0, 0.0]) for shift in (0, 1, -1)])
    common: dict[str, Any] = {"losses": losses, "restitution": restitution, "max_volts": 1e3, "max_impacts": 256}
    tight = simulate(nudged, waveform, method="rk", rtol=1e-12, **common)
    fast = simulate(table, waveform, **common)
    assert (fast.status == 0).all()
    assert tight.impact_speed is not None
    assert tight.impact_time_us is not None
    assert fast.impact_speed is not None
    assert fast.impact_time_us is not None
    count = (tight.impact_speed > 1e-9).sum(axis=1).reshape(3, -1)
    closed = tight.closed.reshape(3, -1)
    regular = (count == count[0]).all(axis=0) & (closed == closed[0]).all(axis=0)  # the others graze: SPEC §8
    assert regular.mean() >= 0.5
    np.testing.assert_array_equal(fast.n_impacts[regular], count[0, regular])
    np.testing.assert_array_equal(fast.closed[regular], closed[0, regular])
    np.testing.assert_allclose(fast.max_contact_speed[regular], tight.max_contact_speed[:8][regular], atol=1e-5)
    np.testing.assert_allclose(fast.final_x[regular], tight.final_x[:8][regular], atol=1e-5)
    for i in np.flatnonzero(regular):
        real = tight.impact_speed[i] > 1e-9
        n = int(real.sum())
        np.testing.assert_allclose(fast.impact_speed[i, :n], tight.impact_speed[i, real], atol=1e-6)
        np.testing.assert_allclose(fast.impact_time_us[i, :n], tight.impact_time_us[i, real], atol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize(
    "losses",
    [
        pytest.param(Losses(quality_factor=8.0), marks=pytest.mark.long),
        Losses(quality_factor=60.0, film_viscosity_uPa_s=1.0),
    ],
)
def test_the_kernel_agrees_with_the_oracle(losses: Losses) -> None:
    switches = load_population("current").sample(6, seed=29)
    found = simulate(switches, HARD, losses=losses, max_impacts=6, horizon_us=120.0)
    assert found.impact_time_us is not None
    assert found.impact_speed is not None
    compared = 0
    for i, (d, g, k, m) in enumerate(switches):
        omega = math.sqrt(1e-3 * k / m)
        one, rate = np.ones(1), np.array([omega / float(losses.quality_factor)])
        film = float(losses.film(AREA))
        switch = ModalSwitch(d, g, np.array([m]), np.array([1e-3 * k]), rate, one, one, film=film)
        for j, (t, speed) in enumerate(switch.run(HARD, 120.0).impacts[:6]):
            assert found.impact_time_us[i, j] == pytest.approx(t, abs=1e-5)
            assert found.impact_speed[i, j] == pytest.approx(speed, abs=1e-6)
            compared += 1
    assert compared >= 12


@pytest.mark.parametrize("losses", [Losses(quality_factor=1e12), Losses(film_viscosity_uPa_s=1e-11)])
def test_hardly_any_losses_are_hardly_none(losses: Losses) -> None:
    # Bounces told from those before, and bounces in closed form, are one.
    switches = load_population("current").sample(40, seed=3)
    none, hardly = (simulate(switches, HARD, losses=given, max_impacts=40) for given in (None, losses))
    np.testing.assert_array_equal(hardly.n_impacts, none.n_impacts)
    np.testing.assert_allclose(hardly.impact_time_us, none.impact_time_us, atol=1e-4)
    np.testing.assert_allclose(hardly.impact_speed, none.impact_speed, rtol=1e-6, atol=1e-9)


def test_outputs_and_neighbours_change_no_bit() -> None:
    switches = load_population("current").sample(30, seed=4)
    losses = Losses(quality_factor=12.0, film_viscosity_uPa_s=0.5, adhesion_uN=30.0)
    plain = simulate(switches, HARD, losses=losses)
    order = np.random.default_rng(1).permutation(30)
    times = np.linspace(0, 250, 301)
    other = simulate(switches[order], HARD, losses=losses, threads=2, times_us=times, max_impacts=4, dtype=np.float32)
    for name in ("max_contact_speed", "settling_us", "final_x", "final_v"):
        np.testing.assert_array_equal(getattr(other, name), getattr(plain, name)[order])


def test_samples_are_those_of_the_twin() -> None:
    switches = load_population("current").sample(10, seed=4)
    losses, times = Losses(quality_factor=12.0, film_viscosity_uPa_s=0.5), np.linspace(0, 250, 301)
    ours = simulate(switches, HARD, losses=losses, times_us=times)
    twin = simulate(switches, HARD, losses=losses, times_us=times, method="rk", rtol=1e-12)
    np.testing.assert_allclose(ours.x, twin.x, atol=1e-6)


@pytest.mark.parametrize("method", ["taylor", "rk"])
def test_losses_and_restitution_are_columns_of_a_lot(method: Any) -> None:
    switches = load_population("current").sample(12, seed=6)
    rng = np.random.default_rng(2)
    q, film, adhesion = rng.uniform(2, 50, 12), rng.uniform(0, 2, 12), rng.uniform(0, 90, 12)
    q[:3], film[2:5], adhesion[4:6], eta = 0.0, 0.0, 0.0, rng.uniform(0.1, 0.9, 12)
    lot = Losses(quality_factor=q, film_viscosity_uPa_s=film, adhesion_uN=adhesion)
    whole = simulate(switches, HARD, losses=lot, restitution=eta, method=method)
    for i in range(12):
        own = Losses(quality_factor=float(q[i]), film_viscosity_uPa_s=float(film[i]), adhesion_uN=float(adhesion[i]))
        alone = simulate(switches[i : i + 1], HARD, losses=own, restitution=float(eta[i]), method=method)
        np.testing.assert_allclose(alone.max_contact_speed[0], whole.max_contact_speed[i], rtol=1e-8)
        assert alone.n_impacts[0] == whole.n_impacts[i]
        assert alone.closed[0] == whole.closed[i]


def test_columns_that_are_none_are_refused() -> None:
    switches = load_population("current").sample(3, seed=6)
    with pytest.raises(LossesError, match=r"quality_factor has shape \(2,\); it must be a number or \(3,\)"):
        simulate(switches, HARD, losses=Losses(quality_factor=np.array([3.0, 4.0])))
    with pytest.raises(LossesError, match=r"adhesion_uN of switch 2 is .*-1"):
        Losses(adhesion_uN=np.array([0.0, -1.0]))
    with pytest.raises(LossesError, match=r"quality_factor is 0\.0005"):
        Losses(quality_factor=np.array([0.0, 0.0005]))
    with pytest.raises(SimulationError, match=r"restitution of switch 1 is 1\.5"):
        simulate(switches, HARD, restitution=np.array([0.5, 1.5, 0.5]))
    with pytest.raises(SimulationError, match="restitution has shape"):
        simulate(switches, HARD, restitution=np.array([0.5, 0.5]))


@pytest.mark.parametrize("order", [9, 16])
@pytest.mark.parametrize("film", [False, True])
@pytest.mark.parametrize("driven", [False, True])
def test_the_series_solve_their_equation(driven: bool, film: bool, order: int) -> None:
    made = functions_of(generate_series.render(order), generate_series.render_lossy(order))
    x0, v0, gap, c, k, d, f, omega = 0.7, 0.1, 3.7, 2.2e-5, 0.019, 0.2, 3.0, 0.5
    u = made["drive"](made["constant"](50.0), 40.0 * np.cos(0.3), 40.0 * np.sin(0.3), omega) if driven else 50.0
    name = ("film" if film else "damped") + ("_driven" if driven else "_constant")
    x = np.polynomial.Polynomial(made[name](x0, v0, u, gap, c, k, d, *((f,) if film else ())))
    for h in (0.05, 0.1):
        volts = 50.0 + (40.0 * math.cos(omega * h + 0.3) if driven else 0.0)
        left = gap - x(h)
        right = c * (volts / left) ** 2 - k * x(h) - d * x.deriv()(h) - (f * x.deriv()(h) / left**3 if film else 0.0)
        assert x.deriv(2)(h) == pytest.approx(right, abs=1e-6 if order == 9 else 1e-13)


@settings(max_examples=examples(60), deadline=None, derandomize=True)
@given(
    force=st.floats(0.01, 1.0), drag=st.floats(0.0, 2.0), first=st.floats(1e-3, 0.02), restitution=st.floats(0.1, 0.6)
)
def test_bounces_are_told_as_a_constant_force_with_drag_makes_them(
    force: float, drag: float, first: float, restitution: float
) -> None:
    # y'' = -F - d y' in closed form: y = (w + F/d)(1 - exp(-d t))/d - F t/d.
    from scipy.optimize import brentq

    def flight(w: float) -> tuple[float, float]:
        if drag < 1e-3:
            return 2.0 * w / force, w
        y = lambda t: -(w + force / drag) * math.expm1(-drag * t) / drag - force * t / drag  # noqa: E731
        t = brentq(y, 1.01 * w / force / (1.0 + drag * w / force), 2.0 * w / force, xtol=1e-18, rtol=1e-15)
        return t, -((w + force / drag) * math.exp(-drag * t) - force / drag)

    memo, n, w, sure = np.empty((3, bounces.MAX_RETURNS)), 0, first, False
    d = drag if drag >= 1e-3 else 0.0
    for _ in range(40):
        duration, back = flight(w)
        n, sure = bounces.learn(memo, n, w, duration, back, force, d, 1e-9)
        w = restitution * back
        if sure or w < 1e-5:
            break
    while w > 1e-5:
        duration, back = flight(w)
        assert bounces.predict(memo, n, w, force, d) == pytest.approx((duration, back), rel=1e-7)
        w = restitution * back
