"""A population that carries its plate area is simulated with it, whoever asks."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import softclose
from softclose.switch import plate
from softclose.switch.plate import OtherAreaError

AREA = 12_000.0
STEP = softclose.Waveform([softclose.Pulse(0.0, 4.0, float("inf"), 80.0)])
N = 300


def lot(folder: Path, area: float | None = AREA) -> Path:
    path = folder / f"lot{area or 0:g}.toml"
    path.write_text('name = "own"\nbase = "current"\n' + (f"plate_area_um2 = {area}\n" if area else ""))
    return path


def test_simulate_takes_the_area_of_the_population(tmp_path: Path) -> None:
    """80 V close most switches of 16,700 µm², and few of 12,000 µm², whose pull-in voltage is 18 % higher."""
    population = softclose.load_population(lot(tmp_path))
    switches = population.sample(N, seed=1)
    own = softclose.simulate(switches, STEP)
    plain = np.array(switches)
    assert own.closed.mean() < 0.4 < 0.6 < softclose.simulate(plain, STEP).closed.mean()
    np.testing.assert_array_equal(own.closed, softclose.simulate(plain, STEP, plate_area_um2=AREA).closed)


WAYS: dict[str, Any] = {
    "table": lambda s: s,
    "rows": lambda s: s[10:200],
    "mask": lambda s: s[s[:, 0] > 2.4],
    "copy": lambda s: s.copy(),
    "lot": softclose.Lot.of,
    "rows of a lot": lambda s: softclose.Lot.of(s).rows(slice(5, 90)),
    "columns of a lot": lambda s: softclose.Lot.of(s).with_columns(gain=np.ones(len(s))).without(["gain"]),
    "joined lots": lambda s: softclose.Lot.joined([softclose.Lot.of(s[:9]), softclose.Lot.of(s[9:40])]),
}


@pytest.mark.parametrize("way", WAYS)
def test_what_is_made_of_a_table_of_switches_keeps_the_area(tmp_path: Path, way: str) -> None:
    found = WAYS[way](softclose.load_population(lot(tmp_path)).sample(N, seed=1))
    table = np.array(found.switches if isinstance(found, softclose.Lot) else found)
    expected = softclose.simulate(table, STEP, plate_area_um2=AREA)
    np.testing.assert_array_equal(softclose.simulate(found, STEP).max_contact_speed, expected.max_contact_speed)
    for formula in (plate.pull_in_voltage, plate.closing_voltage, plate.holding_voltage):
        if not isinstance(found, softclose.Lot):
            np.testing.assert_array_equal(formula(found), formula(table, AREA))
            with pytest.raises(OtherAreaError):
                formula(found, 16_700.0)
    with pytest.raises(ValueError, match=r"given as 16700 µm², and the switches are of a population of 12000 µm²"):
        softclose.simulate(found, STEP, plate_area_um2=16_700.0)


def test_a_campaign_does_not_take_switches_of_another_area(tmp_path: Path) -> None:
    own = softclose.load_config({"population": {"name": str(lot(tmp_path))}})
    other = softclose.load_config({})
    drawn = softclose.draw(own, 50, seed=2)
    assert drawn.plate_area_um2 == AREA
    expected = softclose.simulate(drawn.switches, STEP, plate_area_um2=AREA).max_contact_speed
    np.testing.assert_array_equal(softclose.respond(own, drawn, STEP).max_contact_speed, expected)
    np.testing.assert_array_equal(softclose.simulate(drawn, STEP).max_contact_speed, expected)
    for switches in (drawn, softclose.load_population(lot(tmp_path)).sample(20, seed=1)):
        with pytest.raises(ValueError, match="given as 16700 µm², and the switches are of a population of 12000 µm²"):
            softclose.respond(other, switches, STEP)


def test_a_population_without_an_area_leaves_it_to_the_caller(tmp_path: Path) -> None:
    switches = softclose.load_population(lot(tmp_path, None)).sample(30, seed=1)
    assert type(switches) is np.ndarray
    default, given, less = (
        softclose.simulate(switches, STEP, **area).max_contact_speed
        for area in ({}, {"plate_area_um2": 16_700.0}, {"plate_area_um2": 9_000.0})
    )
    np.testing.assert_array_equal(default, given)
    assert np.isnan(less).sum() > np.isnan(given).sum()


def test_a_lot_goes_to_a_worker_with_its_area(tmp_path: Path) -> None:
    drawn = softclose.Lot.of(softclose.load_population(lot(tmp_path)).sample(5, seed=1))
    assert pickle.loads(pickle.dumps(drawn)).plate_area_um2 == AREA
