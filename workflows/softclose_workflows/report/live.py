"""Owns the live page: all campaigns of a folder, as they stand, from their stores alone, on this machine's loopback.

The server reads; there is nothing that a request could change. Names come from the folder's own listing, never from a
request's path, and a request whose host is not this machine's is refused (a page elsewhere could have sent it).
"""

from __future__ import annotations

import json
import math
import os
import re
import threading
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from functools import partial
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote_to_bytes

import numpy as np

from softclose import __version__
from softclose_store import Holder, StoreError, lock_holder, open_campaign
from softclose_workflows.analyses.certificates import GROUP, read_certification
from softclose_workflows.report.gather import gather
from softclose_workflows.report.page import render_live, render_report
from softclose_workflows.report.shapes import best_so_far, changes
from softclose_workflows.tell.standing import standing_of
from softclose_workflows.tell.tables import beside, n_failed_of
from softclose_workflows.tell.watch import pace

EVERY_S = 1.0
"""How often the folder is looked at [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class State:
    """One campaign, as the page shows it."""

    store: str
    """Name of its folder."""
    report: str
    """Address of its report, below this server's."""
    name: str = ""
    committed: int = 0
    budget: int = 0
    failed: int = 0
    best: dict[str, Any] | None = None
    """candidate, g_cm_s, v_u_cm_s, p_nc, n_switches and warning of the best; None before there is one."""
    certified: dict[str, Any] | None = None
    """candidate, g_cm_s, v_u_cm_s, p_nc and n_switches of the certificate that counts; None where there is none."""
    history: tuple[list[int], list[float]] = field(default_factory=lambda: ([], []))
    """Candidates at which the best so far changes, and its g from there [cm/s]."""
    larger: tuple[tuple[int, int], ...] = ()
    """(candidate, switches) from which on a larger ensemble is used."""
    left_s: float | None = None
    """Time left at the pace of the last waves [s]."""
    driver: str = ""
    """Who drives it now; empty where nobody does."""
    problem: str = ""
    """Why it cannot be read, where it cannot."""


@dataclass(slots=True)
class Folder:
    """The stores of a folder. What has not changed on the disk is not read again."""

    path: Path
    _known: dict[Path, tuple[tuple[int, int, Holder | None], State]] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def stores(self) -> dict[str, Path]:
        """Its stores by name: those in it, or itself where it is one."""
        if (self.path / "zarr.json").is_file():
            return {self.path.name: self.path}
        found = (p.parent for p in self.path.glob("*/zarr.json") if not p.parent.is_symlink())
        return {p.name: p for p in sorted(found, key=lambda p: natural(p.name))}

    def states(self) -> list[State]:
        """Every store as it stands, by name."""
        with self._lock:
            found = []
            for name, path in self.stores().items():
                try:
                    changed = (path / "zarr.json").lstat().st_mtime_ns
                except OSError:
                    continue  # it is gone
                try:
                    holder = lock_holder(path)
                except (StoreError, OSError) as e:
                    found.append(State(store=_shown(name), report=_address(name), problem=str(e)))
                    continue
                version = changed, _certified_at(path), holder
                if self._known.get(path, (None,))[0] != version:
                    self._known[path] = version, _read(name, path, holder)
                found.append(self._known[path][1])
            return found


def natural(name: str) -> tuple[tuple[bool, int, str], ...]:
    """What names are sorted by as people count: `run-9` before `run-10`."""
    parts = re.split(r"([0-9]+)", name.casefold())
    # isdecimal: a superscript is a digit, and no number to int()
    return tuple((part.isdecimal(), int(part) if part.isdecimal() else 0, part) for part in parts)


def _certified_at(path: Path) -> int:
    """When certificates were last written; 0 where there are none."""
    try:
        return (path / GROUP).lstat().st_mtime_ns
    except OSError:
        return 0


def _shown(name: str) -> str:
    """A folder's name as text: bytes of it that are no UTF-8 are spelt out."""
    return os.fsencode(name).decode("utf-8", "backslashreplace")


def _address(name: str) -> str:
    """Address of a store's report, below this server's; any bytes of its name are kept."""
    return f"report/{quote(os.fsencode(name))}"


def _read(name: str, path: Path, holder: Holder | None) -> State:
    try:
        return _state(name, path, holder)
    except Exception as e:  # whatever is wrong with one folder is a row of its own, and no end of the page for all
        said = str(e) if isinstance(e, StoreError | OSError) else f"it cannot be read ({type(e).__name__}: {e})"
        return State(store=_shown(name), report=_address(name), problem=said)


def _state(name: str, path: Path, holder: Holder | None) -> State:
    campaign = open_campaign(path)
    standing, records = standing_of(campaign, name), campaign.records()
    usable = np.flatnonzero(np.isfinite(records["g_cm_s"]) & ~records["failed"])
    best, larger = best_so_far(usable, *(records[name][usable] for name in ("g_cm_s", "rank_cm_s", "n_switches")))
    steps = changes(best)
    b = standing.best
    n_left = standing.budget - standing.committed
    _, left = pace(records["wall_committed_unix_s"], records["n_switches"], records["wave"], n_left)
    return State(
        store=_shown(name),
        report=_address(name),
        name=standing.name,
        committed=standing.committed,
        budget=standing.budget,
        failed=standing.failed,
        best=None
        if b is None
        else {
            "candidate": b.candidate,
            "g_cm_s": b.g_cm_s,
            "v_u_cm_s": b.v_u_cm_s if math.isfinite(b.v_u_cm_s) else None,
            "p_nc": b.p_nc,
            "not_integrated": beside(n_failed_of(b), b.n_switches),
            "n_switches": b.n_switches,
            "warning": standing.warning,
        },
        certified=_certified(path),
        history=([int(i) for i in usable[steps]], [round(float(g), 4) for g in best[steps]]),
        larger=larger,
        left_s=left if math.isfinite(left) and not standing.finished else None,
        driver="" if holder is None else str(holder),
    )


def _certified(path: Path) -> dict[str, Any] | None:
    """The figures of the certificate that counts; a damaged one is `verify`'s business, and none here."""
    try:
        found = read_certification(str(path))
    except StoreError:
        return None
    if found is None:
        return None
    a = found.best.assessment
    return {
        "candidate": found.best.candidate,
        "g_cm_s": a.g_cm_s if math.isfinite(a.g_cm_s) else None,
        "v_u_cm_s": a.v_u_cm_s if math.isfinite(a.v_u_cm_s) else None,
        "p_nc": a.p_nc,
        "n_switches": found.n_switches,
        "warning": a.open_warning,
    }


class Server(ThreadingHTTPServer):
    """Serves one folder on loopback. `with Server(folder, port) as server: server.serve_forever()`."""

    daemon_threads = True

    def __init__(self, folder: Path, port: int = 0) -> None:
        self.folder = Folder(folder)
        self.ending = threading.Event()
        super().__init__(("127.0.0.1", port), _Handler)

    @property
    def address(self) -> str:
        """Where it listens."""
        return f"http://127.0.0.1:{self.server_port}/"

    def shutdown(self) -> None:
        """End the streams, then the server."""
        self.ending.set()
        super().shutdown()

    def changes(self) -> Iterator[str]:
        """The folder's state as JSON, now and after every change; empty where nothing has changed for a while."""
        last, said = "", 0.0
        while not self.ending.is_set():
            now = json.dumps([asdict(state) for state in self.folder.states()], allow_nan=False)
            if now != last or time.monotonic() - said > 10.0:
                yield now if now != last else ""
                last, said = now, time.monotonic()
            self.ending.wait(EVERY_S)


class _Handler(BaseHTTPRequestHandler):
    server: Server
    protocol_version = "HTTP/1.1"
    server_version = f"softclose/{__version__}"
    sys_version = ""

    def log_message(self, format: str, *args: Any) -> None:
        """Nothing: the terminal is the user's."""

    def do_GET(self) -> None:
        """The page, the stream of states, or one campaign's report."""
        port = self.server.server_port
        if self.headers.get("Host", "") not in (f"127.0.0.1:{port}", f"localhost:{port}"):
            self.send_error(HTTPStatus.FORBIDDEN, "not asked for under this machine's name")
            return
        known = {f"/{_address(name)}": path for name, path in self.server.folder.stores().items()}
        pages = {"/": self._page, "/events": self._events}
        pages |= {address: partial(self._report, path) for address, path in known.items()}
        page = pages.get(quote(unquote_to_bytes(self.path.partition("?")[0])))
        if page is None:
            self.send_error(HTTPStatus.NOT_FOUND)
            return
        try:
            page()
        except (BrokenPipeError, ConnectionResetError):  # the reader is gone
            self.close_connection = True

    def _page(self) -> None:
        self._send(render_live())

    def _report(self, path: Path) -> None:
        try:
            text = render_report(gather(str(path)))
        except Exception as e:  # as in the list of stores: what is wrong with one of them is said
            self.send_error(HTTPStatus.SERVICE_UNAVAILABLE, "cannot be read", str(e))
            return
        self._send(text)

    def _send(self, text: str) -> None:
        content = text.encode("utf-8", "backslashreplace")  # names of folders may be any bytes
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", "text/html; charset=utf-8")
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Cache-Control", "no-store")
        self.send_header("X-Content-Type-Options", "nosniff")
        self.end_headers()
        self.wfile.write(content)

    def _events(self) -> None:
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", "text/event-stream")
        self.send_header("Cache-Control", "no-store")
        self.send_header("Connection", "close")
        self.end_headers()
        self.close_connection = True
        for state in self.server.changes():
            self.wfile.write(f"data: {state}\n\n".encode() if state else b": still here\n\n")
            self.wfile.flush()
