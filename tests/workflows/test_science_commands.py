"""Claims about the commands calibrate, tolerance, sensitivity and populations: what they ask, print and refuse."""

from __future__ import annotations

import json
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from small_campaigns import COARSE, make_campaign
from softclose import load_population
from softclose_workflows.analyses.certify import certify
from softclose_workflows.cli import main

EXAMPLE = str(resources.files("softclose.population") / "shipped" / "example_measurements.csv")


def _run(*arguments: str, code: int = 0) -> Result:
    done = CliRunner().invoke(main, list(arguments))
    assert done.exit_code == code, done.output
    return done


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> str:
    return make_campaign(tmp_path_factory.mktemp("science") / "a.zarr", *COARSE, "campaign.budget=4")


def test_populations_show_the_printed_figures_beside_ours() -> None:
    text = _run("populations").stdout
    assert "0.590–0.750 [0.59–0.75]" in text
    assert "0.412–0.524 [0.41–0.52]" in text
    assert "65.300 [65.3]" in text
    said = json.loads(_run("populations", "modified", "--json").stdout)
    assert said["modified"]["G_mean_um"] == pytest.approx(4.18)
    assert "did you mean" in _run("populations", "modifyed", code=2).stderr


def test_calibration_writes_a_population_that_run_accepts(tmp_path: Path) -> None:
    toml, figure, few = tmp_path / "mine.toml", tmp_path / "mine.svg", tmp_path / "few.csv"
    few.write_text("".join(Path(EXAMPLE).read_text("utf-8").splitlines(keepends=True)[:13]), "utf-8")
    asked = [
        "calibrate",
        str(few),
        "-o",
        str(toml),
        "--bootstrap",
        "20",
        "--bounds",
        "D=2.3:2.7",
        "--bounds",
        "G=3.6:3.9",
    ]
    text = _run(*asked, "--figure", str(figure)).stdout
    assert "Cramér–von Mises" in text
    assert "<svg" in figure.read_text("utf-8")
    population = load_population(str(toml))
    assert (population.D.lower, population.D.upper) == (2.3, 2.7)
    said = json.loads(_run(*asked, "--json").stdout)
    assert (said["population"]["name"], said["n_devices"]) == ("mine", 12)
    store = make_campaign(tmp_path / "b.zarr", *COARSE, f"population.name={toml}", "campaign.budget=1")
    assert Path(store).exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nowhere.csv", "-o", "x.toml"], "cannot be read"),
        ([EXAMPLE, "-o", "x.json"], "give a name in .toml"),
        ([EXAMPLE, "-o", "missing/x.toml", "--bootstrap", "20"], "is no folder"),
        ([EXAMPLE, "-o", "x.toml", "--bounds", "D=2.3"], "D=2.3:2.7"),
        ([EXAMPLE, "-o", "x.toml", "--bounds", "D=2.5:2.7"], "widen"),
        ([EXAMPLE, "-o", "x.toml", "--bootstrap", "3"], "at least 20"),
    ],
)
def test_bad_calibrations_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    assert message in _run("calibrate", *arguments, code=2).stderr


def test_tolerance_asks_the_best_candidate_and_the_certified_one_once_there_is_one(store: str) -> None:
    asked = ["tolerance", store, "--switches", "100", "--gain", "0.02", "--slew", "30", "--jitter", "0.3"]
    said = json.loads(_run(*asked, "--generators", "4", "--json").stdout)
    assert said["why"] == "best"
    assert [r["error"] for r in said["rows"]] == ["perfect", "gain +2.00 %", "jitter 0.3 µs (sd)", "slew 30 V/µs"]
    assert said["rows"][0]["v_u_shift_cm_s"] == 0.0
    best = certify(store, n_switches=200, top=2).best
    said = json.loads(_run(*asked, "--json").stdout)
    assert (said["why"], said["candidate"]) == ("best certified", best.candidate)
    # The first of the certified switches, and nothing else: the same V. A switch that never touches has none.
    assert said["rows"][0]["max_cm_s"] == pytest.approx(100.0 * np.nanmax(best.response.max_contact_speed[:100]))
    assert "perfect" in _run(*asked).stdout


def test_sensitivity_gives_a_share_for_each_variable(store: str) -> None:
    asked = ["sensitivity", store, "--candidate", "0", "--points", "16", "--replicates", "2"]
    said = json.loads(_run(*asked, "--json").stdout)
    assert said["why"] == "asked for"
    assert {(i["output"], i["variable"]) for i in said["indices"]} == {
        (o, v) for o in ("v_cm_s", "closed") for v in "DGET"
    }
    assert "with interactions" in _run(*asked).stdout
    assert "power of 2" in _run("sensitivity", store, "--points", "17", code=2).stderr
    assert "not committed" in _run("sensitivity", store, "--candidate", "99", code=2).stderr


CLOSING = "device,voltage_V,closing_time_us,second_contact_us\n"


def test_dynamics_become_a_campaign_that_runs_the_fitted_switch(tmp_path: Path) -> None:
    from dataclasses import replace

    from softclose import load_config
    from softclose.identify.model import Model, predicted
    from softclose.identify.own_campaign import model_of
    from softclose.identify.readings import Reading

    begun = model_of(load_config("current-two"))
    switch, device = begun.at({"M": 1.15 * begun.switch[3], "restitution": 0.6})
    truth = Model(switch=switch, device=device)
    volts = (95.0, 105.0, 120.0)
    first, second = (
        predicted(truth.switch, truth.device, tuple(Reading(kind=kind, value=50.0, volts=u) for u in volts))
        for kind in ("closing", "second contact")
    )
    contacts, statics, mine = tmp_path / "contacts.csv", tmp_path / "statics.csv", tmp_path / "mine.toml"
    contacts.write_text(CLOSING + "".join(f"a,{u},{a},{b}\n" for u, a, b in zip(volts, first, second, strict=True)))
    static = predicted(truth.switch, truth.device, (Reading(kind="pull-in", value=1.0),))
    statics.write_text(f"device,pull_in_V\na,{static[0]}\n")
    tables = [str(contacts), str(statics)]
    asked = ["calibrate", *tables, "--of", "current-two", "-o", str(mine), "--starts", "1", "--error", "closing=0.01"]
    text = _run(*asked).stdout
    assert "K, M and force are not told apart" in text
    assert "fix one of them where you know it (--fix K=VALUE)" in text
    assert "closing at 95 V" in text
    said = json.loads(_run(*asked, "--fix", "K", "--json").stdout)
    assert said["fixed"]["K"] == pytest.approx(begun.switch[2])
    value, low, high = said["parameters"]["restitution"]
    assert low <= value <= high < 0.62
    assert value == pytest.approx(0.6, abs=2e-3)
    assert said["untold"] == []
    assert said["files"] == [str(mine), str(tmp_path / "mine.lot.toml")]
    again = model_of(load_config(mine))
    assert again.device.restitution == pytest.approx(0.6, abs=2e-3)
    assert again.switch[3] == pytest.approx(switch[3], rel=5e-3)
    assert load_config(mine).explore == load_config("current-two").explore
    own = {"restitution": 0.5, "plate_area_um2": 16_700.0}
    assert replace(load_config(mine).model, **own) == load_config("current-two").model
    assert "not of the form NAME=NUMBER" in _run(*asked, "--fix", "K=stiff", code=2).stderr
    assert "lacks its number" in _run(*asked, "--error", "closing", code=2).stderr
    assert "go with --of" in _run("calibrate", *tables, "-o", str(mine), code=2).stderr
    assert "no parameter" in _run(*asked, "--fix", "hardness", code=2).stderr
