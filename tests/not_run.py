"""Owns what a test session says at its end of what it did not run: a line for each reason, and what to do about it."""

from __future__ import annotations

import platform
import re
from collections import Counter
from collections.abc import Iterable, Sequence

import pytest

LONG = pytest.StashKey[list[str]]()
"""Names of the tests that this session, or each of its processes, leaves to `make long`."""

REMEDIES = {
    "chromium": "apt-get install chromium",
    "faketime": "apt-get install faketime",
    "ip ": "apt-get install iproute2",
    "mount a tmpfs": "run as root",
    "munged": "apt-get install munge",
    "need root": "run as root",
    "ngspice": "apt-get install ngspice",
    "sbatch": "apt-get install slurm-wlm",
    "slurm": "apt-get install slurm-wlm",
}
"""Word of a reason -> what brings the tests about; where none is named, the reason has to do."""


def lines(skipped: Iterable[str], long: Sequence[str]) -> list[str]:
    """One line for each reason, the most frequent first: how many tests, why, and what to do about it."""
    found = [f"{n} × {reason}{remedy(reason)}" for reason, n in Counter(skipped).most_common()]
    if long:
        whole = sorted({re.sub(r"\[.*", "", name).rpartition("::")[2] for name in long})
        found.append(f"{len(long)} × long, of {len(whole)} claims with a short case here: `make long` runs them")
    python = f"Python {platform.python_version()} on {platform.system()} {platform.machine()}"
    return [*found, f"everything on any other Python, system and processor: this was {python}"]


def remedy(reason: str) -> str:
    """What makes such a test run, in brackets; nothing where the reason says it."""
    return next((f" ({words})" for word, words in REMEDIES.items() if word in reason), "")


def reason_of(report: pytest.TestReport | pytest.CollectReport) -> str:
    """Why a test was skipped, in its own words."""
    longrepr = report.longrepr
    text = str(longrepr[2]) if isinstance(longrepr, tuple) else str(longrepr)
    return text.removeprefix("Skipped: ")


def pytest_deselected(items: Sequence[pytest.Item]) -> None:
    """Remember which tests are left out because they are long."""
    for item in items:
        if item.get_closest_marker("long") is not None:
            item.config.stash.setdefault(LONG, []).append(item.nodeid)


def pytest_sessionfinish(session: pytest.Session) -> None:
    """A process of several tells its names to the one that writes the summary."""
    output = getattr(session.config, "workeroutput", None)
    if output is not None:
        output["long"] = session.config.stash.get(LONG, [])


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: object) -> None:
    """Every process collects all tests, so that each tells the same names."""
    told = getattr(node, "workeroutput", {}).get("long", [])
    node.config.stash[LONG] = told or node.config.stash.get(LONG, [])  # type: ignore[attr-defined]


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    """The last words of the session."""
    skipped = [reason_of(report) for report in terminalreporter.stats.get("skipped", [])]
    terminalreporter.section("not run")
    for line in lines(skipped, config.stash.get(LONG, [])):
        terminalreporter.write_line(line)
