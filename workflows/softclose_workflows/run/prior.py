"""Owns the prior of a campaign at work: evaluated by the executor, its basins kept in the store before wave 0.

Both are pure functions of the configuration: how waveforms are dealt to workers shows nowhere.
"""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softclose.propose.prior import Prior, prior_config
from softclose.propose.prior_basins import find_basins
from softclose.propose.promises import Ask, Basins, PriorError, PriorValues
from softclose.propose.protocol import Problem
from softclose.propose.stretches import Asking, Generation, Stretch, run_stretch
from softclose.settings import CampaignConfig
from softclose.waveform import Waveform
from softclose_store import DamageError, GroupArray, StoreMissingError, faults, open_campaign, read_group, write_group
from softclose_workflows.errors import Stopped
from softclose_workflows.run.executors.protocol import Executor
from softclose_workflows.run.faults import Retries
from softclose_workflows.run.records import padded_rows, unpadded
from softclose_workflows.run.stopping import StopRequest
from softclose_workflows.run.tasks import Rows, rows_of

GROUP = "prior/basins"
"""Group of the store that holds the basins of the prior."""

LEAST_IN_A_TASK = 8_192
"""Trajectories of one task at least: on a local cluster a task takes 7 to 20 ms of processor time, most of it the
driver's, so many trajectories some 30."""

POLL_S = 0.5
"""How often a wait for the prior looks up: for lost workers, for a stop request [s]."""


@dataclass(frozen=True, slots=True)
class PriorAnswer:
    """What comes back of a task."""

    answer: Any
    """PriorValues of waveforms, a list of Generation of a stretch."""
    took_s: float
    """Time of the worker [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PriorTask:
    """Waveforms for one worker to evaluate on the prior; nothing of it is stored."""

    store: str
    """Path or URL of the campaign's store."""
    fingerprint: str
    """The campaign that the store has to hold."""
    first: int
    """Place of its first waveform among those that were asked for together."""
    waveforms: tuple[Rows, ...]
    n_switches: int | None
    """The first of the prior's switches, None: all."""

    @property
    def name(self) -> str:
        """For messages."""
        return f"{len(self.waveforms)} waveforms on the prior"

    @property
    def key(self) -> str:
        """For the scheduler."""
        return f"prior-{self.first}"

    def run(self) -> PriorAnswer:
        """Evaluate them, in whichever process."""
        began = time.perf_counter()
        waveforms = [Waveform.from_rows(rows) for rows in self.waveforms]
        values = _prior_of(self.store, self.fingerprint).values(waveforms, self.n_switches)
        return PriorAnswer(values, time.perf_counter() - began)


@dataclass(frozen=True, slots=True, kw_only=True)
class StretchTask:
    """A descent on the prior for one worker to run on; nothing of it is stored."""

    store: str
    """Path or URL of the campaign's store."""
    fingerprint: str
    """The campaign that the store has to hold."""
    stretch: Stretch
    first: int = 0
    """The only task of its question."""

    @property
    def name(self) -> str:
        """For messages."""
        return f"{self.stretch.n_generations} generations of a descent on the prior"

    @property
    def key(self) -> str:
        """For the scheduler."""
        descent = self.stretch.descent
        return f"{descent.beginning.stream}-{descent.beginning.who}-{len(descent.told)}"

    def run(self) -> PriorAnswer:
        """Run it on, in whichever process: one that had the stretch before goes on from there."""
        began = time.perf_counter()
        prior = _prior_of(self.store, self.fingerprint)
        run = run_stretch(_descents_of(self.store, self.fingerprint), prior.values, self.stretch)
        return PriorAnswer(run, time.perf_counter() - began)


@lru_cache(maxsize=2)
def _descents_of(store: str, fingerprint: str) -> Problem:
    from softclose_workflows.run.tasks import campaign_of

    return Problem(prior_config(campaign_of(store, fingerprint)[0]))


@lru_cache(maxsize=2)
def _prior_of(store: str, fingerprint: str) -> Prior:
    from softclose_workflows.run.tasks import campaign_of

    return Prior.of(campaign_of(store, fingerprint)[0])


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """How far the descents on the prior have come."""

    tried: int = 0
    """Waveforms."""
    n_switches: int = 0
    """Switches under them, all together."""
    best_g_cm_s: float = math.inf
    """Least g on the prior so far [cm/s]."""

    def after(self, g_cm_s: NDArray[np.float64], n_switches: int) -> Found:
        """The same with more waveforms, on so many switches each."""
        return Found(
            tried=self.tried + len(g_cm_s),
            n_switches=self.n_switches + len(g_cm_s) * n_switches,
            best_g_cm_s=min(self.best_g_cm_s, float(np.min(g_cm_s[np.isfinite(g_cm_s)], initial=math.inf))),
        )


@dataclass(slots=True)
class Took:
    """What the prior has taken so far."""

    worked_s: float = 0.0
    """Time of workers [s]."""
    waited_s: float = 0.0
    """Time that this process waited [s]; where there is no other it works meanwhile."""


@dataclass(slots=True, eq=False)
class PriorQuestion:
    """What workers evaluate: waveforms, or a stretch of a descent."""

    n_switches: int
    """Of the prior, under each waveform."""
    tasks: Sequence[PriorTask | StretchTask]
    retries: Retries
    found: dict[int, Any] = field(default_factory=dict)
    """What has come back, by `first` of its task."""

    @property
    def values(self) -> PriorValues:
        """Of waveforms: the whole answer, once all of it has come back."""
        parts = [self.found[first] for first in sorted(self.found)]
        return PriorValues(
            g_cm_s=np.concatenate([part.g_cm_s for part in parts]) if parts else np.empty(0),
            failure=next((part.failure for part in parts if part.failure), ""),
        )


@dataclass(slots=True, eq=False)
class PriorAtWork:
    """What `Problem` asks of a prior, by a campaign's own executor and store."""

    store: str
    config: CampaignConfig
    fingerprint: str
    executor: Executor
    stop: StopRequest
    receive: Callable[[tuple[Any, Any]], None]
    """Takes what comes back meanwhile: the blocks of waves that are in flight."""
    told: Callable[[Found], None]
    """PriorAnswer after every wave of the descents on the prior."""
    is_busy: Callable[[], bool]
    """Whether every worker has a block to compute: what was asked for now would wait behind it."""
    took: Took = field(default_factory=Took)
    _here: PriorOfStore | None = None
    _finding: Found | None = None
    _asked: dict[int, PriorQuestion] = field(default_factory=dict)
    """Questions whose answer is not waited for yet, by the identity of each task."""

    def basins(self) -> Basins:
        """As stored, or else found and stored, before anything of the campaign is."""
        self._finding = Found()
        try:
            return _stored_or_found(self.store, self.config, self, keeps=True)
        finally:
            self._finding = None
            self._asked.clear()

    def values(self, waveforms: Sequence[Waveform], n_switches: int | None = None) -> PriorValues:
        """The prior's g of each waveform, evaluated by whoever is free: by this process while every worker is busy."""
        if self._finding is None and self.is_busy():
            if self._here is None:
                self._here = PriorOfStore(self.store, self.config)
            return self._here.values(waveforms, n_switches)
        question = self.begin(waveforms, n_switches)
        try:
            return self.wait(question)
        finally:
            self._asked.clear()

    def begin(self, waveforms: Sequence[Waveform], n_switches: int | None = None, *, beside: int = 1) -> PriorQuestion:
        """Send waveforms to the workers; `beside` questions as large are under way together."""
        each_of = self.config.prior.n_switches if n_switches is None else n_switches
        n, n_workers = len(waveforms), max(self.executor.n_workers, 1)
        largest = max(math.ceil(n * beside / (2 * n_workers)), math.ceil(LEAST_IN_A_TASK / each_of))
        n_tasks = math.ceil(n / largest)
        if n_tasks > n_workers:  # as many for each: who has one more keeps the others waiting
            n_tasks -= n_tasks % n_workers
        ends = [round(n * k / n_tasks) for k in range(n_tasks + 1)] if n else []
        return self._begin(
            each_of,
            [
                PriorTask(
                    store=self.store,
                    fingerprint=self.fingerprint,
                    first=first,
                    waveforms=tuple(rows_of(w) for w in waveforms[first:end]),
                    n_switches=n_switches,
                )
                for first, end in itertools.pairwise(ends)
            ],
        )

    def begin_stretch(self, stretch: Stretch) -> PriorQuestion:
        """Have a worker run a descent on."""
        task = StretchTask(store=self.store, fingerprint=self.fingerprint, stretch=stretch)
        return self._begin(stretch.n_switches, [task])

    def _begin(self, n_switches: int, tasks: Sequence[PriorTask | StretchTask]) -> PriorQuestion:
        if self._finding is not None:
            faults.point("finding-basins")
        question = PriorQuestion(n_switches, tasks, Retries(self.executor.submit))
        for task in tasks:
            self._asked[id(task)] = question
            self.executor.submit(task)
        return question

    @property
    def n_elsewhere(self) -> int:
        """Workers."""
        return self.executor.n_workers

    def wait(self, question: PriorQuestion) -> PriorValues:
        """The answer to a question; what comes of others meanwhile is kept for them."""
        self._complete(question)
        values = question.values
        self._tell(values, question)
        return values

    def wait_stretch(self, question: PriorQuestion) -> list[Generation]:
        """The generations of a stretch; what comes of other questions meanwhile is kept for them."""
        self._complete(question)
        run: list[Generation] = question.found[0]
        for generation in run:
            self._tell(generation.values, question)
        return run

    def _tell(self, values: PriorValues, question: PriorQuestion) -> None:
        if self._finding is not None:
            self._finding = self._finding.after(values.g_cm_s, question.n_switches)
            self.told(self._finding)

    def _complete(self, question: PriorQuestion) -> None:
        """Wait until all of an answer has come back."""
        while len(question.found) < len(question.tasks):
            began = time.perf_counter()
            event = self.executor.next_event(POLL_S)
            self.took.waited_s += time.perf_counter() - began
            if self._finding is not None and self.stop:
                raise PriorError from Stopped(
                    f"{self.stop.signal_name} received while the prior's basins were being found: nothing is committed "
                    "yet, and `softclose resume` finds them again"
                )
            if event is None:
                continue
            done, outcome = event
            if not isinstance(done, PriorTask | StretchTask):
                self.receive(event)
                continue
            owner = self._asked.get(id(done))
            if owner is None or not any(done is own for own in owner.tasks):
                continue  # of a proposal that was given up
            if isinstance(outcome, PriorAnswer):
                owner.found[done.first] = outcome.answer
                self.took.worked_s += outcome.took_s
                continue
            assert isinstance(outcome, BaseException)
            try:
                owner.retries.again(done, outcome)
            except Stopped as e:
                raise PriorError from e
        for task in question.tasks:
            self._asked.pop(id(task), None)


@dataclass(slots=True, eq=False)
class PriorOfStore:
    """What `Problem` asks of a prior, where a store holds its basins and this process evaluates."""

    store: str
    config: CampaignConfig
    keeps: bool = False
    """Whether basins that are damaged or missing are stored once they are found again."""
    _prior: Prior | None = None

    def basins(self) -> Basins:
        """As stored; found again where they are damaged or missing."""
        return _stored_or_found(self.store, self.config, self.values, keeps=self.keeps)

    def values(self, waveforms: Sequence[Waveform], n_switches: int | None = None) -> PriorValues:
        """The prior's g of each waveform."""
        if self._prior is None:
            self._prior = Prior.of(self.config)
        return self._prior.values(waveforms, n_switches)


def _stored_or_found(path: str, config: CampaignConfig, ask: Ask | Asking, *, keeps: bool) -> Basins:
    try:
        stored = read_basins(path)
    except DamageError:  # a pure function of the configuration: it comes out the same again
        stored = None
    if stored is not None:
        return stored
    found = find_basins(config, ask)
    if keeps:
        write_basins(path, found)
    return found


def write_basins(path: str, found: Basins) -> None:
    """Put the basins into the store, as a whole or not at all."""
    faults.point("before-basins")
    n, d = found.shapes.shape[:2]
    waveforms = padded_rows(found.waveforms) if n else np.empty((0, 1, 4))
    write_group(
        path,
        GROUP,
        {
            "basin_waveform": GroupArray(
                dims=("basin", "pulse", "parameter"),
                values=waveforms,
                unit="µs or V",
                long_name="start, rise, peak, volts of the best waveform of each basin on the prior",
            ),
            "promised_g": GroupArray(
                dims=("basin",), values=found.g_cm_s, unit="cm/s", long_name="objective of it on the prior's switches"
            ),
            "basin_shape": GroupArray(
                dims=("basin", "coordinate", "direction"),
                values=found.shapes,
                long_name="lower factor of the covariance of the steps that found it, scaled to determinant 1",
            ),
        },
        {"n_tried": found.n_tried, "failure": found.failure, "n_coordinates": d},
        replace=True,
    )
    faults.point("after-basins")


def read_basins(path: str) -> Basins | None:
    """The stored basins; None where there are none. Raises DamageError."""
    try:
        group = read_group(path, GROUP)
    except StoreMissingError:
        return None
    try:
        arrays, said = group.arrays, group.attributes
        return Basins(
            waveforms=tuple(unpadded(rows) for rows in arrays["basin_waveform"]),
            g_cm_s=arrays["promised_g"],
            shapes=arrays["basin_shape"],
            n_tried=int(said["n_tried"]),
            failure=str(said["failure"]),
        )
    except (KeyError, IndexError, TypeError, ValueError) as e:
        raise DamageError(
            f"group {GROUP} of {path} holds no basins ({type(e).__name__}: {e}): run `softclose verify {path} --repair`"
        ) from e


def basins_again(path: str) -> str:
    """Find the basins of a store's campaign again, and store them. Returns why not; empty where it is done."""
    config = CampaignConfig.from_dict(open_campaign(path).config)
    if not config.has_prior:
        return f"{GROUP} of {path} belongs to no prior that this campaign has: delete that group"
    write_basins(path, find_basins(config, PriorOfStore(path, config).values))
    return ""
