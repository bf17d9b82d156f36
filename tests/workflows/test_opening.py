"""Claims about `softclose opening`: its words, its figure, its errors."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner
from PIL import Image

from small_campaigns import COARSE, make_campaign
from softclose_workflows.cli import main


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> str:
    return make_campaign(tmp_path_factory.mktemp("opening") / "a.zarr", *COARSE)


def _opening(*arguments: str, code: int = 0) -> str:
    done = CliRunner().invoke(main, ["opening", *arguments, "-q"])
    assert done.exit_code == code, done.output
    return done.output


def test_it_judges_designs_and_draws(store: str, tmp_path: Path) -> None:
    figure = tmp_path / "opening.png"
    found = json.loads(_opening(store, "--switches", "300", "--brake", "40", "--figure", str(figure), "--json"))
    plain, braked = found["release"], found["braked"]
    assert len(braked["waveform"]) == len(plain["waveform"]) + 1 or braked["overshoot"] == plain["overshoot"]
    assert plain["overshoot_interval"][0] <= plain["overshoot"] <= plain["overshoot_interval"][1]
    with Image.open(figure) as image:
        assert image.size[0] > 500
    told = _opening(store, "--switches", "300")
    assert "the holding pulse falls" in told
    assert "with a brake" not in told
    assert "not within the 200 µs simulated (--watch, opening.watch_us)" in " ".join(told.split())
    longer = json.loads(_opening(store, "--switches", "300", "--watch", "400", "--json"))["release"]
    assert longer["overshoot"] == pytest.approx(plain["overshoot"], rel=0.02), "it comes soon after the fall"


def test_too_early_a_release_is_one_error(store: str) -> None:
    assert "later" in _opening(store, "--switches", "300", "--at", "0.5", code=2)
