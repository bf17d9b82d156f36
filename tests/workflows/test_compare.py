"""Claims about `softclose compare`: the best of each campaign, what differs, and a warning where it is unfair."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner
from PIL import Image

from reported import empty_store
from small_campaigns import COARSE, make_campaign
from softclose import Waveform, load_config
from softclose.evaluate import evaluate
from softclose_store import open_campaign
from softclose_workflows.analyses.certify import certify, fresh_switches
from softclose_workflows.cli import main
from softclose_workflows.report.compare_page import render_comparison
from softclose_workflows.report.comparison import (
    Entry,
    differences,
    differing_settings,
    not_compared,
    read_entries,
    unlike,
)


@pytest.fixture(scope="module")
def entries(finished_store: Path, another_store: Path) -> list[Entry]:
    return read_entries([str(finished_store), str(another_store)])


def test_json_repeats_what_each_store_calls_its_best(finished_store: Path, another_store: Path) -> None:
    result = CliRunner().invoke(main, ["compare", str(finished_store), str(another_store), "--json"])
    assert result.exit_code == 0, result.output
    found = json.loads(result.output)["campaigns"]
    for told, path in zip(found, (finished_store, another_store), strict=True):
        best = open_campaign(path).best()
        assert best is not None
        assert told["best"]["candidate"] == best.candidate
        assert told["best"]["g_cm_s"] == pytest.approx(best.g_cm_s)
        assert not told["best"]["certified"]


def test_only_settings_that_differ_are_listed(entries: list[Entry]) -> None:
    assert {key for key, _ in differing_settings(entries)} == {"campaign.budget", "campaign.name", "campaign.seed"}


def test_table_shows_every_campaign_by_its_name(finished_store: Path, another_store: Path) -> None:
    result = CliRunner().invoke(main, ["compare", str(finished_store), str(another_store)])
    assert result.exit_code == 0, result.output
    assert "another seed" in result.output
    assert "training switches" in result.output


def test_campaigns_of_one_name_are_told_apart_by_their_stores(finished_store: Path, tmp_path: Path) -> None:
    copy = shutil.copytree(finished_store, tmp_path / "copy.zarr")
    labels = [entry.label for entry in read_entries([str(finished_store), str(copy), str(copy)])]
    assert len(set(labels)) == 3
    assert "copy.zarr" in labels[1]


def test_page_warns_where_a_certified_campaign_stands_beside_an_uncertified_one(
    finished_store: Path, another_store: Path, tmp_path: Path
) -> None:
    copy = str(shutil.copytree(another_store, tmp_path / "certified.zarr"))
    certify(copy, n_switches=2000, top=1)
    entries = read_entries([str(finished_store), copy])
    page = render_comparison(entries)
    assert "Not all are certified" in page
    assert "2,000 new switches" in page
    assert "default-src 'none'" in page


def test_page_and_figure_are_written_by_the_ending_of_the_name(
    finished_store: Path, another_store: Path, tmp_path: Path
) -> None:
    for name in ("both.html", "both.png"):
        arguments = ["compare", str(finished_store), str(another_store), "-o", str(tmp_path / name)]
        assert CliRunner().invoke(main, arguments).exit_code == 0
    assert (tmp_path / "both.html").read_text(encoding="utf-8").count('class="plot"') == 3
    with Image.open(tmp_path / "both.png") as image:
        assert image.width > 2000


def test_a_campaign_without_a_result_is_compared_too(finished_store: Path, tmp_path: Path) -> None:
    stores = [str(finished_store), empty_store(tmp_path)]
    result = CliRunner().invoke(main, ["compare", *stores, "--json", "-o", str(tmp_path / "both.svg")])
    assert result.exit_code == 0, result.output
    assert json.loads(result.output)["campaigns"][1]["best"] is None


@pytest.mark.parametrize("arguments", [["a.zarr"], ["STORE", "STORE", "-o", "both.docx"]])
def test_a_mistake_is_one_message(finished_store: Path, arguments: list[str]) -> None:
    named = [str(finished_store) if argument == "STORE" else argument for argument in arguments]
    result = CliRunner().invoke(main, ["compare", *named])
    assert result.exit_code == 2
    assert "Traceback" not in result.output


def test_on_fresh_switches_all_are_judged_alike_and_differences_are_paired(
    finished_store: Path, another_store: Path
) -> None:
    a, b = read_entries([str(finished_store), str(another_store)], 500)
    for entry in (a, b):
        best = open_campaign(finished_store if entry is a else another_store).best()
        assert best is not None
        config = entry.data.config
        switches = fresh_switches(config, 500, seed=a.data.config.campaign.seed)
        expected = evaluate(config, switches, Waveform.from_rows(best.waveform), fresh=True)
        assert entry.design is not None
        assert entry.design.assessment == expected
        assert entry.basis == "500 new switches"
    ((label, first, difference),) = differences([a, b])
    assert (label, first) == (b.label, a.label)
    assert difference.v_u_cm_s == pytest.approx(b.design.assessment.v_u_cm_s - a.design.assessment.v_u_cm_s)
    told = CliRunner().invoke(main, ["compare", str(finished_store), str(another_store), "--fresh", "500"])
    assert f"{b.label} against {a.label}: v_u " in told.output.replace("\n", " ")
    assert "All on new switches" in render_comparison([a, b])
    assert differences(read_entries([str(finished_store), str(another_store)])) == []


@pytest.mark.parametrize(
    ("settings", "named"),
    [
        (["model.quality_factor=5"], "model.quality_factor"),
        (["model.restitution=0.2"], "model.restitution"),
        (["amplifier.bandwidth_kHz=200"], "amplifier.bandwidth_kHz"),
        (["model.plate_area_um2=15000"], "model.plate_area_um2"),
        (["objective.level=0.5"], "objective.level"),
        (["population.name=modified"], "population"),
        (["optimiser.engine=sobol", "campaign.seed=9", "objective.c1_cm_s=3"], ""),
    ],
)
def test_only_drives_of_the_same_switches_in_the_same_device_are_compared_switch_by_switch(
    settings: list[str], named: str
) -> None:
    """A damped lot was "softer on 100.0 % of the switches"."""
    a = load_config("current")
    found = unlike(a, load_config("current", settings))
    assert (named in found) if named else found == []
    assert unlike(a, a) == []


def test_what_cannot_be_compared_is_said(finished_store: Path, tmp_path: Path) -> None:
    damped = make_campaign(tmp_path / "damped.zarr", *COARSE, "model.quality_factor=5", "campaign.name=damped")
    entries = read_entries([str(finished_store), damped], 200)
    assert differences(entries) == []
    (line,) = not_compared(entries)
    assert "damped is not compared with" in line
    assert "they differ in model.quality_factor" in line
    told = CliRunner().invoke(main, ["compare", str(finished_store), damped, "--fresh", "200"])
    assert "switch by switch: they differ in model.quality_factor" in " ".join(told.output.split())
    assert "softer on" not in told.output
    found = json.loads(
        CliRunner().invoke(main, ["compare", str(finished_store), damped, "--fresh", "200", "--json"]).output
    )
    assert (found["differences"], found["not_compared"]) == ([], [line])
