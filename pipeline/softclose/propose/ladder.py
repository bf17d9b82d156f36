"""Owns successive halving: which descents get which candidates of a stage, wave by wave.

Descents are dealt to sets that take turns: while the wave of one set is simulated, that of another is proposed. Rounds
have equal shares of the budget, and after each the better half of every set goes on. The sizes follow from the
configuration; who goes on follows from records that every wave of the round can see, those of its own set.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from softclose.arrays import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """One wave of a stage that is made of descents."""

    turn: int
    """Set whose turn it is."""
    round: int
    """Round of halving; -1 for scouts."""
    start: int
    """Place of its first candidate in the stage."""
    size: int
    """Candidates."""
    n_descents: int
    """Descents that share them."""
    before: int
    """The latest step of the same set; -1 where it is the first."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Ladder:
    """The steps of a stage."""

    n_descents: int
    generation: int
    """Candidates of one descent in one wave."""
    n_scouts: int
    """Candidates from which a descent takes its start."""
    turns: int
    """Sets of descents."""
    goes_on: bool
    """True where descent 0 goes on from an earlier stage: it has no scouts."""
    steps: tuple[Step, ...]

    def members(self, turn: int) -> list[int]:
        """The descents of a set, at the start."""
        return list(range(turn, self.n_descents, self.turns))

    def scouted(self, turn: int) -> list[int]:
        """Those of them that have scouts."""
        return [who for who in self.members(turn) if not (self.goes_on and who == 0)]

    def is_whole(self, number: int) -> bool:
        """Whether a step has a whole generation of each of its descents."""
        step = self.steps[number]
        return step.round >= 0 and step.size == step.n_descents * self.generation

    def n_alike(self, number: int) -> int:
        """Steps behind a whole one that the same descents share, all whole."""
        step = self.steps[number]
        rest = itertools.takewhile(lambda s: (s.round, s.size) == (step.round, step.size), self.steps[number + 1 :])
        return sum(1 for _ in rest)

    def step_at(self, place: int) -> int:
        """Number of the step that holds the candidate at `place` of the stage."""
        return int(np.searchsorted([s.start for s in self.steps], place, side="right")) - 1


@dataclass(slots=True)
class Course:
    """What one descent has been told."""

    scouts: FloatArray = field(default_factory=lambda: np.zeros(0))
    """g of its scouts [cm/s]."""
    told: list[FloatArray] = field(default_factory=list)
    """g of each of its generations [cm/s]."""

    @property
    def best(self) -> float:
        """Least g so far; inf before the first."""
        return float(min((values.min() for values in (self.scouts, *self.told) if len(values)), default=np.inf))


def build_ladder(
    budget: int, *, n_descents: int, generation: int, n_scouts: int, rounds: int, turns: int, goes_on: bool = False
) -> Ladder:
    """The steps that spend `budget` candidates: scouts of every set, then generations in at most `rounds` rounds."""
    turns = min(turns, n_descents)
    ladder = Ladder(
        n_descents=n_descents, generation=generation, n_scouts=n_scouts, turns=turns, goes_on=goes_on, steps=()
    )
    sets = [len(ladder.members(turn)) for turn in range(turns)]
    counts = [sets]
    while len(counts) < rounds and max(counts[-1]) > 1:
        counts.append([max(n // 2, 1) for n in counts[-1]])
    scouts = [n_scouts * len(ladder.scouted(turn)) for turn in range(turns)]
    share = max(budget - sum(scouts), 0) / len(counts)
    lengths = [max(round(share / (generation * sum(n))), 1) for n in counts]

    waves: list[list[tuple[int, int, int]]] = []  # per set: (round, descents, size), the last round without end
    for turn in range(turns):
        first = [(-1, len(ladder.scouted(turn)), scouts[turn])] if scouts[turn] else []
        rest = [
            (r, n[turn], n[turn] * generation)
            for r, (n, length) in enumerate(zip(counts, lengths, strict=True))
            for _ in range(length)
        ]
        waves.append(first + rest)
    steps: list[Step] = []
    latest = [-1] * turns
    spent, k = 0, 0
    while spent < budget:
        lap, turn = divmod(k, turns)
        number, n, size = waves[turn][min(lap, len(waves[turn]) - 1)]
        size = min(size, budget - spent)
        steps.append(Step(turn=turn, round=number, start=spent, size=size, n_descents=n, before=latest[turn]))
        latest[turn] = len(steps) - 1
        spent, k = spent + size, k + 1
    return Ladder(
        n_descents=n_descents,
        generation=generation,
        n_scouts=n_scouts,
        turns=turns,
        goes_on=goes_on,
        steps=tuple(steps),
    )


def courses(
    ladder: Ladder, turn: int, number: int, g: Sequence[float] | FloatArray
) -> tuple[dict[int, Course], list[int]]:
    """What the set `turn` knows before step `number`, and the descents that share that step, best first.

    g: of the stage's candidates from its first on, as far as they are known; unusable ones inf. A generation that the
    end of the budget cut off is left out.
    """
    known = {who: Course() for who in ladder.members(turn)}
    alive, latest = ladder.members(turn), 0
    for k, step in enumerate(ladder.steps[: number + 1]):
        if step.turn != turn:
            continue
        if step.round > latest:
            alive = sorted(alive, key=lambda who: (known[who].best, who))[: step.n_descents]
            latest = step.round
        scouting = step.round < 0
        sharing = ladder.scouted(turn) if scouting else alive
        if k == number:
            return known, sharing
        values = np.asarray(g[step.start : step.start + step.size], dtype=np.float64)
        each = ladder.n_scouts if scouting else ladder.generation
        for j, who in enumerate(sharing):
            part = values[j * each : (j + 1) * each]
            if scouting:
                known[who].scouts = part
            elif len(part) == each:
                known[who].told.append(part)
    return known, alive


def owner(ladder: Ladder, place: int, g: Sequence[float] | FloatArray) -> int:
    """The descent to which the candidate at `place` of the stage belongs."""
    number = ladder.step_at(place)
    step = ladder.steps[number]
    each = ladder.n_scouts if step.round < 0 else ladder.generation
    return courses(ladder, step.turn, number, g)[1][(place - step.start) // each]
