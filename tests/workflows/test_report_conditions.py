"""Claims about what the report shows of a switch of one's own: temperatures, further modes, losses, a front."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from small_campaigns import COARSE, COMPLETE, make_campaign
from softclose.conditions.temperature import heated
from softclose.evaluate import draw, judge, respond
from softclose.presets import find_preset
from softclose.settings import CampaignConfig
from softclose_store import open_campaign
from softclose_workflows.analyses.front import front_of
from softclose_workflows.report import front_charts
from softclose_workflows.report.data import ReportData
from softclose_workflows.report.gather import gather
from softclose_workflows.report.page import render_report
from softclose_workflows.report.sections.temperature import N_TEMPERATURES, speeds
from softclose_workflows.run.records import observations

TEMPERATURE = (
    "temperature.low_C=-40",
    "temperature.high_C=85",
    "temperature.celsius=[-40, 85]",
    "temperature.stiffness=[1.1, 0.9]",
)


def _report(path: Path, *settings: str) -> tuple[ReportData, str]:
    data = gather(make_campaign(path, *COARSE, *settings), learned=False, picks=False)
    return data, render_report(data)


@pytest.mark.parametrize("worst", [(), ("temperature.worst_of=3",)])
def test_over_temperature_the_lot_is_simulated_at_each(worst: tuple[str, ...], tmp_path: Path) -> None:
    data, page = _report(tmp_path / "a.zarr", *TEMPERATURE, *worst)
    found = data.sections["temperature"]
    assert 'id="temperature"' in page
    config = CampaignConfig.from_dict(open_campaign(str(tmp_path / "a.zarr")).config)
    still = config.revised([f"temperature.{k}=20" for k in ("low_C", "high_C")] + ["temperature.worst_of=0"])
    plain = CampaignConfig.from_dict(still.to_dict() | {"temperature": {}})
    lot = draw(plain, 80, seed=config.campaign.seed, sampling=config.population.sampling)
    for place in (0, N_TEMPERATURES - 1):
        hot = heated(config.temperature, lot, float(found.celsius[place]))
        again = judge(plain, respond(plain, hot, data.designs[0].waveform))
        assert found.found[0][place].v_u_cm_s == again.v_u_cm_s
        assert found.found[0][place].p_nc == again.p_nc
    chart = speeds(found)
    drawn = next(trace for trace in chart["data"] if trace.get("name") == "best candidate")
    assert drawn["y"] == pytest.approx([a.v_u_cm_s for a in found.found[0]], rel=1e-3)


def test_without_a_range_there_is_no_such_section(tmp_path: Path) -> None:
    data, page = _report(tmp_path / "a.zarr")
    assert data.sections == {}
    assert not {'id="temperature"', 'id="plainer"', 'id="opening"'} & {part for part in page.split() if "id=" in part}


@pytest.mark.parametrize(
    ("kind", "settings"),
    [
        ("losses", ("model.quality_factor=5",)),
        (
            "modes",
            ("model.name=reduced-order", f"model.modes={find_preset('current').parent / 'modes' / 'plate.toml'}"),
        ),
    ],
)
def test_the_best_candidate_is_shown_with_and_without(kind: str, settings: tuple[str, ...], tmp_path: Path) -> None:
    data, page = _report(tmp_path / "a.zarr", *settings)
    found = data.sections["plainer"]
    assert found.kind == kind
    assert 'data-figure="plainer"' in page
    lot = open_campaign(str(tmp_path / "a.zarr")).switches()
    eqs = CampaignConfig.from_dict(data.config.to_dict() | {"model": {}, "reduced_order_model": {}})
    alone = respond(eqs, lot, data.designs[0].waveform)
    np.testing.assert_allclose(found.without.speed_cm_s, 100.0 * alone.max_contact_speed, rtol=1e-4)
    np.testing.assert_allclose(found.own.speed_cm_s, data.designs[0].speed_cm_s, rtol=1e-6)
    assert np.nanmax(np.abs(found.own.speed_cm_s - found.without.speed_cm_s)) > 0.1
    assert len(found.peaks_um) == (1 if kind == "modes" else 0)


def test_only_candidates_of_the_largest_ensemble_are_on_the_front(tmp_path: Path) -> None:
    campaign = open_campaign(make_campaign(tmp_path / "a.zarr", *COMPLETE))
    records = dict(campaign.records())
    found = front_of(observations(records), CampaignConfig.from_dict(campaign.config))
    assert found is not None
    assert found.n_switches == 100
    assert {*records["n_switches"]} == {40, 100}
    assert {int(records["n_switches"][i]) for i in found.candidates} == {100}
    compared = np.isfinite(found.values).all(axis=1)
    assert {*records["n_switches"][compared]} == {100}


@pytest.mark.parametrize("objectives", [["v_u", "p_nc"], ["peak", "closing", "v_u"]])
def test_the_front_is_that_of_the_campaign_s_own_objectives(objectives: list[str], tmp_path: Path) -> None:
    data, page = _report(tmp_path / "a.zarr", "campaign.budget=32", f"optimiser.objectives={json.dumps(objectives)}")
    campaign = open_campaign(str(tmp_path / "a.zarr"))
    found = front_of(observations(campaign.records()), CampaignConfig.from_dict(campaign.config))
    assert found is not None
    assert data.front is not None
    assert found.candidates == data.front.candidates
    assert len(found.candidates) > 1
    assert 'data-figure="front"' in page
    assert 'data-figure="front-growth"' in page
    chart: dict[str, Any] = front_charts.front(found, data.candidates)
    on_front = chart["data"][1]
    assert [row[0] for row in on_front["customdata"]] == list(found.candidates)
    factor = 100.0 if objectives[1] == "p_nc" else 1.0
    assert on_front["x"] == pytest.approx(factor * found.values[list(found.candidates), 1], rel=1e-3)
    assert ("error_y" in on_front) == (objectives[0] == "v_u")
    grown = front_charts.growth(found)["data"][0]["y"]
    assert grown == sorted(grown)
