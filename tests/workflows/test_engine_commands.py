"""Claims about the commands pareto and compare-engines."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from small_campaigns import COARSE, make_campaign
from softclose_store import open_campaign
from softclose_workflows.cli import main


def _run(*arguments: str, code: int = 0) -> Result:
    done = CliRunner().invoke(main, list(arguments))
    assert done.exit_code == code, done.output
    return done


def test_pareto_shows_the_candidates_that_no_other_beats(tmp_path: Path) -> None:
    store = make_campaign(tmp_path / "a.zarr", *COARSE)
    front = json.loads(_run("pareto", store, "--json").stdout)["front"]
    table = open_campaign(store).records()
    points = list(zip(table["v_u_cm_s"], table["p_nc"], strict=True))
    on_front = {f["candidate"] for f in front}
    assert on_front
    for i, (v, p) in enumerate(points):
        beaten = any(w <= v and q <= p and (w, q) != (v, p) for w, q in points)
        assert (i in on_front) == (v == v and not beaten)
    assert "v_u against p_nc" in _run("pareto", store).stdout


def test_pareto_of_nothing_is_refused(tmp_path: Path) -> None:
    store = make_campaign(tmp_path / "a.zarr", *COARSE, run=False)
    assert "no usable candidate" in _run("pareto", store, code=2).stderr


def test_engines_are_compared_over_seeds(tmp_path: Path) -> None:
    sets = [part for setting in (*COARSE, "campaign.budget=4") for part in ("--set", setting)]
    figure = tmp_path / "engines.svg"
    asked = ["compare-engines", "current", "--engines", "sobol,direct", "--seeds", "5,6", "--switches", "100", *sets]
    said = json.loads(_run(*asked, "--json").stdout)["runs"]
    assert [(r["engine"], r["seed"]) for r in said] == [("sobol", 5), ("sobol", 6), ("direct", 5), ("direct", 6)]
    for r in said:
        assert len(r["best_g_cm_s"]) == len(r["wall_s"]) == 4
        assert r["best_g_cm_s"] == sorted(r["best_g_cm_s"], reverse=True)
        assert r["g_cm_s"] == r["best_g_cm_s"][-1]
    assert "median" in _run(*asked, "--figure", str(figure)).stdout
    assert "<svg" in figure.read_text("utf-8")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--engines", "sobo"], "did you mean 'sobol'"),
        (["--engines", "sobol", "--seeds", "1;2"], "not of the form 1,2,3"),
        (["--engines", "paper", "--seeds", "1"], "two-pulse-paper"),
    ],
)
def test_bad_comparisons_are_refused(arguments: list[str], message: str) -> None:
    assert message in _run("compare-engines", "current", *arguments, code=2).stderr
