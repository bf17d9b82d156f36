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
from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, seed
from hypothesis import strategies as st

from campaigns import command, softclose
from examples import in_turn
from reported import HOSTILE, chromium, hostile_store
from small_campaigns import COARSE, finish, make_campaign
from softclose_store import DamageError, DriverStore, StoreError, open_campaign
from softclose_workflows.analyses.certify import certify
from softclose_workflows.report import live
from softclose_workflows.report.live import Folder, Server, State
from test_report_browser import ARGUMENTS, Visit


@pytest.fixture(scope="module")
def coarse(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of one finished campaign, a.zarr. Read it, don't write to it."""
    folder = tmp_path_factory.mktemp("coarse")
    make_campaign(folder / "a.zarr", *COARSE)
    return folder


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


@pytest.mark.parametrize("spoil", in_turn([deep, without_layout, strange_config, pipe, pipe_as_lock, None], 3))
def test_one_bad_folder_is_a_row_that_says_what_is_wrong_and_the_others_are_shown(
    spoil: Callable[[Path], None] | None, coarse: Path, tmp_path: Path
) -> None:
    shutil.copytree(coarse / "a.zarr", tmp_path / "good.zarr")
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
    assert (b.committed, b.best, b.history, b.left_s) == (0, None, ([], []), None)
    assert c == State(store="c.zarr", report="report/c.zarr", problem=c.problem), "nothing is claimed of it"
    assert (c.committed, c.budget, c.failed, c.driver) == (0, 0, 0, "")
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
@pytest.mark.parametrize("theme", in_turn(["light", "dark"], 2))
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
    a = found.best.assessment
    assert after.certified == {
        "candidate": found.best.candidate,
        "g_cm_s": a.g_cm_s,
        "v_u_cm_s": a.v_u_cm_s,
        "p_nc": a.p_nc,
        "n_switches": 300,
        "warning": a.open_warning,
    }
    json.dumps(asdict(after), allow_nan=False)


@pytest.mark.skipif(chromium() is None, reason="needs chromium, which is not installed")
@pytest.mark.parametrize("theme", in_turn(["light", "dark"], 2, 1))
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
    clock = itertools.count(step=5.25)
    monkeypatch.setattr(live, "EVERY_S", 0.0)
    monkeypatch.setattr(live, "time", SimpleNamespace(monotonic=lambda: next(clock)))
    told = server.changes()
    assert [next(told) for _ in range(3)] == ["[]", "", ""]
    assert next(clock) == 31.5, "two looks in vain before each"
    with urllib.request.urlopen(server.address + "events", timeout=30) as stream:
        assert [stream.readline() for _ in range(4)] == [b"data: []\n", b"\n", b": still here\n", b"\n"]


class Altered:
    """A campaign some of whose records, or whose budget or best candidate, are others."""

    def __init__(self, path: Path, columns: dict[str, Any], others: dict[str, Any]) -> None:
        self._campaign, self._columns = open_campaign(path), columns
        self.budget, self.best = self._campaign.budget, self._campaign.best
        self.__dict__ |= others

    def __getattr__(self, name: str) -> Any:
        return getattr(self._campaign, name)

    def records(self) -> dict[str, Any]:
        return self._campaign.records() | self._columns


def state_of(
    folder: Path, monkeypatch: pytest.MonkeyPatch, columns: dict[str, Any] | None = None, **others: Any
) -> State:
    """The one campaign of a folder, altered."""
    monkeypatch.setattr(live, "open_campaign", lambda path: Altered(path, columns or {}, others))
    (state,) = Folder(folder).states()
    assert not state.problem
    json.dumps(asdict(state), allow_nan=False)
    return state


def test_candidates_without_a_result_are_counted_and_are_no_part_of_the_curve(
    coarse: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a withdrawn candidate the number is still there."""
    g = np.linspace(30.0, 20.0, 8)
    g[3] = np.nan
    failed = np.isin(np.arange(8), (3, 7))
    state = state_of(coarse, monkeypatch, {"g_cm_s": g, "rank_cm_s": g, "failed": failed})
    usable = [0, 1, 2, 4, 5, 6]
    assert state.history == (usable, [round(float(g[i]), 4) for i in usable])
    assert state.failed == 2


def test_the_time_left_is_that_of_the_candidates_left_at_the_pace_of_the_last_waves(
    coarse: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wave = np.arange(8) // 2
    two_in_10_s = {"wall_committed_unix_s": 1e9 + 10.0 * wave, "wave": wave, "n_switches": np.full(8, 80)}
    assert state_of(coarse, monkeypatch, two_in_10_s, budget=14).left_s == pytest.approx(30.0)
    assert state_of(coarse, monkeypatch, two_in_10_s).left_s is None, "it is finished"
    assert state_of(coarse, monkeypatch, two_in_10_s | {"wave": 0 * wave}, budget=14).left_s is None, (
        "one wave: no pace"
    )


def test_the_best_candidate_is_told_with_its_numbers_and_an_undefined_one_is_left_out(
    coarse: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    best = open_campaign(coarse / "a.zarr").best()
    assert best is not None
    told = state_of(coarse, monkeypatch).best
    assert told is not None
    assert (told["candidate"], told["g_cm_s"], told["v_u_cm_s"]) == (best.candidate, best.g_cm_s, best.v_u_cm_s)
    assert (told["p_nc"], told["n_switches"], told["not_integrated"]) == (best.p_nc, 80, "")
    told = state_of(coarse, monkeypatch, best=lambda: replace(best, v_u_cm_s=np.nan)).best
    assert told is not None
    assert (told["g_cm_s"], told["v_u_cm_s"]) == (best.g_cm_s, None)


def test_who_drives_a_campaign_is_told_for_as_long_as_he_does(tmp_path: Path) -> None:
    """Also where nothing else changes: a driver takes the store before its first candidate is committed."""
    path = make_campaign(tmp_path / "a.zarr", *COARSE, run=False)
    folder = Folder(tmp_path)
    told = [folder.states()[0].driver]
    with DriverStore(path):
        told.append(folder.states()[0].driver)
    told.append(folder.states()[0].driver)
    assert (told[0], told[2]) == ("", "")
    assert str(os.getpid()) in told[1]


def test_what_has_not_changed_on_the_disk_is_not_read_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder of a hundred campaigns is looked at every second."""
    for name in ("a.zarr", "b.zarr"):
        make_campaign(tmp_path / name, *COARSE, run=False)
    read: list[str] = []
    real = live._read

    def noted(name: str, *rest: Any) -> State:
        read.append(name)
        return real(name, *rest)

    monkeypatch.setattr(live, "_read", noted)
    folder = Folder(tmp_path)
    first = folder.states()
    assert (folder.states(), folder.states()) == (first, first)
    assert read == ["a.zarr", "b.zarr"]
    finish(tmp_path / "b.zarr")
    assert [s.committed for s in folder.states()] == [0, 8]
    assert read == ["a.zarr", "b.zarr", "b.zarr"]


def test_a_store_that_goes_while_it_is_looked_at_is_left_out_and_the_others_are_shown(
    coarse: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = Folder.stores
    monkeypatch.setattr(Folder, "stores", lambda self: {"0.zarr": self.path / "0.zarr"} | real(self))
    assert [s.store for s in Folder(coarse).states()] == ["a.zarr"]


@pytest.mark.parametrize("error", [StoreError("the lock is no lock"), PermissionError(13, "not yours")])
def test_a_lock_that_cannot_be_read_is_a_row_that_says_so(
    error: Exception, coarse: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unreadable(path: Path) -> None:
        raise error

    monkeypatch.setattr(live, "lock_holder", unreadable)
    assert Folder(coarse).states() == [State(store="a.zarr", report="report/a.zarr", problem=str(error))]


def test_a_link_is_no_store_of_the_folder(coarse: Path, tmp_path: Path) -> None:
    """Only what lies in it is served."""
    (tmp_path / "b.zarr").symlink_to(coarse / "a.zarr")
    assert Folder(tmp_path).states() == []


@pytest.mark.parametrize("undefined", [np.nan, np.inf])
def test_a_certificate_without_a_number_says_so(
    undefined: float, coarse: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    a = SimpleNamespace(g_cm_s=undefined, v_u_cm_s=undefined, p_nc=0.9, open_warning="most stay open")
    found = SimpleNamespace(best=SimpleNamespace(candidate=2, assessment=a), n_switches=100)
    monkeypatch.setattr(live, "read_certification", lambda path: found)
    told = {"candidate": 2, "g_cm_s": None, "v_u_cm_s": None, "p_nc": 0.9, "n_switches": 100}
    assert state_of(coarse, monkeypatch).certified == told | {"warning": "most stay open"}


def test_a_damaged_certificate_does_not_hide_its_campaign(coarse: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def damaged(path: str) -> None:
        raise DamageError("torn")

    monkeypatch.setattr(live, "read_certification", damaged)
    state = state_of(coarse, monkeypatch)
    assert (state.committed, state.certified) == (8, None)


@pytest.mark.parametrize("gone", [BrokenPipeError, ConnectionResetError])
def test_a_reader_who_leaves_is_no_error_and_ends_his_connection(
    gone: type[OSError], server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[object] = []

    def page(handler: Any) -> None:
        raise gone

    monkeypatch.setattr(live._Handler, "_page", page)
    monkeypatch.setattr(server, "handle_error", lambda *about: told.append(about))
    with closing(http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=30)) as connection:
        connection.request("GET", "/")
        with pytest.raises(http.client.RemoteDisconnected):
            connection.getresponse()
    assert told == []


def test_readers_who_stay_do_not_keep_the_server_from_ending(tmp_path: Path) -> None:
    """A browser holds its connections, one of them with the stream of states."""
    server = Server(tmp_path)
    serving = threading.Thread(target=server.serve_forever, args=(0.05,))
    serving.start()
    with closing(http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=30)) as connection:
        connection.request("GET", "/")
        connection.getresponse().read()
        with urllib.request.urlopen(server.address + "events", timeout=30) as stream:
            assert stream.readline() == b"data: []\n"
            server.shutdown()
            ending = threading.Thread(target=server.server_close, daemon=True)
            ending.start()
            assert stream.read() == b"\n", "the stream ends"
        ending.join(10.0)
        assert not ending.is_alive()
    serving.join()


def test_a_page_that_is_open_costs_a_look_a_second(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    waits: list[float] = []

    class Ending:
        def is_set(self) -> bool:
            return len(waits) == 3

        def wait(self, seconds: float) -> None:
            waits.append(seconds)

    monkeypatch.setattr(server, "ending", Ending())
    assert list(server.changes()) == ["[]"]
    assert all(0.5 <= s <= 2.0 for s in waits)
    monkeypatch.undo()


def test_this_machine_s_own_names_and_any_spelling_of_an_address_are_served(coarse: Path) -> None:
    with Server(coarse) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.05,))
        thread.start()
        port = server.server_port
        asked = [get(server, "/report/a%2Ezarr?x=/")[0], get(server, "/", Host=f"localhost:{port}")[0]]
        asked.append(get(server, "/", Host="localhost:1")[0])
        server.shutdown()
        thread.join()
    assert asked == [200, 200, 403]


@pytest.mark.parametrize("name", ["2²", "x3²", "²", "٣ a", "1½"])
def test_a_name_with_other_scripts_digits_does_not_end_the_page(name: str, tmp_path: Path) -> None:
    for folder in (name, "a.zarr"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "zarr.json").write_text("{")
    assert {s.store for s in Folder(tmp_path).states()} == {name, "a.zarr"}
