"""Claims about signals: the first asks the campaign to stop, the second stops it at once, and neither outlives it."""

from __future__ import annotations

import signal
import threading

import pytest

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
