"""Claims about `softclose assess`: a recorded drive on a lot, beside a campaign's best, and kept with it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from small_campaigns import COARSE, make_campaign
from softclose.waveform import WaveformError, read_trace
from softclose_store import read_group, verify
from softclose_workflows import api
from softclose_workflows.analyses.assessed_trace import assess_trace
from softclose_workflows.analyses.certify import certify
from softclose_workflows.cli import main


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> str:
    return make_campaign(tmp_path_factory.mktemp("assess") / "a.zarr", *COARSE)


@pytest.fixture(scope="module")
def exported(store: str, tmp_path_factory: pytest.TempPathFactory) -> str:
    file = tmp_path_factory.mktemp("exported") / "best.csv"
    done = CliRunner().invoke(main, ["export", store, "waveform", "-o", str(file)])
    assert done.exit_code == 0, done.output
    return str(file)


def _assess(*arguments: str, code: int = 0) -> str:
    done = CliRunner().invoke(main, ["assess", *arguments, "-q"])
    assert done.exit_code == code, done.output
    return done.output


def test_what_is_exported_comes_back_as_what_it_was(store: str, exported: str) -> None:
    """Within the quantisation of the file: samples of 0.1 µs."""
    found = json.loads(_assess(store, exported, "--switches", "4000", "--json"))
    against = found["against_best"]
    assert abs(against["v_u_cm_s"]) < 0.02
    assert against["p_nc"] == pytest.approx(0.0, abs=5e-4)
    assert found["assessment"]["v_u_cm_s"] == pytest.approx(found["best_assessment"]["v_u_cm_s"], abs=0.02)


def test_the_switches_are_those_of_a_certificate(store: str, exported: str) -> None:
    found = assess_trace(store, read_trace(exported), n_switches=1500, seed=5)
    certificate = certify(store, n_switches=1500, seed=5, top=1)
    assert found.best is not None
    assert found.best.candidate == certificate.best.candidate
    assert found.best_assessment is not None
    assert repr(found.best_assessment) == repr(certificate.best.assessment)
    np.testing.assert_allclose(
        found.response.max_contact_speed, certificate.best.response.max_contact_speed, atol=2e-4, equal_nan=True
    )


def test_a_preset_has_a_lot_but_no_best(exported: str) -> None:
    found = json.loads(_assess("current", exported, "--switches", "3000", "--json"))
    assert found["against_best"] is None
    assert found["assessment"]["n"] == 3000
    assert "against" not in _assess("current", exported, "--switches", "3000")


def test_another_amplitude_is_another_result_and_is_kept_with_the_campaign(store: str, exported: str) -> None:
    told = _assess(store, exported, "--switches", "2000", "--scale", "1.05", "--keep", "five-percent")
    assert "against candidate" in told
    assert "kept as traces/five-percent" in told
    group = read_group(store, "traces/five-percent")
    assert group.arrays["volts"].max() == pytest.approx(1.05 * read_trace(exported).volts.max(), rel=1e-3)
    again = assess_trace(store, read_trace(exported, scale=1.05), n_switches=2000)
    np.testing.assert_array_equal(group.arrays["max_contact_speed"], again.response.max_contact_speed)
    assert group.attributes["assessment"]["v_u_cm_s"] == again.assessment.v_u_cm_s
    assert abs(again.comparison.v_u_cm_s) > 0.1  # type: ignore[union-attr]
    assert verify(store).ok
    assert "has a group traces/five-percent already" in _assess(
        store, exported, "--switches", "2000", "--keep", "five-percent", code=2
    )


def test_lines_that_are_left_out_change_nothing_that_is_shown(store: str, exported: str) -> None:
    few, all_ = (
        json.loads(_assess(store, exported, "--switches", "2000", "--tolerance", t, "--json")) for t in ("0.001", "0")
    )
    assert few["n_samples"] < 0.5 * all_["n_samples"]
    assert few["assessment"]["v_u_cm_s"] == pytest.approx(all_["assessment"]["v_u_cm_s"], abs=1e-3)


def test_a_bad_file_is_one_error(store: str, tmp_path: Path) -> None:
    file = tmp_path / "bad.csv"
    file.write_text("time_us,volts\n0,0\n1,oops\n")
    assert "line 3" in _assess(store, str(file), code=2)


def _step(file: Path, volts: float, *, unit: str = "V", time: str = "us", scale: float = 1.0) -> str:
    file.write_text(
        f"time_{time},volts_{unit}\n" + "".join(f"{t * scale},{volts if t else 0}\n" for t in (0, 1, 9, 240))
    )
    return str(file)


def test_a_monitor_output_is_asked_for_its_scale(store: str, tmp_path: Path) -> None:
    """A thousandth of the drive, in mV: what closes nothing is another quantity, unless the user says not."""
    file = _step(tmp_path / "m.csv", 100.0, unit="mV")
    told = _assess(store, file, "--switches", "500", code=2)
    assert "reaches 0.1 V within 250 µs, and the mean switch pulls in at" in told
    assert "--scale 1000" in told
    found = json.loads(_assess(store, file, "--switches", "500", "--scale", "1000", "--json"))
    assert found["max_volts"] == pytest.approx(100.0)
    assert "scaled by 1000" in found["read"][0]
    assert json.loads(_assess(store, file, "--switches", "500", "--scale", "1", "--json"))["assessment"]["p_nc"] == 1.0


def test_a_drive_above_the_limit_is_refused_unless_it_is_said(store: str, tmp_path: Path) -> None:
    file = _step(tmp_path / "high.csv", 160.0)
    told = _assess(store, file, "--switches", "500", code=2)
    assert "reaches 160 V within 250 µs; 150 V are allowed" in told
    assert "--max-volts 160" in told
    found = json.loads(_assess(store, file, "--switches", "500", "--max-volts", "160", "--json"))
    assert found["max_volts"] == pytest.approx(160.0)
    assert "140000 V" in _assess(store, _step(tmp_path / "mV.csv", 140e3), "--switches", "500", code=2)


def test_from_python_a_record_is_scaled_and_said_to_be_the_drive(store: str, tmp_path: Path) -> None:
    file = _step(tmp_path / "m.csv", 100.0, unit="mV")
    with pytest.raises(WaveformError, match="scale=1000"):
        api.assess(store, file, n_switches=500)
    found = api.assess(store, file, n_switches=500, scale=1000.0)
    command = json.loads(_assess(store, file, "--switches", "500", "--scale", "1000", "--json"))
    assert found.value.assessment.v_u_cm_s == pytest.approx(command["assessment"]["v_u_cm_s"], abs=1e-3)
    assert list(found.notes[: len(command["read"])]) == command["read"]
    assert api.assess(store, file, n_switches=500, scale=1.0).value.assessment.p_nc == 1.0
    drawn = api.assess(store, read_trace(file), n_switches=500, scale=1000.0)
    assert drawn.value.assessment.v_u_cm_s == found.value.assessment.v_u_cm_s
    with pytest.raises(WaveformError, match="max_volts"):
        api.assess(store, file, n_switches=500, scale=1600.0)
    assert api.assess(store, file, n_switches=500, scale=1600.0, max_volts=160.0).value.assessment.p_nc < 1.0


def test_instants_of_another_unit_reach_no_lot(store: str, tmp_path: Path) -> None:
    """µs that are called ms: a quarter of the first interval lies within the horizon, and no volts with it."""
    assert "nothing would close" in _assess(store, _step(tmp_path / "ms.csv", 100.0, time="ms"), code=2)
    assert "in which no switch moves" in _assess(store, _step(tmp_path / "s.csv", 100.0, scale=1e-6), code=2)
    assert "another unit" in _assess(store, _step(tmp_path / "us.csv", 100.0, time="s"), code=2)


def test_columns_are_named_and_what_was_read_is_said(store: str, tmp_path: Path) -> None:
    file = tmp_path / "two.csv"
    file.write_text("t;U1;U2\n0;0;0\n5;1,5;90,5\n240;1,5;90,5\n")
    assert "--columns" in _assess(store, str(file), code=2)
    told = _assess(store, str(file), "--columns", "time_us=t,volts_V=U2", "--switches", "500")
    assert "UTF-8, semicolons, decimal commas, heading in line 1; 3 samples from 0 to 240 µs, 0 to 90.5 V" in told
    assert "instants [us] from 't', voltages [V] from 'U2'" in told
