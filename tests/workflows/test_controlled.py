"""Claims about a campaign whose prior is a control variate: what is stored, after a kill too, and where it pays."""

from __future__ import annotations

import re
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from campaigns import softclose, softclose_process
from examples import in_turn
from softclose.evaluate import judge
from softclose.evaluate.judging import judge_with
from softclose.metrics.control import Control
from softclose.metrics.objective import Judged
from softclose.population.lot import Lot
from softclose.propose.prior_control import PriorControl
from softclose.propose.promises import PriorError
from softclose.settings import CampaignConfig, load_config
from softclose.waveform import Waveform
from softclose_store import DriverStore, faults, open_campaign, repair, verify
from softclose_workflows.analyses.forecast import prior_trajectories
from softclose_workflows.analyses.recompute import recompute, replay
from softclose_workflows.cli import main
from softclose_workflows.errors import Stopped
from softclose_workflows.report.gather import gather
from softclose_workflows.report.health import health
from softclose_workflows.run.campaign import Driver
from softclose_workflows.run.controlled import GAIN, controlling_of
from softclose_workflows.run.creation import create_store
from softclose_workflows.run.executors.serial import SerialExecutor
from stores import differences
from test_prior_at_work import SETTINGS as OF_PRIOR

SETTINGS = (
    *OF_PRIOR,
    "population.n_switches=96",
    "population.sampling=monte-carlo",
    "prior.control=1024",
    "model.quality_factor=200.0",
    "prior.includes=[]",
)
"""The campaign has losses that its prior does not know."""

FIRST = 2
"""Candidates of the first wave: one a region."""


def run(path: Path, *settings: str) -> Path:
    create_store(load_config("current", (*SETTINGS, *settings)), str(path))
    with DriverStore(path) as store:
        Driver(store, SerialExecutor()).run()
    return path


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return run(tmp_path_factory.mktemp("whole") / "a.zarr")


def arguments(path: Path) -> list[str]:
    sets = [part for setting in SETTINGS for part in ("--set", setting)]
    return ["run", "current", "--store", str(path), "--quiet", *sets]


def test_every_candidates_figures_are_those_with_the_control_variate(whole: Path) -> None:
    campaign = open_campaign(whole)
    stored, config = campaign.records(), CampaignConfig.from_dict(campaign.config)
    prior = PriorControl.of(config, Lot(campaign.population()))
    assert len(prior.many) == 1024
    assert np.median(stored[GAIN][:FIRST]) <= 0.9
    for i, rows in enumerate(stored["waveform"]):
        control, response = prior.under(Waveform.from_rows(rows), 96), campaign.responses(i)
        assert control is not None
        assert np.nanmean(abs(control.same.max_contact_speed - response.max_contact_speed)) < 0.02, "the same switches"
        expected, plain = judge_with(config, response, control), judge(config, response)
        assert stored["g_cm_s"][i] == expected.g_cm_s == stored["rank_cm_s"][i]
        assert stored["g_cm_s"][i] != plain.g_cm_s
        assert stored["mean_lower_cm_s"][i] == expected.mean_interval[0]
        assert stored["p_nc_wilson_upper"][i] == expected.p_nc_intervals.wilson[1]
        assert stored["cvar_cm_s"][i] == plain.cvar_cm_s
        assert stored[GAIN][i] == expected.g_se_cm_s / plain.g_se_cm_s
    assert replay(str(whole), 5).differing == ()


@pytest.mark.parametrize("fault", in_turn(["after-commit:1", "before-commit:3"], 2))
def test_a_kill_ends_in_the_same_store(fault: str, tmp_path: Path, whole: Path) -> None:
    path = tmp_path / "a.zarr"
    killed = softclose_process(*arguments(path), "--serial", env={faults.VARIABLE: fault})
    assert killed.returncode == -signal.SIGKILL, killed.stderr
    done = softclose("resume", str(path), "--serial", "--quiet")
    assert done.returncode == 0, done.stderr
    assert differences(path, whole) == []


def test_workers_find_the_same(tmp_path: Path, whole: Path) -> None:
    path = tmp_path / "a.zarr"
    done = softclose(*arguments(path), "--workers", "2")
    assert done.returncode == 0, done.stderr
    assert differences(path, whole) == []


def test_damaged_records_come_out_the_same_again(tmp_path: Path, whole: Path) -> None:
    path = run(tmp_path / "a.zarr")
    table = path / "candidates" / "records" / "c.0.0"
    content = bytearray(table.read_bytes())
    content[len(content) // 2] ^= 1
    table.write_bytes(bytes(content))
    assert not verify(path).ok
    repair(path, recompute())
    assert verify(path).ok
    assert differences(path, whole) == []


def unrelated(self: PriorControl, waveform: Waveform, n_switches: int, **_: object) -> Control:
    """A cheap model that has nothing to do with the costly one."""
    rng = np.random.default_rng(4)

    def some(n: int) -> Judged:
        speed, closed = 0.15 + 0.03 * rng.random(n), rng.random(n) < 0.9
        return Judged(max_contact_speed=speed, closed=closed, status=np.zeros(n, dtype=np.int8))

    return Control(same=some(n_switches), many=some(1024))


def test_where_it_does_not_pay_the_figures_are_those_of_the_switches_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(PriorControl, "under", unrelated)
    stored = open_campaign(run(tmp_path / "a.zarr")).records()
    plain = open_campaign(run(tmp_path / "plain.zarr", "prior.control=0")).records()
    assert (stored[GAIN][:FIRST] > 0.9).all()
    assert np.isnan(stored[GAIN][FIRST:]).all(), "later candidates do not try it"
    assert GAIN not in plain
    for name in ("g_cm_s", "g_lower_cm_s", "waveform"):
        np.testing.assert_array_equal(stored[name], plain[name])


def test_a_prior_without_an_answer_is_no_control_variate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(PriorControl, "under", lambda *_, **__: None)
    stored = open_campaign(run(tmp_path / "a.zarr")).records()
    assert np.isnan(stored[GAIN]).all()
    assert np.isfinite(stored["g_cm_s"]).all()


def test_a_fault_of_the_machine_stops_the_run_which_can_be_resumed(
    tmp_path: Path, whole: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object, **__: object) -> Control:
        raise PriorError("no licence server")

    path = tmp_path / "a.zarr"
    with monkeypatch.context() as patch:
        patch.setattr(PriorControl, "under", broken)
        with pytest.raises(Stopped, match="wave 0 could not be judged: no licence server"):
            run(path)
    assert open_campaign(path).committed == 0
    with DriverStore(path) as store:
        Driver(store, SerialExecutor()).run()
    assert differences(path, whole) == []


def test_the_forecast_counts_its_trajectories() -> None:
    config, without = (load_config("current", (*SETTINGS, s)) for s in ("prior.control=1024", "prior.control=0"))
    assert prior_trajectories(config) - prior_trajectories(without) == 10 * (96 + 1024)


@pytest.mark.parametrize(
    ("gains", "used"), [([0.95, 0.97, 0.2, 0.2, 0.2], False), ([0.5, 0.8, 1.3, 1.3, 1.3], True), ([], None)]
)
def test_what_was_decided_by_the_first_wave_stays(gains: list[float], used: bool | None, whole: Path) -> None:
    campaign = open_campaign(whole)
    config = CampaignConfig.from_dict(campaign.config)
    found = controlling_of(config, Lot(campaign.population()), {GAIN: np.array(gains)})
    assert found is not None
    assert found.is_used is used


def test_table_and_page_judge_as_the_records_do(whole: Path) -> None:
    campaign = open_campaign(whole)
    best = campaign.best()
    data = gather(str(whole))
    assert best is not None
    assert data.designs[0].assessment.g_cm_s == best.g_cm_s
    step = data.designs[1]
    assert step.assessment.g_cm_s != judge(data.config, step.response).g_cm_s, "references on the same terms"
    said = next(check for check in health(data) if check.name == "Control variate").said
    assert "1,024 further switches" in said
    assert "rest on both models" in said
    page = (Path(__file__).parents[2] / "docs" / "measurements" / "coverage.md").read_text("utf-8")
    rows = re.findall(
        r"^\| .* \| (\d+) \| [\d.]+, [\d.]+ \| ([\d.]+), .*\|$", page.partition("## A cheap model")[2], re.MULTILINE
    )
    means = {n: sorted(float(mean) for size, mean in rows if size == n) for n in ("80", "256")}
    assert [len(found) for found in means.values()] == [44, 44]
    assert means["256"][0] >= 0.93
    least = means["80"][3]  # three are of a group that 80 draws may miss
    assert f"it was measured to hold {100.0 * least:.0f} % of a stated 95" in said
    columns = data.candidates.columns | {GAIN: np.full(10, 0.95)}
    changed = replace(data, candidates=replace(data.candidates, columns=columns))
    larger = {"population": replace(data.config.population, n_switches=256)}
    many = replace(data, config=replace(data.config, prior=replace(data.config.prior, control=2048), **larger))
    assert "so few switches" not in next(c for c in health(many) if c.name == "Control variate").said
    assert "95\u202f% of that without" in next(c for c in health(changed) if c.name == "Control variate").said
    assert "does not pay" in next(c for c in health(changed) if c.name == "Control variate").said


@pytest.mark.parametrize(
    ("control", "said"),
    [
        (1024, "before the first candidate, for the proposals and as control variate"),
        (0, "before the first candidate and for the proposals"),
    ],
)
def test_a_dry_run_says_what_the_prior_is_asked_for(control: int, said: str, tmp_path: Path) -> None:
    command = [*arguments(tmp_path / "a.zarr"), "--set", f"prior.control={control}", "--dry-run", "--serial"]
    done = CliRunner().invoke(main, command)
    assert done.exit_code == 0, done.output
    assert said in done.output
