"""Owns the main job: propose -> simulate -> commit, wave by wave, with the determinism contract.

A wave is proposed as soon as the waves that it may see are committed, and sees exactly those. Waves commit in order,
whole. Nothing outside the store carries state from one wave to the next.
"""

from __future__ import annotations

import contextlib
import itertools
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field

from softclose.evaluate.asked import asked
from softclose.plugins import MEASURED, EngineError
from softclose.population.lot import Lot
from softclose.propose.origins import FALLBACK
from softclose.propose.plan import plan
from softclose.propose.promises import PriorError, PriorHelp
from softclose.propose.proposer import Proposer
from softclose.propose.protocol import Observation, Problem, Proposal, Wave, seen_by
from softclose.settings import CampaignConfig
from softclose.waveform import Waveform
from softclose_store import DriverStore, StoreError
from softclose_workflows.errors import Stopped
from softclose_workflows.run import records
from softclose_workflows.run.controlled import Controlling, controlling_of
from softclose_workflows.run.executors import Executor
from softclose_workflows.run.executors.protocol import Event
from softclose_workflows.run.faults import Retries
from softclose_workflows.run.flight import Flight, plan_tasks, recovered
from softclose_workflows.run.prior import Found, PriorAtWork, PriorOfStore, Took
from softclose_workflows.run.stopping import StopRequest
from softclose_workflows.run.tasks import BlockResult, BlockTask

MOST_FAILED = 20
"""Candidates after which a run stops where none of them has a result: the next thousand would not either."""

MOST_FALLBACKS = 5
"""Candidates in a row that an engine may fail to propose before the run stops: it would end as another engine's."""

PATIENCE_S = 5.0
"""How long a run that is to stop goes on with the waves in flight, so as to commit them [s]."""

POLL_S = 0.5
"""How often the driver looks up from waiting: for a stop request, for lost workers [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Progress:
    """What a progress display may show after each event."""

    committed: int
    """Candidates that are part of the campaign."""
    simulated: int
    """Candidates whose blocks are done, committed or not."""
    budget: int
    stage: str
    """Stage of the oldest wave in flight."""
    best_g_cm_s: float
    """g of the best on the largest ensemble so far [cm/s]; inf before the first."""
    n_switches_done: int
    """Switches simulated by this process's run."""
    n_workers: int
    n_retries: int


@dataclass(slots=True)
class Spent:
    """Where this process's time and its workers' went [s]."""

    propose: float = 0.0
    """Without waiting for the prior."""
    await_prior: float = 0.0
    """Waiting for the prior, which workers evaluate."""
    prior: float = 0.0
    """In the prior, on all workers together."""
    dispatch: float = 0.0
    """Cutting waves into tasks, sending them, and receiving their results."""
    assess: float = 0.0
    commit: float = 0.0
    wait: float = 0.0
    """Waiting for a block."""
    simulate: float = 0.0
    """In the device model, on all workers together."""
    store: float = 0.0
    """In the store, on all workers together: digests, compression, writing."""
    write: float = 0.0
    """Of that, waiting for the disk or the service."""
    wall: float = 0.0
    """From the first wave to the last, start-up apart."""
    worker: float = 0.0
    """Workers that were there, times how long."""

    def to_json(self) -> dict[str, float]:
        """Plain values [s], to the millisecond."""
        return {name: round(value, 3) for name, value in asdict(self).items()}


Listener = Callable[[Progress], None]


@dataclass(slots=True)
class Driver:
    """Drives one store to the end of its budget."""

    store: DriverStore
    executor: Executor
    stop: StopRequest = field(default_factory=StopRequest)
    listener: Listener | None = None
    spent: Spent = field(default_factory=Spent)
    config: CampaignConfig = field(init=False)
    waves: tuple[Wave, ...] = field(init=False)
    _proposer: Proposer = field(init=False)
    _controlling: Controlling | None = field(init=False)
    """Who judges candidates by the prior too; None: nobody."""
    _asked: list[str] = field(init=False)
    """Further quantities that candidates are asked for."""
    _history: list[Observation] = field(init=False, default_factory=list)
    _best: tuple[int, float, float] = field(init=False, default=(0, math.inf, math.inf))
    """Switches, rank and g of the best so far."""
    """Largest ensemble so far, and the smallest g on it: training scores on few switches are optimistic."""
    _flights: dict[int, Flight] = field(init=False, default_factory=dict)
    _retries: Retries = field(init=False)
    _took: Took = field(init=False, default_factory=Took)
    """What the prior has taken."""
    _n_switches_done: int = field(init=False, default=0)
    _stop_seen: float | None = field(init=False, default=None)
    """When the request to stop was first seen [s]."""

    def __post_init__(self) -> None:
        self.config = CampaignConfig.from_dict(self.store.config)
        self._retries = Retries(self.executor.submit)
        problem = Problem(self.config, help=self._prior())
        self.waves = plan(problem)
        self._proposer = Proposer(problem, by_hand=records.by_hand(self.store.by_hand(), self.store.layout))
        self._asked = [q.name for q in asked(self.config)]
        stored = self.store.records()
        self._controlling = controlling_of(self.config, Lot(self.store.population), stored)
        self._observe(records.observations(stored))

    def _prior(self) -> PriorHelp:
        """Who evaluates the prior: the executor, or this process where devices stand in its place."""
        if self.config.model.name == MEASURED:
            return PriorOfStore(self.store.path, self.config, keeps=True)
        return PriorAtWork(
            self.store.path,
            self.config,
            self.store.fingerprint,
            self.executor,
            self.stop,
            self._receive,
            self._report_prior,
            lambda: self.is_busy,
            self._took,
        )

    @property
    def is_busy(self) -> bool:
        """True where there is a block for every worker."""
        return sum(len(flight.missing) for flight in self._flights.values()) >= max(self.executor.n_workers, 1)

    def run(self) -> None:
        """Return when every wave is committed; raise Stopped where the run ends earlier."""
        self._report()
        if self.store.n_waves < len(self.waves):
            self.executor.probe(self.store.path, self.store.fingerprint)
        began = time.perf_counter()
        try:
            while self.store.n_waves < len(self.waves):
                self.launch()
                if not self._flights:
                    raise Stopped(f"{self.stop.signal_name} received: what was in flight is committed")
                self._give_up_in_time()
                self.advance()
                passed = time.perf_counter() - began - self.spent.wall
                self.spent.wall += passed
                self.spent.worker += passed * self.executor.n_workers
        finally:
            if self.spent.wall:
                self.spent.prior, self.spent.await_prior = self._took.worked_s, self._took.waited_s
                with contextlib.suppress(OSError, StoreError):  # what ended the run is what has to be told
                    self.store.amend_run({"spent": self.spent.to_json()})

    def _give_up_in_time(self) -> None:
        """Raise Stopped where a stop was asked for `PATIENCE_S` ago: a wave may take an hour, a batch system gives half
        a minute. Its blocks that are stored are there for whoever goes on."""
        if not self.stop:
            return
        self._stop_seen = time.monotonic() if self._stop_seen is None else self._stop_seen
        if time.monotonic() - self._stop_seen >= PATIENCE_S:
            tasks = sum(len(f.tasks) for f in self._flights.values())
            stored = sum(len(f.results) for f in self._flights.values())
            raise Stopped(
                f"{self.stop.signal_name} received: of what was in flight, {stored:,} of {tasks:,} blocks are stored "
                "and will not be computed again"
            )

    def launch(self) -> None:
        """Propose and submit every wave that may start now."""
        while not self.stop:
            w = self.store.n_waves + len(self._flights)
            if w == len(self.waves) or self.waves[w].sees > self.store.n_waves:
                return
            self._flights[w] = flight = self._propose(self.waves[w])
            began = time.perf_counter()
            for task in flight.missing:
                self.executor.submit(task)
            self.spent.dispatch += time.perf_counter() - began

    def _propose(self, wave: Wave) -> Flight:
        """The wave as a pure function of what it may see, with the blocks that an earlier run has stored."""
        began = time.perf_counter()
        seen = seen_by(wave, self._history)
        pending = [o.waveform for o in self._history[len(seen) :]]
        pending += [p.waveform for w in sorted(self._flights) for p in self._flights[w].proposals]
        waited = self._took.waited_s
        proposals = self._ask(wave, seen, pending)
        proposed = time.perf_counter()
        tasks = plan_tasks(
            wave, proposals, self.store.layout, store=self.store.path, fingerprint=self.store.fingerprint
        )
        flight = Flight(wave=wave, proposals=proposals, tasks=tasks, propose_s=proposed - began)
        self._recover(flight)
        self.spent.propose += proposed - began - (self._took.waited_s - waited)
        self.spent.dispatch += time.perf_counter() - proposed
        return flight

    def _ask(self, wave: Wave, seen: Sequence[Observation], pending: Sequence[Waveform]) -> Sequence[Proposal]:
        """The proposals of a wave. What is no failure of the engine's own is the machine's fault, and stops the run."""
        try:
            proposals = self._proposer.propose(wave, seen, pending)
        except EngineError:
            raise
        except PriorError as e:
            raise e.__cause__ if isinstance(e.__cause__, Stopped) else Stopped(str(e)) from e
        except Exception as e:
            raise Stopped(f"wave {wave.index} could not be proposed ({type(e).__name__}: {e})") from e
        if all(p.origin == FALLBACK for p in proposals):
            earlier = itertools.takewhile(lambda o: o.origin == FALLBACK, reversed(seen))
            in_a_row = len(proposals) + sum(1 for _ in earlier)
            if in_a_row >= MOST_FALLBACKS:
                raise Stopped(
                    f"the engine failed {in_a_row} times in a row, at last: {proposals[-1].note}; mend it, or choose "
                    "another optimiser.engine"
                )
        return proposals

    def _recover(self, flight: Flight) -> None:
        """Take over the blocks that are stored under these very proposals."""
        stage, places = flight.wave.stage, list(flight.tasks)
        done = self.store.blocks_done(stage, places, [flight.tasks[p].proposals_digest for p in places])
        kept = [place for place, is_done in zip(places, done, strict=True) if is_done]
        if not kept:
            return
        markers = self.store.markers(stage, kept)
        for place in kept:
            stored = self.store.read_assessed(stage, *place, flight.wave.n_switches)
            result = recovered(stored, markers[place])
            if result is not None:
                flight.results[place] = result

    @property
    def n_proposed(self) -> int:
        """Waves that are proposed, committed or in flight."""
        return self.store.n_waves + len(self._flights)

    def n_told(self, candidate: int) -> int:
        """Switches of a candidate whose blocks are all stored, committed or not; 0 of another."""
        if 0 <= candidate < self.store.n_committed:
            return self._history[candidate].n_switches
        for flight in self._flights.values():
            if flight.wave.start <= candidate < flight.wave.stop:
                missing = any(task.first <= candidate < task.first + len(task.waveforms) for task in flight.missing)
                return 0 if missing else flight.wave.n_switches
        return 0

    @property
    def is_ready(self) -> bool:
        """True where every block of the next wave in order is stored: it only waits for its commit."""
        flight = self._flights.get(self.store.n_waves)
        return flight is not None and not flight.missing

    def advance(self) -> None:
        """Wait for blocks, then commit every wave that is next in order and complete."""
        if self._flights[self.store.n_waves].missing:
            self._collect()
        while (w := self.store.n_waves) in self._flights and not self._flights[w].missing:
            self._commit(w)

    def _collect(self) -> None:
        """Receive what has come back, waiting a little for the first of it."""
        began = time.perf_counter()
        event = self.executor.next_event(POLL_S)
        self.spent.wait += time.perf_counter() - began
        while event is not None:
            began = time.perf_counter()
            self._receive(event)
            self.spent.dispatch += time.perf_counter() - began
            event = self.executor.next_event(0.0) if self.executor.has_finished else None
        self._report()

    def _receive(self, event: Event) -> None:
        task, outcome = event
        if not isinstance(task, BlockTask):
            return  # asked for by a wave that was given up
        flight = next((f for f in self._flights.values() if f.tasks.get(task.place) is task), None)
        if flight is None:
            return
        if isinstance(outcome, BlockResult):
            try:
                flight.receive(task, outcome)
            except ValueError as e:
                outcome = e
            else:
                self._n_switches_done += outcome.status.size
                self.spent.simulate += outcome.simulate_s
                self.spent.store += outcome.store_s
                self.spent.write += outcome.write_s
                return
        assert isinstance(outcome, BaseException)
        self._retries.again(task, outcome)

    def _commit(self, w: int) -> None:
        """Assess the wave from what came back, and make it part of the campaign."""
        flight = self._flights[w]
        began = time.perf_counter()
        try:
            rows = flight.rows(self.config, self._controlling)
        except PriorError as e:
            raise Stopped(f"wave {w} could not be judged: {e}") from e
        assessed = time.perf_counter()
        try:
            self.store.commit(rows, flight.markers)
        except OSError as e:
            raise Stopped(f"wave {w} could not be committed: {e}") from e
        self.spent.assess += assessed - began
        self.spent.commit += time.perf_counter() - assessed
        del self._flights[w]  # committed, whatever follows: a bench goes on after it has been told why it stopped
        start = flight.wave.start
        self._observe([records.observation(start + i, w, row, self._asked) for i, row in enumerate(rows)])
        if len(self._history) >= min(MOST_FAILED, self.config.total_budget) and not math.isfinite(self._best[1]):
            reason = next((row["failure"] for row in rows if row.get("failure")), "no switch was assessed")
            raise Stopped(
                f"none of {len(self._history)} candidates could be assessed ({reason}): mend the device model, then "
                f"`softclose resume {self.store.path} --retry-failed`"
            )
        self._report()

    def _observe(self, observations: Sequence[Observation]) -> None:
        self._history += observations
        for o in observations:
            if o.usable and (o.n_switches, -o.rank_cm_s) > (self._best[0], -self._best[1]):
                self._best = (o.n_switches, o.rank_cm_s, o.g_cm_s)

    def _report_prior(self, found: Found) -> None:
        """Before the first candidate: how far the descents on the prior have come."""
        if self.listener is not None:
            self.listener(
                Progress(
                    committed=0,
                    simulated=found.tried,
                    budget=self.config.prior.budget + self.config.prior.polish,
                    stage="prior",
                    best_g_cm_s=found.best_g_cm_s,
                    n_switches_done=found.n_switches,
                    n_workers=self.executor.n_workers,
                    n_retries=self.executor.n_retries,
                )
            )

    def _report(self) -> None:
        if self.listener is None:
            return
        flying = [self._flights[w] for w in sorted(self._flights)]
        done = sum(f.wave.size * len(f.results) // max(len(f.tasks), 1) for f in flying)
        at = min(self.store.n_waves, len(self.waves) - 1)
        self.listener(
            Progress(
                committed=len(self._history),
                simulated=len(self._history) + done,
                budget=self.config.total_budget,
                stage=self.waves[at].stage,
                best_g_cm_s=self._best[2],
                n_switches_done=self._n_switches_done,
                n_workers=self.executor.n_workers,
                n_retries=self.executor.n_retries,
            )
        )
