"""Softness that is bought with switches that never close does not win, and is said wherever it is told."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from small_campaigns import finish
from softclose.settings import load_config
from softclose_store import open_campaign
from softclose_workflows import api
from softclose_workflows.analyses.certify import certify, choose_distinct
from softclose_workflows.analyses.finalists import certify_within
from softclose_workflows.analyses.front import front_of
from softclose_workflows.analyses.rescore import Score, rescore
from softclose_workflows.analyses.result import print_result
from softclose_workflows.cli import main
from softclose_workflows.report.gather import gather
from softclose_workflows.report.live import Folder
from softclose_workflows.report.page import render_report
from softclose_workflows.run.creation import create_store
from softclose_workflows.run.records import observations
from softclose_workflows.tell.watch import read_view

FEW, MANY = 80.0, 149.0
"""A step that leaves two switches in five open, softly, and one that slams them all."""


def campaign_of(path: Path, *volts: float, **objective: Any) -> str:
    """A finished campaign whose candidates are steps."""
    config = load_config({
        "campaign": {"budget": len(volts)}, "population": {"n_switches": 120}, "optimiser": {"engine": "sobol"},
        "waveform": {"initial": [[[0.0, 4.0, "hold", u]] for u in volts]}, "store": {"n_times": 3},
        "objective": objective,
    })  # fmt: skip
    create_store(config, str(path))
    finish(path)
    return str(path)


@pytest.fixture(scope="module")
def soft(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Nothing but what leaves many open."""
    return campaign_of(tmp_path_factory.mktemp("soft") / "soft.zarr", FEW, FEW + 1.0)


def test_what_leaves_many_open_is_no_best_however_soft(tmp_path: Path) -> None:
    path = campaign_of(tmp_path / "a.zarr", FEW, MANY, FEW - 1.0)
    campaign = open_campaign(path)
    g = campaign.records()["g_cm_s"]
    assert g[0] < g[1], "the price alone would choose the other one"
    best = campaign.best()
    assert best is not None
    assert best.candidate == 1
    config = load_config(campaign.config)
    assert choose_distinct(campaign, config, 3)[1] == [1, 0, 2]
    assert [r.candidate for r in rescore(path, Score())] == [1, 0, 2]
    assert rescore(path, Score(objective=("max_open=1.0",)))[0].candidate != 1
    found = certify(path, n_switches=400, top=3)
    assert [d.candidate for d in found.candidates] == [1, 0, 2]
    assert certify_within(path, 0.5, n_switches=2000, top=3)[0].best.candidate == 1
    front = front_of(observations(campaign.records()), config, ("v_u", "p_nc"))
    assert front is not None
    assert front.candidates == (1,)


def test_where_the_objective_says_so_g_alone_decides(tmp_path: Path) -> None:
    best = open_campaign(campaign_of(tmp_path / "a.zarr", FEW, MANY, max_open=1.0)).best()
    assert best is not None
    assert best.candidate == 0


def test_where_all_leave_many_open_the_one_that_leaves_fewest_is_best(soft: str) -> None:
    campaign = open_campaign(soft)
    best = campaign.best()
    assert best is not None
    assert best.p_nc == campaign.records()["p_nc"].min()
    front = front_of(observations(campaign.records()), load_config(campaign.config), ("v_u", "p_nc"))
    assert front is not None
    assert front.candidates == (best.candidate,)


def printed(*arguments: str) -> str:
    """What a command prints, on one line."""
    done = CliRunner().invoke(main, [*arguments], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return " ".join(done.output.split())


WARNING = " % of the switches stay open under this waveform, more than objective.max_open (10 %)"


def test_it_is_said_wherever_a_best_is_printed_or_exported(soft: str, tmp_path: Path) -> None:
    assert WARNING in printed("status", soft)
    assert WARNING in json.loads(printed("status", soft, "--json"))["warning"]
    assert WARNING in printed("certify", soft, "--switches", "200", "--top", "1")
    assert WARNING in json.loads(printed("certify", soft, "--switches", "200", "--top", "1", "--json"))["warning"]
    assert WARNING in printed("rescore", soft)
    assert WARNING in printed("sign", soft, "-o", str(tmp_path / "sheet.html"))
    assert WARNING in (tmp_path / "sheet.html").read_text()
    assert WARNING in json.loads(printed("sign", soft, "--json"))["warning"]
    assert "WARNING" in read_view(open_campaign(soft)).best
    assert WARNING in render_report(gather(soft, learned=False, picks=False))
    (state,) = Folder(Path(soft).parent).states()
    assert state.best is not None
    assert WARNING in state.best["warning"]
    pwl = tmp_path / "drive.cir"
    assert WARNING in printed("export", soft, "waveform", "--format", "pwl", "-o", str(pwl))
    assert WARNING in pwl.read_text()
    codes = tmp_path / "codes.txt"
    dac = ("--format", "dac", "--full-scale", "160", "--rate", "20")
    assert WARNING in printed("export", soft, "waveform", *dac, "-o", str(codes))
    assert WARNING in json.loads(codes.with_name("codes.txt.json").read_text())["warning"]
    csv = tmp_path / "drive.csv"
    assert WARNING in printed("export", soft, "waveform", "--rate", "20", "-o", str(csv))
    assert WARNING in printed("export", soft, "ensemble", "-o", str(tmp_path / "e.csv"))
    assert WARNING in repr(api.open_run(soft))
    assert WARNING in repr(api.certify(soft, n_switches=200, top=1))
    assert WARNING in repr(api.rescore(soft))


def test_run_says_it_at_its_end(soft: str, capsys: pytest.CaptureFixture[str]) -> None:
    print_result(soft)
    assert WARNING in " ".join(capsys.readouterr().out.split())


def test_where_few_stay_open_nobody_is_warned(tmp_path: Path) -> None:
    path = campaign_of(tmp_path / "a.zarr", MANY, MANY - 1.0)
    for said in (printed("status", path), repr(api.open_run(path)), printed("rescore", path)):
        assert "WARNING" not in said
