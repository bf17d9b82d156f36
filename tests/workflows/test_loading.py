"""Claims about what the driver loads while workers start: beside them, to its end, of no consequence if it fails."""

from __future__ import annotations

import threading
import time

import pytest

from softclose.settings import load_config
from softclose_workflows.run import driving
from softclose_workflows.run.executors import Placement


@pytest.mark.parametrize("fails", [False, True])
def test_libraries_are_loaded_beside_the_start_of_workers(fails: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    started, done, config = threading.Event(), list[str](), load_config("current")

    def load(given: object) -> None:
        assert given is config
        started.set()
        time.sleep(0.2)
        done.append(threading.current_thread().name)
        if fails:
            raise ImportError("no such library")

    monkeypatch.setattr(driving, "load_ahead", load)
    with driving._loading(config, Placement(workers=1)):
        assert started.wait(10.0)
        assert not done, "whoever starts workers does not wait"
    assert done == ["softclose-loading"]


def test_without_workers_nothing_is_loaded_ahead(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(driving, "load_ahead", lambda config: pytest.fail("its time would be added"))
    with driving._loading(load_config("current"), Placement(serial=True)):
        pass
