"""Owns basins: the best records that are far apart, as far as the records tell."""

from __future__ import annotations

import heapq
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from softclose.propose.known import remembered
from softclose.propose.protocol import Observation, Problem

MOST_RANKED = 500
"""Records among which basins are looked for, best first: what is far down the ranking is no basin worth a look."""


def distinct_basins(problem: Problem, records: Sequence[Observation], n: int, distance: float) -> list[Observation]:
    """The best n records that are points of the space, each farther than `distance` (largest coordinate) from every
    better one."""
    key = "basins", n, distance
    return list(remembered(problem, key, records, lambda asked: _distinct(problem, asked, n, distance)))


def _distinct(problem: Problem, records: Sequence[Observation], n: int, distance: float) -> list[Observation]:
    ranked = heapq.nsmallest(MOST_RANKED, (o for o in records if o.usable), key=lambda o: (o.rank_cm_s, o.index))
    coordinates, places = problem.space.coordinates_of_all([o.waveform for o in ranked])
    points = np.clip(coordinates, 0.0, 1.0)
    chosen: list[int] = []
    far: NDArray[np.bool_] = np.ones(len(points), dtype=np.bool_)
    while len(chosen) < n and far.any():
        first = int(np.argmax(far))
        chosen.append(int(places[first]))
        far &= np.abs(points - points[first]).max(axis=1) > distance
    return [ranked[place] for place in chosen]
