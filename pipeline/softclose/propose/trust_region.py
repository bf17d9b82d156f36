"""Owns the trust region: a box around the best candidate whose size is replayed from the recorded candidates alone.

After TuRBO (Eriksson et al. 2019): doubled after a run of successes, halved after a run of failures, restarted when
it has shrunk to nothing. Nothing is remembered between proposals: `replay` reads the records and their origins.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from softclose.arrays import FloatArray
from softclose.propose.origins import LOCAL


@dataclass(frozen=True, slots=True, kw_only=True)
class TrustRegionRules:
    """How the box grows and shrinks. Lengths are full widths, in units of the cube."""

    initial: float
    smallest: float
    largest: float
    successes: int
    """Successful waves in a row before the box doubles."""
    failures: int
    """Candidates of failed waves in a row before it halves."""
    fresh_every: int = 1
    """Every so many restarts begin elsewhere; the others open the box again around the best record of all."""
    fresh_before: int | None = None
    """Number of records from which no restart begins elsewhere, since too few would remain; None: all may."""
    improvement_cm_s: float
    """A decrease of g by more than this counts as a success."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrustRegion:
    """The state after a history."""

    length: float
    """Width of the box before the weights of the axes."""
    incumbent: int | None
    """Position in the history of the best record of this restart, or of all where it opened around that one; None
    where there is none."""
    begin: int
    """Position in the history at which the last restart elsewhere began."""
    restarts: int
    """Restarts so far."""

    def box(self, centre: FloatArray, length_scales: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Lower and upper corner (d,), the widths weighted by the length scales (geometric mean 1), within the cube."""
        weights = length_scales / np.exp(np.mean(np.log(length_scales)))
        half = 0.5 * self.length * weights
        return np.clip(centre - half, 0.0, 1.0), np.clip(centre + half, 0.0, 1.0)


def replay(
    g: Sequence[float], origins: Sequence[str], rules: TrustRegionRules, waves: Sequence[int] | None = None
) -> TrustRegion:
    """The trust region after the records (g [cm/s], NaN where failed; origin; wave), in their order.

    A wave succeeds where one of its candidates does: the others were there to look elsewhere. waves: by default every
    record is one of its own.
    """
    length, successes, failures, begin, restarts = rules.initial, 0, 0, 0, 0
    incumbent: int | None = None
    best = np.inf
    numbers = range(len(g)) if waves is None else waves
    for _, grouped in groupby(range(len(g)), key=lambda i: numbers[i]):
        wave = list(grouped)
        before = best
        for i in wave:
            if np.isfinite(g[i]) and g[i] < best:
                best, incumbent = g[i], i
        n_local = sum(origins[i] == LOCAL for i in wave)
        if not n_local:
            continue
        better = best < before - rules.improvement_cm_s
        successes, failures = (successes + 1, 0) if better else (0, failures + n_local)
        if successes >= rules.successes:
            length, successes = min(2.0 * length, rules.largest), 0
        elif failures >= rules.failures:
            length, failures = 0.5 * length, 0
        if length < rules.smallest:
            length, successes, failures = rules.initial, 0, 0
            restarts += 1
            seen = wave[-1] + 1
            finite = [(v, j) for j, v in enumerate(g[:seen]) if np.isfinite(v)]
            room = rules.fresh_before is None or seen < rules.fresh_before
            if not finite or (room and restarts % rules.fresh_every == 0):
                begin, best, incumbent = seen, np.inf, None
            else:
                best, incumbent = min(finite)
    return TrustRegion(length=length, incumbent=incumbent, begin=begin, restarts=restarts)
