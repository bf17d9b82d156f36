"""Claims about lots that are not the paper's plate: stiffness, mass, resonance or pull-in voltage given as they are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from softclose.population import Population, PopulationError
from softclose.population.files import read_population, write_population
from softclose.switch.plate import pull_in_voltage, resonance
from softclose_workflows.cli import main

HEAD = """
name = "our relay"
plate_area_um2 = 40000
[D]
distribution = "normal"
mean = 1.6
sd = 0.05
lower = 1.4
upper = 1.8
[G]
distribution = "uniform"
lower = 2.4
upper = 2.6
"""
UNIFORM = '[{}]\ndistribution = "uniform"\nlower = {}\nupper = {}\n'
K, M = UNIFORM.format("K", 90, 110), UNIFORM.format("M", 4, 5)
F, U = UNIFORM.format("f", 28, 32), UNIFORM.format("U_pi", 40, 50)


def lot(tmp_path: Path, *tables: str) -> Population:
    path = tmp_path / "lot.toml"
    path.write_text(HEAD + "".join(tables))
    return read_population(path)


def test_stiffness_and_mass_are_taken_as_they_are(tmp_path: Path) -> None:
    population = lot(tmp_path, K, M)
    switches = population.sample(20_000, seed=1)
    assert switches[:, 2].min() >= 90
    assert switches[:, 2].max() <= 110
    assert switches[:, 2].mean() == pytest.approx(100, abs=0.2)
    assert population.mean_switch == pytest.approx([1.6, 2.5, 100, 4.5], abs=1e-6)
    assert population.summary()["M_sd_ug"] == pytest.approx(1 / np.sqrt(12), rel=1e-3)


def test_resonance_decides_the_mass(tmp_path: Path) -> None:
    population = lot(tmp_path, K, F)
    switches = population.sample(5000, seed=1)
    f = resonance(switches)
    np.testing.assert_allclose(f, population.sample_parameters(5000, seed=1)[:, 3], rtol=1e-12)
    assert population.mean_M == pytest.approx(switches[:, 3].mean(), rel=5e-3)
    low, high = population.summary()["M_lower_ug"], population.summary()["M_upper_ug"]
    assert low <= switches[:, 3].min() < switches[:, 3].max() <= high


def test_pull_in_voltage_decides_the_stiffness_with_the_gap(tmp_path: Path) -> None:
    population = lot(tmp_path, U, F)
    switches = population.sample(5000, seed=1)
    np.testing.assert_allclose(
        pull_in_voltage(switches, 40000.0), population.sample_parameters(5000, seed=1)[:, 2], rtol=1e-12
    )
    assert population.mean_K == pytest.approx(switches[:, 2].mean(), rel=1e-2)
    summary = population.summary()
    assert (summary["U_pi_lower_V"], summary["U_pi_upper_V"]) == (40, 50)
    assert summary["K_lower_N_per_m"] <= switches[:, 2].min()
    assert summary["K_upper_N_per_m"] >= switches[:, 2].max()


@pytest.mark.parametrize("tables", [(K, M), (K, F), (U, F), (U, F, "[correlation]\nU_pi-f = 0.8\n")])
def test_a_lot_is_read_back_from_its_file_and_from_a_store(tmp_path: Path, tables: tuple[str, ...]) -> None:
    population = lot(tmp_path, *tables)
    write_population(population, tmp_path / "again.toml")
    assert read_population(tmp_path / "again.toml") == population
    assert Population.from_dict(population.to_dict()) == population


def test_correlated_variables_of_a_law_are_correlated(tmp_path: Path) -> None:
    p = lot(tmp_path, U, F, "[correlation]\nU_pi-f = 0.9\n").sample_parameters(4000, seed=1)
    assert np.corrcoef(p[:, 2].argsort().argsort(), p[:, 3].argsort().argsort())[0, 1] == pytest.approx(0.9, abs=0.02)


def test_a_base_keeps_the_correlations_of_variables_that_stay(tmp_path: Path) -> None:
    (tmp_path / "base.toml").write_text('base = "current"\n[correlation]\nE-T = 0.7\nD-G = 0.5\n')
    (tmp_path / "own.toml").write_text('base = "base.toml"\n' + UNIFORM.format("K", 60, 70) + UNIFORM.format("M", 3, 4))
    assert read_population(tmp_path / "own.toml").correlation == (("D", "G", 0.5),)


def test_a_base_of_a_plate_may_be_given_its_own_stiffness(tmp_path: Path) -> None:
    path = tmp_path / "lot.toml"
    path.write_text('base = "current"\n' + K + M)
    assert read_population(path).variables == ("D", "G", "K", "M")


@pytest.mark.parametrize(
    ("tables", "said"),
    [
        ((K,), r"\[M\] is missing"),
        ((K, UNIFORM.format("T", 5, 6)), r"\[T\], \[K\] do not go together"),
        ((UNIFORM.format("K", -1, 110), M), "K reaches down to -1 N/m"),
        ((K, M, "[correlation]\nE-T = 0.5\n"), "E"),
    ],
)
def test_what_does_not_make_a_lot_is_said(tmp_path: Path, tables: tuple[str, ...], said: str) -> None:
    with pytest.raises(PopulationError, match=said):
        lot(tmp_path, *tables)


def test_pull_in_voltages_need_an_area(tmp_path: Path) -> None:
    path = tmp_path / "lot.toml"
    path.write_text((HEAD + U + F).replace("plate_area_um2 = 40000", ""))
    with pytest.raises(PopulationError, match="give plate_area_um2"):
        read_population(path)


@pytest.mark.parametrize("law", ["U_pi", "K"])
def test_measured_resonances_are_calibrated_to_a_lot_like_the_one_that_was_measured(tmp_path: Path, law: str) -> None:
    truth = lot(tmp_path, U if law == "U_pi" else K, F)
    p = truth.sample_parameters(60, seed=4)
    column = "pull_in_V" if law == "U_pi" else "K_N_per_m"
    rows = "\n".join(f"{d},{g},{a},{f}" for d, g, a, f in p)
    path = tmp_path / "m.csv"
    path.write_text(f"D_um,G_um,{column},resonance_kHz\n{rows}\n")
    done = CliRunner().invoke(
        main,
        [
            *("calibrate", str(path), "-o", str(tmp_path / "fit.toml"), "--plate-area", "40000", "--bootstrap", "30"),
            *("--figure", str(tmp_path / "fit.png")),
        ],
    )
    assert done.exit_code == 0, done.output
    fitted = read_population(tmp_path / "fit.toml")
    assert fitted.variables == truth.variables
    a, b = truth.switches(p), fitted.sample(4000, seed=1)
    np.testing.assert_allclose(b.mean(axis=0), a.mean(axis=0), rtol=0.02)
    np.testing.assert_allclose(b.std(axis=0), a.std(axis=0), rtol=0.35)


def test_a_resonance_alone_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "m.csv"
    path.write_text("D_um,G_um,resonance_kHz\n" + "1.6,2.5,30\n" * 9)
    done = CliRunner().invoke(main, ["calibrate", str(path), "-o", str(tmp_path / "fit.toml")])
    assert done.exit_code == 2
    assert "no column 'pull_in_V'" in done.output
    assert "needed: G_um, D_um, pull_in_V, resonance_kHz" in done.output.replace("\n", " ")


@pytest.mark.slow
def test_a_campaign_of_such_a_lot_runs_and_is_certified(tmp_path: Path) -> None:
    lot(tmp_path, U, F)
    store = str(tmp_path / "own.zarr")
    sets = ["n_switches=60", "sampling=monte-carlo", f"name='{tmp_path / 'lot.toml'}'"]
    words = [w for s in sets for w in ("--set", f"population.{s}")]
    small = [
        "--set",
        "campaign.budget=6",
        "--set",
        "prior.model=none",
        "--set",
        "explore.budget=0",
        "--set",
        "finish.budget=0",
    ]
    small += ["--set", "waveform.max_volts=90", "--set", "store.n_times=2", "--set", "optimiser.engine=sobol"]
    runner = CliRunner()
    for command in (
        ["run", "current", "--store", store, "--serial", "--quiet", *words, *small],
        ["certify", store, "--switches", "500", "--top", "1"],
        ["sensitivity", store, "--points", "32"],
        ["report", store, "--output", str(tmp_path / "r.html")],
        ["populations", str(tmp_path / "lot.toml"), "current"],
        ["verify", store],
    ):
        done = runner.invoke(main, command)
        assert done.exit_code == 0, (command, done.output, done.exception)
