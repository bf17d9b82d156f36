"""Claims about a disk or a memory that fails once, at any operation of a campaign: nothing of it becomes a result."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from examples import in_turn
from small_campaigns import COARSE, make_campaign
from softclose.settings import load_config
from softclose_store import StoreError, open_campaign, remove_orphans, store_state, verify
from softclose_store.disk import below, files
from softclose_store.write import create
from softclose_store.write.block import forget_writer
from softclose_workflows.commands.driving import drive
from softclose_workflows.errors import Stopped
from softclose_workflows.run.executors import Placement
from stores import differences

EVERY = {"slow": 257, "long": 61}
"""Operations between two that fail: in `make test`, in `make long`."""
FAILURES = {"disk": lambda: OSError(errno.EIO, os.strerror(errno.EIO)), "memory": MemoryError}
OPERATIONS = ("open", "pread", "write", "replace", "rename", "mkdir")


class Faulty:
    """Stands for `os` in the store's modules, and for its reads: one operation fails."""

    def __init__(self, fail_at: int, failure: str) -> None:
        self.left = fail_at
        self.failure = failure
        self.count = 0

    def step(self) -> None:
        self.count += 1
        self.left -= 1
        if self.left == 0:
            raise FAILURES[self.failure]()

    def __getattr__(self, name: str) -> Any:
        real = getattr(os, name)
        if name not in OPERATIONS:
            return real

        def operation(*arguments: Any, **named: Any) -> Any:
            self.step()
            return real(*arguments, **named)

        return operation


@contextmanager
def faulty(fail_at: int, failure: str = "disk") -> Iterator[Faulty]:
    faults = Faulty(fail_at, failure)
    with pytest.MonkeyPatch.context() as patch:
        for module in (below, files, create):
            patch.setattr(module, "os", faults)
        yield faults


def run(path: Path) -> None:
    drive(str(path), Placement(serial=True), config=load_config("current", COARSE), quiet=True)


@pytest.mark.parametrize(
    "every",
    [pytest.param("slow", marks=pytest.mark.slow), pytest.param("long", marks=[pytest.mark.slow, pytest.mark.long])],
)
@pytest.mark.parametrize("failure", in_turn(FAILURES, 2))
@pytest.mark.timeout(1200)
def test_an_operation_that_fails_once_stops_the_run_or_is_done_again_and_the_end_is_the_same(
    failure: str, every: str, tmp_path: Path
) -> None:
    reference = Path(make_campaign(tmp_path / "reference.zarr", *COARSE))
    with faulty(0) as whole:
        run(tmp_path / "counted.zarr")
    assert whole.count > 200
    endings = set()
    for k in range(1, whole.count + 1, EVERY[every]):
        path = tmp_path / f"{k}.zarr"
        with faulty(k, failure):
            try:
                run(path)
                endings.add("done")
            except (Stopped, StoreError) as e:
                endings.add(type(e).__name__)
        forget_writer(path)
        if store_state(path).kind == "campaign":
            assert verify(path).ok, k
            assert not open_campaign(path).records()["failed"].any(), k
        run(path)
        remove_orphans(path)
        assert differences(reference, path) == [], k
        forget_writer(path)
    assert {"done", "Stopped"} <= endings
