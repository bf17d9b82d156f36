"""Owns running several campaigns on one executor, in turn or at once: finished ones are skipped, each is certified."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from softclose import ALGORITHM
from softclose.settings import CampaignConfig
from softclose_store import DriverStore, open_campaign, store_state
from softclose_workflows.analyses.certify import N_REFERENCES, Certification, certify, check_size
from softclose_workflows.errors import ExecutorError, Stopped
from softclose_workflows.run import needs
from softclose_workflows.run.campaign import Driver
from softclose_workflows.run.creation import create_store
from softclose_workflows.run.crew import Crew
from softclose_workflows.run.executors import Executor, Placement, open_executor
from softclose_workflows.run.executors.placement import n_cores
from softclose_workflows.run.progress import show_progress
from softclose_workflows.run.runtime import runtime, say_changes
from softclose_workflows.run.stopping import StopRequest, stop_on_signals
from softclose_workflows.studies.at_once import run_at_once
from softclose_workflows.tell.console import bar
from softclose_workflows.tell.outputs import check_folder, make_folder
from softclose_workflows.terminal import STARTING, say, working


@dataclass(frozen=True, slots=True, kw_only=True)
class Member:
    """One campaign of a series."""

    name: str
    """Name of its store in the series' folder."""
    config: CampaignConfig
    """What it runs."""

    def store(self, folder: str | Path) -> str:
        """Path of its store."""
        return str(Path(folder) / f"{self.name}.zarr")


@dataclass(frozen=True, slots=True, kw_only=True)
class Effort:
    """How a series is computed; no result depends on it but on `n_switches` and `top`."""

    n_switches: int = 100_000
    """New switches of each certification."""
    top: int = 10
    """Candidates certified in each campaign."""
    placement: Placement = field(default_factory=Placement)
    """Where blocks are computed."""
    at_once: int = 1
    """Campaigns that run at the same time."""
    quiet: bool = False
    """Say nothing."""


Done = Callable[[Member, Certification], None]


def run_series(
    members: Sequence[Member], folder: str | Path, effort: Effort, done: Done | None = None
) -> list[Certification]:
    """Run, or continue, every campaign and certify it; returns the certifications in the order of the members.

    Raises OutputError where no such folder can be.
    Every store is created or found to hold the very campaign before anything is computed, so a folder of another series
    is refused at once. done: called after each member. Raises Stopped on a signal; the same call continues.
    """
    check_folder(folder)
    _check(members, folder, effort)
    make_folder(folder)
    for member in members:
        check_size(member.config, effort.n_switches, effort.top)
    for member in members:
        create_store(member.config, member.store(folder))
    results = []
    with stop_on_signals() as stop, ExitStack() as stack, _same_command_continues():

        def opened() -> Executor:
            with working(STARTING, quiet=effort.quiet):
                return stack.enter_context(open_executor(effort.placement))

        cluster = cache(opened)
        threads = cache(lambda: stack.enter_context(open_executor(effort.placement, threads=n_cores())))
        crew = Crew(threads if effort.placement.is_usual else cluster, stop)
        left = [path for m in members if not open_campaign(path := m.store(folder)).finished]
        if effort.at_once > 1 and len(left) > 1:
            executor = cluster()
            if executor.contact is None:
                raise ExecutorError("--at-once needs workers that several drivers can share: leave --serial out")
            run_at_once(
                left,
                executor.contact,
                effort.at_once,
                patience_s=effort.placement.wait_s,
                stop=stop,
                say=lambda line: _say(effort, line),
            )
        for number, member in enumerate(members, start=1):
            if stop:
                raise Stopped(f"{stop.signal_name} received")
            path = member.store(folder)
            if not open_campaign(path).finished:
                _say(effort, f"[{number}/{len(members)}] {member.config.campaign.name}")
                _run(path, cluster(), stop, effort)
            with bar(f"certifying {member.name}", quiet=effort.quiet) as listener:
                result = certify(path, n_switches=effort.n_switches, top=effort.top, mapper=crew, listener=listener)
            results.append(result)
            if done is not None:
                done(member, result)
    return results


def _check(members: Sequence[Member], folder: str | Path, effort: Effort) -> None:
    """Refuse what this machine cannot hold, before the first store is created."""
    designs = [min(effort.top, m.config.total_budget) + N_REFERENCES for m in members]
    runs = needs.of_all(
        needs.of_run(m.config, workers=effort.placement.n_processes, committed=store_state(m.store(folder)).n_committed)
        for m in members
    )
    # What is certified stays in memory until the last campaign has been compared with the others.
    certifications = needs.of_fresh(effort.n_switches, max(designs), n_kept=sum(designs))
    needs.check(
        needs.of_all([runs, certifications]),
        f"{len(members)} campaigns, each certified on {effort.n_switches:,} new switches,",
        "lower population.n_switches, campaign.budget or store.n_times (--set), --switches or --top",
        path=folder,
    )


def _run(path: str, executor: Executor, stop: StopRequest, effort: Effort) -> None:
    with DriverStore(path, expected_algorithm=ALGORITHM) as store:
        say_changes(open_campaign(path).runtime)
        store.note_run(runtime() | {"workers": executor.n_workers})
        with show_progress(quiet=effort.quiet) as listener:
            Driver(store, executor, stop=stop, listener=listener).run()


@contextmanager
def _same_command_continues() -> Iterator[None]:
    try:
        yield
    except Stopped as e:
        raise Stopped(f"{e}; the same command continues") from e


def _say(effort: Effort, message: str) -> None:
    if not effort.quiet:
        say(message, err=True)
