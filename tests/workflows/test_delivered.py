"""Claims about exports: a file that no longer is the waveform is refused, with the error that was computed."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from small_campaigns import COARSE, make_campaign
from softclose.settings import load_config
from softclose.waveform import Pulse, Waveform
from softclose_workflows.cli import main
from softclose_workflows.errors import ExportError
from softclose_workflows.exports.delivered import check_delivered

CONFIG = load_config("current")
TWO = Waveform([Pulse(0.0, 4.0, 3.1, 138.0), Pulse(20.0, 5.0, np.inf, 80.0)])


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> str:
    return make_campaign(tmp_path_factory.mktemp("delivered") / "a.zarr", *COARSE, 'campaign.name="x\\n.control"')


def _samples(rate: float, duration: float) -> tuple[np.ndarray, np.ndarray]:
    t = np.arange(int(rate * duration) + 1) / rate
    return t, TWO.voltage(t)


@pytest.mark.parametrize(("rate", "duration"), [(0.1, 250.0), (0.05, 250.0), (10.0, 5.0), (10.0, 21.0), (1.0, 0.5)])
def test_samples_that_lose_the_waveform_are_refused(rate: float, duration: float) -> None:
    with pytest.raises(ExportError, match=r"V away from the waveform: v_u would be .* in the place of .*--rate") as e:
        check_delivered(CONFIG, TWO, *_samples(rate, duration), most_cm_s=0.5)
    assert "nan" not in str(e.value)


@pytest.mark.parametrize(("rate", "duration"), [(10.0, 250.0), (10.0, 30.0), (2.0, 250.0)])
def test_samples_that_keep_it_are_not(rate: float, duration: float) -> None:
    check_delivered(CONFIG, TWO, *_samples(rate, duration), most_cm_s=0.5)


def test_what_is_allowed_is_the_user_s() -> None:
    t, u = _samples(10.0, 250.0)
    with pytest.raises(ExportError, match=r"at most 0\.001 cm/s"):
        check_delivered(CONFIG, TWO, t, 1.01 * u, most_cm_s=1e-3)
    check_delivered(CONFIG, TWO, t, 1.01 * u, most_cm_s=20.0)


def test_a_simulator_of_one_s_own_is_not_asked() -> None:
    """There the voltage itself is compared: a simulation may take an hour."""
    bench = load_config("current", ["model.name=measured"])
    check_delivered(bench, TWO, *_samples(10.0, 250.0), most_cm_s=0.5)
    with pytest.raises(ExportError, match="V away from the waveform: raise the rate"):
        check_delivered(bench, TWO, *_samples(0.1, 250.0), most_cm_s=0.5)


FORMS = (
    ["--format", "csv"],
    ["--format", "dac", "--full-scale", "200", "--bits", "14"],
    ["--format", "keysight-arb", "--gain", "20"],
    ["--format", "tektronix-tfw", "--gain", "20"],
)


@pytest.mark.parametrize("form", FORMS, ids=lambda f: f[1])
def test_every_format_is_checked(form: list[str], store: str, tmp_path: Path) -> None:
    out = tmp_path / "drive"
    done = CliRunner().invoke(main, ["export", store, "waveform", *form, "--rate", "0.1", "-o", str(out)])
    assert (done.exit_code, list(tmp_path.iterdir())) == (2, []), done.output
    assert "V away from the waveform" in done.output
    done = CliRunner().invoke(main, ["export", store, "waveform", *form, "-o", str(out)])
    assert done.exit_code == 0, done.output


def test_a_name_is_one_comment_of_a_netlist(store: str) -> None:
    """ngspice runs what stands between .control and .endc, shell commands among it."""
    for form in (["pwl"], ["dac", "--full-scale", "200"]):
        done = CliRunner().invoke(main, ["export", store, "waveform", "--format", *form])
        assert done.exit_code == 0, done.output
        assert "x\\n.control" in done.output
        assert re.search(r"^\.control", done.output, re.MULTILINE) is None
