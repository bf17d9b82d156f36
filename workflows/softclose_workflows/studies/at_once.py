"""Owns several campaigns of a series at once on one cluster: a driver process for each, the workers shared.

A campaign waits for its own waves: a cluster that is larger than a wave is filled by several campaigns. Nothing that is
stored depends on it.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from softclose_workflows.errors import ExecutorError, Stopped
from softclose_workflows.run.executors.protocol import Contact
from softclose_workflows.run.stopping import StopRequest

POLL_S = 0.2


@dataclass(slots=True)
class _Running:
    path: str
    driver: subprocess.Popen[str]


def run_at_once(
    paths: Sequence[str],
    contact: Contact,
    at_once: int,
    *,
    patience_s: float,
    stop: StopRequest,
    say: Callable[[str], None],
) -> None:
    """Continue the campaigns at paths to their ends, `at_once` of them at a time.

    Raises Stopped where one stops, or on a signal: the others finish what is in flight first. Raises ExecutorError
    where a driver refuses its campaign.
    """
    waiting, running, failure, ending = list(paths), list[_Running](), "", False
    while waiting or running:
        if (stop or failure) and not ending:
            ending = True
            waiting.clear()
            for each in running:
                each.driver.send_signal(signal.SIGTERM)
        while waiting and len(running) < at_once:
            path = waiting.pop(0)
            say(f"[{len(paths) - len(waiting)}/{len(paths)}] {path}")
            running.append(_Running(path, _driver(path, contact, patience_s)))
        for each in [r for r in running if r.driver.poll() is not None]:
            running.remove(each)
            said = (each.driver.communicate()[1] or "").strip()
            if each.driver.returncode and not failure and not stop:
                failure = f"{each.path}: {said or f'its driver ended with {each.driver.returncode}'}"
        time.sleep(POLL_S)
    if stop:
        raise Stopped(f"{stop.signal_name} received")
    if failure:
        raise (Stopped if "stopped:" in failure else ExecutorError)(failure)


def _driver(path: str, contact: Contact, patience_s: float) -> subprocess.Popen[str]:
    """A process that resumes one campaign on the cluster behind contact; it leaves Ctrl-C to us."""
    words = [sys.executable, "-m", "softclose_workflows", "resume", path, "--quiet", "--scheduler", contact.address]
    words += ["--plain-tcp", "--patience", f"{patience_s:g}"]
    return subprocess.Popen(
        words,
        env=os.environ | contact.environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
