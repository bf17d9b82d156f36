"""Claims about where functions of the facade compute: threads, or what is asked for, and the same bits from each."""

from __future__ import annotations

import contextlib
import inspect
import multiprocessing
import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from examples import in_turn
from small_campaigns import COARSE, make_campaign
from softclose import load_population
from softclose.population.measurements import write_synthetic
from softclose.uncertainty.tolerance import DriveError
from softclose.waveform import Trace
from softclose_workflows import api
from softclose_workflows.analyses.certify import certify
from softclose_workflows.errors import ExecutorError
from softclose_workflows.run import crew
from softclose_workflows.run.executors import Executor, Placement, open_executor
from test_crew import OPENS, bits

FUNCTIONS: dict[str, Callable[..., api.Result[Any]]] = {
    "certify": lambda at, **where: api.certify(at / "plain.zarr", n_switches=300, top=2, **where),
    "compare": lambda at, **where: api.compare([at / "plain.zarr", at / "opens.zarr"], fresh=200, **where),
    "tails": lambda at, **where: api.tails(at / "plain.zarr", [20.0], methods=["brute"], n_switches=9_000, **where),
    "sensitivity": lambda at, **where: api.sensitivity(at / "plain.zarr", points=64, replicates=2, **where),
    "tolerance": lambda at, **where: api.tolerance(
        at / "plain.zarr", [DriveError(gain=0.02), DriveError(jitter_us=0.3)], n_switches=300, n_generators=8, **where
    ),
    "drift": lambda at, **where: api.drift(at / "plain.zarr", values=[-0.05, 0.1], n_switches=300, **where),
    "propagate": lambda at, **where: api.propagate(
        at / "plain.zarr",
        at / "twelve.csv",
        bounds={"D": (2.3, 2.7), "G": (3.6, 3.9)},
        n_lots=20,
        n_switches=300,
        **where,
    ),
    "assess": lambda at, **where: api.assess(
        at / "plain.zarr", Trace([0.0, 5.0, 250.0], [0.0, 100.0, 100.0]), n_switches=300, **where
    ),
    "opening": lambda at, **where: api.opening(at / "opens.zarr", n_switches=200, **where),
}
"""Every function that simulates and gives back a table; `report` writes a page."""

WHERES: tuple[dict[str, Any], ...] = ({}, {"workers": 2}, {"scheduler": "tcp://127.0.0.1:8786"})
"""Threads, two processes, a scheduler."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A certified campaign, one that designs openings, and twelve devices."""
    folder = tmp_path_factory.mktemp("placing")
    certify(make_campaign(folder / "plain.zarr", *COARSE), n_switches=200, top=2)
    make_campaign(folder / "opens.zarr", *COARSE, *OPENS)
    write_synthetic(load_population("current"), folder / "twelve.csv", n=12, seed=2)
    return folder


@pytest.fixture(scope="module")
def cluster() -> Iterator[Executor]:
    """Two processes, which every function of this module is lent that asks for some."""
    with open_executor(Placement(workers=2)) as executor:
        yield executor


@pytest.fixture
def asked(cluster: Executor, monkeypatch: pytest.MonkeyPatch) -> list[Placement]:
    """Where functions ask to compute."""
    placements: list[Placement] = []

    def lend(placement: Placement, **options: Any) -> contextlib.AbstractContextManager[Executor]:
        placements.append(placement)
        usual = placement.is_usual
        return open_executor(placement, **options) if usual else contextlib.nullcontext(cluster)

    monkeypatch.setattr(crew, "open_executor", lend)
    return placements


def test_every_function_that_takes_workers_is_tried() -> None:
    takers = {name for name in api.__all__ if "workers" in inspect.signature(getattr(api, name)).parameters}
    assert takers == {*FUNCTIONS, "report", "run", "resume"}


@pytest.mark.parametrize("name", in_turn(FUNCTIONS, 3))
@pytest.mark.timeout(300)
def test_a_function_computes_where_it_is_told_and_says_the_same(
    name: str, folder: Path, asked: list[Placement], tmp_path: Path
) -> None:
    found = []
    for where in WHERES:
        shutil.rmtree(tmp_path / "at", ignore_errors=True)  # what was certified there would not be simulated again
        found.append(FUNCTIONS[name](shutil.copytree(folder, tmp_path / "at"), **where))
    assert asked == [Placement(**where) for where in WHERES]
    assert bits(found[0].rows) == bits(found[1].rows) == bits(found[2].rows)
    assert bits(found[0].value) == bits(found[1].value) == bits(found[2].value)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_workers_and_a_scheduler_exclude_each_other(name: str, folder: Path) -> None:
    with pytest.raises(ExecutorError, match="exclude each other"):
        FUNCTIONS[name](folder, workers=2, scheduler="tcp://127.0.0.1:8786")


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_worker_that_imports_the_script_ends_before_it_computes(
    name: str, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def leave(code: int) -> None:
        raise SystemExit(code)

    monkeypatch.setattr(multiprocessing.current_process(), "_inheriting", True, raising=False)
    monkeypatch.setattr(os, "_exit", leave)
    with pytest.raises(SystemExit, match="1"):
        FUNCTIONS[name](folder)
    assert 'put its calls under `if __name__ == "__main__":`' in capsys.readouterr().err
