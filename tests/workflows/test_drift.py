"""Claims about `softclose drift`: its switches, its words, its figure."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import pytest
from click.testing import CliRunner
from PIL import Image

from small_campaigns import COARSE, make_campaign
from softclose import load_config, load_population
from softclose.uncertainty.drift import Drift
from softclose_workflows.analyses.certify import certify
from softclose_workflows.analyses.drift import sentences, usual
from softclose_workflows.cli import main


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> str:
    return make_campaign(tmp_path_factory.mktemp("drift") / "a.zarr", *COARSE)


def _drift(*arguments: str, code: int = 0) -> str:
    done = CliRunner().invoke(main, ["drift", *arguments, "-q"])
    assert done.exit_code == code, done.output
    return done.output


def test_without_drift_it_is_the_certificate(store: str) -> None:
    best = certify(store, n_switches=1000, top=2).best
    found = json.loads(_drift(store, "--at", "0.05", "--switches", "1000", "--json"))
    assert found["candidate"] == best.candidate
    assert [row["drift"] for row in found["rows"]] == [0.0, 0.05]
    assert found["rows"][0]["v_u_cm_s"] == best.assessment.v_u_cm_s
    assert found["rows"][1]["change"]["v_u_cm_s"] != 0.0


def test_it_says_where_v_u_has_doubled_and_draws_it(store: str, tmp_path: Path) -> None:
    figure = tmp_path / "drift.png"
    told = _drift(store, "--at", "-0.01", "--at", "0.02", "--switches", "500", "--figure", str(figure))
    assert "none" in told
    assert "v_u has not doubled at −1 %" in told
    assert "+2 %" in told
    with Image.open(figure) as image:
        assert image.size[0] > 500
    volts = _drift(store, "--kind", "charge", "--at", "1.5", "--switches", "200")
    assert "+1.5 V" in volts
    assert "-1.5" not in volts


def test_the_words_follow_the_numbers() -> None:
    class Row:
        def __init__(self, drift: float, p_nc: float = 0.02) -> None:
            self.drift, self.assessment = drift, SimpleNamespace(p_nc=p_nc)

    found = Drift(kind="stiffness", rows=(Row(-0.1), Row(0.0), Row(0.1)), doubled=(-float("inf"), 0.0731))  # type: ignore[arg-type]
    assert sentences(found) == ["v_u has not doubled at −10 %", "v_u has doubled at +7.31 %"]
    never = (-float("inf"), float("inf"))
    open_ = Drift(kind="charge", rows=(Row(-16.0, 0.7), Row(0.0), Row(16.0, 1.0)), doubled=never)  # type: ignore[arg-type]
    assert sentences(open_) == [
        "at −16 V 70.0 % of the switches stay open: v_u is none of the lot there",
        "at +16 V all switches stay open: v_u is none of the lot there",
    ]


@pytest.mark.parametrize(("stiffer", "reach"), [(1.0, 16.2), (0.0625, 4.04)])
def test_the_drifts_that_are_looked_at_are_those_of_the_lot(tmp_path: Path, stiffer: float, reach: float) -> None:
    """±16 V were asked of a switch of 20 V."""
    mean = load_population("current").mean_switch
    lot = tmp_path / "lot.toml"
    lot.write_text(f'name = "x"\nbase = "current"\n[law]\nK = "{stiffer * mean[2]}"\nM = "{mean[3]}"\n')
    config = load_config({"population": {"name": str(lot)}})
    charge = usual(config, "charge")
    assert charge[-1] == pytest.approx(reach, rel=0.02)
    assert charge == tuple(-v for v in reversed(charge))
    assert usual(config, "stiffness")[-1] == 0.2


def test_bad_drifts_are_one_error(store: str) -> None:
    assert "leaves no stiffness" in _drift(store, "--at", "-1", "--switches", "200", code=2)
    assert "heat" in _drift(store, "--kind", "heat", code=2)
