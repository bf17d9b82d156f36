"""Owns who runs a campaign, on what and with which versions: recorded with every run, never part of its identity."""

from __future__ import annotations

import getpass
import os
import platform
import socket
from collections.abc import Mapping
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import version
from typing import Any

from softclose import __version__
from softclose_workflows.terminal import say

RECORDED_VERSIONS = ("dask", "numba", "numpy", "scikit-learn", "scikit-optimize", "scipy", "zarr")
"""Libraries whose version can change bits."""


def runtime() -> dict[str, Any]:
    """This process and this machine."""
    return {
        "versions": _versions() | {"python": platform.python_version(), "softclose": __version__},
        "processor": processor(),
        "machine": platform.machine(),
        "system": platform.platform(),
        "host": socket.gethostname(),
        "user": _user(),
        "pid": os.getpid(),
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
    }


@cache
def _versions() -> dict[str, str]:
    """Of what this process has installed: looked up once, a sixth of the time that the creation of a store takes."""
    return {name: version(name) for name in RECORDED_VERSIONS}


def processor() -> str:
    """Model name of the processor."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as f:
            names = [line.partition(":")[2].strip() for line in f if line.startswith("model name")]
    except OSError:
        names = []
    return names[0] if names else platform.processor()


def _user() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # a container's user id without a name
        return str(os.getuid())


def changes_since(recorded: Mapping[str, Any]) -> list[str]:
    """What differs here from where the store was made, of what may change bits: one line each."""
    now = runtime()
    then = recorded.get("versions", {})
    changes = [
        f"{name} is {now['versions'][name]}, the store was made with {then[name]}"
        for name in sorted(now["versions"].keys() & then.keys())
        if now["versions"][name] != then[name]
    ]
    if recorded.get("processor") not in (None, now["processor"]):
        changes.append(f"this processor is {now['processor']}, the store was made on {recorded['processor']}")
    return changes


def say_changes(recorded: Mapping[str, Any]) -> None:
    """Tell, on standard error, what differs here: also where progress is not wanted."""
    for change in changes_since(recorded):
        say(f"note: {change}: bits of further candidates may differ from a run here alone", err=True)
