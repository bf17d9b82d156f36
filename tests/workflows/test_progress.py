"""Claims about progress: it fits 80 columns, and a log gets a line a minute and not one a block."""

from __future__ import annotations

import contextlib
import io
import math
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner

from small_campaigns import COARSE
from softclose.settings import ConfigError, load_config
from softclose_workflows import terminal
from softclose_workflows.cli import main
from softclose_workflows.errors import ExecutorError
from softclose_workflows.run import driving, progress
from softclose_workflows.run.campaign import Progress
from softclose_workflows.run.executors import Placement
from softclose_workflows.tell.console import bar


def state(simulated: int = 640, **other: float) -> Progress:
    given = {"best_g_cm_s": 15.2, "n_switches_done": 420_000, "n_workers": 2, "n_retries": 0} | other
    return Progress(committed=simulated, simulated=simulated, budget=1600, stage="explore", **given)  # type: ignore[arg-type]


def test_a_line_says_where_it_is_how_good_and_how_fast() -> None:
    expected = "explore: 640 of 1,600 candidates · best g 15.20 cm/s · 210,000 switches/s · 2 workers"
    assert progress.line(state(), 2.0) == expected
    assert progress.line(state(n_workers=1, n_retries=1), 2.0).endswith("1 worker · 1 worker lost")
    assert "compiling" in progress.line(state(n_switches_done=0, best_g_cm_s=math.inf), 2.0)
    assert "best" not in progress.line(state(best_g_cm_s=math.inf), 2.0)


class Clock:
    def __init__(self) -> None:
        self.now = 0.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    made = Clock()
    monkeypatch.setattr(terminal, "time", made)
    monkeypatch.setattr(progress, "time", made)
    return made


@pytest.mark.parametrize("kind", ["run", "bar"])
def test_without_a_terminal_there_is_a_line_a_minute(
    kind: str, clock: Clock, capsys: pytest.CaptureFixture[str]
) -> None:
    shown = progress.show_progress(quiet=False) if kind == "run" else bar("certifying")
    with shown as listener:  # type: ignore[attr-defined]
        assert listener is not None
        for second in range(1, 301):
            clock.now = float(second)
            if kind == "run":
                listener(state(simulated=second))
            else:
                listener(second, 400)
    captured = capsys.readouterr()
    assert captured.out == ""
    lines = captured.err.splitlines()
    assert len(lines) == 5
    first = "explore: 60 of 1,600 candidates · best g 15.20 cm/s · 7,000 switches/s · 2 workers"
    assert lines[0] == (first if kind == "run" else "certifying: 15 %")


@pytest.mark.parametrize("kind", ["run", "bar"])
def test_quiet_is_quiet(kind: str) -> None:
    with progress.show_progress(quiet=True) if kind == "run" else bar("certifying", quiet=True) as listener:  # type: ignore[attr-defined]
        assert listener is None


@pytest.mark.parametrize("width", [80, 139, 140, 200])
def test_a_bar_fits_on_its_line(width: int, monkeypatch: pytest.MonkeyPatch) -> None:
    written = io.StringIO()
    monkeypatch.setattr(written, "isatty", lambda: True, raising=False)
    monkeypatch.setattr(sys, "stderr", written)
    monkeypatch.setenv("COLUMNS", str(width))
    monkeypatch.setenv("TERM", "xterm")
    with progress.show_progress(quiet=False) as listener:
        assert listener is not None
        listener(state(simulated=1599, best_g_cm_s=14.123, n_workers=16, n_retries=2))
    lines = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", written.getvalue()).replace("\r", "\n").splitlines()
    shown = [line for line in lines if "1599/1600" in line]
    assert shown
    assert all(len(line) <= width for line in lines)
    assert all("best g 14.12 cm/s" in line and "left" in line for line in shown)
    assert all(("16 workers" in line) == (width >= progress.NARROW) for line in shown)


@pytest.mark.parametrize(
    "command",
    [
        ["run", "current", "--store", "a.zarr"],
        ["submit", "current", "--store", "a.zarr", "--cluster", "none.toml", "--dry-run"],
        ["compare-engines", "current", "--engines", "sobol"],
    ],
    ids=lambda words: words[0],
)
def test_what_may_compile_kernels_is_said_to_be_at_work(command: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """A lot of one's own: its prices take a simulation, before which half a minute passed in silence."""
    seen: list[str] = []

    @contextlib.contextmanager
    def working(what: str, *, quiet: bool) -> Iterator[None]:
        assert not quiet
        seen.append(what)
        yield
        seen.append("done")

    def load(*_: object) -> None:
        seen.append("load")
        raise ConfigError("enough")

    monkeypatch.setattr(terminal, "working", working)
    monkeypatch.setattr("softclose.settings.load_config", load)
    assert CliRunner().invoke(main, command).exit_code == 2
    assert seen == [terminal.READING, "load"]


def test_workers_that_compile_kernels_are_said_to_be_started(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[str] = []

    @contextlib.contextmanager
    def working(what: str, *, quiet: bool) -> Iterator[None]:
        seen.append(what)
        yield

    def start(placement: Placement) -> None:
        seen.append("start")
        raise ExecutorError("enough")

    monkeypatch.setattr(driving, "working", working)
    monkeypatch.setattr(driving, "open_executor", start)
    with pytest.raises(ExecutorError, match="enough"):
        driving.drive(str(tmp_path / "a.zarr"), Placement(workers=1), config=load_config("current", COARSE))
    assert seen == [terminal.STARTING, "start"]
