"""Claims about campaigns in an object store: killed, fought over, refused and damaged, they are what a local one is."""

from __future__ import annotations

import contextlib
import json
import subprocess
import threading
import time
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import numpy as np
import pytest
from click.testing import CliRunner

from campaigns import run_arguments, softclose
from forked import Forked
from softclose.settings import load_config
from softclose_store import DriverStore, open_campaign, store_state, verify
from softclose_store.disk import objects
from softclose_store.disk.files import list_keys, open_files, read_key, write_key
from softclose_store.disk.objects import ServiceFiles
from softclose_workflows.cli import main
from softclose_workflows.errors import Stopped
from softclose_workflows.run.campaign import Driver
from softclose_workflows.run.creation import create_store
from softclose_workflows.run.driving import drive
from softclose_workflows.run.executors import Placement
from softclose_workflows.run.executors.serial import SerialExecutor
from softclose_workflows.run.stopping import StopRequest
from stores import differences


def fetched(url: str, folder: Path) -> Path:
    """A copy of a bucket's folder on the disk, file by file."""
    files = open_files(url, read_only=True)
    for key in list_keys(files):
        file = folder / key
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(read_key(files, key) or b"")
    return folder


@pytest.mark.long
@pytest.mark.slow
def test_a_run_that_is_killed_three_times_ends_as_a_local_one_does(
    s3: str, reference_store: Path, tmp_path: Path
) -> None:
    arguments = run_arguments(s3)  # type: ignore[arg-type]
    for until in (1, 3, 5):
        driver = Forked(*arguments, "--workers", "2", stderr=subprocess.DEVNULL)
        end = time.monotonic() + 60.0
        while store_state(s3).n_committed < until:
            assert time.monotonic() < end
            assert driver.poll() is None or store_state(s3).finished
            time.sleep(0.05)
        driver.kill()
        driver.wait()
    done = softclose("resume", s3, "--quiet", "--workers", "2")
    assert done.returncode == 0, done.stderr
    assert "nclosed" not in done.stderr
    assert differences(fetched(s3, tmp_path / "copy"), reference_store) == []
    assert verify(s3).ok


@pytest.mark.slow
def test_of_two_drivers_at_once_exactly_one_runs(s3: str, reference_store: Path, tmp_path: Path) -> None:
    create_store(load_config("current", [a for a in run_arguments(Path("x"))[5:] if a != "--set"]), s3)
    drivers = [Forked("resume", s3, "--quiet", "--serial", stderr=subprocess.PIPE) for _ in range(2)]
    ends = [driver.communicate(timeout=120)[1] for driver in drivers]
    codes = [driver.returncode for driver in drivers]
    assert sorted(codes) == [0, 2], ends
    assert "is being driven by process" in ends[codes.index(2)]
    assert differences(fetched(s3, tmp_path / "copy"), reference_store) == []


@pytest.fixture(scope="module")
def small() -> tuple[str, ...]:
    return (
        "campaign.budget=24",
        "objective.warn_open=1.0",  # the best of so few leaves many open
        "prior.model=none",
        "campaign.wave=8",
        "population.n_switches=40",
        "store.n_times=11",
        "optimiser.engine=sobol",
        "explore.budget=0",
        "finish.budget=0",
    )


@pytest.mark.parametrize("every", [False, pytest.param(True, marks=pytest.mark.long)])
def test_every_command_takes_a_url(every: bool, s3: str, small: tuple[str, ...], tmp_path: Path) -> None:
    create_store(load_config("current", small), s3)

    def run(*arguments: str, code: int = 0) -> str:
        done = CliRunner().invoke(main, list(arguments))
        assert done.exit_code == code, done.output
        return done.output

    assert "0 of 24 candidates" in run("status", s3)
    run("resume", s3, "--serial", "--quiet")
    assert "24 of 24 candidates" in run("status", s3)
    if every:
        assert "24 candidates" in run("verify", s3)
    best = json.loads(run("certify", s3, "--switches", "200", "--top", "2", "--json", "-q"))["candidates"][0]
    assert run("export", s3, "waveform").startswith("time_us,volts")
    if every:
        run("certify", s3, "--within", "5", "--switches", "400", "-q")
        run("export", s3, "history", "-o", str(tmp_path / "history.csv"))
        run("report", s3, "-o", str(tmp_path / "report.html"), "-q")
        assert "Certified" in (tmp_path / "report.html").read_text()
        run("figures", s3, "-o", str(tmp_path / "figures"), "--format", "png", "--only", "convergence", "-q")
        run("rescore", s3, "--c1", "50")
        run("pareto", s3)
        run("tolerance", s3, "--switches", "200")
        run("tails", s3, "--method", "brute", "--switches", "1000")
        run("compare", s3, s3)
    campaign = open_campaign(s3)
    dataset = campaign.dataset()
    assert int(dataset.sizes["candidate"]) == 24
    assert np.isfinite(campaign.trajectories(int(best["candidate"])).x[...]).all()
    assert campaign.datatree()["search"] is not None
    assert "24 candidates" in run("verify", s3)


def test_damage_in_a_bucket_is_found_and_repaired(s3: str, small: tuple[str, ...]) -> None:
    create_store(load_config("current", small), s3)
    drive(s3, Placement(serial=True), quiet=True)
    files = open_files(s3, read_only=False)
    key = next(key for key in list_keys(files) if key.startswith("search/response/c"))
    whole = read_key(files, key)
    assert whole is not None
    write_key(files, key, whole[:-9] + bytes(9))
    assert not verify(s3).ok
    done = CliRunner().invoke(main, ["verify", s3, "--repair"])
    assert done.exit_code == 0, done.output
    assert verify(s3).ok
    assert read_key(files, key) == whole


def test_requests_of_a_candidate_are_few(s3: str, small: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    """Counted at the client, between the commits of two waves of 20 and of 40 candidates."""
    made: list[str] = []
    for name in ("get", "set", "delete", "exists", "version", "create", "replace", "list", "list_dir"):
        real = getattr(ServiceFiles, name)

        def counted(self: Any, *a: Any, _real: Any = real, _name: str = name, **k: Any) -> Any:
            made.append(_name)
            return _real(self, *a, **k)

        monkeypatch.setattr(ServiceFiles, name, counted)
    create_store(load_config("current", (*small, "campaign.budget=60", "campaign.wave=20")), s3)
    seen: list[tuple[int, int]] = []
    commit = DriverStore.commit

    def committed(self: DriverStore, *a: Any, **k: Any) -> None:
        commit(self, *a, **k)
        seen.append((self.n_committed, len(made)))

    monkeypatch.setattr(DriverStore, "commit", committed)
    with DriverStore(s3) as store:
        Driver(store, SerialExecutor()).run()
    assert [n for n, _ in seen] == [20, 40, 60]
    a_candidate = (seen[-1][1] - seen[0][1]) / 40
    assert a_candidate <= 6.0


class _Moody(ThreadingHTTPServer):
    """Passes requests on to a service, or refuses them, as `fate` says of each."""

    daemon_threads = True

    def __init__(self, endpoint: str) -> None:
        super().__init__(("127.0.0.1", 0), _Forward)
        self.endpoint = endpoint
        self.fate = iter(())
        self.refused = 0
        self.lock = threading.Lock()

    def next_fate(self) -> int:
        with self.lock:
            code = next(self.fate, 0)
            self.refused += bool(code)
            return code


class _Forward(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server: _Moody

    def _pass(self) -> None:
        body = self.rfile.read(int(self.headers.get("Content-Length") or 0))
        if code := self.server.next_fate():
            self._answer(code, {}, b"<Error><Code>SlowDown</Code></Error>")
            return
        request = Request(self.server.endpoint + self.path, data=body or None, method=self.command)
        for name, value in self.headers.items():
            if name.lower() not in ("host", "content-length", "connection"):
                request.add_header(name, value)
        request.add_header("Content-Type", "application/octet-stream")  # or else a form is looked for in it
        if self.command == "PUT" and not body:
            request.data = b""
        try:
            with urlopen(request) as found:
                self._answer(found.status, dict(found.headers), found.read())
        except HTTPError as e:
            self._answer(e.code, dict(e.headers), e.read())

    def _answer(self, code: int, headers: dict[str, str], body: bytes) -> None:
        self.send_response(code)
        for name, value in headers.items():
            if name.lower() not in ("content-length", "connection", "transfer-encoding", "server", "date"):
                self.send_header(name, value)
        length = headers.get("Content-Length", len(body)) if self.command == "HEAD" else len(body)
        self.send_header("Content-Length", str(length))
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body)

    def log_message(self, *_: Any) -> None:
        """Nothing."""

    do_GET = do_PUT = do_HEAD = do_POST = do_DELETE = _pass


@contextlib.contextmanager
def _moody(endpoint: str) -> Iterator[_Moody]:
    server = _Moody(endpoint)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield server
    server.shutdown()
    server.server_close()


def test_a_service_that_refuses_for_a_while_is_asked_again_and_one_that_goes_on_stops_the_run(
    s3: str, s3_endpoint: str, small: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    small = (*small, "campaign.budget=90")  # more waves than are in flight at once
    local = tmp_path / "local.zarr"
    create_store(load_config("current", small), str(local))
    drive(str(local), Placement(serial=True), quiet=True)
    monkeypatch.setattr(objects, "RETRIES", 3)
    with _moody(s3_endpoint) as service:
        monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{service.server_address[1]}")
        create_store(load_config("current", small), s3)
        service.fate = (code for k in range(10**9) for code in (503 if k % 7 == 3 else 500 if k % 11 == 5 else 0,))
        with DriverStore(s3) as store:
            stop = StopRequest()
            commit = store.commit

            def committed(*a: Any, **k: Any) -> None:
                commit(*a, **k)
                stop.signal_name = "SIGTERM"

            monkeypatch.setattr(store, "commit", committed)
            with pytest.raises(Stopped):
                Driver(store, SerialExecutor(), stop=stop).run()
            assert 8 <= store.n_committed < 90
        assert service.refused > 3
        service.fate = iter([500] * 10**6)
        with pytest.raises(Stopped, match="does not answer as it should"):
            drive(s3, Placement(serial=True), quiet=True)
        service.fate = iter(())
        drive(s3, Placement(serial=True), quiet=True)
    monkeypatch.setenv("AWS_ENDPOINT_URL", s3_endpoint)
    assert differences(fetched(s3, tmp_path / "copy"), local) == []
