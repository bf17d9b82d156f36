"""Claims about what a few devices leave open: more of them leave less, and the truth is among what they leave."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

from examples import is_whole
from softclose import Pulse, Waveform, load_population
from softclose.evaluate import evaluate
from softclose.population.calibrate import calibrate, plausible_populations
from softclose.population.measurements import Measurements
from softclose.population.population import Population, switches_from_parameters
from softclose.settings import load_config
from softclose.switch.plate import pull_in_voltage
from softclose.uncertainty.devices import DevicesError, propagate

PAGE = Path(__file__).parents[2] / "docs" / "measurements" / "coverage.md"
CONFIG = load_config("current")
TRUTH = load_population("current")
SOFT = Waveform([Pulse(0.0, 4.0, 4.78, 84.95), Pulse(32.46, 4.33, 6.2, 149.76), Pulse(45.94, 13.24, math.inf, 75.39)])
BOUNDS = {"D": (2.3, 2.7), "G": (3.6, 3.9)}


def _measured(n: int, seed: int) -> Measurements:
    p = TRUTH.sample_parameters(n, seed=seed)
    u = pull_in_voltage(switches_from_parameters(p))
    return Measurements(device=tuple(map(str, range(n))), G_um=p[:, 1], D_um=p[:, 0], T_um=p[:, 3], pull_in_V=u)


def _fitted(n: int, seed: int) -> Population:
    return calibrate(_measured(n, seed), bounds=BOUNDS, n_bootstrap=20).population


def test_of_few_devices_it_is_said_which_intervals_hold_less_often() -> None:
    """Unless the ends are known, and as docs/measurements/coverage.md has it: every cell there below 93 %."""
    few, some, many = (_measured(n, 3) for n in (12, 60, 120))
    said = {
        n: [note for note in calibrate(m, n_bootstrap=20).notes if "may hold less often than they say" in note]
        for n, m in ((12, few), (60, some), (120, many))
    }
    assert [len(notes) for notes in said.values()] == [1, 1, 0]
    assert said[12][0].startswith("of 12 devices the intervals of lower end, upper end and sd of D, G may")
    assert said[60][0].startswith("of 60 devices the intervals of sd of D, G may")
    known = calibrate(few, bounds={"D": (2.0, 2.9), "G": (3.2, 4.2)}, n_bootstrap=20).notes
    assert not any("less often" in note for note in known)
    section = PAGE.read_text("utf-8").partition("## Fitted lots")[2].partition("\n## ")[0]
    rows = re.findall(r"^\| (\d+) \| [\d.]+ \| [\d,]+ \| (.*) \|$", section, re.MULTILINE)
    assert len(rows) == 8
    for n, (note,) in ((12, said[12]), (60, said[60])):
        cells = [[float(cell) for cell in row.split(" | ")] for devices, row in rows if int(devices) == n]
        lower, upper, mean, sd = np.min(cells, axis=0)
        short = [round(100 * x) for x in (lower, upper, sd) if x < 0.93]
        assert mean >= 0.93
        assert ("lower end" in note) == (min(lower, upper) < 0.93)
        told = f"{min(short)} to {max(short)} %" if len(short) > 1 else f"{short[0]} %"
        assert f"with {n}, {told} in place of 95" in note


@pytest.mark.long
def test_the_truth_is_among_what_the_devices_leave_open() -> None:
    """Of 24 lots of 25 devices; a certificate's interval, which knows of no devices, misses it most of the time."""
    truth = evaluate(CONFIG, TRUTH.sample(50_000, seed=9), SOFT, fresh=True).v_u_cm_s
    hits = by_switches = 0
    for seed in range(24):
        found = propagate(CONFIG, SOFT, _fitted(25, 100 + seed), 25, bounds=BOUNDS, n_lots=40, n_switches=1000)
        low, high = found.interval("v_u_cm_s")
        hits += low <= truth <= high
        low, high = found.assessment.v_u_interval
        by_switches += low <= truth <= high
    assert hits >= 20
    assert by_switches < hits - 4


@pytest.mark.sampled
def test_more_devices_leave_less_open() -> None:
    widths, (n_lots, n_switches) = [], (100, 1500) if is_whole() else (60, 800)
    for n in (12, 60, 300):
        found = propagate(CONFIG, SOFT, _fitted(n, 4), n, bounds=BOUNDS, n_lots=n_lots, n_switches=n_switches)
        low, high = found.interval("g_cm_s")
        widths.append(high - low)
        assert found.n_devices == n
        assert found.n_failed == 0
    assert widths[0] > 1.5 * widths[1] > 2.0 * widths[2]


def test_lots_are_judged_on_the_same_uniforms_and_seeds_repeat() -> None:
    lot = _fitted(30, 1)
    first, again = (propagate(CONFIG, SOFT, lot, 30, n_lots=20, n_switches=500, seed=3) for _ in range(2))
    np.testing.assert_array_equal(first.v_u_cm_s, again.v_u_cm_s)
    other = propagate(CONFIG, SOFT, lot, 30, n_lots=20, n_switches=500, seed=4)
    assert not np.array_equal(first.v_u_cm_s, other.v_u_cm_s)
    assert len(np.unique(first.v_u_cm_s)) == 20


def test_a_plausible_lot_keeps_known_bounds_and_its_plate() -> None:
    lot = _fitted(30, 1)
    (found,) = plausible_populations(lot, 30, 1, seed=5, bounds=BOUNDS)
    assert found is not None
    assert (found.D.lower, found.D.upper, found.G.lower, found.G.upper) == (2.3, 2.7, 3.6, 3.9)
    assert found.plate_area() == lot.plate_area()
    assert found.T != lot.T


def test_too_few_lots_are_refused() -> None:
    with pytest.raises(DevicesError, match="3 lots make no interval; 20 at least"):
        propagate(CONFIG, SOFT, TRUTH, 30, n_lots=3)


def test_devices_that_fit_no_population_are_counted_and_refused_where_they_are_most() -> None:
    near = Population.from_dict(
        TRUTH.to_dict()
        | {"D": {"lower": 3.0, "upper": 3.59, "alpha": 2.0, "beta": 2.0}, "G": {"lower": 3.6, "upper": 3.9}}
    )
    with pytest.raises(DevicesError, match="D must stay below G"):
        propagate(CONFIG, SOFT, near, 8, n_lots=20, n_switches=200)
