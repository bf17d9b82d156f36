"""Claims about the Dask executor that need no cluster: a client that does what the test says stands in for one."""

from __future__ import annotations

import logging
import threading
import time
from dataclasses import replace
from types import SimpleNamespace

import dask
import pytest
from distributed.scheduler import KilledWorker

from small_campaigns import block_task
from softclose_workflows.errors import Stopped
from softclose_workflows.run.executors import dask as executors
from softclose_workflows.run.executors.dask import DaskExecutor
from softclose_workflows.run.executors.protocol import run_task
from softclose_workflows.run.faults import MAX_TRIES

PATIENCE_S = 0.15


class StandIn:
    """A client whose futures end when the test says so."""

    def __init__(self, workers=("a", "b")):
        self.status, self.sent, self.answers = "running", [], {}
        self.topics = {}
        self._workers = workers

    def scheduler_info(self, n_workers):
        assert n_workers == -1  # Dask lists five workers otherwise
        return {"workers": dict.fromkeys(self._workers)}

    def subscribe_topic(self, topic, handler):
        self.topics[topic] = handler

    def unsubscribe_topic(self, topic):
        del self.topics[topic]

    def tell(self, **message):
        self.topics["all"]((0.0, message))

    def run(self, function, *arguments, workers, on_error):
        assert on_error == "return"
        self.asked = (function.__name__, arguments)
        return {w: self.answers.get(w, "") for w in workers or self._workers}

    def submit(self, function, task, *, key, pure, workers):
        assert function is run_task
        assert not pure  # equal blocks of two campaigns are not the same block
        future = SimpleNamespace(key=key, status="pending", task=task, workers=workers, cancelled=False)
        future.add_done_callback = lambda callback: setattr(future, "callback", callback)
        future.cancel = lambda: setattr(future, "cancelled", True)
        self.sent.append(future)
        return future

    def end(self, future, status="finished", result=None, raised=None):
        future.status = status
        future.result = lambda timeout: result
        future.exception = lambda: raised
        future.callback(future)


@pytest.fixture
def client():
    return StandIn()


@pytest.fixture
def executor(client):
    return DaskExecutor(client, None, PATIENCE_S)


@pytest.fixture
def task():
    return block_task()


def test_workers_that_come_and_go_are_counted_and_a_death_is_a_retry(client, executor):
    assert executor.n_workers == 2
    client.tell(action="add-worker", worker="c")
    assert executor.n_workers == 3
    client.tell(action="remove-worker", worker="c", expected=True)
    assert (executor.n_workers, executor.n_retries) == (2, 0)
    client.tell(action="remove-worker", worker="a")
    assert (executor.n_workers, executor.n_retries) == (1, 1)
    client.topics["all"]((0.0, "words of another kind"))
    client.tell(action="something-else", worker="b")
    assert (executor.n_workers, executor.n_retries) == (1, 1)
    executor.close()
    assert not client.topics


def test_a_result_waits_until_it_is_asked_for(client, executor, task):
    executor.submit(task)
    assert not executor.has_finished
    client.end(client.sent[0], result="done")
    assert executor.has_finished
    assert executor.next_event(1.0) == (task, "done")
    assert not executor.has_finished
    assert executor.next_event(0.01) is None


def test_a_block_that_has_left_is_not_told_twice(client, executor, task):
    executor.submit(task)
    client.end(client.sent[0], result="done")
    client.end(client.sent[0], result="again")
    assert executor.next_event(0.01) == (task, "done")
    assert not executor.has_finished


@pytest.mark.parametrize(
    ("status", "raised", "expected"),
    [
        ("error", ValueError("no such model"), "no such model"),
        ("error", KilledWorker("block", None, 3), f"killed {MAX_TRIES + 1} workers in a row"),
        ("cancelled", None, "was cancelled"),
        ("lost", None, "was cancelled"),
    ],
)
def test_what_fails_is_told_with_its_reason(client, executor, task, status, raised, expected):
    executor.submit(task)
    client.end(client.sent[0], status, raised=raised)
    got, outcome = executor.next_event(0.01)
    assert got is task
    assert isinstance(outcome, Stopped) or outcome is raised
    assert expected in str(outcome)
    assert isinstance(outcome, Stopped) == (expected != "no such model")


def test_what_is_raised_on_dask_s_own_thread_reaches_the_driver(client, executor, task):
    """A result that cannot be fetched any more, and even a demand to exit."""
    for raised in (TimeoutError("gone"), SystemExit("gone")):
        executor.submit(task)
        future = client.sent[-1]
        future.status = "finished"

        def result(timeout, raised=raised):
            assert timeout == PATIENCE_S
            raise raised

        future.result = result
        future.callback(future)
        assert executor.next_event(0.01) == (task, raised)


def test_blocks_are_sent_ahead_of_the_workers_and_no_further(client, executor, task):
    """Four for each worker; as one ends the next goes out, and every key is new."""
    for _ in range(11):
        executor.submit(task)
    assert len(client.sent) == 8
    client.end(client.sent[0])
    assert len(client.sent) == 9
    client.tell(action="add-worker", worker="c")
    executor.submit(task)
    assert len(client.sent) == 12
    assert len({future.key for future in client.sent}) == 12
    assert {future.workers for future in client.sent} == {None}


def test_a_scheduler_is_never_given_more_than_it_can_hold(task):
    client = StandIn([f"w{i}" for i in range(400)])
    executor = DaskExecutor(client, None, PATIENCE_S)
    for row in range(1200):  # blocks of their own: names of one and the same differ by six random digits only
        executor.submit(replace(task, row=row))
    assert len(client.sent) == executors.MOST_LIVE


def test_without_a_worker_blocks_still_wait_at_the_scheduler(task):
    client = StandIn([])
    executor = DaskExecutor(client, None, PATIENCE_S)
    for _ in range(9):
        executor.submit(task)
    assert len(client.sent) == executors.LIVE_PER_WORKER


# Workers that cannot compute the campaign's blocks.


def test_unfit_workers_get_no_block(client, executor, task):
    client.answers = {"a": "another version"}
    executor.probe("/store", "f00d")
    assert client.asked[1][:2] == ("/store", "f00d")
    executor.submit(task)
    assert client.sent[0].workers == ["b"]


def test_where_no_worker_is_fit_the_run_stops_with_the_reasons(client, executor):
    client.answers = {"a": "another version", "b": ModuleNotFoundError("softclose")}
    with pytest.raises(Stopped, match=r"another version \(1 of 2\).*ModuleNotFoundError: softclose \(1 of 2\)"):
        executor.probe("/store", "f00d")


def test_a_newcomer_is_asked_beside_the_event_loop(client, executor, task):
    executor.probe("/store", "f00d")
    client.answers = {"c": "another version"}
    client.tell(action="add-worker", worker="c")
    for thread in threading.enumerate():
        if thread is not threading.current_thread() and thread.daemon and "_ask_newcomer" in thread.name:
            thread.join(5)
    executor.submit(task)
    assert client.sent[0].workers == ["a", "b"]


def test_before_the_campaign_is_known_nobody_is_asked(client, executor):
    client.run = None  # calling it would end in a traceback on the thread
    client.tell(action="add-worker", worker="c")
    assert not any("_ask_newcomer" in thread.name for thread in threading.enumerate())
    assert executor.n_workers == 3


def test_an_unfit_worker_that_left_is_forgotten(client, executor, task):
    client.answers = {"a": "another version"}
    executor.probe("/store", "f00d")
    client.tell(action="remove-worker", worker="a", expected=True)
    client.tell(action="add-worker", worker="d")
    executor.submit(task)
    assert client.sent[0].workers is None


def test_a_block_whose_chosen_workers_are_all_gone_is_sent_to_others(client, executor, task):
    client.answers = {"a": "another version"}
    executor.probe("/store", "f00d")
    executor.submit(task)
    assert executor.next_event(0.01) is None
    assert len(client.sent) == 1  # its worker lives: it stays
    client.answers = {}
    client.tell(action="add-worker", worker="c")
    client.tell(action="remove-worker", worker="b")
    executor.next_event(0.01)
    first, second = client.sent
    assert first.cancelled
    assert second.workers == ["c"]
    client.end(first, "cancelled")
    assert not executor.has_finished  # the one that was withdrawn says nothing
    client.end(second, result="done")
    assert executor.next_event(0.01) == (task, "done")


# Patience.


def test_with_workers_the_driver_waits_for_ever(client, executor):
    for _ in range(3):
        time.sleep(PATIENCE_S * 0.6)
        assert executor.next_event(0.01) is None


@pytest.mark.parametrize(("status", "what"), [("running", "no worker is left"), ("connecting", "scheduler is gone")])
def test_patience_ends_and_says_what_it_waited_for(client, executor, status, what):
    client.status = status
    for worker in "ab":
        client.tell(action="remove-worker", worker=worker)
    assert executor.next_event(0.01) is None  # not at once
    time.sleep(PATIENCE_S * 1.2)
    with pytest.raises(Stopped, match=what):
        executor.next_event(0.01)


def test_a_result_or_a_newcomer_renews_patience(client, executor, task):
    executor.submit(task)
    for worker in "ab":
        client.tell(action="remove-worker", worker=worker)
    time.sleep(PATIENCE_S * 1.2)
    client.end(client.sent[0], result="done")
    assert executor.next_event(0.01) == (task, "done")
    assert executor.next_event(0.01) is None
    time.sleep(PATIENCE_S * 1.2)
    client.tell(action="remove-worker", worker="a")
    assert executor.next_event(0.01) is None


def test_workers_that_died_are_replaced_up_to_the_number_asked_for(client, monkeypatch):
    monkeypatch.setattr(executors, "REFILL_S", 0.0)
    asked = []
    executor = DaskExecutor(client, None, PATIENCE_S, asked.append)
    executor.next_event(0.01)
    assert asked == []
    client.tell(action="remove-worker", worker="a")
    executor.next_event(0.01)
    assert asked == [2]


def test_workers_are_replaced_while_the_others_are_busy_and_not_at_every_result(client, task, monkeypatch):
    asked = []
    executor = DaskExecutor(client, None, PATIENCE_S, asked.append, wanted=3)
    for _ in range(3):
        executor.submit(task)
        client.end(client.sent[-1])
        assert executor.next_event(1.0) is not None
    assert asked == []
    monkeypatch.setattr(executors, "REFILL_S", 0.0)
    executor.submit(task)
    client.end(client.sent[-1])
    assert executor.next_event(1.0) is not None
    assert asked == [3]


def test_a_cluster_of_our_own_is_silent_and_restarts_quickly():
    """Dask's account of a worker's death runs to a page; ours is one line."""
    with dask.config.set({}):
        executors.configure()
        assert dask.config.get("distributed.scheduler.allowed-failures") == MAX_TRIES
        assert dask.config.get("distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_") == 2**28
        watched = {name: dask.config.get(name) for name in executors.WATCHING}
        assert watched == executors.WATCHING
        assert watched["distributed.worker.profile.enabled"] is False
    assert not logging.getLogger("distributed.nanny").isEnabledFor(logging.CRITICAL)
