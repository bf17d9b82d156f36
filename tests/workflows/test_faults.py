"""Claims about what a run does when its workers, its scheduler, its disk or its user fail it: DESIGN §5."""

from __future__ import annotations

import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import psutil
import pytest

from campaigns import SMALL, command, run_arguments, softclose, softclose_process
from forked import Forked
from small_campaigns import COARSE, make_campaign
from softclose import Waveform, plugins, simulate
from softclose.device.protocol import CannotSimulate
from softclose.propose import plan, proposer
from softclose.propose.protocol import Problem, Proposal
from softclose.propose.sobol import initial_point
from softclose.settings import load_config
from softclose_store import StoreError, open_campaign, verify
from softclose_workflows.commands.driving import drive
from softclose_workflows.errors import Stopped
from softclose_workflows.run.executors import Placement
from softclose_workflows.run.extension import retry_failed
from stores import differences, files_of
from test_contracts import wait_for_commits
from torture import workers_of


def start(store: Path, *arguments: str) -> Forked:
    """Start the small campaign; the caller ends it."""
    return Forked(*run_arguments(store), *arguments, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)


DASK = "from distributed.cli.dask_{} import main; main()"


def start_worker(address: str, *before: str, env: dict[str, str] | None = None) -> Forked | subprocess.Popen[bytes]:
    """One worker of one thread; before: words that its command line begins with."""
    options = ["--no-nanny", "--no-dashboard", "--nthreads", "1", "--host", "127.0.0.1"]
    if not before and not env:
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        return Forked(*options, address, program=DASK.format("worker"), **quiet)
    return subprocess.Popen(
        [*before, sys.executable, "-m", "distributed.cli.dask_worker", *options, address],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=os.environ | (env or {}),
    )


def _is_written(file: Path) -> bool:
    """Whether a scheduler has said all of itself: its file is there before its text is."""
    try:
        return "address" in json.loads(file.read_text())
    except (FileNotFoundError, ValueError):
        return False


@contextmanager
def cluster(folder: Path) -> Iterator[tuple[str, Forked, Forked | subprocess.Popen[bytes]]]:
    """An external scheduler with one worker: (address, scheduler, worker)."""
    file = folder / "scheduler.json"
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    options = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file)]
    scheduler = Forked(*options, program=DASK.format("scheduler"), **quiet)
    worker = None
    try:
        deadline = time.monotonic() + 60
        while not _is_written(file) and time.monotonic() < deadline:
            time.sleep(0.1)
        address = json.loads(file.read_text())["address"]
        worker = start_worker(address)
        yield address, scheduler, worker
    finally:
        for process in (worker, scheduler):
            if process is not None:
                process.kill()
                process.wait()


@pytest.mark.long
@pytest.mark.slow
def test_a_block_that_kills_every_worker_stops_the_run_and_records_nothing(tmp_path: Path) -> None:
    """Each worker dies at its first marker: a fault of the machine, for all that the run can tell."""
    store = tmp_path / "a.zarr"
    settings = ("campaign.budget=2", "prior.model=none", "population.n_switches=20", "optimiser.n_initial=2")
    done = softclose_process(
        *run_arguments(store, *settings), "--workers", "1", env={"SOFTCLOSE_FAULT": "before-marker:1"}, timeout=280
    )
    assert done.returncode == 3, done.stderr
    assert "killed 4 workers" in done.stderr
    assert open_campaign(store).committed == 0
    assert softclose("resume", str(store), "--serial", "--quiet").returncode == 0
    assert open_campaign(store).finished


class Moody:
    """A device model that has no answer to slow pulses, or meets a fault of the machine."""

    def __init__(self, fault: Exception) -> None:
        self.fault = fault
        self.calls = 0
        self.well = False

    def __call__(self, switches: np.ndarray, waveform: Waveform, **settings: object) -> object:
        self.calls += 1
        if waveform.pulses[0].rise_us > 6.0 and not self.well:
            raise self.fault
        return simulate(switches, waveform, **settings)


def run_moody(store: Path, fault: Exception, monkeypatch: pytest.MonkeyPatch) -> Moody:
    moody = Moody(fault)
    entry = SimpleNamespace(name="moody", load=lambda: moody)
    monkeypatch.setattr(plugins, "entry_points", lambda group: [entry] if group == "softclose.models" else [])
    settings = ("model.name=moody", "optimiser.engine=sobol", "campaign.wave=4")
    drive(str(store), Placement(serial=True), config=load_config("current", (*SMALL, *settings)), quiet=True)
    return moody


@pytest.mark.parametrize("fault", [CannotSimulate("the mesh folds"), ArithmeticError("the mesh folds")])
def test_the_device_models_own_word_fails_its_candidate_and_the_campaign_goes_on(
    fault: Exception, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = tmp_path / "a.zarr"
    run_moody(store, fault, monkeypatch)
    records = open_campaign(store).records()
    slow = records["waveform"][:, 0, 1] > 6.0
    assert 0 < slow.sum() < len(slow)
    assert records["failed"].tolist() == slow.tolist()
    assert all("the mesh folds" in reason for reason in records["failure"][slow])
    assert np.isfinite(records["g_cm_s"][~slow]).all()


@pytest.mark.parametrize("fault", [MemoryError("no room"), ImportError("no such package"), OSError("no such folder")])
def test_a_fault_of_the_machine_is_tried_three_times_then_stops_the_run_and_records_nothing(
    fault: Exception, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = tmp_path / "a.zarr"
    with pytest.raises(Stopped, match=str(fault)):
        run_moody(store, fault, monkeypatch)
    assert not open_campaign(store).records()["failed"].any()
    monkeypatch.undo()
    assert softclose("verify", str(store)).returncode == 0


@pytest.mark.slow
def test_a_campaign_on_an_existing_cluster_gives_the_same_store(tmp_path: Path, reference_store: Path) -> None:
    store = tmp_path / "a.zarr"
    with cluster(tmp_path) as (address, _, _):
        done = softclose(*run_arguments(store), "--scheduler", address)
    assert done.returncode == 0, done.stderr
    assert differences(reference_store, store) == []


@pytest.mark.slow
@pytest.mark.parametrize("victim", [pytest.param("worker", marks=pytest.mark.long), "scheduler"])
def test_without_workers_or_scheduler_a_run_stops_and_says_how_to_resume(
    victim: str, tmp_path: Path, reference_store: Path
) -> None:
    store = tmp_path / "a.zarr"
    with cluster(tmp_path) as (address, scheduler, worker):
        run = start(store, "--scheduler", address, "--patience", "3")
        wait_for_commits(store, 2, run)
        (worker if victim == "worker" else scheduler).kill()
        _, stderr = run.communicate(timeout=60)
    assert run.returncode == 3
    assert f"softclose resume {store}" in stderr
    done = softclose("resume", str(store), "--serial", "--quiet")
    assert done.returncode == 0, done.stderr
    assert differences(reference_store, store) == []


@pytest.mark.slow
@pytest.mark.parametrize("number", [pytest.param(signal.SIGINT, marks=pytest.mark.long), signal.SIGTERM])
def test_the_first_signal_finishes_what_is_in_flight(
    number: signal.Signals, tmp_path: Path, reference_store: Path
) -> None:
    store = tmp_path / "a.zarr"
    run = start(store, "--workers", "1")
    wait_for_commits(store, 2, run)
    run.send_signal(number)
    _, stderr = run.communicate(timeout=60)
    assert run.returncode == 3, stderr
    assert f"{number.name} received" in stderr
    campaign = open_campaign(store)
    assert 2 <= campaign.committed < campaign.budget
    done = softclose("resume", str(store), "--serial", "--quiet")
    assert done.returncode == 0, done.stderr
    assert differences(reference_store, store) == []


def workers_at(address: str, n: int) -> None:
    """Wait until a scheduler has n workers."""
    from distributed import Client

    with Client(address, set_as_default=False) as client:
        client.wait_for_workers(n, timeout=60)


BLIND = ("unshare", "--mount", "sh", "-c", 'mount -t tmpfs tmpfs "$1" && shift && exec "$@"', "sh")
"""Words before a command that runs it without sight of the folder that follows them."""


@pytest.mark.slow
@pytest.mark.parametrize("lacks", ["package", pytest.param("folder", marks=pytest.mark.long)])
def test_a_worker_that_lacks_something_gets_no_work(lacks: str, tmp_path: Path, reference_store: Path) -> None:
    store = tmp_path / "shared" / "a.zarr"
    store.parent.mkdir()
    shadow = tmp_path / "shadow" / "softclose_workflows" / "__init__.py"
    shadow.parent.mkdir(parents=True)
    shadow.write_text("raise ModuleNotFoundError('not installed here')")
    before, env = ((), {"PYTHONPATH": str(tmp_path / "shadow")}) if lacks == "package" else ((*BLIND, store.parent), {})
    if lacks == "folder" and subprocess.run([*map(str, before), "true"], capture_output=True).returncode:
        pytest.skip("needs the right to mount a tmpfs")
    with cluster(tmp_path) as (address, _, able):
        workers_at(address, 1)
        unable = start_worker(address, *map(str, before), env=env)
        try:
            workers_at(address, 2)
            done = softclose(*run_arguments(store), "--scheduler", address)
            assert done.returncode == 0, done.stderr
            assert differences(reference_store, store) == []
            able.kill()
            able.wait()
            store = store.with_name("b.zarr")
            done = softclose(*run_arguments(store), "--scheduler", address)
        finally:
            unable.kill()
            unable.wait()
    assert done.returncode == 3, done.stderr
    assert "no worker can compute blocks of this campaign" in done.stderr
    assert ("ModuleNotFoundError('not installed here')" if lacks == "package" else "StoreMissingError") in done.stderr
    assert done.stderr.endswith(f"continue with: softclose resume {store}\n")
    assert open_campaign(store).committed == 0


def test_a_full_disk_stops_cleanly_and_room_lets_it_go_on(tmp_path: Path, reference_store: Path) -> None:
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=512k", "tmpfs", str(disk)], capture_output=True)
    if mounted.returncode:
        pytest.skip("needs the right to mount a tmpfs")
    try:
        store = disk / "a.zarr"
        full = softclose(*run_arguments(store), "--serial")
        assert full.returncode == 3, full.stderr
        assert "No space left on device" in full.stderr
        assert f"softclose resume {store}" in full.stderr
        assert softclose("verify", str(store)).returncode == 0
        subprocess.run(["mount", "-o", "remount,size=64m", str(disk)], check=True)
        done = softclose("resume", str(store), "--serial", "--quiet")
        assert done.returncode == 0, done.stderr
        assert differences(reference_store, store) == []
    finally:
        subprocess.run(["umount", "-l", str(disk)], check=False)


def test_a_disk_that_fills_up_inside_a_worker_stops_the_run(tmp_path: Path, reference_store: Path) -> None:
    store = tmp_path / "a.zarr"
    full = softclose_process(
        *run_arguments(store), "--workers", "1", env={"SOFTCLOSE_FAULT": "inside-chunk-write:40:raise-enospc"}
    )
    assert full.returncode == 3, full.stderr
    assert softclose("resume", str(store), "--serial", "--quiet").returncode == 0
    assert differences(reference_store, store) == []


def test_a_second_driver_is_refused_by_name(tmp_path: Path) -> None:
    store = tmp_path / "a.zarr"
    run = start(store, "--serial", "--set", "campaign.budget=500")
    try:
        wait_for_commits(store, 1, run)
        second = softclose("resume", str(store), "--serial")
    finally:
        run.kill()
        run.communicate()
    assert second.returncode == 2
    assert str(run.pid) in second.stderr


def test_everything_that_listens_listens_on_loopback(tmp_path: Path) -> None:
    store = tmp_path / "a.zarr"
    run = start(store, "--workers", "2")
    try:
        wait_for_commits(store, 1, run)
        family = [psutil.Process(run.pid), *psutil.Process(run.pid).children(recursive=True)]
        assert 1 <= len(workers_of(run.pid)) <= 2, "what `make torture` kills"
        listening = {
            c.laddr.ip for p in family for c in p.net_connections(kind="inet") if c.status == psutil.CONN_LISTEN
        }
    finally:
        run.kill()
        run.communicate()
    assert listening == {"127.0.0.1"}


def test_a_stranger_on_the_same_machine_is_refused_by_the_local_cluster() -> None:
    from distributed import Client

    from softclose_workflows.run.executors.dask import local_cluster

    with local_cluster(1, 30.0) as executor:
        address = executor._client.scheduler.address
        assert address.startswith("tls://127.0.0.1:")
        with pytest.raises(OSError, match="closed"):
            Client(address.replace("tls://", "tcp://"), timeout=5)
        with pytest.raises((OSError, TypeError)):  # TLS, but without the run's certificate
            Client(address, timeout=5)
        give_up = time.monotonic() + 30.0
        while executor.n_workers != 1 and time.monotonic() < give_up:  # on a busy machine one may be lost and replaced
            time.sleep(0.1)
        assert executor.n_workers == 1


class Broken:
    """An engine that fails at every candidate from the given one on."""

    def __init__(self, first: int) -> None:
        self.first = first

    def propose(self, problem: Problem, index: int, *seen: object) -> Proposal:
        if index >= self.first:
            raise FloatingPointError("the covariance is not positive definite")
        waveform = problem.space.waveform(initial_point(problem, index))
        return Proposal(waveform=waveform, origin="sobol", n_switches=problem.config.population.n_switches)


def test_an_engine_that_fails_now_and_then_is_replaced_and_the_record_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = proposer.load_engine
    monkeypatch.setattr(proposer, "load_engine", lambda name: Broken(5) if name == "skopt" else real(name))
    monkeypatch.setattr(plan, "load_engine", lambda name: Broken(5) if name == "skopt" else real(name))
    drive(str(tmp_path / "a.zarr"), Placement(serial=True), config=load_config({}, SMALL), quiet=True)
    records = open_campaign(tmp_path / "a.zarr").records()
    assert [origin == "fallback" for origin in records["origin"]] == [False] * 5 + [True] * 3
    assert all("the covariance is not positive definite" in note for note in records["note"][5:])
    assert not records["failed"].any()


def test_an_engine_that_keeps_failing_stops_the_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = proposer.load_engine
    monkeypatch.setattr(proposer, "load_engine", lambda name: Broken(2) if name == "skopt" else real(name))
    monkeypatch.setattr(plan, "load_engine", lambda name: Broken(2) if name == "skopt" else real(name))
    with pytest.raises(Stopped, match=r"failed 5 times in a row.*covariance is not positive definite"):
        drive(str(tmp_path / "a.zarr"), Placement(serial=True), config=load_config({}, SMALL), quiet=True)
    assert open_campaign(tmp_path / "a.zarr").committed == 6


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--set", "campaign.seed=2"], "campaign.seed: the store has 1, this configuration 2"),
        (["--scheduler", "tcp://127.0.0.1:9"], "no Dask scheduler answers at tcp://127.0.0.1:9"),
        (["--workers", "0"], "--workers is 0"),
        (["--set", "waveform.initial=[[[0,2.5,3,100]]]"], "rise times below 4 µs"),
        (["--set", "waveform.initial=[[[0,4,3,160]]]"], "may not exceed 150 V"),
        (["--set", "population.n_switches=many"], "population.n_switches is 'many'"),
    ],
)
def test_bad_input_is_one_message_and_changes_nothing(
    arguments: list[str], message: str, tmp_path: Path, reference_store: Path
) -> None:
    exists = "campaign.seed" in arguments[1]
    store = reference_store if exists else tmp_path / "a.zarr"
    before = {f: f.stat().st_mtime_ns for f in store.rglob("*")} if exists else {}
    done = softclose(*run_arguments(store), *arguments)
    assert done.returncode == 2
    assert message in done.stderr
    assert "Traceback" not in done.stderr
    assert ({f: f.stat().st_mtime_ns for f in store.rglob("*")} if exists else {}) == before
    assert exists or not store.exists()


def test_populations_with_a_travel_beyond_the_gap_are_refused(tmp_path: Path) -> None:
    (tmp_path / "p.toml").write_text(
        'name = "bad"\nbase = "current"\n[D]\ndistribution = "beta"\nlower = 2.3\nupper = 3.8\nmean = 2.5\n'
    )
    done = softclose(*run_arguments(tmp_path / "a.zarr", f"population.name={tmp_path / 'p.toml'}"), "--serial")
    assert done.returncode == 2
    assert "every switch needs D < G" in done.stderr


def test_a_campaign_whose_every_candidate_fails_stops_early_and_gives_the_first_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def hopeless(*_: object, **__: object) -> object:
        raise CannotSimulate("no licence for this geometry")

    entry = SimpleNamespace(name="hopeless", load=lambda: hopeless)
    monkeypatch.setattr(plugins, "entry_points", lambda group: [entry] if group == "softclose.models" else [])
    settings = ("model.name=hopeless", "optimiser.engine=sobol", "campaign.budget=100")
    with pytest.raises(Stopped, match=r"none of 20 candidates could be assessed .*no licence for this geometry"):
        drive(
            str(tmp_path / "a.zarr"),
            Placement(serial=True),
            config=load_config("current", (*SMALL, *settings)),
            quiet=True,
        )
    assert open_campaign(tmp_path / "a.zarr").committed == 20


def test_fallbacks_are_counted_in_the_last_lines_and_in_status(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    real = proposer.load_engine
    for module in (proposer, plan):
        monkeypatch.setattr(module, "load_engine", lambda name: Broken(5) if name == "skopt" else real(name))
    store = tmp_path / "a.zarr"
    drive(str(store), Placement(serial=True), config=load_config({}, SMALL), quiet=True)
    assert "3 of 8 candidates are quasi-random points" in capsys.readouterr().out
    told = json.loads(softclose("status", str(store), "--json").stdout)
    assert told["fallbacks"] == 3
    assert "not positive definite" in told["reason"]
    assert "3 of 8 candidates are quasi-random points" in softclose("status", str(store)).stdout


def test_failed_candidates_are_computed_again_on_request_and_recorded_as_such(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = tmp_path / "a.zarr"
    moody = run_moody(store, CannotSimulate("the licence server is away"), monkeypatch)
    before = open_campaign(store).records()
    failed = np.flatnonzero(before["failed"])
    moody.fault = CannotSimulate("still away")
    retry_failed(str(store))
    drive(str(store), Placement(serial=True), quiet=True)
    n = len(before["failed"])
    second = np.arange(n, n + len(failed))
    assert open_campaign(store).records()["failed"][second].all()
    moody.well = True
    retry_failed(str(store))  # what failed twice, under its newest number
    retry_failed(str(store))  # the same words again, before it is done
    drive(str(store), Placement(serial=True), quiet=True)
    records = open_campaign(store).records()
    last = second + len(failed)
    assert len(records["failed"]) == n + 2 * len(failed)
    assert not records["failed"][last].any()
    assert np.isfinite(records["g_cm_s"][last]).all()
    assert records["note"][last].tolist() == [f"candidate {i} again" for i in second]
    assert records["origin"][last].tolist() == ["retry"] * len(failed)
    np.testing.assert_array_equal(records["waveform"][last], before["waveform"][failed])
    np.testing.assert_array_equal(records["failed"][:n], before["failed"])  # the record of the failure stays
    assert verify(store).ok
    with pytest.raises(StoreError, match=r"none of the .* failed: there is nothing to retry"):
        retry_failed(str(store))


def test_resume_of_a_damaged_finished_store_does_not_end_well(tmp_path: Path) -> None:
    store = Path(make_campaign(tmp_path / "a.zarr", *COARSE))
    assert softclose("resume", str(store)).returncode == 0
    shard = next(f for f in files_of(store / "search" / "x") if f.name != "zarr.json")
    content = bytearray(shard.read_bytes())
    content[len(content) // 3] ^= 4
    shard.write_bytes(content)
    done = softclose("resume", str(store))
    assert done.returncode == 1, done.stdout
    assert "is finished and damaged in one place" in done.stderr
    assert f"softclose verify {store} --repair" in done.stderr


def test_a_machine_on_which_no_cluster_starts_is_told_in_one_line(tmp_path: Path) -> None:
    program = f"ulimit -n 32; exec {shlex.join(command(*run_arguments(tmp_path / 'a.zarr')))} --workers 2"
    done = subprocess.run(["bash", "-c", program], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 2, done.stderr
    assert done.stderr.startswith("softclose: no cluster of 2 workers starts on this machine (OSError: [Errno 24]")
    assert done.stderr.count("\n") == 1
    assert "--serial" in done.stderr


def test_a_scheduler_that_speaks_tls_is_not_asked_without_a_certificate(tmp_path: Path) -> None:
    done = softclose(*run_arguments(tmp_path / "a.zarr"), "--scheduler", "tls://127.0.0.1:8786")
    assert done.returncode == 2
    assert "no certificate is configured here: `softclose tls FOLDER` makes one" in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("fate", ["renamed", "deleted"])
def test_a_run_whose_store_is_taken_away_says_so(fate: str, tmp_path: Path) -> None:
    store = tmp_path / "a.zarr"
    run = start(store, "--serial", "--set", "campaign.budget=2000", "--set", "optimiser.engine=sobol")
    wait_for_commits(store, 2, run)
    if fate == "renamed":
        store.rename(tmp_path / "b.zarr")
    else:
        shutil.rmtree(store, ignore_errors=True)
        shutil.rmtree(store, ignore_errors=True)
    _, stderr = run.communicate(timeout=60)
    assert run.returncode == 3, stderr
    assert "Traceback" not in stderr
    assert f"{store} is gone" in stderr
    assert "continue with" not in stderr
    if fate == "renamed":
        assert verify(tmp_path / "b.zarr").ok
