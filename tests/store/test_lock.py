"""Claims about the lock itself, on disk and behind a URL: who holds it, whether that process lives, who may take it."""

from __future__ import annotations

import getpass
import json
import os
import socket
import subprocess
import sys
from dataclasses import asdict, replace
from pathlib import Path

import pytest

from small_store import create
from softclose_store import LockedError, lock_holder
from softclose_store.disk import lock
from softclose_store.disk.below import Below
from softclose_store.disk.files import create_key, open_files, read_key, write_key
from softclose_store.disk.lock import LOCK_KEY, DriverLock, Holder

ME = Holder.this_process()


@pytest.fixture(params=["disk", "url"])
def where(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    path = str(tmp_path / "a.zarr") if request.param == "disk" else f"memory://{tmp_path.name}/a.zarr"
    create(path)
    return path


def dead_pid() -> int:
    process = subprocess.Popen([sys.executable, "-S", "-c", ""])
    process.wait()
    return process.pid


def held_by(url: str, holder: Holder | bytes) -> None:
    text = holder if isinstance(holder, bytes) else json.dumps(asdict(holder)).encode()
    write_key(open_files(url, read_only=False), LOCK_KEY, text)


def test_a_holder_says_who_it_is_and_is_read_back() -> None:
    assert (ME.pid, ME.host, ME.user) == (os.getpid(), socket.gethostname(), getpass.getuser())
    assert Holder.parse(json.dumps(asdict(ME)).encode()) == ME
    assert str(ME) == f"process {os.getpid()} of {getpass.getuser()} on {socket.gethostname()}, since {ME.since}"


@pytest.mark.parametrize("text", [None, b"", b"{", b"[1]", b"{}", b'{"pid": 3}', b"\xff"])
def test_what_is_no_holder_is_none(text: bytes | None) -> None:
    assert Holder.parse(text) is None


def test_a_user_without_a_name_can_hold_a_lock(monkeypatch: pytest.MonkeyPatch) -> None:
    for error in (KeyError, OSError):
        monkeypatch.setattr(lock.getpass, "getuser", lambda error=error: (_ for _ in ()).throw(error("no name")))
        assert Holder.this_process().user == "?"


@pytest.mark.parametrize(
    ("change", "is_dead"),
    [
        ({}, False),
        ({"boot": "", "started": ""}, False),  # the system does not say
        ({"boot": "another"}, True),
        ({"boot": "another", "host": "elsewhere"}, False),  # who knows what runs there
        ({"started": "1"}, True),  # the pid is another process's now
        ({"started": "1", "host": "elsewhere"}, False),
        ({"pid": -1}, True),
    ],
)
def test_a_holder_is_dead_where_that_is_certain(change: dict[str, str], is_dead: bool) -> None:
    holder = replace(ME, **(change | ({"pid": dead_pid()} if change.get("pid") == -1 else {})))
    assert holder.is_dead is is_dead


def test_without_a_boot_of_our_own_none_is_another(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lock, "boot_id", lambda: "")
    assert not replace(ME, boot="another").is_dead


def test_a_lock_is_held_from_acquire_to_release(where: str) -> None:
    assert lock_holder(where) is None
    first, second = DriverLock(where), DriverLock(where)
    assert not first.still_held()
    first.acquire()
    first.check()
    found = lock_holder(where)
    assert found is not None
    assert (found.pid, found.host) == (ME.pid, ME.host)
    with pytest.raises(LockedError, match=rf"is being driven by process {os.getpid()} of .*; a store has one driver"):
        second.acquire()
    second.release()  # what it does not hold it cannot give back
    first.check()
    first.release()
    assert lock_holder(where) is None
    second.acquire()
    second.release()


def out_of_memory(*_: object) -> bool:
    raise MemoryError


@pytest.mark.parametrize("when", ["acquire", "release"])
def test_a_lock_whose_taking_or_giving_back_fails_is_in_nobody_s_way(
    when: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    create(tmp_path / "a.zarr")
    failed, next_one = DriverLock(tmp_path / "a.zarr"), DriverLock(tmp_path / "a.zarr")
    if when == "release":
        failed.acquire()
    with monkeypatch.context() as patch:
        patch.setattr(Below, "is_same", out_of_memory)
        with pytest.raises(MemoryError):
            getattr(failed, when)()
    next_one.acquire()
    next_one.check()
    next_one.release()


def test_who_holds_a_lock_is_refused_it_and_may_break_it(tmp_path: Path) -> None:
    create(tmp_path / "a.zarr")
    mine = DriverLock(tmp_path / "a.zarr")
    mine.acquire()
    with pytest.raises(LockedError, match="is being driven by process"):
        mine.acquire()
    mine.check()
    mine.acquire(break_lock=True)
    mine.check()
    mine.release()
    assert lock_holder(tmp_path / "a.zarr") is None


def test_a_broken_lock_is_its_breakers(where: str, monkeypatch: pytest.MonkeyPatch) -> None:
    first, second = DriverLock(where), DriverLock(where)
    first.acquire()
    # Behind a URL a holder is known by its text: another process's is another.
    monkeypatch.setattr(Holder, "this_process", classmethod(lambda cls: replace(ME, pid=os.getppid(), started="")))
    second.acquire(break_lock=True)
    assert not first.still_held()
    with pytest.raises(LockedError, match="was broken: another driver works"):
        first.check()
    first.release()
    second.check()
    second.release()
    assert lock_holder(where) is None


def test_behind_a_url_the_dead_are_passed_over_and_strangers_are_not(tmp_path: Path) -> None:
    url = f"memory://{tmp_path.name}-url/a.zarr"
    create(url)
    held_by(url, replace(ME, pid=dead_pid()))
    assert lock_holder(url) is None
    mine = DriverLock(url)
    mine.acquire()
    mine.release()
    for stranger, whose in ((replace(ME, host="elsewhere", user="ann"), "ann on elsewhere"), (b"?", "somebody")):
        held_by(url, stranger)
        assert (lock_holder(url) is None) is isinstance(stranger, bytes)
        with pytest.raises(LockedError, match=whose):
            mine.acquire()
        mine.acquire(break_lock=True)
        mine.release()


@pytest.mark.parametrize("late", ["first", "second"])
def test_of_two_that_take_a_url_in_the_same_instant_one_is_refused_however_slow_its_request(
    late: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both have seen no lock; then one's write is delayed until the other has written, read back and begun."""
    url = f"memory://{tmp_path.name}-race/a.zarr"
    create(url)
    create_key = lock.create_key
    rival = DriverLock(url)
    began = []

    def overtaken(files: object, key: str, text: bytes) -> bool:
        monkeypatch.setattr(lock, "create_key", create_key)
        if late == "first":
            rival.acquire()
            began.append(rival)
            return create_key(files, key, text)
        taken = create_key(files, key, text)
        with pytest.raises(LockedError):
            rival.acquire()
        return taken

    monkeypatch.setattr(lock, "create_key", overtaken)
    mine = DriverLock(url)
    if late == "first":
        with pytest.raises(LockedError, match=f"process {os.getpid()}"):
            mine.acquire()
        assert rival.still_held()
        assert not mine.still_held()
    else:
        mine.acquire()
        assert mine.still_held()
        assert not rival.still_held()


def test_a_service_that_cannot_decide_is_asked_in_two_steps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    url = f"memory://{tmp_path.name}-old/a.zarr"
    create(url)
    files = open_files(url, read_only=False)

    async def unknown(*_: object, **__: object) -> None:
        raise TypeError("unexpected keyword argument 'mode'")

    pipe = files.fs._pipe_file
    monkeypatch.setattr(files.fs, "_pipe_file", lambda *a, **k: unknown() if "mode" in k else pipe(*a, **k))
    assert create_key(files, "candidates/digests/one", b"1")
    assert not create_key(files, "candidates/digests/one", b"2")
    assert read_key(files, "candidates/digests/one") == b"1"


def test_a_dead_driver_whose_child_holds_on_is_named_so(tmp_path: Path) -> None:
    path = tmp_path / "a.zarr"
    create(path)
    mine = DriverLock(path)
    mine.acquire()
    (path / LOCK_KEY).write_text(json.dumps(asdict(replace(ME, pid=dead_pid()))))
    assert lock_holder(path) is None
    with pytest.raises(LockedError, match=r"\(that process is gone; one of its children still holds the lock\)"):
        DriverLock(path).acquire()
    mine.release()
