"""Claims about tables of capacitance in the fast kernel: its twin, an oracle, scaled drives, where a table ends."""

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
from softclose import Losses, Pulse, ReducedOrder, Status, Waveform, load_population, simulate
from softclose.kernel import dispatch, generate_series
from softclose.switch.losses import SLIP, SLIP_EXPONENT
from softclose.switch.reduced_order import Capacitance, Mode
from softclose.waveform import Delivered

AREA, GAP = 16700.0, 3.7
HARD = Waveform([Pulse(0, 4, 11.5, 120), Pulse(24, 12, math.inf, 75)])
EPS0 = 8.8541878128e-12


def fingers(n: int = 33, first: float = -3.6, last: float = 2.9, floor: float = 0.3) -> Capacitance:
    """Plates that meet other fields as they close: not those of the formula."""
    x = np.linspace(first, last, n)
    plates = 1e9 * EPS0 * AREA / (GAP - x)
    return Capacitance(
        gap_um=GAP,
        travel_um=tuple(x.tolist()),
        capacitance_fF=tuple((plates * (1.0 - floor * x / GAP) + 20.0 * x).tolist()),
    )


def switch(capacitance: Capacitance, cubic: float = 0.0, quality: float = 0.0) -> ReducedOrder:
    mode = Mode(frequency_kHz=20.0, cubic_per_um2=cubic, quality_factor=quality)
    return ReducedOrder(mode=(mode,), capacitance=capacitance)


@st.composite
def cases(draw: st.DrawFn) -> tuple[ReducedOrder, Losses]:
    """Coarse and fine tables, a cubic, with any of the terms."""
    if draw(st.booleans()):
        c = fingers(draw(st.integers(5, 40)), floor=draw(st.floats(0.0, 0.5)))
    else:
        c = Capacitance(gap_um=GAP, polynomial_fF=(40.0, 11.0, 2.0, draw(st.floats(0.5, 3.0))), valid_um=(-3.0, 3.6))
    losses = Losses(
        film_viscosity_uPa_s=draw(st.one_of(st.just(0.0), st.floats(0.05, 10.0))),
        film_mean_free_path_um=draw(st.one_of(st.just(0.0), st.floats(0.01, 0.5))),
        adhesion_uN=draw(st.one_of(st.just(0.0), st.floats(1.0, 60.0))),
    )
    cubic, quality = draw(st.sampled_from([0.0, 0.05])), draw(st.one_of(st.just(0.0), st.floats(0.5, 100.0)))
    return switch(c, cubic, quality), losses


@st.composite
def drives(draw: st.DrawFn) -> Waveform | Delivered:
    rise = draw(st.one_of(st.just(0.0), st.floats(4.0, 20.0)))
    first = Pulse(0.0, rise, draw(st.floats(2.0, 30.0)), draw(st.floats(60.0, 150.0)))
    command = Waveform([first, Pulse(draw(st.floats(10.0, 50.0)), 8.0, math.inf, draw(st.floats(60.0, 150.0)))])
    delivered = is_whole() and draw(st.booleans())  # further kernels to compile
    return Delivered(command=command, bandwidth_kHz=60.0) if delivered else command


@settings(max_examples=examples(15), deadline=None, derandomize=True)
@given(case=cases(), drive=drives(), seed=st.integers(0, 2**32 - 1), restitution=st.floats(0.05, 0.9))
def test_the_kernel_agrees_with_its_twin(
    case: tuple[ReducedOrder, Losses], drive: Waveform | Delivered, seed: int, restitution: float
) -> None:
    modes, losses = case
    table = np.random.default_rng(seed).uniform((1.8, 3.6, 45.0, 2.8), (2.6, 3.9, 90.0, 4.2), size=(6, 4))
    nudged = np.concatenate([table + shift * np.array([1e-6, 0.0, 0.0, 0.0]) for shift in (0, 1, -1)])
    common: dict[str, Any] = {
        "modes": modes, "losses": losses, "restitution": restitution, "max_volts": 1e3, "max_impacts": 256,
        "times_us": [20.0, 60.0, 200.0],
    }  # fmt: skip
    assert dispatch.in_series(modes, losses)
    tight = simulate(nudged, drive, method="rk", rtol=1e-12, **common)
    fast = simulate(table, drive, **common)
    np.testing.assert_array_equal(fast.status, tight.status[:6])
    agree(fast, tight, fast.status == Status.OK)  # what left its table stands as far as each method got


@pytest.mark.sampled
def test_the_kernel_agrees_with_the_oracle() -> None:
    """DOP853 of scipy, with events of its own, on the table's spline as scipy evaluates it."""
    rng, compared = np.random.default_rng(12), 0
    n = 4 if is_whole() else 1
    for i, (d, g, k, m) in enumerate(load_population("current").sample(4, seed=29)[:n]):
        c = fingers(9 + 6 * i)
        cubic, path = rng.uniform(0.0, 0.1), rng.uniform(0.02, 0.5)
        losses = Losses(film_viscosity_uPa_s=rng.uniform(0.1, 3.0), film_mean_free_path_um=path)
        found = simulate([[d, g, k, m]], HARD, modes=switch(c, cubic, 25.0), losses=losses, max_impacts=6)
        shrink, one = GAP / g, np.ones(1)
        oracle = ModalSwitch(
            d, g, np.array([m]), np.array([1e-3 * k]), np.array([math.sqrt(1e-3 * k / m) / 25.0]), one, one,
            film=float(losses.film(AREA)), cubic=cubic, free_path=path,
            slope=lambda x, c=c, shrink=shrink: float(c.slope_at(np.array(x * shrink))) * shrink**2,
        ).run(HARD, 120.0)  # fmt: skip
        compared += impacts_agree(found, oracle)
    assert compared >= 2 * n


@pytest.mark.parametrize("order", [9, 16])
@pytest.mark.parametrize("film", [False, True])
@pytest.mark.parametrize("driven", [False, True])
def test_the_series_solve_their_equation(driven: bool, film: bool, order: int) -> None:
    made = functions_of(generate_series.render(order), generate_series.render_table(order))
    x0, v0, gap, k, d, f, omega = 0.7, 0.1, 3.7, 0.019, 0.2, 3.0, 0.5
    cubic, path, origin, parabola = 0.003, 0.4, 0.55, (1.6e-6, 0.7e-6, 0.3e-6)
    u = made["drive"](made["constant"](50.0), 40.0 * np.cos(0.3), 40.0 * np.sin(0.3), omega) if driven else 50.0
    name = ("table_film" if film else "table") + ("_driven" if driven else "_constant")
    more = (f, SLIP * path**SLIP_EXPONENT) if film else ()
    x = np.polynomial.Polynomial(made[name](x0, v0, u, gap, k, d, cubic, origin, *parabola, *more))
    for h in (0.05, 0.1):
        volts = 50.0 + (40.0 * math.cos(omega * h + 0.3) if driven else 0.0)
        left, v, z = gap - x(h), x.deriv()(h), x(h) - origin
        pull = (parabola[0] + parabola[1] * z + parabola[2] * z * z) * volts**2
        right = pull - k * x(h) - cubic * x(h) ** 3 - d * v
        right -= f * v / left**3 / (1.0 + SLIP * (path / left) ** SLIP_EXPONENT) if film else 0.0
        assert x.deriv(2)(h) == pytest.approx(right, abs=1e-6 if order == 9 else 1e-13)


def test_scaled_commands_and_columns_are_those_of_each_switch() -> None:
    switches, rng = load_population("current").sample(5, seed=8), np.random.default_rng(3)
    a, b, eta, film = (rng.uniform(*ends, 5) for ends in ((0.95, 1.05), (0.95, 1.05), (0.3, 0.7), (0.1, 2.0)))
    modes, lot = switch(fingers(), 0.01, 30.0), Losses(film_viscosity_uPa_s=film)
    whole = simulate(switches, HARD, modes=modes, drive_volts=a, drive_times=b, restitution=eta, losses=lot)
    for i in range(5):
        own = Waveform(
            [Pulse(p.start_us * b[i], p.rise_us * b[i], p.peak_us * b[i], p.volts * a[i]) for p in HARD.pulses]
        )
        losses = Losses(film_viscosity_uPa_s=float(film[i]))
        alone = simulate(
            switches[i : i + 1], own, modes=modes, restitution=float(eta[i]), losses=losses, horizon_us=250.0 * b[i]
        )
        np.testing.assert_allclose(whole.max_contact_speed[i], alone.max_contact_speed[0], rtol=1e-6)
        assert whole.n_impacts[i] == alone.n_impacts[0]


def test_a_motion_that_leaves_its_table_says_so() -> None:
    """A switch that is let go swings back by more than this table has; one with a longer table does not."""
    let_go = Waveform([Pulse(0.0, 4.0, 60.0, 110.0)])
    switches = load_population("current").sample(20, seed=5)
    for first, ends in ((-0.5, Status.LEFT_TABLE), (-3.6, Status.OK)):
        found = simulate(switches, let_go, modes=switch(fingers(first=first)))
        twin = simulate(switches, let_go, modes=switch(fingers(first=first)), method="rk", rtol=1e-10)
        assert (found.status == ends).all()
        np.testing.assert_array_equal(found.status, twin.status)


def test_what_has_no_parabolas_has_no_series() -> None:
    quartic = Capacitance(gap_um=GAP, polynomial_fF=(40.0, 11.0, 2.0, 1.0, 0.5), valid_um=(-1.0, 3.5))
    assert not dispatch.in_series(switch(quartic), Losses())
    assert dispatch.in_series(switch(fingers()), Losses())
    two = ReducedOrder(mode=(Mode(frequency_kHz=20.0), Mode(frequency_kHz=70.0, electrode=0.3)), capacitance=fingers())
    assert not dispatch.in_series(two, Losses())
