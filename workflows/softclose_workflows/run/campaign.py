"""Owns the main job: propose -> simulate -> commit, candidate by candidate, with the determinism contract.

Proposal i waits for candidate i - lag and sees exactly the records 0 ... i - lag, however much more has come in.
Candidates commit in index order. Nothing outside the store carries state from one candidate to the next.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from softclose.config import CampaignConfig
from softclose.propose.proposer import Proposer
from softclose.propose.protocol import Observation, Problem, Proposal, seen_by
from softclose_store import DriverStore
from softclose_workflows.errors import ChunkFailure, Stopped
from softclose_workflows.run import records
from softclose_workflows.run.executors import Executor
from softclose_workflows.run.stopping import StopRequest
from softclose_workflows.run.tasks import ChunkTask, chunk_task

POLL_S = 0.5
"""How often the driver looks up from waiting: for a stop request, for lost workers [s]."""


@dataclass(slots=True)
class Flight:
    """One candidate between its proposal and its commit."""

    proposal: Proposal
    proposed: dict[str, Any]
    """The proposal as the store keeps it."""
    missing: set[int]
    """Chunks not yet marked."""
    started: float = field(default_factory=time.monotonic)
    wall_propose_s: float = 0.0
    failure: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Progress:
    """What a progress display may show after each event."""

    committed: int
    budget: int
    best_g_cm_s: float
    n_switches_done: int
    """Switches simulated by this process's run."""
    n_workers: int
    n_retries: int


Listener = Callable[[Progress], None]


class Campaign:
    """Drives one store to the end of its budget."""

    def __init__(
        self,
        store: DriverStore,
        executor: Executor,
        *,
        stop: StopRequest | None = None,
        listener: Listener | None = None,
    ) -> None:
        self.config = CampaignConfig.from_dict(store.config)
        self._store = store
        self._executor = executor
        self._stop = stop if stop is not None else StopRequest()
        self._listener = listener
        self._proposer = Proposer(Problem(self.config))
        self._history: list[Observation] = records.observations(store.records())
        self._flights: dict[int, Flight] = {}
        self._n_switches_done = 0

    def run(self) -> None:
        """Return when every candidate is committed; raise Stopped where the run ends earlier."""
        total = self.config.total_budget
        self._report()
        while len(self._history) < total:
            self._launch()
            if not self._flights:
                raise Stopped(f"{self._stop.signal_name} received: what was in flight is committed")
            self._advance()

    def _launch(self) -> None:
        """Propose and submit every candidate that may start now."""
        while not self._stop:
            i = len(self._history) + len(self._flights)
            if i >= self.config.total_budget or len(self._flights) >= self.config.campaign.lag:
                return
            self._flights[i] = flight = self._propose(i)
            for chunk in sorted(flight.missing):
                self._executor.submit(self._task(i, chunk))

    def _propose(self, i: int) -> Flight:
        """The stored proposal where one survived a kill, a fresh one otherwise."""
        started = time.monotonic()
        stored = self._store.proposal(i)
        if stored is None:
            seen = seen_by(i, self._history, self.config.campaign.lag)
            unseen = [o.waveform for o in self._history[len(seen) :]]
            unseen += [self._flights[j].proposal.waveform for j in sorted(self._flights)]
            proposal = self._proposer.propose(i, seen, unseen)
            self._store.propose(i, records.proposal_record(proposal))
            stored = self._store.proposal(i)
            assert stored is not None
        else:
            proposal = records.proposal_from_record(stored)
        done = self._store.chunks_done(i)
        return Flight(
            proposal=proposal,
            proposed=stored,
            missing={chunk for chunk, is_done in enumerate(done) if not is_done},
            wall_propose_s=time.monotonic() - started,
        )

    def _task(self, i: int, chunk: int) -> ChunkTask:
        flight = self._flights[i]
        return chunk_task(
            self.config,
            self._store.path,
            i,
            chunk,
            flight.proposal.waveform,
            flight.proposal.n_switches,
            self._store.proposal_digest(i),
        )

    def _advance(self) -> None:
        """Wait for one event, then commit every candidate that is next in order and complete."""
        if any(flight.missing for flight in self._flights.values()):
            event = self._executor.next_event(POLL_S)
            if event is not None:
                self._receive(*event)
        while (i := len(self._history)) in self._flights and not self._flights[i].missing:
            self._commit(i)

    def _receive(self, task: ChunkTask, outcome: object) -> None:
        flight = self._flights.get(task.candidate)
        if isinstance(outcome, Stopped):
            raise outcome
        if isinstance(outcome, OSError):
            raise Stopped(f"{task.name} could not be stored: {outcome}") from outcome
        if flight is None:
            return  # a chunk of a candidate that has failed meanwhile
        if isinstance(outcome, BaseException):
            reason = str(outcome) if isinstance(outcome, ChunkFailure) else f"{type(outcome).__name__}: {outcome}"
            flight.failure = flight.failure or f"{task.name}: {reason}"
        else:
            self._n_switches_done += task.stop - task.start
        flight.missing.discard(task.chunk)

    def _commit(self, i: int) -> None:
        """Assess candidate i from what its chunks stored, and make it part of the campaign."""
        flight = self._flights[i]
        wall = {"wall_propose_s": flight.wall_propose_s, "wall_simulate_s": time.monotonic() - flight.started}
        if flight.failure:
            record = records.failed_record(flight.failure)
        else:
            stored = self._store.read_switch_metrics(i)
            record = records.assessment_record(records.assess_stored(stored, self.config))
        try:
            self._store.commit(i, record | wall)
        except OSError as e:
            raise Stopped(f"candidate {i} could not be committed: {e}") from e
        self._history.append(records.observation(i, flight.proposed, record))
        del self._flights[i]
        self._report()

    def _report(self) -> None:
        if self._listener is None:
            return
        usable = [o for o in self._history if not o.failed]
        largest = max((o.n_switches for o in usable), default=0)
        self._listener(
            Progress(
                committed=len(self._history),
                budget=self.config.total_budget,
                best_g_cm_s=min((o.g_cm_s for o in usable if o.n_switches == largest), default=float("nan")),
                n_switches_done=self._n_switches_done,
                n_workers=self._executor.n_workers,
                n_retries=self._executor.n_retries,
            )
        )
