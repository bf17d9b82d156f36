"""Owns where the time of a campaign's runs went: of its workers, and of the driver between them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

from softclose_store import open_campaign
from softclose_workflows.tell.labels import in_percent


@dataclass(frozen=True, slots=True, kw_only=True)
class Where:
    """Seconds of all runs that came to an end, start-up apart."""

    wall: float
    """Of the runs, one after the other."""
    worker: float
    """Of the workers: how many were there, times how long."""
    simulate: float
    """Of the workers in the device model, x and v on their grid included."""
    compress: float
    """Of the workers in digests and compression."""
    write: float
    """Of the workers waiting for the disk or the service."""
    prior: float
    """Of the workers on the prior: descents to its basins, and what proposals look at."""
    propose: float
    """Of the driver, without waiting for the prior."""
    await_prior: float
    """Of the driver, waiting for the prior; in a run in one process it is evaluated meanwhile."""
    dispatch: float
    """Of the driver, cutting waves into tasks, sending them, and receiving results."""
    assess: float
    """Of the driver, judging."""
    commit: float
    """Of the driver, writing records."""
    wait: float
    """Of the driver, waiting for a block; in a run in one process the blocks are computed meanwhile."""
    n_runs: int
    """Runs that were counted; one that was killed says nothing."""

    @property
    def idle(self) -> float:
        """Of the workers, waiting for a task."""
        return max(self.worker - self.simulate - self.compress - self.write - self.prior, 0.0)

    def to_json(self) -> dict[str, float]:
        """Plain values."""
        return asdict(self) | {"idle": self.idle}


def where(path: str) -> Where:
    """Where the time of the campaign's runs went."""
    runs = open_campaign(path).runtime.get("runs") or []
    return total([run["spent"] for run in runs if isinstance(run, dict) and run.get("spent")])


def total(spent: list[Mapping[str, Any]]) -> Where:
    """The sum over runs; spent: as `softclose_workflows.run.campaign.Spent` says it."""

    def of(run: Mapping[str, Any], name: str) -> float:
        own = float(run.get(name, 0.0))
        return own - float(run.get("write", 0.0)) if name == "store" else own

    names = {f.name: "store" if f.name == "compress" else f.name for f in fields(Where) if f.name != "n_runs"}
    return Where(**{name: sum(of(run, told) for run in spent) for name, told in names.items()}, n_runs=len(spent))


def print_where(path: str, found: Where) -> None:
    """Two rows of shares: of the workers, of the driver."""
    from rich.table import Table

    from softclose_workflows.tell.console import wide_console

    console = wide_console()
    if not found.n_runs:
        console.print(f"no run of {path} has come to its end yet: a run says where its time went when it ends")
        return
    n = "1 run" if found.n_runs == 1 else f"{found.n_runs} runs"
    table = Table(title=f"{path}: {n}, {found.wall:.1f} s without start-up", title_justify="left")
    for column in ("whose", "where", "seconds", "share"):
        table.add_column(column, justify="right" if column in ("seconds", "share") else "left")
    words = {
        "workers": (found.worker, {"device model": found.simulate, "prior": found.prior,
                                   "digests and compression": found.compress, "writing": found.write,
                                   "waiting for a task": found.idle}),
        "driver": (found.wall, {"proposing": found.propose, "waiting for the prior": found.await_prior,
                                "tasks and results": found.dispatch,
                                "judging": found.assess, "committing": found.commit, "waiting for blocks": found.wait}),
    }  # fmt: skip
    for whose, (whole, parts) in words.items():
        for part, seconds in parts.items():
            table.add_row(whose, part, f"{seconds:.2f}", in_percent(seconds / whole) if whole else "–")
    console.print(table)
