"""Claims about plug-in device models: every command that simulates calls the model that the campaign names."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from click.testing import CliRunner

from softclose import plugins, simulate
from softclose_workflows.cli import main

SETTINGS = {
    "campaign.budget": 6,
    "prior.model": "none",
    "population.n_switches": 40,
    "optimiser.n_initial": 4,
    "store.n_times": 11,
    "model.name": "counted",
}

calls: list[int] = []


def counted(switches: Any, *arguments: Any, **settings: Any) -> Any:
    """The model of the study, heavier by half, and on record."""
    calls.append(len(switches))
    heavier = switches.copy()
    heavier[:, 3] *= 1.5
    return simulate(heavier, *arguments, **settings)


@pytest.fixture(autouse=True)
def _installed(monkeypatch: pytest.MonkeyPatch) -> None:
    entry = SimpleNamespace(name="counted", load=lambda: counted)
    monkeypatch.setattr(plugins, "entry_points", lambda group: [entry] if group == "softclose.models" else [])
    calls.clear()


def _call(*arguments: str) -> int:
    """Calls of the model that one command made."""
    before = len(calls)
    result = CliRunner().invoke(main, list(arguments), catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return len(calls) - before


@pytest.fixture
def store(tmp_path: Path) -> str:
    path = str(tmp_path / "a.zarr")
    assert (
        _call("run", "current", "--store", path, "--serial", "--quiet", *_set(SETTINGS)) >= SETTINGS["campaign.budget"]
    )
    return path


def _set(settings: dict[str, Any]) -> list[str]:
    return [word for key, value in settings.items() for word in ("--set", f"{key}={value}")]


@pytest.mark.parametrize(
    ("command", "options"),
    [
        ("certify", ["--switches", "200", "--top", "2"]),
        ("tolerance", ["--switches", "64", "--gain", "0.01"]),
        ("sensitivity", ["--points", "16", "--replicates", "2"]),
        ("report", ["-o", "{folder}/a.html"]),
        ("verify", ["--replay", "2"]),
    ],
)
def test_every_question_to_a_store_calls_the_campaigns_model(
    store: str, tmp_path: Path, command: str, options: list[str]
) -> None:
    assert _call(command, store, *[o.format(folder=tmp_path) for o in options]) > 0


def test_engines_are_compared_on_the_campaigns_model() -> None:
    options = ["--engines", "sobol", "--seeds", "1", "--switches", "100"]
    assert _call("compare-engines", "current", *options, *_set(SETTINGS)) > SETTINGS["campaign.budget"]


def test_a_study_calls_the_model_of_its_campaigns(tmp_path: Path) -> None:
    settings = "\n".join(f"{k} = {v!r}" for k, v in SETTINGS.items())
    text = 'name = "s"\nbase = "current"\nparameter = "objective.c1_cm_s"\nvalues = [20, 30]\n[set]\n'
    study = tmp_path / "study.toml"
    study.write_text(text + settings)
    assert _call("study", str(study), "--out", str(tmp_path / "out"), "--serial", "--quiet", "--switches", "200") > 12
