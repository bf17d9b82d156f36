"""Owns the mapper that analyses simulate by: their pieces become tasks of an executor, answers come back in order.

Where pieces run changes no bit of what comes back (`softclose.evaluate.pieces`).
"""

from __future__ import annotations

import contextlib
import functools
import itertools
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from softclose.device.protocol import is_own_word
from softclose.evaluate.pieces import Answer, Piece
from softclose_store import open_campaign
from softclose_workflows.errors import Stopped
from softclose_workflows.run.executors import Executor, Placement, open_executor
from softclose_workflows.run.executors.placement import n_cores
from softclose_workflows.run.faults import Retries
from softclose_workflows.run.stopping import StopRequest, stop_on_signals

POLL_S = 0.5
"""How often a crew looks up from waiting: for a stop request, for lost workers [s]."""

AHEAD_PER_WORKER, LEAST_AHEAD = 8, 64
"""Pieces that are sent, or answered, ahead of the one that is waited for: for each worker, and at least."""

_NUMBERS = itertools.count()


@dataclass(frozen=True, slots=True, eq=False)
class PieceTask:
    """One piece of a question."""

    function: Callable[[Any], Any]
    """Of a module: other processes import it."""
    piece: Any
    """What it is given."""
    number: int
    """Which task of this process."""

    @property
    def name(self) -> str:
        """For messages."""
        return f"piece {self.number} ({self.function.__name__.strip('_')})"

    @property
    def key(self) -> str:
        """What a scheduler calls it."""
        return f"piece-{self.number}"

    def run(self) -> Any:
        """Answer it."""
        return self.function(self.piece)


class Crew:
    """A mapper (`softclose.evaluate.pieces.Mapper`) on an executor.

    The executor is asked for with the first question: what is known already needs no cluster.
    """

    def __init__(self, executor: Callable[[], Executor], stop: StopRequest | None = None) -> None:
        self._opened = functools.cache(executor)
        self._stop = StopRequest() if stop is None else stop

    def __call__(self, function: Callable[[Piece], Answer], pieces: Iterable[Piece], /) -> Iterator[Answer]:
        """The answers, in the order of the pieces.

        Raises what the device model, or the science, says of a piece; Stopped for a fault of the machine that is met
        again elsewhere, and for a signal.
        """
        executor, waiting = self._opened(), (PieceTask(function, piece, next(_NUMBERS)) for piece in pieces)
        order: deque[int] = deque()
        left: dict[int, PieceTask] = {}
        came: dict[int, Answer] = {}
        retries = Retries(executor.submit)
        while True:
            room = max(LEAST_AHEAD, AHEAD_PER_WORKER * executor.n_workers) - len(order)
            for task in itertools.islice(waiting, room):
                order.append(task.number)
                left[task.number] = task
                executor.submit(task)
            if not order:
                return
            while order[0] in left:
                self._receive(left, came, retries)
            yield came.pop(order.popleft())

    def _receive(self, left: dict[int, PieceTask], came: dict[int, Any], retries: Retries) -> None:
        """Wait a little for what comes next. Answers to a question that was given up are thrown away."""
        if self._stop:
            raise Stopped(f"{self._stop.signal_name} received: what was being computed is not kept")
        event = self._opened().next_event(POLL_S)
        if event is None or left.get(number := getattr(event[0], "number", -1)) is not event[0]:
            return
        task, outcome = event
        if not isinstance(outcome, BaseException):
            came[number] = outcome
            del left[number]
            return
        if _is_an_answer(outcome):
            raise outcome
        retries.again(task, outcome)


def _is_an_answer(failure: BaseException) -> bool:
    """Whether a failure would come from any process: what this project itself raises of what it was asked."""
    ours = ("softclose", "softclose_store", "softclose_workflows")
    return is_own_word(failure) or type(failure).__module__.partition(".")[0] in ours


@contextlib.contextmanager
def open_crew(placement: Placement, *, threads: int | None = None, store: str = "") -> Iterator[Crew]:
    """A crew for the length of a `with` block: threads of this process, one per core, where nothing else is asked for.

    store: the campaign's, where pieces write into it (trajectories): then every worker has to reach it.
    Ctrl-C and SIGTERM end its work (Stopped). Raises ExecutorError where it cannot be started.
    """
    with stop_on_signals() as stop, contextlib.ExitStack() as stack:

        def opened() -> Executor:
            executor = stack.enter_context(open_executor(placement, threads=threads or n_cores()))
            executor.probe(store, open_campaign(store).fingerprint if store else "")
            return executor

        yield Crew(opened, stop)
