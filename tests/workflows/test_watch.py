"""Claims about the live view: it reads the store alone, tells pace and time left, and ends."""

from __future__ import annotations

import io
import math
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from rich.console import Console

from small_store import create, run
from softclose_store import DriverStore
from softclose_workflows.cli import main
from softclose_workflows.tell import watch


def test_pace_is_the_median_gap_so_a_pause_between_runs_does_not_count() -> None:
    at = np.array([0.0, 1.0, 2.0, 5000.0, 5001.0, 5002.0])
    rate, left = watch.pace(at, np.full(6, 300), np.arange(6), n_left=10)
    assert rate == pytest.approx(300.0)
    assert left == pytest.approx(10.0)


def test_the_candidates_of_a_wave_share_the_time_since_the_wave_before() -> None:
    wave = np.repeat([3, 4, 5], [2, 20, 10])
    rate, left = watch.pace(np.repeat([10.0, 20.0, 25.0], [2, 20, 10]), np.full(32, 100), wave, n_left=40)
    assert rate == pytest.approx(200.0)
    assert left == pytest.approx(20.0)


@pytest.mark.parametrize("n", [0, 1])
def test_one_commit_has_no_pace(n: int) -> None:
    assert all(math.isnan(v) for v in watch.pace(np.zeros(n), np.ones(n), np.arange(n), n_left=3))


def small(path: Path, until: int) -> None:
    of = {"campaign": {"seed": 7, "budget": 8, "name": "eight"}, "objective": {"max_open": 1.0, "warn_open": 0.2}}
    create(path, config=of | {"model": {"horizon_us": 250.0}})
    run(path, until)


def test_watching_follows_another_process_and_ends_when_it_has_finished(tmp_path: Path) -> None:
    path = tmp_path / "a.zarr"
    small(path, 4)
    upto = iter((5, 7, 8))

    def go_on(_: float) -> None:
        """Stands for the time that the other process uses."""
        run(path, next(upto))

    seen = [(view.committed, view.finished) for view in watch.views(str(path), 1.0, go_on)]
    assert seen == [(4, False), (5, False), (7, False), (8, True)]


def test_a_running_driver_is_named_and_its_absence_said(tmp_path: Path) -> None:
    path = tmp_path / "a.zarr"
    small(path, 5)
    campaign = watch.open_campaign(path)
    assert "nobody drives it" in watch.one_line(watch.read_view(campaign))
    with DriverStore(path) as store:
        store.note_run({"workers": 5})
        campaign.refresh()
        view = watch.read_view(campaign)
    assert str(view.workers) == "5"
    assert "process" in view.driver
    assert math.isfinite(view.left_s)


@pytest.mark.parametrize("until", [0, 5, 8])
def test_the_panel_shows_every_figure(tmp_path: Path, until: int) -> None:
    path = tmp_path / "a.zarr"
    small(path, until)
    console = Console(file=io.StringIO(), width=100, force_terminal=True, color_system=None)
    console.print(watch.panel(watch.read_view(watch.open_campaign(path))))
    text = console.file.getvalue()  # type: ignore[attr-defined]
    for word in (
        "eight",
        f"{until} of 8",
        "best g",
        "switches/s" if until > 1 else "rate",
        "time left",
        "workers",
        "failed",
    ):
        assert word in text


def test_on_a_pipe_it_prints_one_line_per_change(tmp_path: Path) -> None:
    path = tmp_path / "a.zarr"
    small(path, 8)
    done = CliRunner().invoke(main, ["status", str(path), "--watch"])
    assert done.exit_code == 0, done.output
    assert done.output.splitlines() == [done.output.strip()]
    assert done.output.startswith("8 of 8 candidates · best g ")


def test_json_and_watch_exclude_each_other(tmp_path: Path) -> None:
    done = CliRunner().invoke(main, ["status", str(tmp_path), "--watch", "--json"])
    assert done.exit_code == 2
    assert "exclude each other" in done.output


def test_ctrl_c_ends_the_view_quietly(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.zarr"
    small(path, 4)

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(watch, "views", interrupt)
    watch.watch(str(path), 1.0, Console(file=io.StringIO()))
