"""Owns processes of `softclose` that begin with their imports done: forked from one that did nothing but import.

A process that imports for itself takes three seconds of a processor before its work. These are processes like any
other: they have an environment, a folder and streams of their own, are killed, and end as the interpreter ends.
"""

from __future__ import annotations

import atexit
import contextlib
import gc
import json
import os
import select
import signal
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Mapping
from functools import cache
from importlib import import_module
from pathlib import Path
from subprocess import DEVNULL, PIPE
from typing import IO, Any

IMPORTED = (
    "softclose_workflows.run.preloaded",
    "softclose_workflows.cli",
    "softclose_workflows.commands.run",
    "softclose_workflows.commands.driving",
    "softclose_workflows.analyses.result",
    "softclose.propose.surrogate",
)
"""What a run imports, a Gaussian process included."""

SOFTCLOSE = "import runpy; runpy.run_module('softclose_workflows', run_name='__main__')"
"""What `python -m softclose_workflows` does."""
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def serve(fd: int) -> str:
    """Fork a process for each request, and tell of its end. Returns in the new processes alone: what they execute."""
    for name in IMPORTED:
        import_module(name)
    sys.excepthook = sys.__excepthook__
    assert threading.active_count() == 1, "locks of other threads would stay locked in a fork"
    gc.collect()
    gc.freeze()
    interrupt = signal.signal(signal.SIGINT, signal.SIG_IGN)  # the terminal's is meant for the tests
    asking = socket.socket(fileno=fd)
    asking.sendall(b"r")
    while fds := socket.recv_fds(asking, 1, 4)[1]:
        with contextlib.suppress(ChildProcessError):
            while os.waitpid(-1, os.WNOHANG)[0]:
                pass
        if os.fork() == 0:
            signal.signal(signal.SIGINT, interrupt)
            asking.close()
            *streams, told = fds
            if (pid := os.fork()) == 0:
                os.close(told)
                return _become(*streams)
            for stream in streams:
                os.close(stream)
            os.write(told, f"{pid}\n".encode())
            os.write(told, f"{os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])}\n".encode())
            os._exit(0)
        for stream in fds:
            os.close(stream)
    sys.exit()


def _become(request: int, stdout: int, stderr: int) -> str:
    """Take on the arguments, environment, folder and streams that are asked for; the program that is."""
    import dask.config

    with open(request, encoding="utf-8") as file:
        asked = json.load(file)
    for number, stream in enumerate((stdout, stderr), 1):
        os.dup2(stream, number)
        os.close(stream)
    os.environ.clear()
    os.environ.update(asked["environment"])
    os.chdir(asked["folder"])
    sys.path[:] = ["", *filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep)), *asked["path"]]
    # What Dask read as it was imported.
    dask.config.paths[:] = dask.config._get_paths()
    dask.config.refresh()
    sys.argv = ["softclose", *asked["arguments"]]
    return str(asked["program"])


@cache
def _server() -> socket.socket:
    """The process that imports; it ends with this one."""
    here, there = socket.socketpair()
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("SOFTCLOSE", "DASK"))}
    environment |= {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))} | dict.fromkeys(ONE_THREAD, "1")
    words = [sys.executable, "-c", f"import forked; exec(forked.serve({there.fileno()}))"]
    process = subprocess.Popen(words, env=environment, pass_fds=[there.fileno()])
    there.close()
    assert here.recv(1) == b"r"

    def end() -> None:
        here.close()
        process.wait()

    atexit.register(end)
    return here


class Forked:
    """A process of `softclose`: what tests ask of a `subprocess.Popen`, of text.

    env, folder: its environment and working directory, by default those of this process. stdout, stderr: what is
    written to PIPE `communicate` gives back; None is this process's own. program: another one, of Python.
    """

    def __init__(
        self,
        *arguments: str,
        env: Mapping[str, str] | None = None,
        folder: Path | str = ".",
        stdout: int | None = None,
        stderr: int | None = None,
        program: str = SOFTCLOSE,
    ) -> None:
        server = _server()
        self.args = ["softclose", *arguments]
        self.returncode: int | None = None
        self._said: list[IO[bytes] | None] = []
        asked: dict[str, Any] = {
            "program": program,
            "arguments": arguments,
            "environment": dict(os.environ if env is None else env),
            "folder": os.path.abspath(folder),
            "path": [part for part in sys.path if part],
        }
        self._end, told = os.pipe()
        with tempfile.TemporaryFile() as request, open(os.devnull, "wb") as nobody:
            request.write(json.dumps(asked).encode())
            request.seek(0)
            streams = [request.fileno()]
            for number, wanted in ((1, stdout), (2, stderr)):
                said = tempfile.TemporaryFile() if wanted == PIPE else None  # noqa: SIM115 - `communicate` closes it
                self._said.append(said)
                streams.append(said.fileno() if said else nobody.fileno() if wanted == DEVNULL else number)
            socket.send_fds(server, [b"r"], [*streams, told])
        os.close(told)
        self._told = b""
        self.pid = int(self._line(None))

    def _line(self, timeout: float | None) -> str:
        """What is told next. Raises TimeoutError."""
        while b"\n" not in self._told:
            if not select.select([self._end], [], [], timeout)[0]:
                raise TimeoutError(f"{self.args} has not ended")
            more = os.read(self._end, 64)
            assert more, "whoever forks has ended"
            self._told += more
        line, _, self._told = self._told.partition(b"\n")
        return line.decode()

    def poll(self) -> int | None:
        """The exit code, negative that of a signal; None while it runs."""
        if self.returncode is None:
            try:
                self.returncode = int(self._line(0.0))
            except TimeoutError:
                return None
            os.close(self._end)
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        """The exit code, once it has ended. Raises subprocess.TimeoutExpired."""
        if self.poll() is None and not select.select([self._end], [], [], timeout)[0]:
            raise subprocess.TimeoutExpired(self.args, timeout or 0.0)
        while (code := self.poll()) is None:
            pass
        return code

    def communicate(self, timeout: float | None = None) -> tuple[str, str]:
        """All that it wrote, once it has ended."""
        self.wait(timeout)
        found = []
        for said in self._said:
            if said is not None:
                said.seek(0)
            found.append("" if said is None else said.read().decode())
            if said is not None:
                said.close()
        self._said = [None, None]
        return found[0], found[1]

    def send_signal(self, number: int) -> None:
        """As `os.kill`, where it still runs."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        """End it at once."""
        self.send_signal(signal.SIGKILL)
