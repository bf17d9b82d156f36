"""Claims about a store whose engine and device model are not installed here: only running asks for them."""

from __future__ import annotations

import json
import shutil
from importlib.metadata import EntryPoint
from pathlib import Path
from types import SimpleNamespace

import pytest
from click.testing import CliRunner, Result

import softclose.plugins
from softclose import plugins, simulate
from softclose.propose.sobol import SobolEngine
from softclose_workflows.cli import main

SETTINGS = (
    "campaign.budget=3",
    "prior.model=none",
    "population.n_switches=40",
    "store.n_times=11",
    "optimiser.engine=their-engine",
    "model.name=their-model",
    "finish.budget=0",
)
their_engine, their_model = SobolEngine, simulate


def _installed(group: str) -> list[EntryPoint]:
    name = {"softclose.engines": "their-engine", "softclose.models": "their-model"}[group]
    return [EntryPoint(name, f"{__name__}:{name.replace('-', '_')}", group)]


def _run(*arguments: str) -> Result:
    return CliRunner().invoke(main, list(arguments))


@pytest.fixture(scope="module")
def theirs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished store, made with both plug-ins."""
    path = tmp_path_factory.mktemp("theirs") / "theirs.zarr"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(softclose.plugins, "entry_points", lambda *, group: _installed(group))
        sets = [word for s in SETTINGS for word in ("--set", s)]
        done = _run("run", "current", "--store", str(path), "--serial", "--quiet", *sets)
        assert done.exit_code == 0, done.output
    return path


@pytest.mark.parametrize(
    "arguments",
    [
        ("status", "{store}"),
        ("rescore", "{store}", "--level", "0.8"),
        ("pareto", "{store}"),
        ("verify", "{store}"),
        ("resume", "{store}"),
        ("export", "{store}", "waveform"),
        ("export", "{store}", "history"),
        ("report", "{store}", "-o", "{folder}/a.html"),
        ("figures", "{store}", "-o", "{folder}/figures", "--format", "png", "--only", "convergence"),
        pytest.param(("figures", "{store}", "-o", "{folder}/figures", "--format", "png"), marks=pytest.mark.long),
        ("compare", "{store}", "{store}"),
    ],
    ids=lambda a: " ".join(a[:1] + a[2:3] + a[7:]),
)
def test_reading_needs_no_plugin(theirs: Path, tmp_path: Path, arguments: tuple[str, ...]) -> None:
    done = _run(*(a.format(store=theirs, folder=tmp_path) for a in arguments))
    assert done.exit_code == 0, done.output


def test_what_cannot_be_simulated_is_said(theirs: Path, tmp_path: Path) -> None:
    assert _run("report", str(theirs), "-o", str(tmp_path / "a.html")).exit_code == 0
    page = (tmp_path / "a.html").read_text("utf-8")
    assert "o unshaped design to compare with: no device model named" in page
    assert "no unshaped design to compare with: no device model named" in _run("resume", str(theirs)).stdout


@pytest.mark.parametrize("command", ["certify", "tolerance", "sensitivity"])
def test_simulating_says_what_is_missing(theirs: Path, command: str) -> None:
    done = _run(command, str(theirs))
    assert done.exit_code == 2
    assert "no device model named 'their-model'" in done.stderr
    assert "entry point their-model of group softclose.models: install it" in done.stderr


def test_running_says_what_is_missing(tmp_path: Path) -> None:
    sets = [word for s in SETTINGS[:-1] for word in ("--set", s)]
    done = _run("run", "current", "--store", str(tmp_path / "a.zarr"), "--serial", *sets)
    assert done.exit_code == 2
    assert "no engine named 'their-engine'" in done.stderr
    assert not (tmp_path / "a.zarr").exists()


def test_resuming_says_what_is_missing_before_it_starts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from softclose.settings import CampaignConfig, load_config
    from softclose_workflows.run.creation import create_store

    data = load_config("current", SETTINGS[:3]).to_dict()
    data["optimiser"]["engine"] = "their-engine"
    with monkeypatch.context() as installed:
        theirs = SimpleNamespace(name="their-engine", load=lambda: SobolEngine)
        installed.setattr(plugins, "entry_points", lambda group: [theirs] if group == "softclose.engines" else [])
        create_store(CampaignConfig.from_dict(data), str(tmp_path / "a.zarr"))
    done = _run("resume", str(tmp_path / "a.zarr"), "--serial")
    assert done.exit_code == 2
    assert "no engine named 'their-engine'" in done.stderr
    assert json.loads(_run("status", str(tmp_path / "a.zarr"), "--json").stdout)["committed"] == 0
    shutil.rmtree(tmp_path / "a.zarr")
