"""Claims about a driver on a file system that remembers for a while what is not there, as NFS does (lookupcache)."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from campaigns import SMALL
from softclose.settings import load_config
from softclose_store import verify
from softclose_store.disk.below import Below
from softclose_workflows.run.creation import create_store
from softclose_workflows.run.driving import drive
from softclose_workflows.run.executors import Placement
from stores import differences

REMEMBERED_S = 60.0


@pytest.fixture
def late(monkeypatch: pytest.MonkeyPatch) -> dict[str, float]:
    """This process sees a name that another made only a minute after it has once looked for it in vain."""
    missing: dict[str, float] = {}
    look = {name: getattr(Below, name) for name in ("read", "size", "identity")}
    put = Below.write

    def late(name: str) -> Callable[..., Any]:
        def looking(self: Below, key: str, *a: Any, **k: Any) -> Any:
            place = f"{self.root}/{key}"
            if time.monotonic() - missing.get(place, -REMEMBERED_S) < REMEMBERED_S:
                return None
            found = look[name](self, key, *a, **k)
            if found is None:
                missing[place] = time.monotonic()
            return found

        return looking

    def seen_write(self: Below, key: str, *a: Any, **k: Any) -> None:
        put(self, key, *a, **k)
        missing.pop(f"{self.root}/{key}", None)  # what a host writes itself it sees

    for name in look:
        monkeypatch.setattr(Below, name, late(name))
    monkeypatch.setattr(Below, "write", seen_write)
    return missing


@pytest.mark.slow
def test_a_run_needs_no_name_that_it_has_looked_for_in_vain(
    late: dict[str, float], reference_store: Path, tmp_path: Path
) -> None:
    store = tmp_path / "a.zarr"
    create_store(load_config("current", SMALL), str(store))
    drive(str(store), Placement(workers=2), quiet=True)
    assert late  # it did look, and workers wrote those names
    assert differences(store, reference_store) == []
    late.clear()
    assert verify(str(store)).ok
