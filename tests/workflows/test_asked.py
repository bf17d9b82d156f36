"""Claims about campaigns that ask for further quantities: weighed, limited, on a front, in records, pages, tables."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner
from numpy.testing import assert_allclose, assert_array_equal

from small_campaigns import COARSE, finish, make_campaign
from softclose.evaluate import judge, respond
from softclose.evaluate.asked import told
from softclose.evaluate.quantities import QUANTITIES
from softclose.metrics.ranking import is_beyond
from softclose.population.lot import Lot
from softclose.settings import CampaignConfig
from softclose.waveform import Waveform
from softclose_store import open_campaign, repair, verify
from softclose_workflows.analyses.certificates import read_certification
from softclose_workflows.analyses.certify import certify, fresh_switches
from softclose_workflows.analyses.recompute import recompute, replay
from softclose_workflows.analyses.rescore import Score, rescore
from softclose_workflows.cli import main
from softclose_workflows.report.gather import gather
from softclose_workflows.report.page import render_report
from stores import differences

FURTHER = sorted(name for name, q in QUANTITIES.items() if q.per != "lot")
ASKED = (
    *COARSE,
    "store.max_impacts=64",
    "amplifier.gain_error=0.02",
    "objective.weights={impact_energy=20.0, peak=0.05}",
    "objective.quantity_limits={hold_margin=2.0}",
    f"objective.lines={FURTHER}",
)


def softclose(*arguments: str, code: int = 0) -> str:
    done = CliRunner().invoke(main, list(arguments))
    assert done.exit_code == code, done.output
    return str(done.output)


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = make_campaign(tmp_path_factory.mktemp("asked") / "a.zarr", *ASKED)
    certify(path, n_switches=100, top=2)
    return path


def test_records_hold_each_quantity_as_it_is_simulated_again(store: str) -> None:
    campaign = open_campaign(store)
    config = CampaignConfig.from_dict(campaign.config)
    records, lot = campaign.records(), Lot(campaign.population())
    for i in (0, 5):
        response = respond(config, lot, Waveform.from_rows(campaign.waveform(i)))
        a = judge(config, response)
        assert_allclose(records["g_cm_s"][i], a.g_cm_s, rtol=1e-12)
        for name, value in told(config, response, a).items():
            found = [records[f"{name}{end}"][i] for end in ("", "_lower", "_upper")]
            assert_allclose(found, [value.estimate, *value.interval], rtol=1e-12, err_msg=name)
    assert verify(store).ok
    assert replay(store, 3).ok


def test_plain_xarray_shows_each_of_them_with_its_unit(store: str) -> None:
    tree: Any = xr.open_datatree(store, engine="zarr", chunks=None)
    tables, stage = tree["candidates"], tree["search"]
    for name in FURTHER:
        assert str(tables.field_unit.sel(field=name).values) == QUANTITIES[name].unit
        column = stage.response.sel(quantity=name)
        assert str(column.quantity_unit.values) == QUANTITIES[name].unit
    energy = stage.response.sel(quantity="impact_energy", candidate=3).to_numpy()
    hard = np.sort(energy[~np.isnan(energy)])
    expected = hard[int(np.ceil(0.9 * len(hard) - 1e-9)) - 1]
    assert_allclose(tables.records.sel(field="impact_energy", candidate=3), expected)
    fresh = tree["certification/100-1"]
    assert fresh.switch_impact_energy.dims == ("design", "fresh_switch")
    assert fresh.switch_impact_energy.attrs["units"] == fresh.impact_energy.attrs["units"] == "nJ"


def test_a_certificate_weighs_what_the_campaign_weighs(store: str) -> None:
    result = read_certification(store)
    assert result is not None
    config = CampaignConfig.from_dict(open_campaign(store).config)
    lot = fresh_switches(config, 100, seed=1)
    for design in (*result.candidates, *result.references):
        plain = respond(config, lot, design.waveform, for_everybody=design.candidate is None)
        assert plain.asked is not None
        assert_array_equal(design.response.asked, plain.asked)
        assert design.assessment.g_cm_s == judge(config, plain, fresh=True).g_cm_s
        assert set(design.values) == set(FURTHER)
    told_by = softclose("certify", store, "--switches", "100", "--seed", "1")
    as_json = json.loads(softclose("certify", store, "--switches", "100", "--seed", "1", "--json"))
    for name in FURTHER:
        assert QUANTITIES[name].long_name in " ".join(told_by.split())
        estimate = as_json["candidates"][0]["quantities"][name]["estimate"]
        assert estimate is None or estimate == pytest.approx(result.best.values[name].estimate)


def test_the_page_has_a_line_for_each(store: str) -> None:
    page = render_report(gather(store))
    for name in FURTHER:
        assert QUANTITIES[name].long_name in page, name


@pytest.mark.parametrize("name", FURTHER)
def test_each_may_be_an_axis_of_a_front(store: str, name: str) -> None:
    found = json.loads(softclose("pareto", store, "--objective", "v_u", "--objective", name, "--json"))
    assert found["objectives"] == ["v_u", name]
    records = open_campaign(store).records()
    sign = 1.0 if QUANTITIES[name].better == "low" or name == "peak" else -1.0
    front = {row["candidate"] for row in found["front"]}
    values = records["peak"] if name == "peak" else records[name]
    points = np.stack([records["v_u_cm_s"], sign * values], axis=1)
    usable = np.isfinite(points).all(axis=1)
    ranks = records["rank_cm_s"]
    beyond = is_beyond(ranks)
    usable &= ~beyond if not beyond[usable].all() else ranks <= ranks[usable].min()
    for i in np.flatnonzero(usable):
        beaten = any(
            (points[j] <= points[i]).all() and (points[j] < points[i]).any() for j in np.flatnonzero(usable) if j != i
        )
        assert (i in front) == (not beaten), (name, i)
    assert front <= {int(i) for i in np.flatnonzero(usable)}
    assert 0.0 <= found["hypervolume"][-1]["share"] <= 1.0
    assert name in softclose("pareto", store, "--objective", "v_u", "--objective", name)


def test_a_quantity_that_is_not_kept_is_no_axis(store: str, tmp_path: Path) -> None:
    plain = make_campaign(tmp_path / "plain.zarr", *COARSE)
    told_by = softclose("pareto", plain, "--objective", "v_u", "--objective", "hold_margin", code=2)
    assert "keeps no hold_margin" in told_by
    assert "objective.lines" in told_by


def test_a_damaged_record_and_a_damaged_block_are_computed_again(store: str, tmp_path: Path) -> None:
    copy = Path(shutil.copytree(store, tmp_path / "copy.zarr"))
    (copy / "candidates" / "records" / "c.0.0").write_bytes(b"")
    (copy / "search" / "response" / "c.0.0.0").write_bytes(b"")
    done = repair(copy, recompute())
    assert done.ok, done.after.problems
    assert differences(copy, Path(store)) == []


def test_a_run_that_was_cut_off_ends_in_the_same_store(store: str, tmp_path: Path) -> None:
    path = make_campaign(tmp_path / "cut.zarr", *ASKED, run=False)
    finish(tmp_path / "cut.zarr", blocks=3)
    assert not open_campaign(path).finished
    softclose("resume", path, "--serial", "--quiet")
    assert [d for d in differences(Path(path), Path(store)) if not d.startswith("certification")] == []


def test_another_weight_ranks_anew_without_a_simulation(store: str) -> None:
    score = Score(objective=("weights={peak=1.0}", "quantity_limits={}"))
    found = {r.candidate: r.assessment.g_cm_s for r in rescore(store, score)}
    records = open_campaign(store).records()
    for i, g in found.items():
        c1 = CampaignConfig.from_dict(open_campaign(store).config).objective.c1_cm_s
        v_u = 60.0 if np.isnan(records["v_u_cm_s"][i]) else records["v_u_cm_s"][i]
        assert_allclose(g, v_u + c1 * records["p_nc"][i] + records["peak"][i], rtol=1e-9)


def test_a_race_says_that_it_does_not_weigh_them(store: str) -> None:
    told_by = softclose("certify", store, "--switches", "200", "--within", "0.5", code=2)
    assert "g weighs further quantities" in " ".join(told_by.split())


def test_a_search_for_a_front_weighs_a_quantity(tmp_path: Path) -> None:
    pytest.importorskip("pymoo")
    settings = [s for s in COARSE if not s.startswith(("optimiser.engine", "campaign.budget"))]
    path = make_campaign(
        tmp_path / "front.zarr",
        *settings,
        "optimiser.engine=nsga2",
        "campaign.budget=120",
        "optimiser.objectives=['v_u', 'hold_margin']",
    )
    found = json.loads(softclose("pareto", path, "--json"))
    assert found["objectives"] == ["v_u", "hold_margin"]
    shares = [step["share"] for step in found["hypervolume"]]
    assert shares == sorted(shares)
    assert "hold voltage above" in render_report(gather(path)).lower()


def test_in_several_cases_the_store_has_each_and_what_counts(tmp_path: Path) -> None:
    """The case at the worst end of each quantity counts, whichever that is for another one."""
    path = make_campaign(
        tmp_path / "cases.zarr", *COARSE, "campaign.budget=2", "objective.lines=['hold_margin']",
        "temperature.celsius=[-40, 20, 85]", "temperature.gap_um=[-0.02, 0.0, 0.03]", "temperature.low_C=-40",
        "temperature.high_C=85", "temperature.worst_of=3",
    )  # fmt: skip
    tree: Any = xr.open_datatree(path, engine="zarr", chunks=None)
    margins = tree["search"].case_response.sel(quantity="hold_margin")
    assert margins.sizes["case"] == 3
    assert_array_equal(tree["search"].response.sel(quantity="hold_margin"), margins.min("case"))
    assert verify(path).ok
