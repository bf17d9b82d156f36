"""Claims about trimmed campaigns: every command knows the scales, and the test floor gets them."""

from __future__ import annotations

import csv
import io
import json

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.testing import assert_allclose, assert_array_equal

from softclose import Waveform
from softclose.conditions.trim import trim_of
from softclose.evaluate import draw, evaluate, judge, respond
from softclose.evaluate.chain import chain_of
from softclose.evaluate.respond import drives_of
from softclose.population.lot import Lot
from softclose.settings import CampaignConfig, load_config
from softclose_store import open_campaign, verify
from softclose_workflows import api
from softclose_workflows.analyses.certify import certify, fresh_switches
from softclose_workflows.cli import main
from softclose_workflows.report.gather import gather
from softclose_workflows.report.page import render_report
from softclose_workflows.studies.study_file import load_study

SETTINGS = (
    "campaign.budget=6",
    "prior.model=none",
    "explore.budget=0",
    "finish.budget=0",
    "optimiser.engine=sobol",
    "population.n_switches=64",
    "population.sampling=monte-carlo",
    "store.n_times=11",
    "waveform.space=two-pulse-full",
)


def scales_of(config, campaign, i):
    """(n,) voltage and time scales that the training switches are given under a candidate."""
    drives = drives_of(chain_of(config), Lot(campaign.population()), Waveform.from_rows(campaign.waveform(i)))
    return drives.volts, drives.times


def made(path, *settings):
    api.run("current-trim", path, settings=[*SETTINGS, *settings], serial=True)
    return path


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    """Six candidates, trimmed by both quantities. Read it only."""
    path = made(tmp_path_factory.mktemp("trim") / "a.zarr")
    certify(str(path), n_switches=200, seed=None, top=2)
    return path


def invoke(*words):
    return CliRunner().invoke(main, [str(w) for w in words])


def table(text):
    return list(csv.DictReader(io.StringIO(text)))


def test_the_store_holds_the_scales_and_the_responses_to_the_scaled_drives(store):
    campaign = open_campaign(store)
    config = CampaignConfig.from_dict(campaign.config)
    lot = draw(config, 64, seed=config.campaign.seed)
    stored = campaign.population()
    assert [*stored] == [*lot]
    for name in lot:
        assert_array_equal(stored[name], lot[name], name)
    assert {"voltage_scale", "time_scale", "measured_pull_in", "measured_resonance"} < {*stored}
    waveform = Waveform.from_rows(campaign.waveform(2))
    expected = respond(config, lot, waveform)
    assert_array_equal(campaign.responses(2).max_contact_speed, expected.max_contact_speed)
    untrimmed = respond(config, lot, waveform, for_everybody=True)
    assert (np.nan_to_num(untrimmed.max_contact_speed) != np.nan_to_num(expected.max_contact_speed)).mean() > 0.5


def test_a_trimmed_store_verifies_and_can_be_replayed(store):
    assert verify(store).ok
    assert invoke("verify", store, "--replay", "2").exit_code == 0


def test_a_campaign_that_measures_nothing_stores_no_scales(tmp_path):
    campaign = open_campaign(made(tmp_path / "b.zarr", "trim.measured=nothing"))
    assert [*campaign.population()] == [*"DGETKM"]


def test_certificates_trim_candidates_and_leave_the_reference_designs_as_they_are(store):
    found = certify(str(store), n_switches=200, seed=None, top=2)
    config = load_config("current-trim", SETTINGS)
    unshaped = next(r for r in found.references if r.name == "unshaped")
    fresh = fresh_switches(config, 200, seed=found.seed)
    assert found.best.assessment.v_u_cm_s == evaluate(config, fresh, found.best.waveform, fresh=True).v_u_cm_s
    alike = respond(config, fresh, unshaped.waveform, for_everybody=True)
    assert unshaped.assessment.v_u_cm_s == judge(config, alike, fresh=True).v_u_cm_s
    plain = load_config("current", SETTINGS)
    assert unshaped.assessment.v_u_cm_s == evaluate(plain, fresh.switches, unshaped.waveform, fresh=True).v_u_cm_s


# The test floor.


def test_a_table_of_devices_has_the_scales_of_the_campaign_s_own_switches(store, tmp_path):
    """Measured values of the training switches give the very scales of the store, within the drive's limits."""
    campaign = open_campaign(store)
    config = CampaignConfig.from_dict(campaign.config)
    population = campaign.population()
    measured = np.column_stack([population["measured_pull_in"], population["measured_resonance"]])
    devices = tmp_path / "devices.csv"
    lines = [f"S{i};{v!r};{f!r}".replace(".", ",") for i, (v, f) in enumerate(measured.tolist())]
    devices.write_text("device;pull_in_V;resonance_kHz\n" + "\n".join(lines) + "\n")
    done = invoke("export", store, "trim", "--candidate", 2, "--devices", devices)
    assert done.exit_code == 0, done.output
    rows = table(done.stdout)
    voltage, time = scales_of(config, campaign, 2)
    assert [row["device"] for row in rows] == [f"S{i}" for i in range(64)]
    assert_allclose([float(row["voltage_scale"]) for row in rows], voltage, atol=1e-6)
    assert_allclose([float(row["time_scale"]) for row in rows], time, atol=1e-6)
    at_limit = (voltage != population["voltage_scale"]) | (time != population["time_scale"])
    assert_array_equal([row["at_a_limit"] == "1" for row in rows], at_limit)
    assert at_limit.any()
    assert not at_limit.all()


def test_a_table_covers_the_lot_and_bins_have_one_row_each(store, tmp_path):
    rows = table(invoke("export", store, "trim", "--rows", 5).stdout)
    assert len(rows) == 25
    volts = [float(row["pull_in_V"]) for row in rows]
    assert min(volts) < 55.0
    assert max(volts) > 105.0
    binned = made(tmp_path / "b.zarr", "trim.measured=pull-in", "trim.bins=7")
    rows = table(invoke("export", binned, "trim").stdout)
    assert list(rows[0]) == ["pull_in_V", "voltage_scale", "time_scale", "at_a_limit"]
    assert len(rows) == 7


def test_the_waveform_of_one_switch_is_the_scaled_one(store, tmp_path):
    config = CampaignConfig.from_dict(open_campaign(store).config)
    common = Waveform.from_rows(open_campaign(store).waveform(3))
    done = invoke(
        "export", store, "waveform", "--candidate", 3, "--pull-in", 70, "--resonance", 21, "-o", tmp_path / "w.csv"
    )
    assert done.exit_code == 0, done.output
    scales = trim_of(config.trim, chain_of(config).around).scales([[70.0, 21.0]])
    assert "volts × 0.8" in done.stderr
    drive = np.loadtxt(tmp_path / "w.csv", delimiter=",", skiprows=1)
    expected = scales.volts[0] * common.voltage(drive[:, 0] / scales.times[0])
    assert_allclose(drive[:, 1], expected, atol=1e-5)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["waveform", "--pull-in", 70], "--resonance is missing; this campaign measures pull-in and resonance: give"),
        (["waveform", "--pull-in", 70, "--resonance", 21000], "resonance is 21000, but the mean switch"),
        (["waveform", "--pull-in", -1, "--resonance", 21], "pull-in voltage is -1; it must be above 0"),
    ],
)
def test_what_was_not_measured_or_cannot_be_is_refused(store, words, said):
    done = invoke("export", store, *words)
    assert done.exit_code == 2
    assert said in done.output


def test_devices_in_other_units_or_without_a_column_are_refused(store, tmp_path):
    devices = tmp_path / "devices.csv"
    for text, said in (
        ("pull_in_V,resonance_kHz\n70,21000\n", "resonance_kHz is 21000; expected 0.1–10000 kHz: are these Hz?"),
        ("pull_in_V,frequency\n70,21\n", "no column 'resonance_kHz'"),
        ("pull_in_V,resonance_kHz\n", "nothing stands below the heading"),
    ):
        devices.write_text(text)
        done = invoke("export", store, "trim", "--devices", devices)
        assert done.exit_code == 2
        assert said in done.output


def test_a_campaign_without_trim_has_no_table(tmp_path):
    plain = made(tmp_path / "b.zarr", "trim.measured=nothing")
    for words in (["trim"], ["waveform", "--pull-in", 70]):
        done = invoke("export", plain, *words)
        assert done.exit_code == 2
        assert "this campaign drives every switch alike" in done.output


# What people look at.


def test_the_report_shows_what_trim_brings(store):
    data = gather(str(store))
    config = data.config
    campaign = open_campaign(store)
    lot, best = Lot(campaign.population()), data.best_design
    plain = evaluate(load_config("current", SETTINGS), campaign.switches(), best.waveform)
    assert data.sections["trim"].untrimmed.assessment.v_u_cm_s == plain.v_u_cm_s
    voltage, time = scales_of(config, campaign, campaign.best().candidate)
    assert_array_equal(data.sections["trim"].voltage, voltage)
    assert_array_equal(data.sections["trim"].time, time)
    limited = (voltage != lot["voltage_scale"]) | (time != lot["time_scale"])
    assert data.sections["trim"].n_limited == int(limited.sum())
    page = render_report(data)
    assert 'id="trim"' in page
    assert "trim-scales" in page
    assert set(data.parameters) == set("DGETKM")


def test_the_report_of_a_campaign_without_trim_has_no_such_section(tmp_path):
    page = render_report(gather(str(made(tmp_path / "b.zarr", "trim.measured=nothing"))))
    assert 'id="trim"' not in page


def test_a_study_sets_both_errors_together_and_its_figure_compares(store, tmp_path):
    members = load_study("trim-error", SETTINGS).members()
    assert [m.config.trim.pull_in_error for m in members] == [m.config.trim.resonance_error for m in members]
    assert len({m.config.trim.pull_in_error for m in members}) == len(members)
    study = tmp_path / "s.toml"
    pairs = [setting.split("=") for setting in SETTINGS]
    sets = "\n".join(f"{key} = {value if value.isdigit() else json.dumps(value)}" for key, value in pairs)
    study.write_text(
        'name = "t"\nbase = "current-trim"\nparameter = "trim.error"\nvalues = [0.0, 0.05]\n[set]\n' + sets + "\n"
    )
    figure = tmp_path / "worth.svg"
    words = ["--out", tmp_path / "out", "--switches", 200, "--top", 1, "--serial", "-q", "--figure", figure]
    done = invoke("study", study, *words, "--beside", store)
    assert done.exit_code == 0, done.output
    text = figure.read_text()
    assert text.startswith("<?xml")
    assert len(text) > 5000


def test_a_store_that_is_not_certified_is_no_comparison(tmp_path):
    plain = made(tmp_path / "b.zarr")
    done = invoke("study", "trim-error", "--out", tmp_path / "o", "--figure", tmp_path / "f.svg", "--beside", plain)
    assert done.exit_code == 2
    assert "is not certified: softclose certify" in done.output
    assert not (tmp_path / "o").exists()


def test_lowering_the_error_of_measurement_lands_softer(tmp_path):
    """The whole chain: sampled, scaled, simulated, certified."""
    g = []
    for error in (0.0, 0.2):
        settings = [f"trim.pull_in_error={error}", f"trim.resonance_error={error}", "population.n_switches=128"]
        path = made(
            tmp_path / f"{error}.zarr",
            *settings,
            "campaign.budget=40",
            "prior.model=none",
        )
        g.append(open_campaign(path).best().g_cm_s)
    assert g[0] < g[1]


def test_devices_known_by_their_contact_times_get_the_scales_of_the_campaign(tmp_path):
    path = made(tmp_path / "c.zarr", "trim.measured=contact times")
    campaign = open_campaign(path)
    config = CampaignConfig.from_dict(campaign.config)
    population = campaign.population()
    told = np.column_stack([population["threshold"], population["contact_time"]])
    devices = tmp_path / "devices.csv"
    lines = [f"{volts!r},{time!r}" for volts, time in told.tolist()]
    devices.write_text("threshold_V,contact_time_us\n" + "\n".join(lines) + "\n")
    done = invoke("export", path, "trim", "--candidate", 2, "--devices", devices)
    assert done.exit_code == 0, done.output
    voltage, time = scales_of(config, campaign, 2)
    rows = table(done.stdout)
    assert_allclose([float(row["voltage_scale"]) for row in rows], voltage, atol=1e-6)
    assert_allclose([float(row["time_scale"]) for row in rows], time, atol=1e-6)
    grid = table(invoke("export", path, "trim", "--rows", 4).stdout)
    assert len(grid) == 16
    done = invoke("export", path, "waveform", "--pull-in", 70)
    assert done.exit_code == 2
    assert "columns threshold_V and contact_time_us" in done.output
