"""Claims about `softclose propagate`: what it says beside a certificate, and of a file that is none."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from examples import in_turn
from small_campaigns import COARSE, make_campaign
from softclose import load_population
from softclose.population.calibrate import calibrate
from softclose.population.measurements import read_measurements, write_synthetic
from softclose.uncertainty.devices import apart
from softclose_workflows.cli import main


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> str:
    return make_campaign(tmp_path_factory.mktemp("propagate") / "a.zarr", *COARSE)


@pytest.fixture(scope="module")
def devices(tmp_path_factory: pytest.TempPathFactory) -> str:
    file = tmp_path_factory.mktemp("devices") / "twelve.csv"
    write_synthetic(load_population("current"), file, n=12, seed=2)
    return str(file)


def _propagate(*arguments: str, code: int = 0) -> str:
    done = CliRunner().invoke(main, ["propagate", *arguments, "-q"])
    assert done.exit_code == code, done.output
    return done.output


def test_it_says_what_switches_and_what_devices_leave_open(store: str, devices: str) -> None:
    few = ("--lots", "40", "--switches", "1000", "--bounds", "D=2.3:2.7", "--bounds", "G=3.6:3.9")
    told = _propagate(store, devices, *few)
    assert "on the lot of 12 devices" in told
    found = json.loads(_propagate(store, devices, *few, "--json"))
    low, high = found["by_devices"]["v_u_cm_s"]
    assert f"{low:.2f}–{high:.2f}" in told
    by_switches = found["assessment"]["v_u_interval"]
    assert high - low > by_switches[1] - by_switches[0]
    assert len(found["lots"]["p_nc"]) == found["n_lots"] == 40


def test_of_few_devices_it_says_how_often_such_intervals_were_measured_to_hold(store: str, tmp_path: Path) -> None:
    said = {}
    for n in (12, 40):
        write_synthetic(load_population("current"), tmp_path / f"{n}.csv", n=n, seed=2)
        few = ("--lots", "20", "--switches", "200", "--bounds", "D=2.3:2.7", "--bounds", "G=3.6:3.9")
        said[n] = " ".join(_propagate(store, str(tmp_path / f"{n}.csv"), *few).split())
    page = (Path(__file__).parents[2] / "docs" / "measurements" / "coverage.md").read_text("utf-8")
    section = page.partition("## What devices leave open")[2]
    (row,) = re.findall(r"^\| 12 \| [\d,]+ \| (0\.\d+) \| (0\.\d+) \|$", section, re.MULTILINE)
    v_u, p_nc = (f"{100.0 * float(cell):.0f} %" for cell in row)
    assert "12 devices are few: of 12, without known bounds, intervals of a stated 95 %" in said[12]
    assert f"were measured to hold v_u {v_u} of" in said[12]
    assert f"the share left open {p_nc}" in said[12]
    assert "few" not in said[40]


def test_bad_input_is_one_error(store: str, devices: str, tmp_path: Path) -> None:
    assert "is not of the form D=2.3:2.7" in _propagate(store, devices, "--bounds", "D", code=2)
    assert "lots make no interval" in _propagate(store, devices, "--lots", "2", code=2)
    empty = tmp_path / "none.csv"
    empty.write_text("G_um\n")
    assert "none.csv" in _propagate(store, str(empty), code=2)


@pytest.mark.parametrize("change", in_turn([{"f": 3.0}, {"D": -0.5}, {"U_pi": 0.25}], 3, 2))
def test_devices_of_another_lot_are_refused_and_taken_where_it_is_said(
    store: str, tmp_path: Path, change: dict[str, float]
) -> None:
    file = tmp_path / "other.csv"
    rng = np.random.default_rng(3)
    rows = ["D_um,G_um,pull_in_V,resonance_kHz"]
    for _ in range(12):
        d, g = 2.43 + change.get("D", 0.0) + 0.05 * rng.standard_normal(), 3.68 + 0.03 * rng.standard_normal()
        u, f = 80.0 * change.get("U_pi", 1.0), 22.0 * change.get("f", 1.0)
        rows.append(f"{d},{g},{u * (1 + 0.02 * rng.standard_normal())},{f * (1 + 0.02 * rng.standard_normal())}")
    file.write_text("\n".join(rows) + "\n")
    few = ("--lots", "20", "--switches", "200")
    said = " ".join(_propagate(store, str(file), *few, code=2).split())
    (name,) = change
    assert "are of another lot than 'current'" in said
    assert f"{name} is " in said
    assert "--any-lot" in said
    taken = " ".join(_propagate(store, str(file), *few, "--any-lot").split())
    assert "of a shifted or of another lot" in taken
    assert json.loads(_propagate(store, str(file), *few, "--any-lot", "--json"))["notes"]


def test_devices_of_the_lot_itself_are_not_remarked_upon(store: str, tmp_path: Path) -> None:
    for seed in range(12):
        file = tmp_path / "own.csv"
        write_synthetic(load_population("current"), file, n=12, seed=seed)
        fitted = calibrate(read_measurements(file), n_bootstrap=20).population
        assert apart(load_population("current"), fitted, 12, 16_700.0) == ([], [])
