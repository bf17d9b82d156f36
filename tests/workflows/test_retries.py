"""Claims about the one policy for faults of the machine: three tries, none where another would meet the same."""

from __future__ import annotations

import ast
import errno
from pathlib import Path
from types import SimpleNamespace

import pytest

import softclose_workflows.run
from softclose_workflows.errors import Stopped
from softclose_workflows.run.faults import MAX_TRIES, Retries

A, B = (SimpleNamespace(name=f"block {key}", key=key) for key in "ab")


def test_a_task_is_submitted_again_until_it_was_tried_so_often() -> None:
    submitted: list[object] = []
    retries = Retries(submitted.append)
    for _ in range(MAX_TRIES - 1):
        retries.again(A, MemoryError("no room"))
    retries.again(B, MemoryError("no room"))  # each has its own count
    assert submitted == [A] * (MAX_TRIES - 1) + [B]
    with pytest.raises(Stopped) as e:
        retries.again(A, MemoryError("no room"))
    assert str(e.value) == (
        f"block a could not be computed, tried {MAX_TRIES} times (MemoryError: no room); nothing of it is recorded"
    )
    assert isinstance(e.value.__cause__, MemoryError)
    assert len(submitted) == MAX_TRIES


@pytest.mark.parametrize(
    ("failure", "said"),
    [
        (OSError(errno.ENOSPC, "full"), "tried once .OSError"),
        (OSError(errno.EDQUOT, "quota"), "tried once"),
        (OSError(errno.EROFS, "read-only"), "tried once"),
        (Stopped("no worker is left"), "^no worker is left$"),
    ],
)
def test_what_another_try_would_meet_too_stops_at_once(failure: BaseException, said: str) -> None:
    with pytest.raises(Stopped, match=said):
        Retries(lambda task: pytest.fail("submitted")).again(A, failure)


def test_another_fault_of_a_disk_is_tried_again() -> None:
    submitted: list[object] = []
    Retries(submitted.append).again(A, OSError(errno.EIO, "a cable"))
    assert submitted == [A]


def test_nobody_else_counts_tries() -> None:
    """Executors count workers that die; tasks that fail are counted here."""
    folder = Path(softclose_workflows.run.__file__).parent
    for path in folder.glob("*.py"):
        names = {n.id for n in ast.walk(ast.parse(path.read_text("utf-8"))) if isinstance(n, ast.Name)}
        assert path.name == "faults.py" or "MAX_TRIES" not in names, path
