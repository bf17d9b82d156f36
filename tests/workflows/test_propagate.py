"""Claims about `softclose propagate`: what it says beside a certificate, and of a file that is none."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from small_campaigns import COARSE, make_campaign
from softclose import load_population
from softclose.population.measurements import write_synthetic
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
    assert f"{low:.2f} – {high:.2f}" in told
    by_switches = found["assessment"]["v_u_interval"]
    assert high - low > by_switches[1] - by_switches[0]
    assert len(found["lots"]["p_nc"]) == found["n_lots"] == 40


def test_bad_input_is_one_error(store: str, devices: str, tmp_path: Path) -> None:
    assert "is not of the form D=2.3:2.7" in _propagate(store, devices, "--bounds", "D", code=2)
    assert "lots make no interval" in _propagate(store, devices, "--lots", "2", code=2)
    empty = tmp_path / "none.csv"
    empty.write_text("G_um\n")
    assert "none.csv" in _propagate(store, str(empty), code=2)
