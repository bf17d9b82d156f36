"""Claims about what is said before a campaign runs, and about references within its limits."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from softclose import load_population
from softclose.settings import load_config
from softclose.switch.plate import closing_voltage, pull_in_voltage
from softclose_workflows.analyses.forewarned import forewarnings
from softclose_workflows.cli import main

SETS = (
    "campaign.budget=2",
    "prior.model=none",
    "population.n_switches=40",
    "store.n_times=11",
    "optimiser.engine=sobol",
    "finish.budget=0",
)


def test_a_limit_below_pull_in_is_said_with_its_share() -> None:
    config = load_config("current", ["waveform.max_volts=75"])
    volts = pull_in_voltage(load_population("current").sample(40_000, seed=3))
    share = float((volts > 75.0).mean())
    assert 0.1 < share < 0.9
    (line,) = forewarnings(config)
    assert "waveform.max_volts is 75 V, below the pull-in voltage of " in line
    assert float(line.split("voltage of ")[1].split(" %")[0]) == pytest.approx(100.0 * share, abs=1.0)
    assert forewarnings(load_config("current")) == []
    assert "of all of the lot" in forewarnings(load_config("current", ["waveform.max_volts=20"]))[0]


def test_a_travel_below_a_third_of_the_gap_closes_where_it_is_held(tmp_path: Path) -> None:
    path = tmp_path / "short.toml"
    path.write_text('base = "current"\n[D]\ndistribution = "fixed"\nvalue = 1.0\n')
    config = load_config("current", [f"population.name={path}"])
    switches = config.build_population().sample(4096, seed=0, sampling="sobol")
    assert (closing_voltage(switches) < pull_in_voltage(switches)).all()


def test_run_says_it_first_and_says_why_a_row_is_missing(tmp_path: Path) -> None:
    sets = [word for s in (*SETS, "waveform.max_volts=60") for word in ("--set", s)]
    done = CliRunner().invoke(
        main, ["run", "current", "--store", str(tmp_path / "a.zarr"), "--serial", "--quiet", *sets]
    )
    assert done.exit_code == 0, done.output
    assert "note: waveform.max_volts is 60 V, below the pull-in voltage of" in done.stderr
    assert "60.00 V from 0.00 µs, ideal step" in done.stdout
    assert "100.00 V" not in done.stdout
    assert "no deterministic design to compare with: 60 V never bring the mean switch" in done.stdout
    page = tmp_path / "a.html"
    assert CliRunner().invoke(main, ["report", str(tmp_path / "a.zarr"), "-o", str(page)]).exit_code == 0
    told = page.read_text("utf-8")
    assert "o deterministic design to compare with: 60 V never bring the mean switch" in told
    assert "unshaped 60 V step" in told


def test_the_limit_on_p_nc_is_judged_wherever_it_is_told(tmp_path: Path) -> None:
    sets = [word for s in (*SETS, "objective.form=chance", "objective.p_max=0.01") for word in ("--set", s)]
    store = str(tmp_path / "a.zarr")
    run = CliRunner().invoke(main, ["run", "current", "--store", store, "--serial", "--quiet", *sets])
    assert run.exit_code == 0, run.output
    for arguments in (("status", store), ("certify", store, "--switches", "40", "--top", "1"), ("rescore", store)):
        told = CliRunner().invoke(main, list(arguments))
        assert "at most 1 % left open is " in told.stdout, told.output
    assert "at most 1 % left open is " in run.stdout
    assert np.isfinite(load_config("current").objective.p_max)


def test_edges_faster_than_the_papers_are_warned_of() -> None:
    (said,) = forewarnings(load_config("current", ["waveform.min_rise_us=1.5"]))
    assert "waveform.min_rise_us is 1.5 µs" in said
    assert "second mode" in said
    assert forewarnings(load_config("current", ["waveform.min_rise_us=6"])) == []
