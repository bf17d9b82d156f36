"""Claims about the live page: it follows the stores of a folder in a real browser, and lets nobody else in."""

from __future__ import annotations

import http.client
import itertools
import json
import os
import re
import shutil
import signal
import socket
import subprocess
import threading
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import asdict
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given, seed
from hypothesis import strategies as st

from campaigns import command, softclose
from reported import HOSTILE, chromium, hostile_store
from small_campaigns import COARSE, finish, make_campaign
from softclose_store import DriverStore
from softclose_workflows.analyses.certify import certify
from softclose_workflows.report import live
from softclose_workflows.report.live import Folder, Server
from test_report_browser import ARGUMENTS, Visit


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Server]:
    with Server(tmp_path) as found:
        thread = threading.Thread(target=found.serve_forever, args=(0.05,))
        thread.start()
        yield found
        found.shutdown()
        thread.join()


def get(server: Server, path: str, method: str = "GET", **headers: str) -> tuple[int, bytes]:
    with closing(http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=30)) as connection:
        connection.putrequest(method, path, skip_host="Host" in headers)
        for name, value in headers.items():
            connection.putheader(name, value)
        connection.endheaders()
        answer = connection.getresponse()
        return answer.status, answer.read()


def first_event(server: Server) -> list[dict[str, Any]]:
    with urllib.request.urlopen(server.address + "events", timeout=30) as stream:
        return json.loads(stream.readline().removeprefix(b"data: "))


def deep(root: Path) -> None:
    (root / "zarr.json").write_text("[" * 100_000)


def without_layout(root: Path) -> None:
    document = json.loads((root / "zarr.json").read_text())
    del document["attributes"]["layout"]
    (root / "zarr.json").write_text(json.dumps(document))


def strange_config(root: Path) -> None:
    document = json.loads((root / "zarr.json").read_text())
    document["attributes"]["config"] = {"campaign": 3}
    (root / "zarr.json").write_text(json.dumps(document))


def pipe(root: Path) -> None:
    (root / "zarr.json").unlink()
    os.mkfifo(root / "zarr.json")


def pipe_as_lock(root: Path) -> None:
    (root / "candidates" / "digests" / "driver.lock").unlink(missing_ok=True)
    os.mkfifo(root / "candidates" / "digests" / "driver.lock")


@pytest.mark.parametrize("spoil", [deep, without_layout, strange_config, pipe, pipe_as_lock, None])
def test_one_bad_folder_is_a_row_that_says_what_is_wrong_and_the_others_are_shown(
    spoil: Callable[[Path], None] | None, tmp_path: Path
) -> None:
    make_campaign(tmp_path / "good.zarr", *COARSE)
    bad = Path(os.fsdecode(bytes(tmp_path) + b"/b\xff.zarr"))
    shutil.copytree(tmp_path / "good.zarr", bad)
    if spoil is not None:
        spoil(bad)
    found = {state.store: state for state in Folder(tmp_path).states()}
    assert found["good.zarr"].committed == 8
    if spoil is pipe:  # nothing that is no plain file is a store
        assert len(found) == 1 or found["b\\xff.zarr"].problem
    else:
        assert bool(found["b\\xff.zarr"].problem) == (spoil not in (None, pipe_as_lock))
    json.dumps([asdict(state) for state in found.values()]).encode()
    with Server(tmp_path) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.05,))
        thread.start()
        assert get(server, "/report/good.zarr")[0] == 200
        if spoil is not pipe:
            assert get(server, "/" + found["b\\xff.zarr"].report)[0] == (200 if spoil in (None, pipe_as_lock) else 503)
        server.shutdown()
        thread.join()


def test_a_folder_is_its_stores_as_they_stand(tmp_path: Path) -> None:
    make_campaign(tmp_path / "a.zarr", *COARSE)
    growing = make_campaign(tmp_path / "b.zarr", *COARSE, run=False)
    (tmp_path / "c.zarr").mkdir()
    (tmp_path / "c.zarr" / "zarr.json").write_text("{")
    (tmp_path / "notes").mkdir()
    folder = Folder(tmp_path)
    a, b, c = folder.states()
    assert (a.store, a.committed, a.budget, a.driver) == ("a.zarr", 8, 8, "")
    assert a.best is not None
    assert a.history[1] == sorted(a.history[1], reverse=True)
    assert a.history[1][-1] == pytest.approx(a.best["g_cm_s"], abs=1e-4)
    assert (b.committed, b.best, b.history) == (0, None, ([], []))
    assert "softclose verify" in c.problem
    finish(Path(growing))
    assert [s.committed for s in folder.states()[:2]] == [8, 8]
    shutil.rmtree(tmp_path / "a.zarr")
    assert [s.store for s in folder.states()] == ["b.zarr", "c.zarr"]
    assert [s.store for s in Folder(tmp_path / "b.zarr").states()] == ["b.zarr"]


def test_the_server_tells_and_changes_nothing(server: Server, tmp_path: Path) -> None:
    make_campaign(tmp_path / "a b.zarr", *COARSE)
    (state,) = first_event(server)
    assert (state["store"], state["report"]) == ("a b.zarr", "report/a%20b.zarr")
    status, page = get(server, "/report/a%20b.zarr")
    assert (status, page[:15]) == (200, b"<!doctype html>")
    assert get(server, "/")[0] == 200
    before = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}
    for method in ("POST", "PUT", "DELETE", "PATCH"):
        assert get(server, "/report/a%20b.zarr", method)[0] == 501
    assert {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()} == before


@pytest.mark.parametrize(
    "path", ["/report/../a.zarr", "/report/%2e%2e/secret", "/report//etc/passwd", "/a.zarr/zarr.json", "/report/", "/x"]
)
def test_nothing_outside_the_folder_s_own_listing_is_served(path: str, server: Server, tmp_path: Path) -> None:
    (tmp_path.parent / "secret").mkdir(exist_ok=True)
    assert get(server, path)[0] == 404


def test_another_host_s_page_is_refused_and_only_loopback_listens(server: Server) -> None:
    for host in ("evil.example", f"evil.example:{server.server_port}", ""):
        assert get(server, "/events", Host=host)[0] == 403
    assert server.server_address[0] == "127.0.0.1"


def test_the_command_says_where_it_is_and_ends_with_ctrl_c(tmp_path: Path) -> None:
    with subprocess.Popen(command("serve", str(tmp_path), "--port", "0"), stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            address = line.split()[1]
            with urllib.request.urlopen(address, timeout=30) as page:
                assert b"Campaigns" in page.read()
            with urllib.request.urlopen(address + "events", timeout=30) as stream:
                assert stream.readline() == b"data: []\n"
                process.send_signal(signal.SIGINT)
                assert process.wait(timeout=20) == 0
        finally:
            process.kill()
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        done = softclose("serve", str(tmp_path), "--port", str(taken.getsockname()[1]))
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "--port 0" in done.stderr
    assert softclose("serve", str(tmp_path / "none")).returncode == 2


def opened(playwright: Any, profile: Path, server: Server, *, width: int, theme: str) -> tuple[Any, Visit]:
    """A browser with a profile of its own, at the live page."""
    browser = playwright.chromium.launch_persistent_context(
        profile,
        executable_path=chromium(),
        headless=True,
        args=ARGUMENTS,
        viewport={"width": width, "height": 800},
        color_scheme=theme,
    )
    visit = Visit(browser.pages[0])
    visit.page.goto(server.address)
    return browser, visit


@pytest.mark.skipif(chromium() is None, reason="needs chromium, which is not installed")
@pytest.mark.parametrize("theme", ["light", "dark"])
def test_the_page_follows_a_campaign_in_a_browser(theme: str, server: Server, tmp_path: Path) -> None:
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    shutil.copytree(hostile_store(), tmp_path / "hostile.zarr")
    path = Path(make_campaign(tmp_path / "night.zarr", *COARSE, run=False))
    with playwright.sync_playwright() as p:
        browser, visit = opened(p, tmp_path.parent / f"profile-{theme}", server, width=390, theme=theme)
        visit.until("() => document.querySelectorAll('.campaign').length === 2")
        assert visit.page.inner_text("[data-store='hostile.zarr'] .lead") == HOSTILE
        assert visit.page.get_attribute("[data-store='night.zarr']", "data-committed") == "0"
        finish(path)
        visit.until("() => document.querySelector(\"[data-store='night.zarr']\").dataset.committed === '8'")
        assert "finished · 8 of 8 candidates" in visit.page.inner_text("[data-store='night.zarr']")
        assert visit.page.evaluate("() => document.documentElement.scrollWidth <= 390")
        visit.page.click("[data-store='night.zarr'] a")
        visit.page.wait_for_selector("html[data-ready] #fig-convergence .main-svg", state="attached", timeout=60_000)
        assert visit.said == []
        assert all(url.startswith((server.address, "blob:", "data:")) for url in visit.requests), visit.requests
        browser.close()


@seed(39)
@given(st.lists(st.integers(0, 10**6), min_size=2, max_size=6), st.text("ab-_", max_size=3))
def test_numbers_in_names_are_sorted_as_people_count(numbers: list[int], stem: str) -> None:
    names = sorted((f"{stem}{n}.zarr" for n in numbers), key=live.natural)
    assert [int(re.findall(r"\d+", name)[0]) for name in names] == sorted(numbers)


def test_a_certificate_counts_as_soon_as_it_is_there(tmp_path: Path) -> None:
    path = make_campaign(tmp_path / "a.zarr", *COARSE)
    folder = Folder(tmp_path)
    (before,) = folder.states()
    assert before.certified is None
    found = certify(path, n_switches=300, top=2)
    (after,) = folder.states()
    assert after.certified is not None
    assert (after.certified["candidate"], after.certified["n_switches"]) == (found.best.candidate, 300)
    assert after.certified["p_nc"] == found.best.assessment.p_nc
    json.dumps(asdict(after), allow_nan=False)


@pytest.mark.skipif(chromium() is None, reason="needs chromium, which is not installed")
@pytest.mark.parametrize("theme", ["light", "dark"])
def test_many_campaigns_are_a_table_with_those_that_run_first_and_a_filter(
    theme: str, server: Server, tmp_path: Path
) -> None:
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    shutil.copytree(hostile_store(), tmp_path / "run-1.zarr")
    for k in (2, 10, 11):
        shutil.copytree(tmp_path / "run-1.zarr", tmp_path / f"run-{k}.zarr")
    certify(str(tmp_path / "run-2.zarr"), n_switches=300, top=1)
    growing = make_campaign(tmp_path / "run-9.zarr", *COARSE, run=False)
    with playwright.sync_playwright() as p, DriverStore(growing):
        browser, visit = opened(p, tmp_path.parent / f"profile-table-{theme}", server, width=1280, theme=theme)
        rows = "() => [...document.querySelectorAll('.campaigns tbody tr')].map(r => r.dataset.store)"
        visit.until(f"() => ({rows})().length === 5")
        order = ["run-9.zarr", "run-1.zarr", "run-2.zarr", "run-10.zarr", "run-11.zarr"]
        assert visit.page.evaluate(rows) == order
        assert "running" in visit.page.inner_text("[data-store='run-9.zarr']")
        assert "on 300" in visit.page.inner_text("[data-store='run-2.zarr']")
        paper = visit.page.evaluate("() => getComputedStyle(document.body).backgroundColor")
        assert paper == ("rgb(255, 255, 255)" if theme == "light" else "rgb(18, 22, 27)")
        visit.page.fill("#filter", "run-1")
        assert visit.page.evaluate(rows) == ["run-1.zarr", "run-10.zarr", "run-11.zarr"]
        visit.page.fill("#filter", "running")
        assert visit.page.evaluate(rows) == ["run-9.zarr"]
        assert visit.said == []
        browser.close()


def test_a_page_on_which_nothing_changes_is_told_that_the_server_lives(
    server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A line that is no event, after ten seconds of silence and not before."""
    clock = itertools.count(step=6.0)
    monkeypatch.setattr(live, "EVERY_S", 0.0)
    monkeypatch.setattr(live, "time", SimpleNamespace(monotonic=lambda: next(clock)))
    told = server.changes()
    assert [next(told) for _ in range(3)] == ["[]", "", ""]
    assert next(clock) == 36.0, "two looks in vain before each"
    with urllib.request.urlopen(server.address + "events", timeout=30) as stream:
        assert [stream.readline() for _ in range(4)] == [b"data: []\n", b"\n", b": still here\n", b"\n"]
