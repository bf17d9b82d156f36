"""Owns how a question is cut into pieces that any process can answer, and the answers put together again.

Pieces follow from the question alone, never from who answers them: an analysis hands them to a mapper, which is the
built-in `map` or a cluster of any size, and gets the answers back in their order.
"""

from __future__ import annotations

import functools
import pickle
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Protocol, TypeVar

import numpy as np

from softclose.device.cost import LARGE_PIECE_S, rows_a_piece
from softclose.evaluate.chain import seconds_a_switch
from softclose.evaluate.respond import respond
from softclose.metrics.objective import Judged
from softclose.population.lot import Lot
from softclose.settings import CampaignConfig
from softclose.waveform import Drive

Piece = TypeVar("Piece")
Answer = TypeVar("Answer")


class Mapper(Protocol):
    """Whoever answers pieces: functions of a module, and pieces that can be pickled."""

    def __call__(self, function: Callable[[Piece], Answer], pieces: Iterable[Piece], /) -> Iterator[Answer]:
        """The answers, in the order of the pieces."""
        ...


def here(function: Callable[[Piece], Answer], pieces: Iterable[Piece], /) -> Iterator[Answer]:
    """The mapper that answers one piece after the other, in this process."""
    return map(function, pieces)


class Sent:
    """A configuration on its way to other processes: each makes one object of it, however many pieces come with it.

    What a configuration stands for (its lot, its conditions) is kept by the object (`chain_of`), and building it anew
    for every piece would cost more than many a piece.
    """

    __slots__ = ("_raw", "config")

    def __init__(self, config: CampaignConfig) -> None:
        self.config = config
        self._raw = b""

    def __reduce__(self) -> tuple[Any, ...]:
        if not self._raw:
            self._raw = pickle.dumps(self.config)
        return _received, (self._raw,)


@functools.lru_cache(maxsize=64)
def _received(raw: bytes) -> Sent:
    return Sent(pickle.loads(raw))


@dataclass(frozen=True, slots=True, kw_only=True)
class Work:
    """A lot under a drive."""

    sent: Sent
    lot: Lot
    drive: Drive
    for_everybody: bool = False
    """See `respond`."""


MANY = 128
"""Pieces that keep enough workers busy."""


def rows_of_pieces(config: CampaignConfig, n: int, *, n_waveforms: int = 1) -> list[range]:
    """The rows of each piece of n switches, by what the device model says that a trajectory costs: larger ones where
    there are `MANY` all the same."""
    seconds = seconds_a_switch(config)
    least = rows_a_piece(seconds, n_waveforms=n_waveforms)
    most = max(least, min(n // MANY, rows_a_piece(seconds, n_waveforms=n_waveforms, piece_s=LARGE_PIECE_S)))
    return [range(start, min(start + most, n)) for start in range(0, n, most)]


def judged_rows(work: Work) -> Judged:
    """What is judged of a lot under a drive."""
    return light(respond(work.sent.config, work.lot, work.drive, for_everybody=work.for_everybody))


def light(found: Any) -> Judged:
    """The least that is judged of responses."""
    return Judged(
        max_contact_speed=np.asarray(found.max_contact_speed, dtype=np.float64),
        closed=np.asarray(found.closed, dtype=np.bool_),
        status=np.asarray(found.status, dtype=np.int8),
        settling_us=np.asarray(found.settling_us, dtype=np.float64),
        asked=found.asked,
        first_contact_us=np.asarray(found.first_contact_us, dtype=np.float64),
        n_impacts=np.asarray(found.n_impacts, dtype=np.int32),
    )


def respond_to_all(works: Sequence[Work], mapper: Mapper = here) -> Iterator[Judged]:
    """What is judged of each lot under its drive, all of their pieces in one go.

    As `respond` of each, whatever the pieces: a row of a device model depends on no other row.
    """
    cuts = [rows_of_pieces(work.sent.config, len(work.lot)) for work in works]
    answers = mapper(
        judged_rows,
        (
            replace(work, lot=work.lot.rows(slice(rows.start, rows.stop)))
            for work, cut in zip(works, cuts, strict=True)
            for rows in cut
        ),
    )
    for cut in cuts:
        yield joined_judged([next(answers) for _ in cut])


def joined_judged(parts: Sequence[Judged]) -> Judged:
    """What is judged of several lots, one after the other."""
    joined: dict[str, Any] = {}
    for field in fields(Judged):
        own = [getattr(part, field.name) for part in parts]
        joined[field.name] = None if any(values is None for values in own) else np.concatenate(own)
    return Judged(**joined)
