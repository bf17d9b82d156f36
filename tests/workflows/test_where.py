"""Claims about where the time of runs went: it adds up, over runs too, and a killed run takes nothing with it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from small_campaigns import COARSE, Halting, make_campaign
from softclose_store import DriverStore, open_campaign
from softclose_workflows.analyses.where import print_where, total, where
from softclose_workflows.cli import main
from softclose_workflows.errors import Stopped
from softclose_workflows.run.campaign import Driver
from softclose_workflows.run.executors.serial import SerialExecutor


def _run(path: str, blocks: int | None) -> Driver:
    with DriverStore(path) as store:
        store.note_run({"host": "here"})
        driver = Driver(store, Halting(blocks) if blocks else SerialExecutor())
        driver.run()
    return driver


def test_what_is_told_is_what_was_spent_and_adds_up_over_runs(tmp_path: Path) -> None:
    path = make_campaign(tmp_path / "a.zarr", *COARSE, run=False)
    assert where(path).n_runs == 0
    told = CliRunner().invoke(main, ["status", path, "--where"])
    assert "no run of" in told.output
    with pytest.raises(Stopped):
        _run(path, 5)
    first = where(path)
    driver = _run(path, None)
    both = where(path)
    assert (first.n_runs, both.n_runs) == (1, 2)
    spent = driver.spent
    assert spent.write <= spent.store
    assert both.simulate == pytest.approx(first.simulate + spent.simulate, abs=2e-3)
    assert both.compress + both.write == pytest.approx(first.compress + first.write + spent.store, abs=4e-3)
    # One worker, and one process: its blocks and the driver's own work fill the time.
    parts = both.propose + both.await_prior + both.dispatch + both.assess + both.commit + both.wait
    assert 0.8 * both.wall <= parts <= 1.001 * both.wall + 0.01
    assert both.simulate + both.compress + both.write <= both.wait + 0.01
    assert both.worker == pytest.approx(both.wall, abs=0.01)
    said = json.loads(CliRunner().invoke(main, ["status", path, "--where", "--json"]).output)
    assert said["idle"] == pytest.approx(both.idle)
    shown = CliRunner().invoke(main, ["status", path, "--where"]).output
    assert "2 runs" in shown
    assert "waiting for a task" in shown


def test_the_prior_is_no_idleness_of_workers_and_no_proposing_of_the_driver(tmp_path: Path) -> None:
    path = make_campaign(
        tmp_path / "a.zarr", *COARSE, "optimiser.engine=skopt", "prior.model=single-mode", "prior.budget=400", run=False
    )
    _run(path, None)
    found = where(path)
    assert 0.0 < found.prior <= found.await_prior + 0.01
    assert found.await_prior + found.propose <= found.wall
    parts = found.propose + found.await_prior + found.dispatch + found.assess + found.commit + found.wait
    assert 0.8 * found.wall <= parts <= 1.001 * found.wall + 0.01
    assert found.idle == pytest.approx(
        found.worker - found.simulate - found.compress - found.write - found.prior, abs=1e-9
    )
    shown = CliRunner().invoke(main, ["status", path, "--where"]).output
    assert "waiting for the prior" in shown


def test_a_run_that_was_killed_says_nothing() -> None:
    found = total([{"wall": 2.0, "worker": 4.0, "simulate": 1.0, "store": 1.0, "write": 0.25}])
    assert (found.compress, found.write, found.idle) == (0.75, 0.25, 2.0)


def test_the_campaign_is_what_it_was(tmp_path: Path) -> None:
    """Times are not part of what a campaign is."""
    path = make_campaign(tmp_path / "a.zarr", *COARSE)
    before = open_campaign(path)
    with DriverStore(path) as store:
        store.note_run({"host": "here"})
        store.amend_run({"spent": {"wall": 1.0}})
    after = open_campaign(path)
    assert (after.fingerprint, after.committed) == (before.fingerprint, before.committed)
    assert after.runtime["runs"][-1] == {"host": "here", "spent": {"wall": 1.0}}


def test_nobody_is_idle_for_less_than_no_time_and_a_run_without_files_wrote_for_none() -> None:
    """What workers and driver measure by themselves may add up to a little more than the whole."""
    found = total([{"wall": 2.0, "worker": 4.0, "simulate": 3.0, "store": 1.5}])
    assert (found.compress, found.write, found.idle, found.n_runs) == (1.5, 0.0, 0.0, 1)


@pytest.mark.parametrize(("n", "runs"), [(1, "1 run,"), (2, "2 runs,")])
def test_seconds_stand_beside_their_share_of_the_whole(n: int, runs: str, capsys: pytest.CaptureFixture[str]) -> None:
    spent = {"wall": 8.0, "worker": 16.0, "simulate": 4.0, "prior": 2.0, "propose": 6.0}
    print_where("a.zarr", total([spent] * n))
    said = capsys.readouterr().out
    assert f"a.zarr: {runs} {8 * n}.0 s without start-up" in said
    rows = [[cell.strip() for cell in line.split("│")[1:-1]] for line in said.splitlines() if line.startswith("│")]
    assert ["workers", "device model", f"{4 * n}.00", "25 %"] in rows
    assert ["driver", "proposing", f"{6 * n}.00", "75 %"] in rows
    assert all(word in said for word in ("whose", "where", "seconds", "share"))
