"""A certificate says how far its lot is from letting go: softness that is bought with hold is no gain."""

from __future__ import annotations

import json
import math
import shutil
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
    words = f"the worst has {best.least_V:.2f} V to spare (76.00 V are held)"
    warning = f"leaves the worst of {N} switches only {best.least_V:.2f} V to spare of the 76.00 V held"
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


def weak(estimate: float, least: float, n_short: int) -> Hold:
    value = Value(estimate=estimate, interval=(estimate - 0.1, estimate + 0.1), n=100_000)
    return Hold(name="candidate 56", margin_V=value, least_V=least, held_V=74.76, n=100_000, n_short=n_short)


def test_how_many_switches_are_not_held_is_said_and_how_much_the_worst_needs() -> None:
    line, warning = hold_lines([weak(7.3, -10.99, 959)], 0.9)
    assert "and 959 of 100,000 switches need more to stay closed, the worst 10.99 V more" in warning
    assert "to spare" not in warning
    assert "the worst needs 10.99 V more (74.76 V are held)" in line
    assert "1 of 100,000 switches needs more" in hold_lines([weak(7.3, -0.5, 1)], 0.9)[1]


def test_no_switch_is_held_a_negative_number_of_volts_above_anything() -> None:
    best, reference = weak(-3.2, -10.99, 20_000), weak(-1.5, -4.0, 15_000)
    for line in hold_lines([best, reference], 0.9):
        assert "−" not in line
        assert " -" not in line
    assert "10 % of the switches are held 3.20 (3.10–3.30) V or more below the voltage" in hold_lines([best], 0.9)[0]
    assert "10 % lack 1.50 V or more, the worst needs 4.00 V more" in hold_lines([best, reference], 0.9)[0]


def test_switches_that_are_not_held_are_counted(tmp_path: Path) -> None:
    found, certification = holds(campaign_of(tmp_path / "low.zarr", 66.0))
    config = CampaignConfig.from_dict(open_campaign(str(tmp_path / "low.zarr")).config)
    needed = holding_voltage(fresh_switches(config, N, seed=certification.seed).switches, config.model.plate_area_um2)
    assert (found[0].n, found[0].n_short) == (N, int((needed > 66.0).sum()))
    assert 0 < found[0].n_short < N


def test_run_compare_and_python_warn_of_hold_as_certify_does(near: str, tmp_path: Path) -> None:
    (best, *_), _ = holds(near)
    again = str(shutil.copytree(near, tmp_path / "again.zarr"))
    warning = f"leaves the worst of {N} switches only {best.least_V:.2f} V to spare of the 76.00 V held"
    said = CliRunner().invoke(main, ["compare", near, again, "-o", str(tmp_path / "c.html")], catch_exceptions=False)
    page = (tmp_path / "c.html").read_text(encoding="utf-8")
    told = CliRunner().invoke(main, ["compare", near, again, "--json"], catch_exceptions=False)
    assert said.output.count(warning) == page.count(warning) == told.output.count(warning) == 2
    assert " ".join(repr(api.compare([near, again])).split()).count(warning) == 2
    fresh = CliRunner().invoke(main, ["compare", near, again, "--fresh", "300"], catch_exceptions=False)
    assert fresh.output.count("leaves the worst of 300 switches only") == 2
    resumed = CliRunner().invoke(main, ["resume", near, "--serial", "--quiet"], catch_exceptions=False)
    assert "leaves the worst of 60 switches only" in resumed.output


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
