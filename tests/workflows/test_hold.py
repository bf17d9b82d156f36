"""A certificate says how far its lot is from letting go: softness that is bought with hold is no gain."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from small_campaigns import finish
from softclose.evaluate.quantities import Value
from softclose.settings import CampaignConfig, load_config
from softclose.switch.plate import holding_voltage
from softclose_store import open_campaign
from softclose_workflows import api
from softclose_workflows.analyses.certify import certify, fresh_switches
from softclose_workflows.analyses.hold import Hold, hold_lines, holds_of
from softclose_workflows.cli import main
from softclose_workflows.report.gather import gather
from softclose_workflows.report.page import render_report
from softclose_workflows.run.creation import create_store

N = 200


def campaign_of(path: Path, hold_volts: float, **sections: Any) -> str:
    """A finished and certified campaign of one waveform, which closes the lot and then holds it at a voltage."""
    close = [[0.0, 4.0, 90.0, 140.0 - hold_volts], [0.0, 4.0, "hold", hold_volts]]
    config = load_config({
        "campaign": {"budget": 1}, "population": {"n_switches": 60}, "optimiser": {"engine": "sobol"},
        "waveform": {"initial": [close], "max_volts": 300.0}, "store": {"n_times": 3}, **sections,
    })  # fmt: skip
    create_store(config, str(path))
    finish(path)
    certify(str(path), n_switches=N, top=1)
    return str(path)


@pytest.fixture(scope="module")
def near(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Held at 76 V, hardly above what the stiffest switches need."""
    return campaign_of(tmp_path_factory.mktemp("near") / "near.zarr", 76.0)


def holds(path: str) -> Any:
    campaign = open_campaign(path)
    certification = gather(path, learned=False, picks=False).certification
    assert certification is not None
    return holds_of(CampaignConfig.from_dict(campaign.config), certification), certification


def test_margins_are_those_of_the_certificates_own_switches(near: str) -> None:
    found, certification = holds(near)
    config = CampaignConfig.from_dict(open_campaign(near).config)
    lot = fresh_switches(config, N, seed=certification.seed)
    margins = np.sort(76.0 - holding_voltage(lot.switches, config.model.plate_area_um2))
    assert found[0].held_V == pytest.approx(76.0)
    assert found[0].least_V == pytest.approx(margins[0])
    assert found[0].margin_V.estimate == pytest.approx(margins[N // 10])
    low, high = found[0].margin_V.interval
    assert low <= found[0].margin_V.estimate <= high
    step = next(h for h in found if h.name == "unshaped")
    assert step.least_V == pytest.approx(margins[0] + config.reference.step_volts - 76.0)


def test_it_is_said_by_certificate_report_json_and_python(near: str) -> None:
    (best, *_), _ = holds(near)
    words = f"the least is {best.least_V:.2f} V (76.00 V held)"
    warning = f"holds one switch with only {best.least_V:.2f} V to spare of 76.00 V"
    said = CliRunner().invoke(main, ["certify", near, "--switches", str(N), "--top", "1"], catch_exceptions=False)
    for told in (" ".join(said.output.split()), " ".join(repr(api.certify(near, n_switches=N, top=1)).split())):
        assert words in told
        assert warning in told
        assert "unshaped" in told.partition("hold margin")[2]
    told = CliRunner().invoke(main, ["certify", near, "--switches", str(N), "--top", "1", "--json"])
    assert json.loads(told.output)["hold"][0]["least_V"] == pytest.approx(best.least_V)
    page = render_report(gather(near, learned=False, picks=False))
    assert words in page
    assert warning in page


def test_a_switch_that_is_not_held_at_all_is_said_to_need_more() -> None:
    value = Value(estimate=7.3, interval=(7.2, 7.4), n=100_000)
    weak = Hold(name="candidate 56", margin_V=value, least_V=-10.99, held_V=74.76)
    warning = hold_lines([weak], 0.9)[1]
    assert "holds with 74.76 V, and one switch needs 10.99 V more to stay closed" in warning
    assert "to spare" not in warning


def test_a_lot_that_is_held_well_is_not_warned_about(tmp_path: Path) -> None:
    found, certification = holds(campaign_of(tmp_path / "well.zarr", 110.0))
    (line,) = hold_lines(found, certification.best.assessment.level)
    assert "90 % of the switches are held" in line
    assert found[0].least_V > 11.0


def test_drives_of_their_own_hold_with_their_own_voltages_and_references_with_the_common_one(tmp_path: Path) -> None:
    trim = {"trim": {"measured": "pull-in", "pull_in_error": 0.01}}
    path = campaign_of(tmp_path / "trim.zarr", 80.0, **trim)
    (best, *others), certification = holds(path)
    config = CampaignConfig.from_dict(open_campaign(path).config)
    lot = fresh_switches(config, N, seed=certification.seed)
    needed = holding_voltage(lot.switches, config.model.plate_area_um2)
    own = lot["voltage_scale"] * 80.0 - needed
    assert best.least_V == pytest.approx(float(own.min()), rel=1e-6)
    step = next(h for h in others if h.name == "unshaped")
    assert step.least_V == pytest.approx(float((config.reference.step_volts - needed).min()), rel=1e-6)


def test_where_nothing_is_known_of_release_nothing_is_said(near: str) -> None:
    _, certification = holds(near)
    config = CampaignConfig.from_dict(open_campaign(near).config).revised(["model.name=measured"])
    assert holds_of(config, certification) == ()
    assert hold_lines((), 0.9) == []
    assert not math.isnan(holds(near)[0][0].margin_V.estimate)
