"""Claims about the run loop, in this process: what a wave sees, how blocks may come back, what is tried again."""

from __future__ import annotations

import itertools
import math
import random
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from examples import in_turn
from small_campaigns import COARSE, COMPLETE, block_task, make_campaign
from softclose import Observation, Problem, Proposal, Wave, Waveform
from softclose.propose import plan, proposer
from softclose.propose.sobol import sobol_points
from softclose_store import DriverStore, StoreMissingError, open_campaign
from softclose_workflows.errors import Stopped
from softclose_workflows.run import tasks
from softclose_workflows.run.campaign import PATIENCE_S, Driver, Progress
from softclose_workflows.run.executors.dask import LIVE_PER_WORKER, DaskExecutor
from softclose_workflows.run.executors.serial import SerialExecutor
from softclose_workflows.run.stopping import StopRequest
from softclose_workflows.run.tasks import BlockResult, BlockTask
from stores import differences

SIZES = (4, 4, 4, 4, 2)
LAG = 3


class Recorder:
    """An engine of five waves that remembers what it was shown."""

    def __init__(self) -> None:
        self.seen: dict[int, tuple[list[int], list[Waveform]]] = {}
        self.proposed: dict[int, list[Waveform]] = {}

    def wave_sizes(self, problem: Problem, budget: int) -> Sequence[int]:
        return SIZES

    def propose_wave(
        self, problem: Problem, wave: Wave, history: Sequence[Observation], pending: Sequence[Waveform]
    ) -> Sequence[Proposal]:
        self.seen[wave.index] = ([o.index for o in history], list(pending))
        points = sobol_points(problem.space.dim, wave.stop, np.random.default_rng(3))[wave.start :]
        # What was seen goes into the proposal: a wave that sees more or less than it may gives another store.
        points = np.clip(points + 1e-3 * len(history) + 1e-4 * len(pending), 0.0, 1.0)
        self.proposed[wave.index] = [problem.space.waveform(point) for point in points]
        return [Proposal(waveform=w, origin="sobol", n_switches=wave.n_switches) for w in self.proposed[wave.index]]


@pytest.fixture
def recorder(monkeypatch: pytest.MonkeyPatch) -> Recorder:
    engine = Recorder()
    for module in (plan, proposer):
        monkeypatch.setattr(module, "load_engine", lambda name: engine)
    return engine


def created(path: Path, *settings: str) -> str:
    many = (f"campaign.budget={sum(SIZES)}", f"campaign.lag={LAG}")
    return make_campaign(path, *COARSE, *many, *settings, run=False)


class Unruly(SerialExecutor):
    """Hands blocks back in any order; `spoil` may turn a result into something else first."""

    def __init__(self, seed: int, spoil: Callable[[BlockTask, BlockResult], Any] | None = None) -> None:
        super().__init__()
        self._rng = random.Random(seed)
        self._spoil = spoil
        self.n_most = 0

    def next_event(self, timeout_s: float) -> Any:
        self.n_most = max(self.n_most, len(self._waiting))
        self._waiting.rotate(self._rng.randrange(max(len(self._waiting), 1)))
        event = super().next_event(timeout_s)
        if event is None or self._spoil is None or not isinstance(event[1], BlockResult):
            return event
        return event[0], self._spoil(*event)


def drive(path: str, executor: Any, **options: Any) -> Driver:
    with DriverStore(path) as store:
        driver = Driver(store, executor, **options)
        driver.run()
    return driver


def test_a_wave_sees_the_waves_that_its_lag_lets_it_and_the_waveforms_between(
    tmp_path: Path, recorder: Recorder
) -> None:
    executor = Unruly(1)
    drive(created(tmp_path / "a.zarr"), executor)
    firsts = np.cumsum([0, *SIZES])
    for w in range(len(SIZES)):
        n_seen = max(w - LAG + 1, 0)
        indices, pending = recorder.seen[w]
        assert indices == list(range(firsts[n_seen]))
        assert pending == [waveform for v in range(n_seen, w) for waveform in recorder.proposed[v]]
    assert executor.n_most > 2 * SIZES[0]  # several waves were in flight at once, two blocks a candidate


@pytest.mark.parametrize("seed", in_turn(range(3), 3))
def test_the_order_in_which_blocks_finish_shows_nowhere(seed: int, tmp_path: Path, recorder: Recorder) -> None:
    in_order, shuffled = created(tmp_path / "a.zarr"), created(tmp_path / "b.zarr")
    drive(in_order, SerialExecutor())
    drive(shuffled, Unruly(seed))
    assert differences(Path(in_order), Path(shuffled)) == []
    assert open_campaign(shuffled).finished


def test_a_stopped_run_commits_what_is_in_flight_and_the_next_one_goes_on_without_computing_it_again(
    tmp_path: Path, recorder: Recorder, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, stopped = created(tmp_path / "a.zarr"), created(tmp_path / "b.zarr")
    drive(whole, SerialExecutor())
    stop = StopRequest()

    def after_one_block(progress: Progress) -> None:
        if progress.simulated:
            stop.signal_name = "SIGTERM"

    with pytest.raises(Stopped, match="SIGTERM received: what was in flight is committed"):
        drive(stopped, Unruly(2), stop=stop, listener=after_one_block)
    assert open_campaign(stopped).n_waves == LAG
    computed = []
    real = tasks.compute_block

    def counted(*arguments: Any) -> Any:
        computed.append(len(arguments[2]))
        return real(*arguments)

    monkeypatch.setattr(tasks, "compute_block", counted)
    drive(stopped, SerialExecutor())
    assert sum(computed) == 2 * sum(SIZES[LAG:])
    assert differences(Path(whole), Path(stopped)) == []


def test_a_wave_that_takes_long_is_not_waited_for_and_what_of_it_is_stored_counts(
    tmp_path: Path, recorder: Recorder, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A batch system gives half a minute, a wave of 1,600 candidates may take an hour."""
    whole, stopped = created(tmp_path / "a.zarr"), created(tmp_path / "b.zarr")
    drive(whole, SerialExecutor())
    stop, clock, computed = StopRequest(), [0.0], []
    monkeypatch.setattr("softclose_workflows.run.campaign.time.monotonic", lambda: clock[0])
    real = tasks.compute_block

    def slow(*arguments: Any) -> Any:
        computed.append(len(arguments[2]))
        clock[0] += 0.4 * PATIENCE_S
        stop.signal_name = "SIGTERM"
        return real(*arguments)

    monkeypatch.setattr(tasks, "compute_block", slow)
    with pytest.raises(Stopped, match=rf"SIGTERM received: of what was in flight, 4 of {2 * sum(SIZES[:LAG])} blocks"):
        drive(stopped, SerialExecutor(), stop=stop)
    assert len(computed) == 4
    assert open_campaign(stopped).committed == 0
    stop.signal_name = None
    drive(stopped, SerialExecutor())
    assert sum(computed) == 2 * sum(SIZES)
    assert differences(Path(whole), Path(stopped)) == []


def test_blocks_that_an_interrupted_run_stored_are_taken_over(
    tmp_path: Path, recorder: Recorder, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, cut = created(tmp_path / "a.zarr"), created(tmp_path / "b.zarr")
    drive(whole, SerialExecutor())
    results = []

    def cut_off(task: BlockTask, result: BlockResult) -> Any:
        results.append(task.place)
        return result if len(results) < 5 else Stopped("cut off")

    with pytest.raises(Stopped, match="cut off"):
        drive(cut, Unruly(4, cut_off))
    assert open_campaign(cut).committed == 0
    computed = []
    real = tasks.compute_block
    monkeypatch.setattr(tasks, "compute_block", lambda *a: (computed.append(len(a[2])), real(*a))[1])
    drive(cut, SerialExecutor())
    assert sum(computed) == 2 * sum(SIZES) - len(results)
    assert differences(Path(whole), Path(cut)) == []


def test_a_result_that_was_damaged_on_its_way_is_asked_for_again(tmp_path: Path, recorder: Recorder) -> None:
    whole, path = created(tmp_path / "a.zarr"), created(tmp_path / "b.zarr")
    drive(whole, SerialExecutor())
    spoiled = []

    def spoil(task: BlockTask, result: BlockResult) -> BlockResult:
        if not spoiled:
            spoiled.append(task)
            result.max_contact_speed[0, 0] += 1e-9
        return result

    drive(path, Unruly(5, spoil))
    assert spoiled
    assert differences(Path(whole), Path(path)) == []


def test_a_block_is_tried_three_times(tmp_path: Path, recorder: Recorder) -> None:
    path = created(tmp_path / "a.zarr")
    tried: list[BlockTask] = []

    def fail(task: BlockTask, result: BlockResult) -> Any:
        if task.place == (0, 0):
            tried.append(task)
            return MemoryError("no room")
        return result

    with pytest.raises(Stopped, match=r"tried 3 times \(MemoryError: no room\)"):
        drive(path, Unruly(6, fail))
    assert len(tried) == 3
    assert open_campaign(path).committed == 0


def test_no_more_blocks_are_sent_than_the_workers_can_use_soon() -> None:
    class Client:
        """As much of a Dask client as an executor asks for; nothing ever finishes."""

        status = "running"
        sent = 0

        def scheduler_info(self, **_: Any) -> dict[str, Any]:
            return {"workers": {"a": {}, "b": {}}}

        def subscribe_topic(self, *_: Any) -> None:
            pass

        def submit(self, *_: Any, **__: Any) -> Any:
            self.sent += 1
            return type("Future", (), {"add_done_callback": lambda self, callback: None})()

    client: Any = Client()
    executor = DaskExecutor(client, None, 30.0)
    for row in range(100):
        executor.submit(block_task(row=row, first=row, proposals_digest=row))
    assert client.sent == 2 * LIVE_PER_WORKER


def test_a_block_that_fails_in_this_process_comes_back_with_its_failure(tmp_path: Path) -> None:
    executor = SerialExecutor()
    task = block_task(store=str(tmp_path / "none.zarr"))
    assert executor.next_event(0.0) is None
    executor.submit(task)
    event = executor.next_event(0.0)
    assert event is not None
    assert event[0] is task
    assert isinstance(event[1], StoreMissingError)


def test_what_a_run_says_of_itself_is_so(tmp_path: Path, recorder: Recorder) -> None:
    told: list[Progress] = []
    path = created(tmp_path / "a.zarr")
    began = time.perf_counter()
    driver = drive(path, Unruly(1), listener=told.append)
    wall = time.perf_counter() - began
    campaign = open_campaign(path)
    g = campaign.records()["g_cm_s"]
    assert (told[0].committed, told[0].simulated, told[0].n_switches_done) == (0, 0, 0)
    assert math.isinf(told[0].best_g_cm_s)
    assert {(p.budget, p.stage, p.n_workers, p.n_retries) for p in told} == {(sum(SIZES), "search", 1, 0)}
    last = told[-1]
    assert (last.committed, last.simulated, last.n_switches_done) == (18, 18, 18 * 80)
    for before, after in itertools.pairwise(told):
        assert before.committed <= after.committed
        assert before.committed <= before.simulated <= sum(SIZES)
        assert isinstance(before.simulated, int)
    for p in told:
        assert p.best_g_cm_s == min(g[: p.committed], default=math.inf)
    assert any(p.simulated > p.committed for p in told)
    spent = driver.spent
    own = (spent.propose, spent.dispatch, spent.assess, spent.commit, spent.wait)
    assert all(0.0 < t < wall for t in own)
    assert sum(own) <= wall
    assert 0.0 < spent.simulate + spent.store < spent.wait + wall


def test_the_best_so_far_is_one_on_the_largest_ensemble(tmp_path: Path) -> None:
    told: list[Progress] = []
    path = make_campaign(tmp_path / "a.zarr", *COMPLETE, run=False)
    drive(path, SerialExecutor(), listener=told.append)
    records = open_campaign(path).records()
    n, g = records["n_switches"], records["g_cm_s"]
    for p in told:
        largest = n[: p.committed] == n[: p.committed].max(initial=0)
        assert p.best_g_cm_s == min(g[: p.committed][largest], default=math.inf)
    assert {"search", "explore", "finish"} == {p.stage for p in told}


def test_a_commit_that_the_disk_refuses_stops_the_run(tmp_path: Path, recorder: Recorder) -> None:
    path = created(tmp_path / "a.zarr")
    with DriverStore(path) as store:
        driver = Driver(store, SerialExecutor())

        def refused(*_: object) -> None:
            raise OSError("no room")

        commit, store.commit = store.commit, refused
        with pytest.raises(Stopped, match="wave 0 could not be committed: no room"):
            driver.run()
        store.commit = commit


def test_a_run_asks_its_workers_once_and_a_finished_one_asks_nobody(tmp_path: Path, recorder: Recorder) -> None:
    asked: list[tuple[str, str]] = []

    class Asked(SerialExecutor):
        def probe(self, store: str, fingerprint: str) -> None:
            asked.append((store, fingerprint))

    path = created(tmp_path / "a.zarr")
    drive(path, Asked())
    assert len(asked) == 1
    drive(path, Asked())
    assert asked == [(path, open_campaign(path).fingerprint)]
