"""Claims about the process that local workers are forked from: it imports for all of them and hands nothing else on."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from softclose import plugins
from softclose_workflows.run import forking
from softclose_workflows.run.executors.dask import local_cluster

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="workers are forked on Linux only")


def looked(*names: str) -> dict[str, Any]:
    """What a worker sees."""
    import threading

    return {
        "environment": {name: os.environ.get(name) for name in names},
        "parent": os.getppid(),
        "threads": threading.active_count(),
        "folder": os.getcwd(),
    }


def seen(*names: str) -> list[dict[str, Any]]:
    """What each of two workers sees."""
    with local_cluster(2, 30.0) as executor:
        return list(executor._client.run(looked, *names).values())


def test_workers_have_one_parent_that_imports_and_is_not_this_process() -> None:
    first, second = seen()
    assert first["parent"] == second["parent"] != os.getpid()
    loaded = Path(f"/proc/{first['parent']}/maps").read_text()
    assert "llvmlite" in loaded
    assert "numpy" in loaded


def test_workers_have_the_environment_of_now_and_not_of_the_first_cluster(monkeypatch: pytest.MonkeyPatch) -> None:
    seen()
    monkeypatch.setenv("ELSEWHERE", "told later")
    monkeypatch.setenv(plugins.ALLOWED, "mine:model")
    for worker in seen("ELSEWHERE", plugins.ALLOWED):
        assert worker["environment"] == {"ELSEWHERE": "told later", plugins.ALLOWED: "mine:model"}
    monkeypatch.delenv(plugins.ALLOWED)
    for worker in seen(plugins.ALLOWED):
        assert worker["environment"] == {plugins.ALLOWED: None}, "what was allowed to an earlier run"


def environment_of(pid: int) -> list[bytes]:
    """What a process was begun with; empty while it is only just replacing what it was forked from."""
    started = time.monotonic()
    while not (environment := Path(f"/proc/{pid}/environ").read_bytes()):
        assert time.monotonic() - started < 30, "nothing to read"
        time.sleep(0.01)
    return environment.split(b"\0")


def test_what_is_allowed_here_is_not_allowed_to_whoever_comes_later(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The process begins while something is allowed, and serves a run later to which nothing is."""
    from multiprocessing import forkserver

    monkeypatch.setattr(forkserver, "_forkserver", other := forkserver.ForkServer())
    for name in ("ensure_running", "connect_to_new_process", "set_forkserver_preload"):
        monkeypatch.setattr(forkserver, name, getattr(other, name))
    monkeypatch.setenv(plugins.ALLOWED, "mine:model")
    before = dict(os.environ)
    forking.start_ahead()
    assert dict(os.environ) == before
    environment = environment_of(other._forkserver_pid)
    assert not any(entry.startswith(b"SOFTCLOSE") for entry in environment)
    assert b"OPENBLAS_NUM_THREADS=1" in environment
    assert f"MALLOC_TRIM_THRESHOLD_={2**28}".encode() in environment
    other._stop()


def test_where_nothing_is_forked_nothing_begins(monkeypatch: pytest.MonkeyPatch) -> None:
    from multiprocessing import forkserver

    monkeypatch.setattr(forking, "METHOD", "spawn")
    monkeypatch.setattr(forkserver, "ensure_running", lambda: pytest.fail("it begins"))
    forking.start_ahead()
