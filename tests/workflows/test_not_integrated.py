"""Claims about switches that could not be integrated: they stand beside p_nc wherever it is told, and make no best."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from softclose import Pulse, Waveform, assess, load_config
from softclose.conditions.streams import Ensemble
from softclose.device.status import Status, not_integrated, reasons
from softclose.evaluate import draw, respond
from softclose.metrics.objective import Judged
from softclose.settings import ConfigError
from softclose.uncertainty.sensitivity import SensitivityError, sensitivity
from softclose.uncertainty.tails import tail
from softclose_store import Best, open_campaign
from softclose_workflows.analyses.forewarned import forewarnings
from softclose_workflows.cli import main
from softclose_workflows.run.records import assessment_record
from softclose_workflows.tell.standing import Standing, best_to_json
from softclose_workflows.tell.tables import metrics_row, print_standing, share_open

PLATE = """
name = "plate on a soft contact"
plate_area_um2 = 10353.5
[D]
distribution = "uniform"
lower = 2.574
upper = 2.626
[G]
distribution = "uniform"
lower = 3.781
upper = 3.819
[K]
distribution = "uniform"
lower = 40.74
upper = 43.26
[f]
distribution = "uniform"
lower = 20.8
upper = 21.2
"""
SOFT = """
[[mode]]
frequency_kHz = 21.0
quality_factor = 25.0
[contact]
force_at_1_um_uN = 312.4
exponent = 1.0
loss_us_per_um = 2.367
"""
DESIGN = """
[campaign]
name = "soft contact"
budget = 4
[population]
name = "lot.toml"
n_switches = 20
[model]
name = "reduced-order"
modes = "soft.toml"
[waveform]
max_volts = 120.0
[objective] # its step closes too few switches to scale prices with the lot
c1_cm_s = 25.0
undefined_v_u_cm_s = 60.0
chance_penalty_cm_s = 500.0
limits_cm_s = [19.7]
[optimiser]
engine = "sobol"
[explore]
budget = 0
[finish]
budget = 0
[store]
n_times = 11
"""


def test_prices_that_cannot_be_scaled_are_asked_for_and_it_is_said_why(tmp_path: Path) -> None:
    """More voltage would not help a lot that is pulled through its contact."""
    unpriced = "\n".join(line for line in DESIGN.splitlines() if "_cm_s" not in line and "[objective]" not in line)
    for name, text in (("lot.toml", PLATE), ("soft.toml", SOFT), ("design.toml", unpriced)):
        (tmp_path / name).write_text(text)
    with pytest.raises(
        ConfigError, match=r"\(4,0\d\d of 4,096 .*collapsed onto.*\): give .*or lower waveform.max_volts"
    ):
        load_config(str(tmp_path / "design.toml"))
    low = {"population": {"name": "current"}, "waveform": {"max_volts": 20.0}}
    with pytest.raises(ConfigError, match=r"with the lot: give .* or raise waveform.max_volts or model.horizon_us"):
        load_config(low)


@pytest.fixture
def pulled_through(tmp_path: Path) -> Path:
    """The folder of a design whose lot is pulled through its contact."""
    for name, text in (("lot.toml", PLATE), ("soft.toml", SOFT), ("design.toml", DESIGN)):
        (tmp_path / name).write_text(text)
    (tmp_path / "step.csv").write_text("t_us,V\n0,0\n0.05,95\n250,95\n")
    return tmp_path


@pytest.mark.long
def test_a_lot_that_is_pulled_through_its_contact_names_no_best(pulled_through: Path) -> None:
    store, runner = str(pulled_through / "a.zarr"), CliRunner()
    done = runner.invoke(main, ["run", str(pulled_through / "design.toml"), "--store", store, "--serial", "--quiet"])
    assert done.exit_code in (0, 1, 3), done.output
    assert "its contact, until its electrode collapses" in done.stderr
    campaign = open_campaign(store)
    records = campaign.records()
    gone = records["n_failed_switches"] > 1
    assert gone.any()
    assert records["failed"][gone].all()
    assert np.isnan(records["g_cm_s"][gone]).all()
    assert "20 of 20 switches could not be integrated: 20 collapsed" in " ".join(map(str, records["failure"]))
    best = campaign.best()
    assert best is None or best.record["n_failed_switches"] <= 1


def test_a_drive_that_pulls_a_lot_through_its_contact_has_no_value(pulled_through: Path) -> None:
    asked = ["assess", *(str(pulled_through / name) for name in ("design.toml", "step.csv")), "--switches", "40"]
    told = CliRunner().invoke(main, asked)
    assert told.exit_code == 0, told.output
    assert "40 not integrated" in told.stdout
    said = json.loads(CliRunner().invoke(main, [*asked, "--json"]).stdout)
    assert '"g_cm_s": null' in json.dumps(said)


def test_it_stands_beside_p_nc_in_every_table(capsys: pytest.CaptureFixture[str]) -> None:
    status = np.zeros(100, dtype=np.int8)
    status[:3] = Status.COLLAPSED
    made = Judged(max_contact_speed=np.linspace(0.1, 0.2, 100), closed=np.ones(100, dtype=bool), status=status)
    record = assessment_record(assess(made))
    assert "3 not integrated" in metrics_row(record)[2]
    assert "not integrated" not in share_open(0.1, (0.05, 0.2), 0)
    best = Best(
        candidate=4,
        g_cm_s=15.0,
        v_u_cm_s=14.0,
        mean_cm_s=9.0,
        p_nc=0.03,
        n_switches=100,
        waveform=np.array([[0.0, 4.0, np.inf, 100.0]]),
        record=record,
    )
    standing = Standing(
        store="a.zarr", name="a", committed=5, budget=9, failed=0, fallbacks=0, reason="", best=best, limit=None
    )
    print_standing(standing)
    assert "3 of 100 switches could not be integrated" in capsys.readouterr().out
    assert best_to_json(best)["n_failed"] == 3


def test_reasons_are_counted_and_named() -> None:
    assert reasons([0, 0]) == not_integrated(0, 5) == ""
    each = "2 collapsed onto the counter-electrode, 1 left the table of capacitance"
    assert reasons([0, 2, 2, 3]) == f"3 of 4 switches could not be integrated: {each}"
    assert "1 ended with status 9" in reasons([0, 9])


BRIDGE = """
[[mode]]
frequency_kHz = 61.0
mass_ug = 0.064
electrode = 0.8
[[mode]]
frequency_kHz = 240.0
mass_ug = 0.07
contact = -0.5
electrode = 0.3
"""


def test_tails_and_sensitivity_take_no_failed_switch_for_an_answer(tmp_path: Path) -> None:
    """Brute force counts it as open, and says how many; variance has no shares of what is not known."""
    modes = tmp_path / "bridge.toml"
    modes.write_text(BRIDGE)
    config = load_config("current", ["model.name=reduced-order", f"model.modes={modes}"])
    drive = Waveform([Pulse(0.0, 4.0, math.inf, 135.0)])
    lot = draw(config, 400, seed=5, ensemble=Ensemble.TAIL)
    found = respond(config, lot, drive)
    failed = int((found.status != Status.OK).sum())
    assert 0 < failed < 200
    for event in ("open", "fast"):
        (row,) = tail(config, drive, event, limit_cm_s=1e-3, methods=("brute",), n_switches=400, seed=5)
        assert f"{failed} of 400 switches could not be integrated" in row.note
        expected = (~found.closed).mean() if event == "open" else np.isfinite(found.max_contact_speed).mean()
        assert row.probability == pytest.approx(expected)
    with pytest.raises(SensitivityError, match="could not be integrated"):
        sensitivity(config.build_population(), drive, config=config, n=64, n_replicates=2)


def test_what_may_end_a_switch_is_said_before_the_run(tmp_path: Path) -> None:
    modes = tmp_path / "modes.toml"
    x = [round(-0.5 + 0.25 * i, 2) for i in range(14)]
    c = [round(147.9 / (3.68 - v), 3) for v in x]
    modes.write_text(f"{BRIDGE}\n[capacitance]\ngap_um = 3.68\ntravel_um = {x}\ncapacitance_fF = {c}\n")
    config = load_config("current", ["model.name=reduced-order", f"model.modes={modes}"])
    said = " ".join(forewarnings(config))
    assert "its contact, until its electrode collapses" in said
    assert "the capacitance is known from -0.5 µm on ([capacitance] travel_um)" in said
    calm = load_config("current", ["model.name=reduced-order", f"model.modes={modes}", "waveform.max_volts=60"])
    assert "collapses" not in " ".join(forewarnings(calm))
