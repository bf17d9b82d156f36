"""Claims about lots that are spread over a range of temperature."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import by_hand
from softclose import Pulse, Waveform
from softclose.conditions.temperature import Temperature, heated
from softclose.device.device import worst
from softclose.evaluate import draw, evaluate, respond
from softclose.settings import ConfigError, load_config

TABLES: dict[str, Any] = {
    "celsius": [-40, 20, 85],
    "stiffness": [1.06, 1.0, 0.93],
    "gap_um": [-0.02, 0.0, 0.03],
    "travel_um": [-0.02, 0.0, 0.03],
}
DRIVE = Waveform([Pulse(0, 4.4, 7.25, 111.6), Pulse(56.5, 19, math.inf, 75)])


def config(**settings: Any):  # type: ignore[no-untyped-def]
    return load_config({"temperature": TABLES | settings})


def test_each_switch_is_at_a_temperature_of_its_own() -> None:
    cold = load_config({})
    lot, plain = draw(config(low_C=-40, high_C=85), 5000, seed=2), draw(cold, 5000, seed=2)
    factor = lot["K"] / plain["K"]
    assert 0.93 <= factor.min() < 0.935
    assert 1.055 < factor.max() <= 1.06
    # A factor is a temperature; the shift of the gap is that of the same one, and the column says it.
    celsius = np.interp(-factor, [-1.06, -1.0, -0.93], [-40, 20, 85])
    np.testing.assert_allclose(lot["celsius"], celsius, atol=1e-9)
    for name in "GD":
        shift = np.interp(celsius, [-40, 20, 85], [-0.02, 0, 0.03])
        np.testing.assert_allclose(lot[name] - plain[name], shift, atol=1e-9)
    for name in "MET":
        np.testing.assert_array_equal(lot[name], plain[name])
    assert abs(np.corrcoef(celsius, plain["K"])[0, 1]) < 0.05
    assert np.histogram(celsius, 5, (-40, 85))[0] == pytest.approx(1000, rel=0.12), "uniform over the range"


def test_temperatures_are_keyed_by_the_switch_and_common_to_all_candidates() -> None:
    hot = config(low_C=-40, high_C=85)
    later, whole = draw(hot, 10, seed=2, start=30), draw(hot, 50, seed=2)
    for name in whole:
        np.testing.assert_array_equal(later[name], whole[name][30:40], name)


def test_at_the_population_s_own_temperature_nothing_changes() -> None:
    np.testing.assert_array_equal(draw(config(), 20, seed=1).switches, draw(load_config({}), 20, seed=1).switches)


def test_at_its_worst_each_switch_has_the_largest_speed_and_closes_only_if_it_always_does() -> None:
    """Against one simulation for each temperature, put together here."""
    worst = config(low_C=-40, high_C=85, worst_of=3)
    lot = draw(worst, 3000, seed=5)
    np.testing.assert_array_equal(lot.switches, draw(load_config({}), 3000, seed=5).switches)
    assert "celsius" not in lot, "the lot itself has no temperature"
    times = np.linspace(0.0, 250.0, 26)
    found = respond(worst, lot, DRIVE, times_us=times, max_impacts=8)
    tables = worst.temperature
    alone = [
        respond(load_config({}), heated(tables, lot, celsius), DRIVE, times_us=times, max_impacts=8)
        for celsius in (-40.0, 22.5, 85.0)
    ]
    speeds = np.array([r.max_contact_speed for r in alone])
    np.testing.assert_array_equal(found.max_contact_speed, np.fmax.reduce(speeds))
    np.testing.assert_array_equal(found.closed, np.all([r.closed for r in alone], axis=0))
    np.testing.assert_array_equal(found.settling_us, np.max([r.settling_us for r in alone], axis=0))
    which = np.argmax(np.nan_to_num(speeds, nan=-1.0), axis=0)
    assert {*which} == {0, 1, 2}, "each is the worst for some"
    for name in ("first_contact_us", "impact_speed", "x", "n_impacts"):
        np.testing.assert_array_equal(
            getattr(found, name), np.array([getattr(r, name) for r in alone])[which, np.arange(3000)], name
        )
    np.testing.assert_array_equal(found.times_us, times)
    own = config(low_C=-40, high_C=85)
    assert evaluate(worst, lot, DRIVE).g_cm_s > evaluate(own, draw(own, 3000, seed=5), DRIVE).g_cm_s + 1.0


def test_a_switch_that_could_not_be_integrated_at_one_temperature_is_none() -> None:
    """Nothing but its status is told of it, whichever of its temperatures it failed at, and whatever it did before."""
    whole = respond(load_config({}), draw(load_config({}), 5, seed=1), DRIVE, max_impacts=4)
    status = np.array([0, 1, 0, 0, 0], dtype=np.int8)
    failed = replace(whole, status=status)
    assert whole.closed[1]
    for each in ([failed, whole], [whole, failed], [whole, failed, whole]):
        found = worst(each)
        np.testing.assert_array_equal(found.status, status)
        assert math.isnan(found.max_contact_speed[1])
        assert np.isnan([found.first_contact_us[1], found.settling_us[1]]).all()
        assert not found.closed[1]
        assert found.n_impacts[1] == 0
        assert np.isnan([found.final_x[1], found.final_v[1]]).all()
        assert np.isnan(found.impact_speed[1]).all()
        rest = status == 0
        for name in ("max_contact_speed", "first_contact_us", "settling_us", "closed", "impact_speed"):
            np.testing.assert_array_equal(getattr(found, name)[rest], getattr(whole, name)[rest], name)


def test_at_its_worst_a_trimmed_switch_keeps_its_drive() -> None:
    """It was measured once, before it is cold or hot; its worst is of its own drive at each temperature."""
    settings = {"temperature": TABLES | {"low_C": -40, "high_C": 85, "worst_of": 2},
                "trim": {"measured": "pull-in and resonance"},
                "amplifier": {"gain_error": 0.01, "time_error": 0.01}}  # fmt: skip
    c = load_config(settings)
    found = respond(c, draw(c, 10, seed=5), DRIVE)
    alone = by_hand.respond(c, by_hand.rows(c, 10, seed=5), DRIVE)
    np.testing.assert_allclose(found.max_contact_speed, alone.max_contact_speed, rtol=1e-5)
    np.testing.assert_allclose(found.settling_us, alone.settling_us, rtol=1e-5)
    np.testing.assert_array_equal(found.closed, alone.closed)


@pytest.mark.parametrize(("low", "high", "worst_of"), [(-40, 85, 1), (20, 20, 3)])
def test_a_worst_that_is_none_is_refused(low: float, high: float, worst_of: int) -> None:
    with pytest.raises(ConfigError, match="worst_of"):
        config(low_C=low, high_C=high, worst_of=worst_of)


def test_a_worst_without_tables_is_refused() -> None:
    with pytest.raises(ConfigError, match="celsius is missing"):
        load_config({"temperature": {"worst_of": 3}})


def test_a_range_of_temperature_makes_a_lot_harder_to_close_softly() -> None:
    still, hot = load_config({}), config(low_C=-40, high_C=85)
    g = [evaluate(c, draw(c, 20_000, seed=3), DRIVE).g_cm_s for c in (still, hot)]
    assert g[1] > g[0] + 0.3
    lot = draw(still, 4, seed=3)
    assert heated(hot.temperature, lot, 85.0)["K"] == pytest.approx(0.93 * lot["K"])


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"low_C": 30, "high_C": 20}, "it must not be reversed"),
        ({"high_C": 120}, "leaves the tables, which end at -40 and 85"),
        ({"stiffness": [1.0]}, "stiffness has 1 entries, temperature.celsius 3"),
        ({"celsius": [20, -40, 85]}, "two or more temperatures, rising"),
        ({"celsius": []}, "celsius is missing"),
        ({"travel_um": [0, 0, 3]}, "every switch needs 0 < D < G"),
        ({"stiffness": [1, -1, 1]}, "temperature.stiffness.1 is -1"),
    ],
)
def test_what_is_no_table_is_said(settings: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        config(**settings)


@pytest.mark.parametrize("names", [["stiffness"], ["gap_um"], ["travel_um"], ["gap_um", "travel_um"], list(TABLES)[1:]])
def test_every_table_is_used_whichever_others_there_are(names: list[str]) -> None:
    tables = {"celsius": TABLES["celsius"]} | {name: TABLES[name] for name in names}
    settings = load_config({"temperature": tables | {"low_C": -40, "high_C": 85}}).temperature
    lot = draw(load_config({}), 6, seed=3)
    found = heated(settings, lot, 52.5)
    changes = {"K": lot["K"] * 0.965, "G": lot["G"] + 0.015, "D": lot["D"] + 0.015}
    column = {"stiffness": "K", "gap_um": "G", "travel_um": "D"}
    changed = {column[name] for name in names}
    for name, expected in changes.items():
        np.testing.assert_allclose(found[name], expected if name in changed else lot[name], rtol=1e-12, err_msg=name)


LOT = load_config({}).build_population()


@pytest.mark.parametrize(
    ("travel", "gap", "said"),
    [
        ([-0.02, 0.0, LOT.G.lower - LOT.D.upper + 0.01], None, "at 85 °C travels are"),
        ([-(LOT.D.lower + 0.001), 0.0, 0.03], None, "at -40 °C travels are"),
        ([-LOT.D.lower, 0.0, 0.03], None, "at -40 °C travels are"),
        (None, [LOT.D.upper - LOT.G.lower - 0.001, 0.0, 0.03], "at -40 °C travels are"),
        ([-(LOT.D.lower - 0.001), 0.0, LOT.G.lower - LOT.D.upper - 0.001], None, ""),
        (None, [LOT.D.upper - LOT.G.lower + 0.001, 0.0, 0.03], ""),
        ([0.0, 0.0, 0.2], [0.0, 0.0, 0.2], ""),
    ],
)
def test_tables_that_would_close_a_switch_by_themselves_are_refused(
    travel: list[float] | None, gap: list[float] | None, said: str
) -> None:
    settings = TABLES | {"travel_um": travel or [], "gap_um": gap or []}
    if said:
        with pytest.raises(ConfigError, match=said):
            load_config({"temperature": settings})
    else:
        load_config({"temperature": settings})


def test_one_temperature_is_no_table() -> None:
    with pytest.raises(ConfigError, match="two or more temperatures, rising"):
        load_config({"temperature": {"celsius": [20.0], "stiffness": [1.0], "low_C": 20.0, "high_C": 20.0}})


def test_what_it_rests_on_is_said() -> None:
    spread, worst_of_three = config(low_C=-40, high_C=85), config(low_C=-40, high_C=85, worst_of=3)
    assert Temperature.assumed(load_config({}).temperature) == []
    assert Temperature.assumed(spread.temperature) == ["Each switch has a temperature of its own from -40 to 85 °C."]
    assert Temperature.assumed(worst_of_three.temperature) == [
        "Each switch counts at the worst of 3 temperatures from -40 to 85 °C."
    ]
