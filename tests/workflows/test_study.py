"""Claims about studies: what each value changes, that they continue, and what crossing the optima says."""

from __future__ import annotations

import contextlib
import json
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from small_campaigns import COARSE
from softclose import Pulse, Waveform, assess, load_population
from softclose.evaluate import evaluate
from softclose.settings import ConfigError
from softclose_workflows.analyses.certify import fresh_switches
from softclose_workflows.cli import main
from softclose_workflows.run.executors import Placement
from softclose_workflows.studies.series import Effort
from softclose_workflows.studies.study import StudyResult, cross_evaluate, print_study, run_study
from softclose_workflows.studies.study_file import FOLDER, load_study
from softclose_workflows.terminal import READING, STARTING
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


def test_a_study_is_no_silence_while_kernels_are_compiled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shown: list[str] = []

    @contextlib.contextmanager
    def working(what: str, *, quiet: bool) -> Iterator[None]:
        shown.append(f"{what}{' quiet' * quiet}")
        yield

    for module in ("study", "series"):
        monkeypatch.setattr(f"softclose_workflows.studies.{module}.working", working)
    study = replace(load_study("u-max", SMALL), values=(100.0, 150.0))
    run_study(study, tmp_path, replace(EFFORT, quiet=False))
    assert shown == [READING, STARTING]


def _optimum(waveform: Waveform, n_switches: int, seed: int, g: float = 0.0) -> Any:
    """What a study asks of a certification."""
    best = SimpleNamespace(waveform=waveform, assessment=SimpleNamespace(g_cm_s=g))
    return SimpleNamespace(best=best, n_switches=n_switches, seed=seed)


def test_a_row_is_one_value_and_a_column_the_optimum_of_one() -> None:
    study = replace(load_study("c1", SMALL), values=(0.0, 100.0))
    members = study.members()
    waveforms = [Waveform([Pulse(0, 4, 5, 150), Pulse(25, 20, math.inf, u)]) for u in (70.0, 90.0)]
    optima = [_optimum(waveforms[0], 40, 3, 11.0), _optimum(waveforms[1], 60, 4, 12.0)]
    g = cross_evaluate(members, optima, EFFORT)
    assert np.diag(g).tolist() == [11.0, 12.0]
    for i, j, n, seed in ((0, 1, 40, 3), (1, 0, 60, 4)):
        switches = fresh_switches(members[i].config, n, seed=seed)
        assert g[i, j] == evaluate(members[i].config, switches, waveforms[j], fresh=True).g_cm_s
    assert g[0, 1] != g[1, 0]


def test_an_optimum_at_the_limit_but_for_rounding_is_admissible() -> None:
    members = replace(load_study("u-max", SMALL), values=(100.0, 150.0)).members()
    for excess, admissible in ((5e-10, True), (1e-3, False)):
        step = Waveform([Pulse(0, 4, math.inf, 100.0 * (1.0 + excess))])
        g = cross_evaluate(members, [_optimum(step, 5, 1), _optimum(step, 5, 1)], EFFORT)
        assert np.isfinite(g[0, 1]) == admissible
        assert np.isfinite(g[1, 0])


def _judged(optimum: Any) -> Any:
    """The same with everything that the table shows."""
    speed = np.linspace(0.05, 0.2, 20)
    best = SimpleNamespace(
        waveform=optimum.best.waveform,
        assessment=assess(SimpleNamespace(max_contact_speed=speed, closed=speed < 0.19)),
        optimism_cm_s=0.75,
    )
    references = [SimpleNamespace(assessment=SimpleNamespace(v_u_cm_s=v)) for v in (41.25, 33.5)]
    return SimpleNamespace(best=best, references=references)


def test_regret_is_what_a_value_loses_by_the_optimum_of_another(capsys: pytest.CaptureFixture[str]) -> None:
    study = replace(load_study("u-max"), values=(100.0, 150.0))
    optimum = _judged(_optimum(Waveform([Pulse(0, 4, math.inf, 80)]), 5, 1))
    result = StudyResult(
        study=study,
        members=tuple(study.members()),
        certifications=(optimum, optimum),
        cross_g_cm_s=np.array([[10.0, 13.0], [11.0, 9.0]]),
    )
    assert result.regret_cm_s.tolist() == [[0.0, 3.0], [2.0, 0.0]]
    print_study(replace(result, cross_g_cm_s=np.array([[10.0, math.nan], [11.0, 9.0]])))
    said = capsys.readouterr().out
    for text in (
        study.parameter,
        "[V]",
        "another value [cm/s]",
        "+0.75",
        "41.25",
        "80.00 V from",
        "v_u [cm/s]",
        "10.00 % (",
        "optimum of 100",
    ):
        assert text in " ".join(said.split())
    assert "33.5" not in said  # the second reference
    rows = [line.replace("│", " ").split() for line in said.splitlines() if "+0.00" in line]
    assert rows == [["100", "+0.00", "not", "admissible"], ["150", "+2.00", "+0.00"]]


def test_a_study_continues_and_repeats_bit_for_bit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    study = replace(load_study("c1", SMALL), values=(5.0, 25.0))
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
    asked = [
        "study",
        "repeatability",
        "--out",
        str(tmp_path),
        "--serial",
        "--quiet",
        "--switches",
        "100",
        "--top",
        "1",
        *sets,
    ]
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
