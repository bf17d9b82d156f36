"""Owns the one-driver rule: a lock that a crash releases, and a message that says whose it is.

On local paths the lock is `flock` on a file; its text says who holds it. The kernel releases it when the holder dies,
however it dies. In an object store the text is a lease that its holder renews, and conditional writes let one of two
win. Behind any other URL there is only the text: a holder that died on this host is recognised, any other must be
broken by hand.
"""

from __future__ import annotations

import fcntl
import getpass
import json
import os
import socket
import uuid
from dataclasses import asdict, replace
from datetime import UTC, datetime
from typing import Annotated

from pydantic import AfterValidator, ConfigDict, Field, TypeAdapter
from pydantic.dataclasses import dataclass

from softclose_store.disk.below import Below
from softclose_store.disk.files import (
    ZIPPED,
    StorePath,
    create_key,
    delete_key,
    is_zip,
    key_version,
    local_path,
    look_at,
    normalised,
    open_files,
    path_text,
    read_key,
    replace_key,
)
from softclose_store.disk.lease import Renewal, has_expired, looks_expired
from softclose_store.disk.names import OWN_FOLDER
from softclose_store.disk.objects import ServiceFiles
from softclose_store.disk.processes import boot_id, process_is_alive, process_start
from softclose_store.errors import LockedError, StoreError

LOCK_KEY = f"{OWN_FOLDER}/driver.lock"


def _printable(word: str) -> str:
    """It is shown at a terminal, to which a control character would be an instruction."""
    if not word.isprintable():
        raise ValueError("it has a control character")
    return word


Word = Annotated[str, AfterValidator(_printable)]


@dataclass(frozen=True, slots=True, kw_only=True, config=ConfigDict(strict=True, extra="forbid"))
class Holder:
    """Who holds a store."""

    host: Word
    """Host name."""
    pid: Annotated[int, Field(ge=1, lt=2**31)]
    """Process on that host."""
    started: Word
    """Its start in clock ticks since boot: pids are reused."""
    boot: Word
    """Identity of the host's boot."""
    user: Word
    """User name."""
    since: Word
    """When the lock was taken, ISO 8601."""
    token: Word = ""
    """Tells two locks of one process apart."""
    renewals: Annotated[int, Field(ge=0, lt=2**31)] = 0
    """How often an object store's lease was renewed."""

    @classmethod
    def this_process(cls) -> Holder:
        """The calling process."""
        try:
            user = getpass.getuser()
        except (KeyError, OSError):
            user = "?"
        return cls(
            host=socket.gethostname(),
            pid=os.getpid(),
            started=process_start(os.getpid()),
            boot=boot_id(),
            user=user,
            since=datetime.now(UTC).isoformat(timespec="seconds"),
            token=uuid.uuid4().hex,
        )

    @classmethod
    def parse(cls, text: bytes | None) -> Holder | None:
        """Who wrote a lock; None where the text is none or unreadable."""
        try:
            return TypeAdapter(cls).validate_json(text or b"")
        except ValueError:
            return None

    @property
    def text(self) -> bytes:
        """What a lock holds."""
        return json.dumps(asdict(self)).encode()

    @property
    def is_dead(self) -> bool:
        """True where the holder certainly runs no more: it was on this host, and is not any longer."""
        if self.host != socket.gethostname():
            return False
        if self.boot and boot_id() and self.boot != boot_id():
            return True
        if not process_is_alive(self.pid):
            return True
        return bool(self.started and process_start(self.pid) and self.started != process_start(self.pid))

    def __str__(self) -> str:
        return f"process {self.pid} of {self.user} on {self.host}, since {self.since}"


class DriverLock:
    """The lock of one store, held from `acquire` to `release`."""

    def __init__(self, path: StorePath) -> None:
        self._where = normalised(path)
        local = local_path(path)
        if local is not None and is_zip(local):
            raise StoreError(f"{path_text(path)} {ZIPPED}")
        self._below = None if local is None else Below(self._where)
        self._files = None if self._below is not None else open_files(path, read_only=False)
        self._descriptor: int | None = None
        self._text: bytes | None = None
        """What is ours behind a URL."""
        self._holder = Holder.this_process()
        self._renewal: Renewal | None = None

    def acquire(self, *, break_lock: bool = False) -> None:
        """Take the lock; raises LockedError where a live driver holds it. break_lock takes it anyway."""
        self._holder = Holder.this_process()
        text = self._holder.text
        if self._below is not None:
            self._acquire_local(self._below, text, break_lock)
            return
        assert self._files is not None
        if isinstance(self._files, ServiceFiles):
            self._acquire_lease(self._files, break_lock)
            return
        content = read_key(self._files, LOCK_KEY)
        holder = Holder.parse(content)
        if content and not break_lock and (holder is None or not holder.is_dead):
            raise self._refusal(holder)
        if content is not None:
            delete_key(self._files, LOCK_KEY)
        # The service decides between two that come in the same instant, however long their requests take.
        created = create_key(self._files, LOCK_KEY, text)
        if not created or read_key(self._files, LOCK_KEY) != text:
            raise self._refusal(Holder.parse(read_key(self._files, LOCK_KEY)))
        self._text = text

    def _acquire_lease(self, files: ServiceFiles, break_lock: bool) -> None:
        held = key_version(files, LOCK_KEY)
        if held is None:
            taken = create_key(files, LOCK_KEY, self._holder.text)
        else:
            holder = Holder.parse(held.content)
            dead = holder is not None and holder.is_dead
            if not (break_lock or dead or has_expired(files, held)):
                raise self._refusal(holder)
            taken = replace_key(files, LOCK_KEY, self._holder.text, held.tag)
        if not taken:  # another was faster
            raise self._refusal(Holder.parse(read_key(files, LOCK_KEY)))
        self._text = self._holder.text
        self._renewal = Renewal(files, LOCK_KEY, self._next_text, self._is_mine)

    def _next_text(self) -> bytes:
        self._holder = replace(self._holder, renewals=self._holder.renewals + 1)
        return self._holder.text

    def _is_mine(self, content: bytes) -> bool:
        holder = Holder.parse(content)
        return holder is not None and holder.token == self._holder.token

    def _acquire_local(self, below: Below, text: bytes, break_lock: bool) -> None:
        if break_lock:
            below.delete(LOCK_KEY)  # a new file is a new lock; the old holder keeps one that nobody looks at
        while True:
            descriptor = below.open_lock(LOCK_KEY)
            try:
                if self._is_locked(below, descriptor):
                    os.ftruncate(descriptor, 0)
                    os.pwrite(descriptor, text, 0)
                    self._descriptor = descriptor
                    return
            except BaseException:
                os.close(descriptor)  # else this process would be in its own way, whatever it tries next
                raise
            os.close(descriptor)

    def _is_locked(self, below: Below, descriptor: int) -> bool:
        """Lock an open file; False where it is the store's lock no longer, or is another name's file too."""
        if not _lock(descriptor):
            raise self._refusal(Holder.parse(os.read(descriptor, 4096)))
        if not below.is_same(descriptor, LOCK_KEY):
            return False  # it was replaced between opening and locking it
        if os.fstat(descriptor).st_nlink != 1:
            below.delete(LOCK_KEY)  # nothing is written into what is another name's file
            return False
        return True

    def still_held(self) -> bool:
        """False once somebody has broken the lock."""
        if self._below is not None:
            return self._descriptor is not None and self._below.is_same(self._descriptor, LOCK_KEY)
        assert self._files is not None
        if self._text is None:
            return False
        content = read_key(self._files, LOCK_KEY)
        return content == self._text or (content is not None and self._is_mine(content))

    def check(self) -> None:
        """Raise LockedError once somebody has broken the lock: the store is theirs now."""
        if not self.still_held():
            raise LockedError(f"the lock of {self._where} was broken: another driver works on the store now")

    def release(self) -> None:
        """Give the lock back; one that was broken is left to its new holder."""
        if self._renewal is not None:
            self._renewal.stop()
            self._renewal = None
        if self._below is not None:
            if self._descriptor is not None:
                try:
                    if self._below.is_same(self._descriptor, LOCK_KEY):
                        self._below.delete(LOCK_KEY)
                finally:
                    os.close(self._descriptor)
                    self._descriptor = None
        elif self._files is not None and self.still_held():
            delete_key(self._files, LOCK_KEY)

    def _refusal(self, holder: Holder | None) -> LockedError:
        whose = "somebody" if holder is None else str(holder)
        fate = ""
        if holder is not None and holder.is_dead:
            fate = " (that process is gone; one of its children still holds the lock)"
        return LockedError(
            f"{self._where} is being driven by {whose}{fate}; a store has one driver at a time: wait for it, or, if "
            "you are sure that it is gone, take the store with --break-lock"
        )


def lock_holder(path: StorePath) -> Holder | None:
    """Who drives a store now; None where nobody does. Takes nothing and waits for nothing."""
    local = local_path(path)
    if local is None:
        files = open_files(path, read_only=True)
        if isinstance(files, ServiceFiles):
            held = key_version(files, LOCK_KEY)
            content = None if held is None or looks_expired(held) else held.content
        else:
            content = read_key(files, LOCK_KEY)
        holder = Holder.parse(content)
        return None if holder is None or holder.is_dead else holder
    holder = Holder.parse(None if is_zip(local) else look_at(open_files(path, read_only=True), LOCK_KEY))
    return None if holder is None or holder.is_dead else holder


def _lock(descriptor: int) -> bool:
    """True where the lock was free."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True
