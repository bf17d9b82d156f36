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
from softclose.conditions.learning import actuate
from softclose.evaluate import draw, drive_scales, evaluate, learn, respond, touch_of
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
    "explore.budget=0",
    "finish.budget=0",
    "optimiser.engine=sobol",
    "population.n_switches=64",
    "population.sampling=monte-carlo",
    "store.n_times=11",
    "waveform.space=two-pulse-full",
)


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
    assert_array_equal(campaign.lot(), lot)
    assert_array_equal(campaign.population()["time_scale"], lot[:, 5])
    waveform = Waveform.from_rows(campaign.waveform(2))
    expected = respond(config, lot, waveform)
    assert_array_equal(campaign.responses(2).max_contact_speed, expected.max_contact_speed)
    untrimmed = respond(config, lot[:, :4], waveform)
    assert (np.nan_to_num(untrimmed.max_contact_speed) != np.nan_to_num(expected.max_contact_speed)).mean() > 0.5


def test_a_trimmed_store_verifies_and_can_be_replayed(store):
    assert verify(store).ok
    assert invoke("verify", store, "--replay", "2").exit_code == 0


def test_a_campaign_that_measures_nothing_stores_scales_of_one(tmp_path):
    campaign = open_campaign(made(tmp_path / "b.zarr", "trim.measured=nothing"))
    assert_array_equal(campaign.lot()[:, 4:], 1.0)


def test_certificates_trim_candidates_and_leave_the_reference_designs_as_they_are(store):
    found = certify(str(store), n_switches=200, seed=None, top=2)
    config = load_config("current-trim", SETTINGS)
    unshaped = next(r for r in found.references if r.name == "unshaped")
    fresh = fresh_switches(config, 200, seed=found.seed)
    assert fresh.shape == (200, 6)
    assert found.best.assessment.v_u_cm_s == evaluate(config, fresh, found.best.waveform, fresh=True).v_u_cm_s
    assert unshaped.assessment.v_u_cm_s == evaluate(config, fresh[:, :4], unshaped.waveform, fresh=True).v_u_cm_s


# The test floor.


def test_a_table_of_devices_has_the_scales_of_the_campaign_s_own_switches(store, tmp_path):
    """Measured values of the training switches give the very scales of the store, within the drive's limits."""
    campaign = open_campaign(store)
    config = CampaignConfig.from_dict(campaign.config)
    trim = config.build_trim()
    measured = trim.measure(campaign.switches(), seed=config.campaign.seed)
    devices = tmp_path / "devices.csv"
    lines = [f"S{i};{v!r};{f!r}".replace(".", ",") for i, (v, f) in enumerate(measured.tolist())]
    devices.write_text("device;pull_in_V;resonance_kHz\n" + "\n".join(lines) + "\n")
    done = invoke("export", store, "trim", "--candidate", 2, "--devices", devices)
    assert done.exit_code == 0, done.output
    rows = table(done.stdout)
    scales = drive_scales(config, campaign.lot(), Waveform.from_rows(campaign.waveform(2)))
    assert [row["device"] for row in rows] == [f"S{i}" for i in range(64)]
    assert_allclose([float(row["voltage_scale"]) for row in rows], scales.voltage, atol=1e-6)
    assert_allclose([float(row["time_scale"]) for row in rows], scales.time, atol=1e-6)
    at_limit = (scales.voltage != campaign.lot()[:, 4]) | (scales.time != campaign.lot()[:, 5])
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
    scales = config.build_trim().scales([[70.0, 21.0]])
    assert "volts × 0.8" in done.stderr
    drive = np.loadtxt(tmp_path / "w.csv", delimiter=",", skiprows=1)
    expected = scales.voltage[0] * common.voltage(drive[:, 0] / scales.time[0])
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
    lot = open_campaign(store).lot()
    best = data.best_design
    plain = evaluate(config, lot[:, :4], best.waveform)
    assert data.trim.untrimmed.assessment.v_u_cm_s == plain.v_u_cm_s
    assert_array_equal(data.trim.voltage, drive_scales(config, lot, best.waveform).voltage)
    assert data.trim.n_limited == int(((data.trim.voltage != lot[:, 4]) | (data.trim.time != lot[:, 5])).sum())
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
        )
        g.append(open_campaign(path).best().g_cm_s)
    assert g[0] < g[1]


def test_devices_known_by_their_contact_times_get_the_scales_of_the_campaign(tmp_path):
    path = made(tmp_path / "c.zarr", "trim.measured=contact times")
    campaign = open_campaign(path)
    config = CampaignConfig.from_dict(campaign.config)
    told = actuate(touch_of(config), campaign.switches(), learn(config).protocol, seed=config.campaign.seed)
    devices = tmp_path / "devices.csv"
    lines = [f"{volts!r},{time!r}" for volts, time in told.tolist()]
    devices.write_text("threshold_V,contact_time_us\n" + "\n".join(lines) + "\n")
    done = invoke("export", path, "trim", "--candidate", 2, "--devices", devices)
    assert done.exit_code == 0, done.output
    scales = drive_scales(config, campaign.lot(), Waveform.from_rows(campaign.waveform(2)))
    rows = table(done.stdout)
    assert_allclose([float(row["voltage_scale"]) for row in rows], scales.voltage, atol=1e-6)
    assert_allclose([float(row["time_scale"]) for row in rows], scales.time, atol=1e-6)
    grid = table(invoke("export", path, "trim", "--rows", 4).stdout)
    assert len(grid) == 16
    done = invoke("export", path, "waveform", "--pull-in", 70)
    assert done.exit_code == 2
    assert "columns threshold_V and contact_time_us" in done.output
