"""Owns leases of keys in an object store: a lock that its holder renews, and that others may take once it has not.

Ages are differences of two of the service's own times: no clock of a host has to be right.
"""

from __future__ import annotations

import threading
import uuid
from collections.abc import Callable
from datetime import UTC, datetime, timedelta

from softclose_store.disk.files import delete_key, key_version, replace_key, write_key
from softclose_store.disk.names import PARTIAL
from softclose_store.disk.objects import ServiceFiles, Version
from softclose_store.errors import ServiceError, StoreError

LEASE_S = 120.0
"""A lock that was not renewed for so long belongs to nobody [s]."""

RENEW_S = 20.0
"""Time between renewals [s]."""

CLOCK_S = 600.0
"""How wrong the clock of a host that only looks may be [s]."""


def has_expired(files: ServiceFiles, held: Version) -> bool:
    """Whether a lock's last renewal is longer ago than a lease: by a key that is written now, and removed."""
    probe = f"digests/now.{uuid.uuid4().hex}{PARTIAL}"
    write_key(files, probe, b"")
    now = key_version(files, probe)
    delete_key(files, probe)
    return now is not None and now.modified - held.modified > timedelta(seconds=LEASE_S)


def looks_expired(held: Version) -> bool:
    """The same for who only looks and writes nothing, by this host's clock, which may be ten minutes wrong."""
    return datetime.now(UTC) - held.modified > timedelta(seconds=LEASE_S + CLOCK_S)


class Renewal:
    """Rewrites a key every so often, for as long as it is ours; in a thread of its own."""

    def __init__(self, files: ServiceFiles, key: str, text: Callable[[], bytes], mine: Callable[[bytes], bool]) -> None:
        """text: what to write next, different every time. mine: whether what is there is ours."""
        self._files, self._key, self._text, self._mine = files, key, text, mine
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="softclose-lease", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Renew no more."""
        self._stopping.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._stopping.wait(RENEW_S):
            try:
                if not self.renew():
                    return
            except (ServiceError, StoreError):  # the lease outlasts some failures; at a commit they are told
                continue

    def renew(self) -> bool:
        """One renewal; False where the key is not ours any more."""
        held = key_version(self._files, self._key)
        if held is None or not self._mine(held.content):
            return False
        return replace_key(self._files, self._key, self._text(), held.tag)
