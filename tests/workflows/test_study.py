"""Claims about studies: what each value changes, that they continue, and what crossing the optima says."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from small_campaigns import COARSE
from softclose import load_population
from softclose.config import ConfigError
from softclose_workflows.cli import main
from softclose_workflows.run.executors import Placement
from softclose_workflows.studies.series import Effort
from softclose_workflows.studies.study import run_study
from softclose_workflows.studies.study_file import FOLDER, load_study
from stores import differences

SMALL = (*COARSE, "campaign.budget=3")
EFFORT = Effort(n_switches=150, top=1, placement=Placement(serial=True), quiet=True)


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.toml")), ids=lambda p: p.stem)
def test_every_shipped_study_is_a_valid_series_of_campaigns(path: Path) -> None:
    study = load_study(path.stem)
    members = study.members()
    assert len(members) == len(study.values) >= 4
    assert len({m.config.fingerprint() for m in members}) == len(members)
    assert len({m.name for m in members}) == len(members)


def test_transforms_are_those_of_the_shipped_populations() -> None:
    for name, value, shipped in (("design-change", 1.0, "modified"), ("repeatability", 0.5, "process-improved")):
        study = load_study(name)
        member = study.members()[study.values.index(value)]
        ours, theirs = member.config.build_population(), load_population(shipped)
        np.testing.assert_allclose(ours.sample(200, seed=3), theirs.sample(200, seed=3), rtol=1e-12)


def test_study_certifies_each_value_and_crosses_the_optima(tmp_path: Path) -> None:
    study = replace(load_study("u-max", SMALL), values=(100.0, 150.0))
    result = run_study(study, tmp_path, EFFORT)
    assert np.isfinite(np.diag(result.cross_g_cm_s)).all()
    for i, (value, c) in enumerate(zip(study.values, result.certifications, strict=True)):
        assert c.best.waveform.max_voltage() <= value * (1 + 1e-9)
        assert result.cross_g_cm_s[i, i] == c.best.assessment.g_cm_s
    for i in range(len(study.values)):
        for j, c in enumerate(result.certifications):
            too_high = c.best.waveform.max_voltage() > study.values[i] * (1 + 1e-9)
            assert np.isnan(result.cross_g_cm_s[i, j]) == too_high
    assert json.loads((tmp_path / "study.json").read_text())["cross_g_cm_s"][0][0] == result.cross_g_cm_s[0, 0]


def test_a_study_continues_and_repeats_bit_for_bit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    study = replace(load_study("c1", SMALL), values=(5.0, 10.0, 25.0))
    whole = run_study(study, tmp_path / "a", EFFORT)

    finished = []

    def stop_after_one(path: str, *rest: object) -> None:
        if len(finished) == 1:
            raise KeyboardInterrupt
        run(path, *rest)  # type: ignore[arg-type]
        finished.append(path)

    from softclose_workflows.studies import series

    run = series._run
    monkeypatch.setattr(series, "_run", stop_after_one)
    with pytest.raises(KeyboardInterrupt):
        run_study(study, tmp_path / "b", EFFORT)
    monkeypatch.undo()
    again = run_study(study, tmp_path / "b", EFFORT)
    np.testing.assert_array_equal(again.cross_g_cm_s, whole.cross_g_cm_s)
    for member in study.members():
        assert differences(Path(member.store(tmp_path / "a")), Path(member.store(tmp_path / "b"))) == []


def test_command_prints_the_table_or_json(tmp_path: Path) -> None:
    sets = [part for setting in SMALL for part in ("--set", setting)]
    asked = ["study", "repeatability", "--out", str(tmp_path), "--serial", "--quiet", "--switches", "100", *sets]
    first = CliRunner().invoke(main, asked)
    assert first.exit_code == 0, first.output
    assert "keeping the optimum" in first.stdout
    said = json.loads(CliRunner().invoke(main, [*asked, "--json"]).stdout)
    assert [v["value"] for v in said["values"]] == [0.0, 0.25, 0.5, 0.75, 1.0]
    assert len(said["regret_cm_s"]) == 5


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "name is missing"),
        ('name="a"\nbase="current"\nparameter="model.restitution"\nvalues=[0.5]', "two or more numbers"),
        ('name="a"\nbase="current"\nparameter="model.restitution"\nvalues=[0.5, 0.5]', "once"),
        ('name="a"\nbase="current"\nparameter="population.shift_mean"\nvalues=[0, 1]', r"needs \[weights\]"),
        ('name="a"\nbase="current"\nparameter="x"\nvalues=[0, 1]\nvariables=["Q"]', "no variable"),
        ('nam="a"', "unknown key 'nam'"),
    ],
)
def test_bad_files_are_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "bad.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=message):
        load_study(str(path))


def test_bad_values_and_names_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="did you mean 'restitution'"):
        load_study("restitutions")
    path = tmp_path / "s.toml"
    path.write_text('name="a"\nbase="current"\nparameter="model.restitution"\nvalues=[0.5, 1.5]')
    with pytest.raises(ConfigError, match=r"model.restitution is 1.5"):
        load_study(str(path)).members()
