"""Claims about Python's way in: each function gives what its command gives, and shows it briefly."""

from __future__ import annotations

import json
import subprocess
import sys
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from campaigns import softclose
from small_campaigns import COARSE, make_campaign
from softclose.uncertainty.tolerance import DriveError
from softclose_store import StoreMissingError, open_campaign
from softclose_workflows import api
from stores import differences

EXAMPLE = Path(str(resources.files("softclose.population") / "shipped" / "example_measurements.csv"))


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> str:
    return make_campaign(tmp_path_factory.mktemp("api") / "a.zarr", *COARSE)


def test_a_run_from_python_is_the_commands_run_and_a_path_to_everything_else(store: str, tmp_path: Path) -> None:
    done = api.run("current", tmp_path / "b.zarr", settings=COARSE, serial=True)
    assert differences(Path(store), Path(done)) == []
    assert done.standing.finished
    assert done.campaign.committed == 8
    lines = repr(done).splitlines()
    assert lines[0] == f"current design, two pulses: 8 of 8 candidates in {tmp_path / 'b.zarr'}"
    assert lines[1].startswith(f"best: candidate {done.standing.best.candidate}, g ")
    assert "<strong>" in done._repr_html_()
    assert done.waveform.rows().tolist() == done.standing.best.waveform.tolist()
    api.resume(done, budget=10, serial=True)
    assert api.open_run(done).standing.committed == 10


def test_a_certificate_has_the_commands_numbers(store: str) -> None:
    found = api.certify(store, n_switches=300, top=2)
    told = json.loads(softclose("certify", store, "--switches", "300", "--top", "2", "--json").stdout)
    frame = found.to_frame()
    assert frame["g [cm/s]"].tolist()[0] == told["candidates"][0]["g_cm_s"]
    assert frame["design"].tolist()[:2] == [f"candidate {d['candidate']}" for d in told["candidates"]]
    assert found.value.n_switches == 300
    assert repr(found).startswith(f"{store} on 300 new switches\ndesign ")


def test_rescoring_tolerance_and_sensitivity_have_the_commands_numbers(store: str) -> None:
    found = api.rescore(store, ["level=0.8"])
    told = json.loads(softclose("rescore", store, "--level", "0.8", "--json").stdout)["candidates"]
    assert [r.candidate for r in found.value] == [c["candidate"] for c in told]
    assert [r["g [cm/s]"] for r in found.rows] == [c["g_cm_s"] for c in told]

    errors = api.tolerance(store, [DriveError(gain=0.01)], candidate=3, n_switches=500)
    said = json.loads(
        softclose("tolerance", store, "--gain", "0.01", "--candidate", "3", "--switches", "500", "--json").stdout
    )
    assert [r["generator"] for r in errors.rows] == [r["error"] for r in said["rows"]]
    assert [r["change of v_u [cm/s]"] for r in errors.rows] == [r["v_u_shift_cm_s"] for r in said["rows"]]

    shares = api.sensitivity(store, candidate=3, points=64, replicates=2)
    indices = json.loads(
        softclose("sensitivity", store, "--candidate", "3", "--points", "64", "--replicates", "2", "--json").stdout
    )["indices"]
    np.testing.assert_equal([r["by itself"] for r in shares.rows], [_number(i["first"]) for i in indices])


def _number(value: float | None) -> float:
    return float("nan") if value is None else value


def test_a_population_and_a_report_are_written_where_they_are_asked_for(store: str, tmp_path: Path) -> None:
    found = api.calibrate(EXAMPLE, tmp_path / "lot.toml", n_bootstrap=20)
    assert (tmp_path / "lot.toml").is_file()
    assert {row["variable"] for row in found.rows} == {"D", "G", "E", "T"}
    assert found.value.population.name == "lot"
    page = api.report(store, tmp_path / "a.html")
    assert page.read_text("utf-8").startswith("<!doctype html>")


def test_what_is_shown_is_short_and_safe(store: str) -> None:
    found = api.Result(
        value=None,
        title="<b>",
        rows=[{"name": f"<{i}>", "g [cm/s]": 12.345, "p": 0.01234, "none": float("nan")} for i in range(12)],
        notes=("see <there>",),
    )
    lines = repr(found).splitlines()
    assert lines[:3] == ["<b>", "name  g [cm/s]  p       none", "<0>   12.35     0.0123  –"]
    assert lines[-2:] == ["… and 2 more rows (to_frame())", "see <there>"]
    assert len(found.to_frame()) == 12
    shown = found._repr_html_()
    assert "<b>" not in shown
    assert "&lt;0&gt;" in shown
    assert repr(api.Result(value=None, title="nothing", rows=[])) == "nothing\n"


def test_there_is_no_run_where_there_is_no_store(tmp_path: Path) -> None:
    with pytest.raises(StoreMissingError):
        api.open_run(tmp_path / "none.zarr")


@pytest.mark.parametrize("name", api.__all__)
def test_every_name_of_the_facade_is_there(name: str) -> None:
    assert getattr(api, name).__doc__
    assert name in dir(api)
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = api.nothing


@pytest.mark.slow
def test_a_script_without_a_main_guard_is_told_what_it_lacks(tmp_path: Path) -> None:
    script = tmp_path / "mine.py"
    script.write_text(
        f"from softclose_workflows import api\napi.run('current', {str(tmp_path / 'a.zarr')!r}, workers=1)\n"
    )
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 1
    assert 'put its calls under `if __name__ == "__main__":`' in done.stderr
    assert "no cluster of 1 workers starts" in done.stderr
    assert not (tmp_path / "a.zarr").exists()


def test_a_store_that_grows_shows_what_it_has(tmp_path: Path) -> None:
    path = make_campaign(tmp_path / "a.zarr", *COARSE, run=False)
    run = api.open_run(path)
    assert repr(run) == f"current design, two pulses: 0 of 8 candidates in {path}"
    with pytest.raises(ValueError, match="no usable candidate yet"):
        _ = run.waveform
    assert open_campaign(path).committed == 0
