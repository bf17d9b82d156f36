"""Claims about the lock of a store in an object store: one of any number wins, and the dead hold nothing for ever."""

from __future__ import annotations

import json
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest

from small_store import create
from softclose_store import LockedError, lock_holder
from softclose_store.disk import lease, objects
from softclose_store.disk.files import create_key, key_version, list_keys, open_files, read_key, replace_key, write_key
from softclose_store.disk.lock import LOCK_KEY, DriverLock, Holder
from softclose_store.errors import ServiceError, StoreError

ME = Holder.this_process()
STRANGER = replace(ME, host="elsewhere", user="ann", token="other")


def _hold(url: str, holder: Holder) -> None:
    write_key(open_files(url, read_only=False), LOCK_KEY, holder.text)


def test_a_key_is_created_once_and_replaced_only_in_the_state_that_was_seen(s3: str) -> None:
    files = open_files(s3, read_only=False)
    assert create_key(files, "one", b"1")
    assert not create_key(files, "one", b"2")
    seen = key_version(files, "one")
    assert seen is not None
    assert seen.content == b"1"
    write_key(files, "one", b"3")
    assert not replace_key(files, "one", b"4", seen.tag)
    now = key_version(files, "one")
    assert now is not None
    assert replace_key(files, "one", b"5", now.tag)
    assert read_key(files, "one") == b"5"
    assert key_version(files, "none") is None
    assert not replace_key(files, "none", b"6", now.tag)


@pytest.mark.parametrize("before", ["nothing", "dead"])
def test_of_many_that_come_at_once_exactly_one_wins(before: str, s3: str) -> None:
    if before == "dead":
        _hold(s3, replace(ME, boot="an earlier one", token="dead"))
    locks = [DriverLock(s3) for _ in range(8)]
    together = threading.Barrier(len(locks))

    def take(lock: DriverLock) -> bool:
        together.wait()
        try:
            lock.acquire()
        except LockedError:
            return False
        return True

    with ThreadPoolExecutor(len(locks)) as pool:
        taken = list(pool.map(take, locks))
    assert sum(taken) == 1
    assert [lock.still_held() for lock in locks] == taken
    for lock in locks:
        lock.release()
    assert lock_holder(s3) is None


def test_who_renews_keeps_a_lock_and_who_does_not_loses_it(s3: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lease, "RENEW_S", 0.2)
    monkeypatch.setattr(lease, "LEASE_S", 2.0)
    monkeypatch.setattr(Holder, "this_process", classmethod(lambda cls: STRANGER))
    theirs = DriverLock(s3)
    theirs.acquire()
    monkeypatch.setattr(Holder, "this_process", classmethod(lambda cls: ME))
    time.sleep(4.0)  # twice the lease
    with pytest.raises(LockedError, match="ann on elsewhere"):
        DriverLock(s3).acquire()
    assert theirs._renewal is not None
    theirs._renewal.stop()  # as if it had died
    time.sleep(4.0)
    mine = DriverLock(s3)
    mine.acquire()
    assert not theirs.still_held()
    with pytest.raises(LockedError, match="was broken: another driver works"):
        theirs.check()
    theirs.release()
    mine.check()
    mine.release()


@pytest.mark.parametrize("failure", [ServiceError("slow down"), StoreError("refused")])
def test_a_renewal_that_fails_is_tried_again(failure: Exception, s3: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lease, "RENEW_S", 0.05)
    real, failures = lease.key_version, [failure, failure]

    def faltering(*a: Any) -> Any:
        if failures:
            raise failures.pop()
        return real(*a)

    monkeypatch.setattr(lease, "key_version", faltering)
    mine = DriverLock(s3)
    mine.acquire()
    end = time.monotonic() + 10.0
    while json.loads(read_key(open_files(s3, read_only=True), LOCK_KEY) or b"{}").get("renewals", 0) < 2:
        assert time.monotonic() < end
        time.sleep(0.05)
    assert not failures
    mine.check()
    mine.release()
    assert lock_holder(s3) is None


def test_a_renewal_never_takes_a_lock_back(s3: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lease, "RENEW_S", 3600.0)
    first = DriverLock(s3)
    first.acquire()
    second = DriverLock(s3)
    monkeypatch.setattr(Holder, "this_process", classmethod(lambda cls: STRANGER))
    second.acquire(break_lock=True)
    assert first._renewal is not None
    assert not first._renewal.renew()
    second.check()
    first.release()
    second.check()
    assert second._renewal is not None
    assert second._renewal.renew()
    second.check()
    second.release()


def test_a_hosts_clock_does_not_matter(s3: str, monkeypatch: pytest.MonkeyPatch) -> None:
    _hold(s3, STRANGER)
    real = time.time
    monkeypatch.setattr(time, "time", lambda: real() + 86_400.0)
    with pytest.raises(LockedError, match="ann on elsewhere"):
        DriverLock(s3).acquire()


def test_who_looks_sees_no_driver_behind_a_lock_that_is_long_expired(s3: str, monkeypatch: pytest.MonkeyPatch) -> None:
    _hold(s3, STRANGER)
    found = lock_holder(s3)
    assert found is not None
    assert found.host == "elsewhere"
    monkeypatch.setattr(lease, "LEASE_S", -610.0)
    assert lock_holder(s3) is None


def test_without_a_bucket_or_credentials_it_is_said_what_to_do(s3: str, monkeypatch: pytest.MonkeyPatch) -> None:
    files = open_files("s3://nowhere/a.zarr", read_only=False)
    with pytest.raises(StoreError, match="make the bucket first"):
        write_key(files, "a", b"1")
    with pytest.raises(StoreError, match="make the bucket first"):
        create_key(files, "a", b"1")


def test_a_service_that_never_answers_is_no_bad_input(s3: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://127.0.0.1:9")
    monkeypatch.setattr(objects, "RETRIES", 1)
    files = open_files(s3, read_only=False)
    with pytest.raises(ServiceError, match="does not answer as it should"):
        read_key(files, "a")
    assert issubclass(ServiceError, OSError)


def test_a_service_without_conditional_writes_is_refused(s3: str, monkeypatch: pytest.MonkeyPatch) -> None:
    import obstore
    from obstore.exceptions import NotSupportedError

    async def unable(*_: Any, mode: Any = None, **__: Any) -> None:
        raise NotSupportedError("no conditional put")

    monkeypatch.setattr(obstore, "put_async", unable)
    with pytest.raises(StoreError, match="has no conditional writes"):
        DriverLock(s3).acquire()


def test_a_store_in_a_bucket_holds_what_a_local_one_holds(s3: str, tmp_path: Any) -> None:
    create(s3)
    create(tmp_path / "a.zarr")
    keys = open_files(s3, read_only=True)
    local = open_files(tmp_path / "a.zarr", read_only=True)
    assert list_keys(keys) == list_keys(local)


@pytest.mark.parametrize(("age_s", "gone"), [(100.0, False), (500.0, False), (700.0, False), (740.0, True)])
def test_who_only_looks_allows_for_a_clock_that_is_ten_minutes_wrong(age_s: float, gone: bool) -> None:
    """A lease of two minutes, and ten of the looking host's own error."""
    held = objects.Version(content=b"", tag="", modified=datetime.now(UTC) - timedelta(seconds=age_s))
    assert lease.looks_expired(held) is gone
