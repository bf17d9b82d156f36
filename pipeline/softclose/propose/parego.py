"""Owns the ParEGO engine: a front of several objectives by the Gaussian process, one weighting of them a candidate.

Knowles (2006): every candidate minimises an augmented Tchebycheff norm of the objectives, each between its least and
its worst so far, under weights of its own. The process and its acquisition are those of the skopt engine.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from softclose.arrays import FloatArray
from softclose.metrics.ranking import is_beyond
from softclose.propose.design import design_point
from softclose.propose.objectives import front_values, worst_values
from softclose.propose.origins import FALLBACK, PAREGO, SOBOL
from softclose.propose.protocol import Observation, Problem, Proposal, Wave, search_history
from softclose.propose.trust_region import TrustRegion
from softclose.waveform import Waveform

if TYPE_CHECKING:
    from softclose.propose.surrogate import SurrogateData


AUGMENTED = 0.05
"""Part of the sum in the norm: without it a point that is only not worse would do."""

LENGTHS = (0.05, 0.2, 0.8)
"""Widths of the box in which the acquisition is looked for, in turn: a front is finished and explored at once."""

SLICES = 16
"""Weights that candidates take in turn; with two objectives, evenly from the one to the other."""


class ParegoEngine:
    """The process on a weighting of the objectives, another one for each candidate."""

    def wave_sizes(self, problem: Problem, budget: int) -> list[int]:
        """All of the initial design, then batches."""
        settings = problem.config.optimiser
        first = min(max(settings.n_initial, problem.n_initial_waveforms), budget)
        return [first, *(min(settings.batch, budget - begin) for begin in range(first, budget, settings.batch))]

    def propose_wave(
        self, problem: Problem, wave: Wave, history: Sequence[Observation], pending: Sequence[Waveform]
    ) -> list[Proposal]:
        """The design first, then a candidate a weighting."""
        from softclose.propose.skopt_engine import acquire
        from softclose.propose.surrogate import collect  # imported where they are used: skopt is slow to import

        def proposals(points: FloatArray, origin: str, note: str = "") -> list[Proposal]:
            return [
                Proposal(waveform=w, origin=origin, n_switches=wave.n_switches, note=note)
                for w in problem.space.waveforms(points)
            ]

        def design() -> FloatArray:
            return np.array([design_point(problem, wave.start + k) for k in range(wave.size)])

        search = search_history(problem, history)
        data = collect(problem, search)
        if wave.start < problem.config.optimiser.n_initial:
            return proposals(design(), SOBOL)
        if len(data.g) < 2:
            return proposals(design(), FALLBACK, note="fewer than two usable candidates")
        by_index = {o.index: o for o in search}
        values = scaled_values(problem, [by_index[int(i)] for i in data.indices])
        draw = problem.generator("parego", wave.start)
        flying = list(pending)
        found: list[Proposal] = []
        for k in range(wave.size):
            number = wave.start + k
            norm = tchebycheff(values, weights(values.shape[1], number, draw))
            region = TrustRegion(
                length=LENGTHS[number // SLICES % len(LENGTHS)], incumbent=int(np.argmin(norm)), begin=0, restarts=0
            )
            try:
                points, _ = acquire(problem, _with_norm(data, norm), region, flying, 1, draw)
                found += proposals(points, PAREGO)
            except (np.linalg.LinAlgError, ValueError, FloatingPointError) as e:
                near = data.points[int(np.argmin(norm))] + 0.05 * draw.standard_normal((1, problem.space.dim))
                found += proposals(near, FALLBACK, note=f"surrogate failed ({type(e).__name__}: {e})"[:200])
            flying.append(found[-1].waveform)
        return found


def _with_norm(data: SurrogateData, norm: FloatArray) -> SurrogateData:
    return replace(data, g=norm)


def scaled_values(problem: Problem, records: Sequence[Observation]) -> FloatArray:
    """(n, k) objectives, 0 at the least and 1 at the median of what was found; beyond it their logarithm grows.

    An undefined one counts as the worst, and who leaves too many open is worse than that in all of them.
    """
    objectives = problem.config.optimiser.objectives
    values = front_values(problem.config, records, objectives)
    worst = worst_values(problem.config, objectives, values)
    values = np.where(np.isfinite(values), values, worst)
    top = np.maximum(worst, values.max(axis=0))
    values[is_beyond([o.rank_cm_s for o in records])] = top + np.abs(top)  # of what is better high all are negative
    least = values.min(axis=0)
    span = np.maximum(np.median(values, axis=0) - least, 1e-9)
    return np.asarray(np.log1p((values - least) / span) / np.log(2.0))


def weights(k: int, number: int, draw: np.random.Generator) -> FloatArray:
    """(k,) weights, adding up to 1: two objectives take `SLICES` of them in turn, more draw theirs."""
    if k == 2:
        first = (number * 7 % SLICES + 0.5) / SLICES
        return np.array([first, 1.0 - first])
    return np.asarray(draw.dirichlet(np.ones(k)))


def tchebycheff(values: FloatArray, weight: FloatArray) -> FloatArray:
    """(n,) the augmented norm of values (n, k)."""
    weighted = values * weight
    return np.asarray(weighted.max(axis=1) + AUGMENTED * weighted.sum(axis=1))
