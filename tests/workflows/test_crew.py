"""Claims about crews: every analysis says the same bits wherever its pieces run, and a fault is tried again or told."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import random
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from examples import in_turn
from small_campaigns import COARSE, make_campaign
from softclose import load_population
from softclose.device.protocol import CannotSimulate
from softclose.evaluate.pieces import Mapper, here
from softclose.opening import OpeningError
from softclose.population.measurements import write_synthetic
from softclose.settings import CampaignConfig
from softclose.uncertainty.tolerance import DriveError
from softclose.waveform import Trace
from softclose_store import DamageError, open_campaign
from softclose_workflows.analyses import assessed_trace, devices, drift, drive_errors, opening, tails
from softclose_workflows.analyses.certify import certify
from softclose_workflows.analyses.finalists import certify_within
from softclose_workflows.analyses.references import simulate_references
from softclose_workflows.cli import main
from softclose_workflows.errors import Stopped
from softclose_workflows.report.comparison import read_entries
from softclose_workflows.run.creation import lot_of
from softclose_workflows.run.crew import AHEAD_PER_WORKER, LEAST_AHEAD, Crew, open_crew
from softclose_workflows.run.executors import Executor, Placement, open_executor
from softclose_workflows.run.executors.placement import n_cores
from softclose_workflows.run.executors.protocol import Event, Task, run_task
from softclose_workflows.run.faults import MAX_TRIES
from softclose_workflows.run.stopping import StopRequest

OPENS = (
    "model.quality_factor=20",
    "opening.release_us=300",
    "opening.brake=26",
    "opening.n_switches=60",
    "opening.watch_us=100",
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign, one that designs openings, and twelve devices."""
    folder = tmp_path_factory.mktemp("crew")
    make_campaign(folder / "plain.zarr", *COARSE)
    make_campaign(folder / "opens.zarr", *COARSE, *OPENS)
    write_synthetic(load_population("current"), folder / "twelve.csv", n=12, seed=2)
    return folder


ANALYSES: dict[str, Callable[[Path, Mapper], Any]] = {
    "certificate": lambda at, m: certify(str(at / "plain.zarr"), n_switches=5000, top=2, seed=3, mapper=m),
    "opening in a certificate": lambda at, m: certify(str(at / "opens.zarr"), n_switches=100, top=1, mapper=m),
    "race": lambda at, m: certify_within(str(at / "plain.zarr"), 0.3, n_switches=12_000, top=3, mapper=m),
    "tails": lambda at, m: tails.tails(
        str(at / "plain.zarr"),
        tails.questions([20.0], True),
        methods=("brute", "subset", "form"),
        n_switches=9_000,
        relative_error=0.5,
        mapper=m,
    ),
    "tolerance": lambda at, m: drive_errors.tolerance(
        str(at / "plain.zarr"), [DriveError(gain=0.02), DriveError(jitter_us=0.3)], n_switches=3000, mapper=m
    ),
    "sensitivity": lambda at, m: drive_errors.sensitivity(str(at / "plain.zarr"), points=256, replicates=2, mapper=m),
    "drift": lambda at, m: drift.drift(str(at / "plain.zarr"), "stiffness", [-0.05, 0.1], n_switches=3000, mapper=m),
    "charge": lambda at, m: drift.drift(str(at / "plain.zarr"), "charge", [2.0], n_switches=3000, mapper=m),
    "propagate": lambda at, m: devices.propagate(
        str(at / "plain.zarr"),
        str(at / "twelve.csv"),
        bounds={"D": (2.3, 2.7), "G": (3.6, 3.9)},
        n_lots=20,
        n_switches=300,
        mapper=m,
    ),
    "recorded drive": lambda at, m: assessed_trace.assess_trace(
        str(at / "plain.zarr"), Trace([0.0, 5.0, 250.0], [0.0, 100.0, 100.0]), n_switches=3000, mapper=m
    ),
    "opening": lambda at, m: opening.opening(str(at / "opens.zarr"), brake=26, n_switches=2100, mapper=m),
    "references": lambda at, m: _references(at / "plain.zarr", m),
    "comparison": lambda at, m: [
        e.fresh for e in read_entries([str(at / "plain.zarr"), str(at / "opens.zarr")], fresh=200, mapper=m)
    ],
}
"""Everything that simulates beside a campaign's own candidates."""


def _references(store: Path, mapper: Mapper) -> Any:
    config = CampaignConfig.from_dict(open_campaign(str(store)).config)
    return simulate_references(config, lot_of(config), mapper)


def bits(value: Any) -> Any:
    """All of a value, arrays to the last bit."""
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    if dataclasses.is_dataclass(value) and not isinstance(value, CampaignConfig):
        return [bits(getattr(value, f.name)) for f in dataclasses.fields(value)]
    if isinstance(value, Mapping):
        return [(k, bits(v)) for k, v in value.items()]
    return [bits(v) for v in value] if isinstance(value, list | tuple) else repr(value)


CREWS = ("threads", "two workers")


@pytest.fixture(scope="module")
def crew(request: pytest.FixtureRequest) -> Iterator[Crew]:
    placement, threads = (Placement(), 3) if request.param == "threads" else (Placement(workers=2), None)
    with open_executor(placement, threads=threads) as executor:
        executor.probe("", "")
        yield Crew(lambda: executor)


@pytest.mark.parametrize(
    ("crew", "name"),
    in_turn((pytest.param(crew, name) for crew in CREWS for name in ANALYSES), 2, 1),
    indirect=["crew"],
)
@pytest.mark.timeout(300)
def test_an_analysis_says_the_same_wherever_its_pieces_run(name: str, crew: Crew, folder: Path, tmp_path: Path) -> None:
    found = []
    for mapper in (here, crew):
        at = shutil.copytree(folder, tmp_path / str(len(found)))
        found.append(bits(ANALYSES[name](at, mapper)))
    assert found[0] == found[1]


class Deck:
    """An executor that answers in an order of its own, and fails as often as it is told."""

    n_retries = 0
    n_workers = 2
    dashboard = contact = None
    has_finished = False

    def __init__(self, failures: Sequence[BaseException] = ()) -> None:
        self.waiting: list[Task] = []
        self.failures = list(failures)
        self.most = self.done = 0

    def probe(self, store: str, fingerprint: str) -> None:
        assert not store

    def submit(self, task: Task) -> None:
        self.waiting.append(task)
        self.most = max(self.most, len(self.waiting))

    def next_event(self, timeout_s: float) -> Event | None:
        if not self.waiting:
            return None
        task = self.waiting.pop(random.Random(len(self.waiting)).randrange(len(self.waiting)))
        self.done += 1
        return task, self.failures.pop() if self.failures else run_task(task)


def on(deck: Executor, stop: StopRequest | None = None) -> Crew:
    return Crew(lambda: deck, stop)


@pytest.mark.parametrize("n_workers", [2, 20])
@pytest.mark.parametrize("n", [0, 1, 5, 500])
def test_answers_come_in_the_order_of_the_pieces_and_few_are_under_way(n: int, n_workers: int) -> None:
    deck = Deck()
    deck.n_workers = n_workers
    assert [*on(deck)(math.sqrt, range(n))] == [math.sqrt(k) for k in range(n)]
    assert deck.most == min(n, max(LEAST_AHEAD, AHEAD_PER_WORKER * n_workers))


def test_a_question_that_was_given_up_does_not_answer_the_next() -> None:
    crew = on(Deck())
    assert next(crew(math.sqrt, range(30))) == 0.0
    assert [*crew(math.exp, range(3))] == [math.exp(k) for k in range(3)]


def test_a_fault_of_the_machine_is_tried_again_and_then_ends_the_work() -> None:
    assert [*on(Deck([OSError("a disk")] * (MAX_TRIES - 1)))(math.sqrt, [4.0])] == [2.0]
    with pytest.raises(Stopped, match=f"tried {MAX_TRIES} times .OSError: a disk"):
        [*on(Deck([OSError("a disk")] * MAX_TRIES))(math.sqrt, [4.0])]


@pytest.mark.parametrize(
    "word",
    [
        CannotSimulate("no"),
        OpeningError("none held"),
        Stopped("the scheduler is gone"),
        DamageError("a chunk"),
    ],
)
def test_what_would_be_said_anywhere_is_said_at_once(word: Exception) -> None:
    deck = Deck([word] * 9)
    with pytest.raises(type(word), match=str(word)):
        [*on(deck)(math.sqrt, [4.0])]
    assert deck.done == 1


def test_a_signal_ends_the_work_between_two_pieces() -> None:
    stop = StopRequest()
    answers = on(Deck(), stop)(math.sqrt, range(9))
    next(answers)
    stop.signal_name = "SIGINT"
    with pytest.raises(Stopped, match="SIGINT received"):
        list(answers)


@pytest.mark.parametrize("threads", [None, 3])
@pytest.mark.parametrize("has_store", [False, True])
def test_a_crew_has_a_thread_for_each_core_or_as_many_as_are_asked_for_and_workers_that_reach_the_store(
    threads: int | None, has_store: bool, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = str(folder / "plain.zarr") if has_store else ""
    asked: list[Any] = []
    deck = Deck()
    monkeypatch.setattr(deck, "probe", lambda *probed: asked.append(probed))

    def opened(placement: Placement, **settings: Any) -> Any:
        asked.append(settings)
        return contextlib.nullcontext(deck)

    monkeypatch.setattr("softclose_workflows.run.crew.open_executor", opened)
    with open_crew(Placement(), threads=threads, store=store) as crew:
        assert [*crew(math.sqrt, [4.0])] == [2.0]
    fingerprint = open_campaign(store).fingerprint if has_store else ""
    assert asked == [{"threads": threads or n_cores()}, (store, fingerprint)]


def test_a_cluster_is_not_started_for_what_is_known_already(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = str(shutil.copytree(folder / "plain.zarr", tmp_path / "a.zarr"))
    certify(store, n_switches=100, top=1)
    monkeypatch.setattr("softclose_workflows.run.crew.open_executor", lambda *_, **__: pytest.fail("started"))
    for where in ((), ("--workers", "2")):
        done = CliRunner().invoke(main, ["certify", store, "--switches", "100", "--top", "1", *where])
        assert done.exit_code == 0, done.output


COMMANDS = ("certify", "tails", "tolerance", "sensitivity", "drift", "propagate", "assess", "opening", "compare")


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_that_simulates_can_be_told_where(command: str) -> None:
    options = {o.name for o in main.commands[command].params}
    assert {"workers", "scheduler", "cluster", "serial", "patience", "plain_tcp"} <= options
