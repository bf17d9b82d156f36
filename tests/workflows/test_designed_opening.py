"""Claims about a campaign that designs closing and opening: the store, its certificate, its report, its drive."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from small_campaigns import COARSE, make_campaign
from softclose.evaluate import judge, respond
from softclose.evaluate.pieces import here
from softclose.opening import Released, judge_opening
from softclose.population.lot import Lot
from softclose.settings import CampaignConfig, ConfigError, load_config
from softclose.waveform import Waveform
from softclose_store import DamageError, open_campaign
from softclose_workflows.analyses.certify import certify, fresh_switches, read_certification
from softclose_workflows.cli import main
from softclose_workflows.report.gather import gather
from softclose_workflows.report.page import render_report
from softclose_workflows.run.opening import design_at_the_end, designed_opening, read_opening

SETTINGS = (
    *COARSE,
    "model.quality_factor=20",
    "opening.release_us=300",
    "opening.brake=40",
    "opening.n_switches=60",
    "opening.watch_us=100",
)


def _softclose(*arguments: str, code: int = 0) -> Result:
    done = CliRunner().invoke(main, list(arguments))
    assert done.exit_code == code, done.output
    return done


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("opening") / "a.zarr"
    sets = [part for setting in SETTINGS for part in ("--set", setting)]
    told = _softclose("run", "current", "--store", str(path), "--serial", "--quiet", *sets).stdout
    assert "let go at 300 µs" in told
    return str(path)


@pytest.fixture(scope="module")
def best(store: str) -> int:
    found = open_campaign(store).best()
    assert found is not None
    return found.candidate


def _same(a: Released, b: Released) -> None:
    assert a.waveform == b.waveform
    for name in ("held", "stuck", "rebound", "overshoot", "rest_us", "times_us", "quantiles"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), name)


def test_a_run_ends_with_the_opening_of_its_best_candidate(store: str, best: int) -> None:
    campaign = open_campaign(store)
    config = CampaignConfig.from_dict(campaign.config)
    found = read_opening(store, best)
    assert found is not None
    assert found.braked is not None
    closing = Waveform.from_rows(campaign.waveform(best))
    drive = found.braked.released.waveform
    assert drive.pulses[: len(closing.pulses) - 1] == closing.pulses[:-1]
    t = np.linspace(0.0, 299.0, 2000)
    np.testing.assert_array_equal(drive.voltage(t), closing.voltage(t), "closing and holding are the candidate's")
    assert drive.voltage(np.array([450.0]))[0] == 0.0
    lot = Lot(campaign.population()).rows(slice(60))
    for o in (found.plain, found.braked):
        _same(o.released, judge_opening(config, lot, o.released.waveform, at_us=300.0).released)
    assert found.braked.overshoot < found.plain.overshoot - 0.05


def test_what_is_designed_stays(store: str, best: int) -> None:
    file = Path(store) / "opening" / str(best) / "zarr.json"
    before = file.stat().st_mtime_ns
    _softclose("resume", store, "--serial", "--quiet")
    assert file.stat().st_mtime_ns == before


def test_the_objective_does_not_see_the_release(store: str, best: int) -> None:
    campaign = open_campaign(store)
    config = CampaignConfig.from_dict(campaign.config)
    found = read_opening(store, best)
    assert found is not None
    assert found.braked is not None
    again = judge(config, respond(config, Lot(campaign.population()), found.braked.released.waveform))
    assert again.g_cm_s == campaign.records()["g_cm_s"][best]


def test_it_is_a_function_of_the_campaign(store: str, best: int, tmp_path: Path) -> None:
    other = make_campaign(tmp_path / "b.zarr", *SETTINGS)
    assert read_opening(other, best) is None, "this one ended before its opening was designed"
    _softclose("resume", other, "--serial", "--quiet")
    a, b = read_opening(store, best), read_opening(other, best)
    assert a is not None
    assert b is not None
    assert a.braked is not None
    assert b.braked is not None
    _same(a.plain.released, b.plain.released)
    _same(a.braked.released, b.braked.released)


@pytest.fixture(scope="module")
def certified(store: str) -> str:
    certify(store, n_switches=200, top=2)
    return store


def test_the_certificate_judges_the_opening_on_fresh_switches(certified: str) -> None:
    found = read_certification(certified)
    assert found is not None
    assert found.best.candidate is not None
    designed = designed_opening(certified, found.best.candidate)
    assert found.openings is not None
    assert designed is not None
    assert found.openings.braked is not None
    assert designed.braked is not None
    assert found.openings.braked.released.waveform == designed.braked.released.waveform
    config = CampaignConfig.from_dict(open_campaign(certified).config)
    fresh = fresh_switches(config, 200, seed=found.seed)
    for o in (found.openings.plain, found.openings.braked):
        _same(o.released, judge_opening(config, fresh, o.released.waveform, at_us=300.0).released)
    told = json.loads(_softclose("certify", certified, "--switches", "200", "--top", "2", "-q", "--json").stdout)
    assert told["opening"]["braked"]["overshoot"] == found.openings.braked.overshoot
    assert "with a brake" in _softclose("certify", certified, "--switches", "200", "--top", "2", "-q").stdout


def test_the_command_opening_takes_the_campaign_s_own(certified: str) -> None:
    found = json.loads(_softclose("opening", certified, "--switches", "200", "-q", "--json").stdout)
    certificate = read_certification(certified)
    assert certificate is not None
    assert certificate.openings is not None
    assert certificate.openings.braked is not None
    assert found["at_us"] == 300.0
    assert found["braked"]["overshoot"] == certificate.openings.braked.overshoot
    plain = json.loads(_softclose("opening", certified, "--switches", "200", "--at", "350", "-q", "--json").stdout)
    assert plain["braked"] is None


def test_damage_is_repaired_to_the_same_bits(certified: str, best: int) -> None:
    folder = Path(certified) / "opening" / str(best)
    victims = [p for p in sorted(folder.rglob("*")) if p.is_file() and "c" in p.relative_to(folder).parts]
    before = {p: p.read_bytes() for p in victims}
    assert before
    for p in victims[:2]:
        p.write_bytes(b"x")
    with pytest.raises(DamageError, match=f"group opening/{best} of .* is damaged"):  # nothing damaged is read
        read_opening(certified, best)
    assert f"opening/{best}" in _softclose("verify", certified, code=1).output
    _softclose("verify", certified, "--repair")
    assert {p: p.read_bytes() for p in victims} == before


def test_the_report_has_both(certified: str) -> None:
    data = gather(certified, learned=False)
    certificate = read_certification(certified)
    assert certificate is not None
    assert certificate.openings is not None
    assert data.sections["opening"].plain.n == certificate.openings.plain.n > 60, (
        "the new switches', not the training ones'"
    )
    page = render_report(data)
    assert 'id="opening"' in page
    assert "new switches that were still closed then" in page
    assert 'data-figure="opening"' in page
    assert 'data-figure="plainer"' in page, "the switches have losses"


def test_the_whole_drive_is_exported(certified: str, best: int, tmp_path: Path) -> None:
    drive = designed_opening(certified, best)
    assert drive is not None
    assert drive.braked is not None
    file = tmp_path / "drive.csv"
    _softclose("export", certified, "waveform", "--candidate", str(best), "--release", "-o", str(file))
    t, u = np.loadtxt(file, delimiter=",", skiprows=1).T
    np.testing.assert_allclose(u, drive.braked.released.waveform.voltage(t), atol=1e-6)
    assert t[-1] >= drive.braked.released.waveform.breakpoints()[-1]
    assert u[-1] == pytest.approx(0.0, abs=1e-3)


def test_without_an_opening_there_is_none(tmp_path: Path) -> None:
    store = make_campaign(tmp_path / "c.zarr", *COARSE)
    _softclose("resume", store, "--serial", "--quiet")
    assert not (Path(store) / "opening").exists()
    certify(store, n_switches=100, top=1)
    found = read_certification(store)
    assert found is not None
    assert found.openings is None
    assert 'id="opening"' not in render_report(gather(store, learned=False))
    assert "designs no opening" in _softclose("export", store, "waveform", "--release", code=2).output


def test_a_lot_that_nothing_holds_is_said(tmp_path: Path) -> None:
    low = [[0.0, 4.0, "hold", 20.0]]
    settings = [part for s in (*SETTINGS, "campaign.budget=1") for part in ("--set", s)]
    done = _softclose(
        "run", "current", "--store", str(tmp_path / "d.zarr"), "--serial", "--quiet", *settings,
        "--set", f"waveform.initial={json.dumps([low])}",
    )  # fmt: skip
    assert "no opening is designed for candidate 0: 0 of 60 switches are held" in done.output


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ("opening.release_us=100", "until model.horizon_us 250"),
        ("waveform.space=two-pulse-release", "lets go by itself"),
        ("opening.brake=-1", "opening.brake"),
        ("opening.watch_us=0", "opening.watch_us"),
    ],
)
def test_what_does_not_go_with_an_opening_is_refused(setting: str, said: str) -> None:
    with pytest.raises(ConfigError) as refused:
        load_config("current", ["opening.release_us=300", setting])
    assert said in str(refused.value)


def test_a_release_at_infinity_is_refused() -> None:
    with pytest.raises(ConfigError, match="release_us"):
        load_config({"opening": {"release_us": math.inf}})


def test_a_run_says_that_it_designs_the_opening_and_only_where_it_does(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A campaign of three candidates showed nothing for as long as its brake took."""
    path = make_campaign(tmp_path / "a.zarr", *SETTINGS, "opening.brake=3", "campaign.budget=2")
    design_at_the_end(path, mapper=here, quiet=True)
    assert capsys.readouterr().err == ""
    again = make_campaign(tmp_path / "b.zarr", *SETTINGS, "opening.brake=3", "campaign.budget=2")
    design_at_the_end(again, mapper=here)
    said = capsys.readouterr().err
    assert "designing how candidate" in said
    assert "a brake of 3 tries, on 60 switches" in said
    design_at_the_end(again, mapper=here)
    assert capsys.readouterr().err == "", "it is designed already"
