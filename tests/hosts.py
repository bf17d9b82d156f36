"""Hosts of the tests' own on one machine: network namespaces on a bridge, cut off and healed at will."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import uuid
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from forked import SOFTCLOSE, Forked

PROGRAMS = ("ip", "unshare")

FIRST = "10.77.0."

THERE = """
import ctypes, socket
c = ctypes.CDLL(None, use_errno=True)
with open("/run/netns/{space}") as space:
    assert c.setns(space.fileno(), 0) == 0, ctypes.get_errno()
assert c.unshare(0x04000000) == 0, ctypes.get_errno()  # CLONE_NEWUTS
socket.sethostname("{name}")
"""
"""Goes to a host, under its name."""


def _ip(*arguments: str, inside: str = "") -> None:
    within = ["ip", "netns", "exec", inside] if inside else []
    done = subprocess.run([*within, "ip", *arguments], capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"ip {' '.join(arguments)}: {done.stderr.strip()}")


@dataclass(slots=True)
class Hosts:
    """Hosts on one network."""

    tag: str
    names: tuple[str, ...]
    running: list[subprocess.Popen[str] | Forked] = field(default_factory=list)

    def address(self, name: str) -> str:
        """IPv4 address of a host."""
        return f"{FIRST}{self.names.index(name) + 1}"

    def start(self, name: str, *command: str, env: Mapping[str, str] | None = None, **options: Any) -> Any:
        """Run a program on a host, under the host's own name; it ends with the hosts at the latest."""
        words = ["ip", "netns", "exec", f"{self.tag}{name}", "unshare", "--uts"]
        words += ["sh", "-c", 'hostname "$0"; exec "$@"', name, *command]
        options = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL} | options
        process = subprocess.Popen(words, env=os.environ | dict(env or {}), text=True, **options)
        self.running.append(process)
        return process

    def begin(
        self,
        name: str,
        *arguments: str,
        program: str = SOFTCLOSE,
        env: Mapping[str, str] | None = None,
        stderr: int = subprocess.DEVNULL,
    ) -> Forked:
        """As `start`, of a program that begins with its imports done (`forked.py`)."""
        program = THERE.format(space=f"{self.tag}{name}", name=name) + program
        environment = os.environ | dict(env or {})
        process = Forked(*arguments, program=program, env=environment, stdout=subprocess.DEVNULL, stderr=stderr)
        self.running.append(process)
        return process

    def cut(self, name: str) -> None:
        """Take a host off the network: what is sent is lost, and nobody is told."""
        _ip("link", "set", f"{self.tag}p{self.names.index(name)}", "down", inside=f"{self.tag}net")

    def heal(self, name: str) -> None:
        """Put it back."""
        _ip("link", "set", f"{self.tag}p{self.names.index(name)}", "up", inside=f"{self.tag}net")


@contextlib.contextmanager
def hosts_on_a_network(*names: str) -> Iterator[Hosts]:
    """Make hosts of these names; they, and what runs on them, are gone at the end."""
    hosts = Hosts(f"sc{uuid.uuid4().hex[:4]}", names)
    spaces = [f"{hosts.tag}net"]
    try:
        _ip("netns", "add", spaces[0])
        _ip("link", "add", "bridge", "type", "bridge", inside=spaces[0])
        _ip("link", "set", "bridge", "up", inside=spaces[0])
        for i, name in enumerate(names):
            space = f"{hosts.tag}{name}"
            _ip("netns", "add", space)
            spaces.append(space)
            port, end = f"{hosts.tag}p{i}", f"{hosts.tag}e{i}"
            _ip("link", "add", end, "netns", space, "type", "veth", "peer", "name", port, "netns", spaces[0])
            _ip("link", "set", port, "master", "bridge", "up", inside=spaces[0])
            _ip("addr", "add", f"{hosts.address(name)}/24", "dev", end, inside=space)
            _ip("link", "set", end, "up", inside=space)
            _ip("link", "set", "lo", "up", inside=space)
        yield hosts
    finally:
        for space in reversed(spaces):
            left = subprocess.run(["ip", "netns", "pids", space], capture_output=True, text=True, check=False).stdout
            for pid in left.split():  # their children too
                with contextlib.suppress(ProcessLookupError):
                    os.kill(int(pid), signal.SIGKILL)
        for process in hosts.running:
            process.wait()
        for space in reversed(spaces):
            subprocess.run(["ip", "netns", "delete", space], capture_output=True, check=False)
