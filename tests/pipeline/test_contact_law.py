"""Claims about what happens at and behind a contact: impacts, holding, letting go, and the electrode's collapse."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from examples import examples, is_whole
from modal_reference import ModalSwitch, oracle
from softclose import Losses, Pulse, ReducedOrder, Waveform, load_population, simulate
from softclose.device.simulate import Responses, Status
from softclose.switch.collapse import collapse_voltage
from softclose.switch.plate import pull_in_voltage
from softclose.switch.reduced_order import Capacitance, CompliantContact, Mode, ReducedOrderError
from softclose.waveform import Trace

AREA = 16700.0
MEAN = np.array([2.43, 3.68, 65.3, 3.41])
HARD = Waveform([Pulse(0, 4, 11.5, 120), Pulse(24, 12, math.inf, 75)])
BRIDGE = ReducedOrder(
    mode=(
        Mode(frequency_kHz=61.0, mass_ug=0.064, electrode=0.8),
        Mode(frequency_kHz=240.0, mass_ug=0.07, contact=-0.5, electrode=0.3),
    )
)
"""A further mode that moves the contact the other way."""
BEAM = ReducedOrder(
    mode=(
        Mode(frequency_kHz=18.0, mass_ug=2.1, quality_factor=12.0, electrode=0.8),
        Mode(frequency_kHz=96.0, mass_ug=2.4, quality_factor=30.0, contact=-0.6, electrode=0.25),
    )
)


def ramp(volts: float, until_us: float = 250.0) -> Trace:
    return Trace([0.0, 4.0, until_us], [0.0, volts, volts])


def further(draw: st.DrawFn) -> ReducedOrder:
    """Two or three modes, those above the first with any sign."""
    q = st.sampled_from([0.0, 5.0, 30.0])
    above = [
        Mode(
            frequency_kHz=draw(st.floats(50.0, 250.0)),
            mass_ug=draw(st.floats(0.5, 8.0)),
            quality_factor=draw(q),
            contact=draw(st.floats(-1.0, 1.0)),
            electrode=draw(st.floats(-0.6, 1.0)),
        )
        for _ in range(draw(st.integers(1, 2 if is_whole() else 1)))
    ]
    first = Mode(frequency_kHz=20.0, mass_ug=3.4, quality_factor=draw(q), electrode=draw(st.floats(0.7, 1.1)))
    return ReducedOrder(mode=(first, *above))


# What is drawn depends on the constants of all modules that are loaded; a lively example takes the slow oracle minutes.
@pytest.mark.timeout(900)
@settings(max_examples=examples(12), deadline=None, derandomize=True)
@given(modes=st.composite(further)(), volts=st.floats(60.0, 150.0), fall=st.floats(40.0, 90.0))
def test_every_impact_and_every_ending_is_that_of_the_constraint(
    modes: ReducedOrder, volts: float, fall: float
) -> None:
    """Chatter, holding, letting go and collapse, all by an integrator and events of another make."""
    waveform = Waveform([Pulse(0.0, 4.0, fall, volts), Pulse(fall + 6.0, 5.0, math.inf, 0.7 * volts)])
    expected: ModalSwitch = oracle(modes, MEAN).follow(waveform, 120.0)
    found = simulate([MEAN], waveform, modes=modes, horizon_us=120.0, max_impacts=400, rtol=1e-11, max_volts=math.inf)
    assert found.impact_speed is not None
    assert found.impact_time_us is not None
    if expected.ending == "collapsed":
        assert found.status[0] == Status.COLLAPSED
        return
    assert found.status[0] == Status.OK
    assert bool(found.closed[0]) == (expected.ending == "held")
    assert found.final_x[0] == pytest.approx(expected.final, abs=2e-6)
    # Chatter multiplies errors, and what is slower than 1e-3 µm/µs is its last moments.
    hard = np.array([impact for impact in expected.impacts if impact[1] > 1e-3]).reshape(-1, 2)
    same = found.impact_speed[0] > 1e-3
    assert abs(int(same.sum()) - len(hard)) <= 1
    first = min(len(hard), int(same.sum()), 6)
    np.testing.assert_allclose(found.impact_time_us[0][same][:first], hard[:first, 0], atol=2e-5)
    np.testing.assert_allclose(found.impact_speed[0][same][:first], hard[:first, 1], atol=5e-6)


@pytest.mark.parametrize("modes", [BRIDGE, BEAM])
@pytest.mark.parametrize("lot", ["current", "modified"])
def test_no_switch_stalls(modes: ReducedOrder, lot: str) -> None:
    """20,000 steps are a hundred times what the hardest of these takes; a switch that ends early has a reason."""
    population = load_population(lot)
    switches = population.sample(40, seed=1)
    for volts in (90.0, 110.0, 130.0, 150.0):
        found = simulate(
            switches, ramp(volts), modes=modes, plate_area_um2=population.plate_area(None), max_steps=20_000
        )
        assert not (found.status == Status.WORK_LIMIT).any()
        limits = collapse_voltage(switches, modes, population.plate_area(None))
        assert (limits[found.status == Status.COLLAPSED] < 1.35 * volts).all(), "a swing collapses it at a little less"
        assert (limits[found.closed] > volts).all()
        assert found.closed.any() or volts < 100.0 or lot == "modified"


def test_statics_say_at_which_voltage_a_held_electrode_collapses() -> None:
    """A ramp so slow that nothing swings holds below that voltage and collapses above it."""
    damped = ReducedOrder(
        mode=tuple(
            Mode(
                frequency_kHz=m.frequency_kHz,
                mass_ug=m.mass_ug,
                quality_factor=1.0,
                contact=m.contact,
                electrode=m.electrode,
            )
            for m in BRIDGE.mode
        )
    )
    (limit,) = collapse_voltage(MEAN[None], damped, AREA)
    assert 80.0 < limit < 1000.0
    for share, status in ((0.995, Status.OK), (1.005, Status.COLLAPSED)):
        slow = Trace([0.0, 4.0, 60.0, 4000.0], [0.0, 90.0, 90.0, share * limit])
        found = simulate([MEAN], slow, modes=damped, horizon_us=4200.0, max_volts=math.inf)
        assert found.status[0] == status


def test_a_soft_contact_lets_the_plate_through_where_statics_say_so() -> None:
    soft = ReducedOrder(
        mode=(Mode(frequency_kHz=20.0, quality_factor=1.0),),
        contact=CompliantContact(force_at_1_um_uN=4000.0, exponent=1.0, loss_us_per_um=2.0),
    )
    (limit,) = collapse_voltage(MEAN[None], soft, AREA)
    pull_in = float(pull_in_voltage(MEAN, AREA))
    assert limit > 1.2 * pull_in
    for share, status in ((0.99, Status.OK), (1.01, Status.COLLAPSED)):
        slow = Trace([0.0, 200.0, 3000.0], [0.0, 1.1 * pull_in, share * limit])
        found = simulate([MEAN], slow, modes=soft, horizon_us=3200.0, max_volts=math.inf)
        assert found.status[0] == status
        assert bool(found.closed[0]) == (status == Status.OK)


def test_an_electrode_that_moves_with_the_contact_never_collapses() -> None:
    alike = ReducedOrder(mode=(Mode(frequency_kHz=20.0), Mode(frequency_kHz=70.0, contact=0.3, electrode=0.3)))
    assert np.isinf(collapse_voltage(MEAN[None], alike, AREA)).all()


def test_a_collapse_ends_early_and_tells_no_number() -> None:
    times = np.linspace(0.0, 250.0, 251)
    switches = load_population("current").sample(20, seed=1)
    found = simulate(switches, ramp(150.0), modes=BRIDGE, times_us=times, max_impacts=8, max_steps=2000)
    gone = found.status == Status.COLLAPSED
    assert 5 < gone.sum() < 20
    assert_untold(found, gone)
    assert found.x is not None
    assert np.isnan(found.x[gone, -1]).all()
    assert np.isfinite(found.x[gone, :10]).all(), "x stands as far as it was integrated"


def test_a_failed_switch_tells_no_number_whichever_model_had_it() -> None:
    """Every kernel, and every model of one's own: the mask is the type's."""
    switches = load_population("current").sample(6, seed=1)
    for method in ("taylor", "rk"):
        short = simulate(switches, HARD, method=method, max_steps=12, max_impacts=4)  # type: ignore[arg-type]
        assert_untold(short, short.status != Status.OK)
        assert (short.status == Status.WORK_LIMIT).any()
    damped = simulate(switches, HARD, losses=Losses(quality_factor=9.0), max_steps=12, max_impacts=4)
    assert_untold(damped, damped.status == Status.WORK_LIMIT)
    mine = Responses(
        max_contact_speed=np.array([0.1, 2.8e7]),
        first_contact_us=np.array([9.0, 1.0]),
        closed=np.array([True, True]),
        settling_us=np.array([20.0, 1.0]),
        n_impacts=np.array([2, 5], dtype=np.int32),
        final_x=np.array([2.0, 3e9]),
        final_v=np.array([0.0, 1e9]),
        status=np.array([0, 1], dtype=np.int8),
    )
    assert_untold(mine, np.array([False, True]))


def assert_untold(found: Responses, failed: np.ndarray) -> None:
    """Nothing of the failed ones, everything of the others."""
    assert failed.any()
    for name in ("max_contact_speed", "first_contact_us", "settling_us", "final_x", "final_v"):
        values = getattr(found, name)
        assert np.isnan(values[failed]).all(), name
        assert name == "max_contact_speed" or not np.isnan(values[~failed]).any(), name
    assert not found.closed[failed].any()
    assert (found.n_impacts[failed] == 0).all()
    for name in ("impact_time_us", "impact_speed", "mode_peak_um"):
        values = getattr(found, name)
        assert values is None or np.isnan(values[failed]).all(), name


@pytest.mark.parametrize(
    ("modes", "losses"),
    [
        (None, Losses(quality_factor=20.0)),
        (None, Losses(quality_factor=3.0, film_viscosity_uPa_s=2.0)),
        (BEAM, Losses()),
        pytest.param(BEAM, Losses(film_viscosity_uPa_s=2.0), marks=pytest.mark.long),
    ],
)
def test_letting_go_is_no_impact(modes: ReducedOrder | None, losses: Losses) -> None:
    """A slow fall of the voltage lets each switch go at rest; what it did until then are its impacts."""
    switches = load_population("current").sample(200, seed=2)
    held = Trace([0.0, 4.0, 300.0], [0.0, 110.0, 110.0])
    released = Trace([0.0, 4.0, 200.0, 300.0], [0.0, 110.0, 110.0, 0.0])
    kwargs = {"losses": losses, "modes": modes, "horizon_us": 300.0, "max_impacts": 64}
    a, b = simulate(switches, held, **kwargs), simulate(switches, released, **kwargs)  # type: ignore[arg-type]
    assert a.closed.mean() > 0.9
    assert b.impact_speed is not None
    assert not (b.impact_speed < 1e-9).any(), "an impact at the speed of rounding"
    if modes is not None:
        return  # further modes ring on: near its release such a switch touches again and again
    settled = a.closed & (a.settling_us < 190.0)
    assert settled.sum() > 100
    np.testing.assert_array_equal(a.n_impacts[settled], b.n_impacts[settled])


@pytest.mark.parametrize("polynomial", [False, True])
def test_a_switch_that_leaves_its_capacitance_says_so(polynomial: bool) -> None:
    """Let go, a switch swings below rest; a table that begins at rest is asked no further, one that reaches down is."""
    gap, deep = 3.7, 3.0

    def capacitance(begin: float) -> Capacitance:
        x = np.linspace(begin, 3.0, 120)
        if polynomial:
            near = tuple(1e9 * AREA * 8.8541878128e-12 / gap ** (j + 1) for j in range(60))
            return Capacitance(gap_um=gap, polynomial_fF=near, valid_um=(begin, 3.0))
        c = 1e9 * AREA * 8.8541878128e-12 / (gap - x)
        return Capacitance(gap_um=gap, travel_um=tuple(x.tolist()), capacitance_fF=tuple(c.tolist()))

    switches = load_population("current").sample(60, seed=2)
    drive = Waveform([Pulse(0.0, 4.0, 40.0, 110.0), Pulse(80.0, 4.0, math.inf, 90.0)])
    times = np.linspace(0.0, 250.0, 501)
    plates = simulate(switches, drive, modes=ReducedOrder(mode=(Mode(frequency_kHz=20.0),)), times_us=times)
    for begin in (0.0, -1.0, -deep):
        one = ReducedOrder(mode=(Mode(frequency_kHz=20.0),), capacitance=capacitance(begin))
        found = simulate(switches, drive, modes=one, times_us=times)
        assert plates.x is not None
        lowest = np.asarray(plates.x).min(axis=1) * gap / switches[:, 1]
        clear = np.abs(lowest - begin) > 0.05
        np.testing.assert_array_equal((found.status == Status.LEFT_TABLE)[clear], (lowest < begin)[clear])
        inside = found.status == Status.OK
        np.testing.assert_array_equal(found.closed[inside], plates.closed[inside])
    unsaid = Capacitance(gap_um=gap, polynomial_fF=(40.0, 11.0, 3.0))
    assert unsaid.slope()[0][0] == 0.0, "a polynomial that does not say its range begins at rest"
    with pytest.raises(ReducedOrderError, match="belongs to polynomial_fF"):
        ReducedOrder(
            mode=(Mode(frequency_kHz=20.0),),
            capacitance=Capacitance(
                gap_um=gap, travel_um=(0.0, 1.0, 2.0, 3.0), capacitance_fF=(40.0, 50.0, 70.0, 99.0), valid_um=(0.0, 3.0)
            ),
        )


def test_a_table_ends_where_it_says_above_as_well() -> None:
    """The electrode behind the contact goes on into the end of the table, not into an extrapolation."""
    gap = 3.7
    x = np.linspace(-3.0, 3.0, 121)
    c = Capacitance(
        gap_um=gap,
        travel_um=tuple(x.tolist()),
        capacitance_fF=tuple((1e9 * AREA * 8.8541878128e-12 / (gap - x)).tolist()),
    )
    assert math.isnan(float(c.slope_at(np.array([3.01]))[0]))
    modes = ReducedOrder(mode=BRIDGE.mode, capacitance=c)
    found = simulate(load_population("current").sample(20, seed=1), ramp(150.0), modes=modes, max_steps=5000)
    assert (found.status == Status.LEFT_TABLE).sum() > 5
    assert not (found.status == Status.WORK_LIMIT).any()


def test_an_ideal_step_in_mid_drive_is_seen_at_its_instant() -> None:
    """Two pieces of a drive that do not join: the first slope behind the step is the new one's."""
    late = Waveform([Pulse(0.0, 4.0, 20.0, 40.0), Pulse(60.0, 0.0, math.inf, 110.0)])
    switches = load_population("current").sample(20, seed=1)
    plain = simulate(switches, late, rtol=1e-11)
    modal = simulate(switches, late, rtol=1e-11, modes=ReducedOrder(mode=(Mode(frequency_kHz=20.0),)))
    np.testing.assert_allclose(modal.max_contact_speed, plain.max_contact_speed, atol=1e-8)


def test_a_compliant_contact_presses_and_never_pulls() -> None:
    """A dashpot that would creep for 15 µs lets go in a fraction of one: what flies off then is the spring alone."""
    soft = CompliantContact(force_at_1_um_uN=1e4, exponent=1.0, dashpot_uN_s_per_m=6e4)
    modes = ReducedOrder(mode=(Mode(frequency_kHz=20.0),), contact=soft)
    drop = Waveform([Pulse(0.0, 0.0, 200.0, 110.0)])
    times = np.linspace(200.0, 206.0, 6001)
    found = simulate([MEAN], drop, modes=modes, times_us=times, rtol=1e-10)
    assert found.x is not None
    assert found.v is not None
    travel, _gap, k, m = MEAN
    omega2 = 1e-3 * k / m
    x, v = np.asarray(found.x)[0], np.asarray(found.v)[0]
    assert x[0] > travel, "held, with the contact pressed in"
    inwards = np.gradient(v, times) + omega2 * x
    assert inwards.max() < 0.02 * omega2 * travel, "nothing but the spring pulls, and the contact only pushes away"
    assert x[-1] < 0.9 * travel


@pytest.mark.parametrize("modes", [None, ReducedOrder(mode=(Mode(frequency_kHz=20.0),))], ids=["one mode", "modes"])
def test_a_switch_that_arrives_without_voltage_stays_where_it_sticks_harder_than_its_spring_pulls(
    modes: ReducedOrder | None,
) -> None:
    """It does not rebound: whether it stays is a matter of forces alone."""
    travel, _gap, k, _m = MEAN
    flung = Waveform([Pulse(0.0, 4.0, 8.0, 125.0)])
    ends = []
    for part in (0.0, 0.98, 1.02):
        losses = Losses(adhesion_uN=part * k * travel)
        found = simulate([MEAN], flung, modes=modes, losses=losses, restitution=1e-6, horizon_us=60.0)
        assert found.first_contact_us[0] > 16.0, "the pulse is over"
        ends.append(bool(found.closed[0]))
    assert ends == [False, False, True]
