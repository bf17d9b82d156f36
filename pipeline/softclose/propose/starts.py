"""Owns the trust regions of a process without a prior: one around each of the best points of its design.

They share the first quarter of the candidates in rounds, after each of which the better half goes on; the last one has
the rest. A single region ends where its start leads, and some lead nowhere: of nine seeds three were lost (ADR 131).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from softclose.propose.protocol import Problem
from softclose.propose.regions import Rounds, halved, nearest, shares
from softclose.propose.trust_region import TrustRegion, TrustRegionRules, replay
from softclose.waveform import Waveform

if TYPE_CHECKING:
    from softclose.propose.surrogate import SurrogateData

APART = 0.1
"""Two starts differ by more than this in a coordinate."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Starts:
    """Whose the candidates of one wave are."""

    dealt: Counter[int]
    """Candidates of each region, by its number."""
    regions: dict[int, TrustRegion]
    """State of each of these; `incumbent` and `begin` are positions among all that is known."""

    @property
    def first(self) -> int:
        """Number of the region with the best start, of those that have a candidate."""
        return min(self.dealt)


def rounds_of(problem: Problem, n_starts: int) -> Rounds:
    """Regions of each round, and the index at which each ends: halving has a quarter of what follows the design."""
    first, budget = problem.config.optimiser.n_initial, problem.config.campaign.budget
    counts = halved(n_starts)
    halvings = len(counts) - 1
    ends = [first + round((budget - first) * (k + 1) / (4 * halvings)) for k in range(halvings)]
    return Rounds(counts=tuple(counts), ends=(*ends, budget))


def starts_of(
    problem: Problem,
    data: SurrogateData,
    rules: TrustRegionRules,
    *,
    start: int,
    size: int,
    pending: Sequence[Waveform],
) -> Starts:
    """The regions that have the candidates from `start` on, each with its share and its state after the records.

    data: at least one record; pending: what is proposed and not known.
    """
    settings = problem.config.optimiser
    begun = _begun(data, settings.n_initial, settings.n_starts)
    numbers = _numbers(data, begun, settings.n_initial)
    counted = np.flatnonzero(numbers >= 0)
    rounds = rounds_of(problem, len(begun))
    flying = np.clip(problem.space.coordinates_of_all(pending)[0], 0.0, 1.0)
    dealt = shares(
        rounds,
        start=start,
        size=size,
        numbers=numbers[counted].tolist(),
        g=data.g[counted],
        indices=data.indices[counted].tolist(),
        in_flight=[int(numbers[counted[nearest(data.points[counted], x)]]) for x in flying],
    )
    if len(begun) > 1:
        rules = replace(rules, fresh_before=0)  # they have looked elsewhere
    return Starts(dealt=dealt, regions={n: _state(data, numbers, n, rules) for n in dealt})


def _begun(data: SurrogateData, n_initial: int, n_starts: int) -> list[int]:
    """Positions of the best records of the design that are apart from each other; of all where it has no usable one."""
    design = np.flatnonzero(data.indices < n_initial)
    if not len(design):
        design = np.arange(len(data.g))
    found: list[int] = []
    for i in design[np.argsort(data.g[design], kind="stable")].tolist():
        if len(found) < n_starts and all(np.abs(data.points[i] - data.points[k]).max() > APART for k in found):
            found.append(i)
    return found


def _numbers(data: SurrogateData, begun: list[int], n_initial: int) -> NDArray[np.int64]:
    """(n,) number of the region of each record: what no region asked for belongs to the nearest start, and no other
    point of the design than the starts to any (-1)."""
    found = np.full(len(data.g), -1)
    found[begun] = np.arange(len(begun))
    for i in np.flatnonzero((found < 0) & (data.indices >= n_initial)):
        asked = data.regions[i]
        found[i] = int(asked) if np.isfinite(asked) else nearest(data.points[begun], data.points[i])
    return found


def _state(data: SurrogateData, numbers: NDArray[np.int64], number: int, rules: TrustRegionRules) -> TrustRegion:
    own = np.flatnonzero(numbers == number).tolist()
    found = replay(data.g[own].tolist(), [data.origins[i] for i in own], rules, [data.waves[i] for i in own])
    return replace(
        found,
        incumbent=None if found.incumbent is None else own[found.incumbent],
        begin=own[found.begin - 1] + 1 if found.begin else 0,
    )
