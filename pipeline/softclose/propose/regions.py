"""Owns the trust regions of a search with a prior: one a basin, which candidates are whose, who goes on, how wide.

Everything is replayed from the records. Rounds have equal shares of the budget, and after each the better half of the
regions goes on, as with descents. A region widens where it succeeds and shrinks where it fails (after TuRBO, Eriksson
et al. 2019).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from softclose.arrays import FloatArray
from softclose.propose.origins import LOCAL
from softclose.propose.protocol import Problem
from softclose.propose.trust_region import TrustRegionRules, replay

REGION = "region"
"""Name under which a proposal says which region it is of."""

RULES = TrustRegionRules(
    initial=0.06, smallest=0.002, largest=0.4, successes=2, failures=6, fresh_before=0, improvement_cm_s=0.01
)
"""Of each region; a length is two standard deviations of the steps, along a shape of determinant 1."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Rounds:
    """How many regions share the candidates, round by round."""

    counts: tuple[int, ...]
    """Regions of each round."""
    ends: tuple[int, ...]
    """The index at which each ends."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Region:
    """One trust region after the records."""

    number: int
    """That of its basin."""
    incumbent: int
    """Place of its best record among those that are known."""
    length: float
    """Two standard deviations of its steps."""


def shares(
    rounds: Rounds,
    *,
    start: int,
    size: int,
    numbers: Sequence[int],
    g: FloatArray,
    indices: Sequence[int],
    in_flight: Sequence[int] = (),
) -> Counter[int]:
    """How many of the candidates from `start` on each region gets: those that have had fewest, the better ones first.

    numbers, g [cm/s], indices: region, objective and index of every record that is known; in_flight: the region of
    every candidate that is proposed and not known.
    """
    now = sum(start >= end for end in rounds.ends[:-1])
    begin = rounds.ends[now - 1] if now else 0
    best: dict[int, float] = {}
    had = Counter(in_flight)
    for number, value, index in zip(numbers, g, indices, strict=True):
        had[number] += 1
        if not now or index < begin or number not in best:
            best[number] = min(best.get(number, np.inf), float(value))
    alive = sorted(best, key=lambda number: (best[number], number))[: rounds.counts[now]]
    found: Counter[int] = Counter()
    for _ in range(size):
        found[min(alive, key=lambda number: (had[number] + found[number], best[number], number))] += 1
    return found


def rounds_of(problem: Problem) -> Rounds:
    """With a prior: rounds of equal budgets."""
    settings = problem.config.optimiser
    first = problem.n_initial_waveforms + settings.n_regions
    counts = halved(settings.n_regions)[: settings.rounds]
    rest = problem.config.campaign.budget - first
    ends = tuple(first + round(rest * (k + 1) / len(counts)) for k in range(len(counts)))
    return Rounds(counts=tuple(counts), ends=ends)


def halved(n: int) -> list[int]:
    """n, half of it, and so on to 1."""
    counts = [n]
    while counts[-1] > 1:
        counts.append(counts[-1] // 2)
    return counts


def nearest(points: FloatArray, x: FloatArray) -> int:
    """Place of the nearest of points (n, d) to a point (d,): whose region it is that nobody names."""
    return int(np.argmin(((points - x) ** 2).sum(axis=1)))


def region_of(number: int, *, numbers: Sequence[int], g: FloatArray, waves: Sequence[int]) -> Region:
    """The state of one region, which has a record."""
    own = [i for i, found in enumerate(numbers) if found == number]
    state = replay([float(g[i]) for i in own], [LOCAL] * len(own), RULES, [waves[i] for i in own])
    return Region(number=number, incumbent=min(own, key=lambda i: (g[i], i)), length=state.length)
