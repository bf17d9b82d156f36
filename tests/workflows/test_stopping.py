"""Claims about signals: the first asks the campaign to stop, the second stops it at once, and neither outlives it."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
import time

import psutil
import pytest

from examples import in_turn
from softclose_workflows.errors import Stopped
from softclose_workflows.run.stopping import StopRequest, stop_on_signals

SIGNALS = (signal.SIGINT, signal.SIGTERM)


@pytest.mark.parametrize("number", SIGNALS)
def test_the_first_signal_is_a_request_and_the_second_ends_the_run(number: signal.Signals) -> None:
    with stop_on_signals() as stop:
        assert not stop
        signal.raise_signal(number)  # raises nothing: what is in flight may be committed
        assert stop
        assert stop.signal_name == number.name
        with pytest.raises(Stopped, match="at once by a second SIGTERM"):
            signal.raise_signal(signal.SIGTERM)


def test_handlers_are_given_back_however_the_block_ends() -> None:
    before = [signal.getsignal(number) for number in SIGNALS]

    def interrupted() -> None:
        with stop_on_signals():
            assert [signal.getsignal(number) for number in SIGNALS] != before
            raise RuntimeError

    with pytest.raises(RuntimeError):
        interrupted()
    assert [signal.getsignal(number) for number in SIGNALS] == before


def test_outside_the_main_thread_nothing_is_installed() -> None:
    found: list[StopRequest] = []

    def work() -> None:
        with stop_on_signals() as stop:
            found.append(stop)
            assert signal.getsignal(signal.SIGINT) is before

    before = signal.getsignal(signal.SIGINT)
    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert len(found) == 1
    assert not found[0]


STUCK = """
import itertools
from softclose_workflows.run import stopping
stopping._WATCH = stopping._WATCH.replace(str(stopping.GRACE_S), "0.5")
with stopping.stop_on_signals():
    print("ready", flush=True)
    sum(itertools.repeat(0))  # no handler runs in here, ever
"""


@pytest.mark.parametrize("n", in_turn([1, 2, 3], 3, 1))
def test_a_run_that_never_comes_back_to_python_is_ended_by_the_second_signal(n: int) -> None:
    with subprocess.Popen([sys.executable, "-c", STUCK], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        for _ in range(n):
            process.send_signal(signal.SIGTERM)
            time.sleep(0.1)
        try:
            assert process.wait(timeout=2.0 if n == 1 else 20.0) == -signal.SIGKILL
            assert n > 1
        except subprocess.TimeoutExpired:
            assert n == 1
        finally:
            process.kill()


def test_the_process_beside_ends_with_the_block() -> None:
    before = signal.set_wakeup_fd(-1)
    signal.set_wakeup_fd(before)
    children = {child.pid for child in psutil.Process().children()}
    with stop_on_signals():
        assert len({child.pid for child in psutil.Process().children()} - children) == 1
    assert signal.set_wakeup_fd(before) == before
    assert {child.pid for child in psutil.Process().children()} <= children
