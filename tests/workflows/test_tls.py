"""Claims about clusters of one's own: a certificate made by one command lets in who holds it, and nobody else."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import stat
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from campaigns import run_arguments, softclose_process
from forked import Forked
from softclose_workflows.errors import ExecutorError
from softclose_workflows.run.certificates import make_certificates
from softclose_workflows.run.executors.dask import remote_cluster
from stores import differences


@contextlib.contextmanager
def _cluster(folder: Path) -> Iterator[str]:
    """A scheduler and a worker under the settings in folder."""
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        address = f"tls://127.0.0.1:{s.getsockname()[1]}"
    environment = os.environ | {"DASK_CONFIG": str(folder), "OMP_NUM_THREADS": "1"}
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    port = address.rpartition(":")[2]
    commands = (
        ["scheduler", "--protocol", "tls", "--host", "127.0.0.1", "--port", port, "--no-dashboard"],
        ["worker", address, "--nworkers", "1", "--nthreads", "1", "--no-dashboard"],
    )
    running = []
    try:
        for command in commands:
            running.append(Forked(*command, env=environment, program="from dask.__main__ import main; main()", **quiet))
            if len(running) == 1:
                _until_it_listens(int(port))
        yield address
    finally:
        for process in reversed(running):
            process.send_signal(signal.SIGTERM)
            process.wait(timeout=20)


def _until_it_listens(port: int) -> None:
    end = time.monotonic() + 30.0
    while True:
        with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), timeout=1.0):
            return
        assert time.monotonic() < end
        time.sleep(0.1)


def test_who_holds_the_key_computes_on_the_cluster_and_nobody_else(reference_store: Path, tmp_path: Path) -> None:
    keys, others = tmp_path / "keys", tmp_path / "others"
    made = softclose_process("tls", str(keys))
    assert made.returncode == 0, made.stderr
    assert f"export DASK_CONFIG={keys}" in made.stdout
    make_certificates(others)
    with _cluster(keys) as address:
        store = tmp_path / "a.zarr"
        arguments = [*run_arguments(store), "--scheduler", address]
        stranger = softclose_process(*arguments, env={"DASK_CONFIG": str(others)})
        assert stranger.returncode == 2
        assert "no Dask scheduler answers" in stranger.stderr
        assert not store.exists()
        done = softclose_process(*arguments, env={"DASK_CONFIG": str(keys)})
        assert done.returncode == 0, done.stderr
        assert differences(store, reference_store) == []


@pytest.mark.long
@pytest.mark.slow
def test_a_cluster_that_is_far_away_and_loses_packets_computes_the_same(reference_store: Path, tmp_path: Path) -> None:
    """50 ms each way between driver and scheduler, and 1 % of the packets half a second later."""
    keys = make_certificates(tmp_path / "keys").folder
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        port = s.getsockname()[1]
    with _cluster(keys) as address:
        words = [sys.executable, str(Path(__file__).parents[1] / "relay.py"), str(port), address.rpartition(":")[2]]
        relay = subprocess.Popen([*words, "50", "0.01", "500"])
        try:
            _until_it_listens(port)
            store = tmp_path / "a.zarr"
            arguments = [*run_arguments(store), "--scheduler", f"tls://127.0.0.1:{port}"]
            done = softclose_process(*arguments, env={"DASK_CONFIG": str(keys)})
        finally:
            relay.kill()
            relay.wait()
        assert done.returncode == 0, done.stderr
        assert differences(store, reference_store) == []


def test_keys_are_the_owners_alone_and_never_replaced(tmp_path: Path) -> None:
    made = make_certificates(tmp_path / "keys")
    assert stat.S_IMODE(made.folder.stat().st_mode) == 0o700
    assert {stat.S_IMODE(p.stat().st_mode) for p in made.folder.iterdir()} == {0o600}
    before = (made.folder / "key.pem").read_bytes()
    with pytest.raises(ExecutorError, match="holds a key already"):
        make_certificates(made.folder)
    assert (made.folder / "key.pem").read_bytes() == before


@pytest.mark.parametrize("address", ["tcp://192.0.2.7:8786", "192.0.2.7:8786", "tcp://[2001:db8::7]:8786"])
def test_plain_tcp_to_another_host_is_refused_unless_asked_for(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []

    def client(address: str, **_: object) -> None:
        asked.append(address)
        raise OSError("nobody there")

    monkeypatch.setattr("distributed.Client", client)
    with pytest.raises(ExecutorError, match="--plain-tcp"), remote_cluster(address, 1.0):
        pass
    assert asked == []
    with pytest.raises(ExecutorError, match="no Dask scheduler answers"), remote_cluster(address, 1.0, plain_tcp=True):
        pass
    assert asked == [address]


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:8786", "localhost:8786", "tcp://[::1]:8786", "tcp://127.9.9.9:1"])
def test_loopback_needs_no_tls(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def client(address: str, **_: object) -> None:
        raise OSError("nobody there")

    monkeypatch.setattr("distributed.Client", client)
    with pytest.raises(ExecutorError, match="no Dask scheduler answers"), remote_cluster(address, 1.0):
        pass
