"""Claims about the reproduction: every published case is there, and what it writes follows from the presets alone."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner

from examples import is_whole
from softclose.presets import preset_names
from softclose_workflows.cli import main
from softclose_workflows.figures.reproduction import draw_all
from softclose_workflows.run.executors import Placement
from softclose_workflows.studies.published import CASES, presets
from softclose_workflows.studies.reproduce import members, reproduce
from softclose_workflows.studies.series import Effort

TINY = (
    "campaign.budget=2",
    "prior.model=none",
    "population.n_switches=40",
    "explore.budget=0",
    "finish.budget=0",
    "compute.block_switches=0",
    "store.n_times=6",
    "optimiser.engine=sobol",
)
EFFORT = Effort(n_switches=100, top=10, placement=Placement(serial=True), quiet=True)


def test_every_published_figure_has_a_case() -> None:
    """SPEC §7, as printed."""
    printed = {(40.7, 34.1), (42.6, 24.7), (19.7, 15.3), (18.8, 14.0), (12.5, 10.7), (12.8, 9.6)}
    assert {(c.published.v_u_cm_s, c.published.mean_cm_s) for c in CASES if c.published} == printed
    assert set(presets()) <= set(preset_names())
    for what, two in (("current", "current-two"), ("modified", "modified"), ("process-improved", "process-improved")):
        assert {two, f"{what}-three", f"{what}-paper"} <= set(presets())


def test_presets_are_what_their_names_say() -> None:
    for member in members():
        config = member.config
        name = member.name
        design = name if name == "paper-text" else re.sub("-(two|three|paper|direct)$", "", name)
        assert config.population.name == design
        assert config.waveform.space.startswith("three" if name.endswith(("-three", "-direct")) else "two")
        assert config.waveform.max_volts == 150.0
        if name.endswith(("-paper", "-direct")):
            assert config.population.n_switches == 200  # as published


@pytest.fixture(scope="module")
def monkeypatch_module() -> Iterator[pytest.MonkeyPatch]:
    with pytest.MonkeyPatch.context() as patch:
        yield patch


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, monkeypatch_module: pytest.MonkeyPatch) -> Path:
    out = tmp_path_factory.mktemp("reproduce")
    monkeypatch_module.setattr("softclose_workflows.figures.reproduction.N_DRAWN", 3)
    rows = reproduce(out, EFFORT, TINY)
    has_figure = [row for row in rows if row.case.figure or "3 pulses" in row.case.title]
    draw_all(out / "figures", rows if is_whole() else [row for row in rows if row not in has_figure[1:]])
    return out


@pytest.mark.long
@pytest.mark.slow
def test_a_second_run_writes_the_same_bytes(folder: Path) -> None:
    before = {p: p.read_bytes() for p in folder.rglob("*") if p.is_file() and "stores" not in p.parts}
    assert {"table.txt", "table.json"} <= {p.name for p in before}
    draw_all(folder / "figures", reproduce(folder, EFFORT, TINY))
    assert all(p.read_bytes() == content for p, content in before.items())


def test_table_sets_published_figures_beside_ours(folder: Path) -> None:
    cases = json.loads((folder / "table.json").read_text())["cases"]
    assert len(cases) == len(CASES)
    step = cases[0]
    assert step["v_u_cm_s"] == pytest.approx(41.6, abs=4.0)
    lower, upper = step["v_u_range_of_200_cm_s"]
    assert lower < step["published"]["v_u_cm_s"] < upper  # the prototype of SPEC §7 agrees with the study here
    assert step["verdict"] == "agrees"
    text = (folder / "table.txt").read_text()
    for case in CASES:
        assert case.title in text
    assert all(math.isfinite(c["g_cm_s"]) for c in cases)


def test_command_prints_json(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("softclose_workflows.figures.reproduction.draw_all", lambda folder, rows: [])
    sets = [part for setting in TINY for part in ("--set", setting)]
    asked = ["reproduce", "--out", str(folder), "--serial", "--switches", "100", *sets]
    done = CliRunner().invoke(main, [*asked, "--json"])
    assert done.exit_code == 0, done.output
    assert len(json.loads(done.stdout)["cases"]) == len(CASES)


def test_a_folder_of_another_reproduction_is_refused(folder: Path) -> None:
    sets = [part for setting in (*TINY, "campaign.seed=9") for part in ("--set", setting)]
    done = CliRunner().invoke(main, ["reproduce", "--out", str(folder), "--serial", "--quiet", *sets])
    assert done.exit_code == 2
    assert "campaign.seed" in done.stderr
