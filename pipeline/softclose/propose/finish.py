"""Owns the finishing stage: the best distinct basins again on a larger ensemble, then polished there.

An engine like any other: its candidates are the last `finish.budget` of a campaign, its state is read from the records.
What looked best on the search's ensemble flatters itself (by 0.5-1.1 cm/s at N = 200), so ranking starts again here.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from threadpoolctl import threadpool_limits

from softclose.propose.protocol import Observation, Problem, Proposal
from softclose.propose.replay import Answers, CmaStart, cma_points, next_point
from softclose.spaces import SpaceError
from softclose.waveform import Waveform

if TYPE_CHECKING:
    from softclose.config import FinishSection

FloatArray = NDArray[np.float64]

RERANK, POLISH, EXTRA = "finish-rerank", "finish-polish", "finish-extra"
"""Origins: a basin of the search again, a step of the polish, a point beside it while the polish waits."""


class FinishEngine:
    """Re-rank, then polish, by the method of `finish.method`."""

    def propose(
        self, problem: Problem, index: int, history: Sequence[Observation], pending: Sequence[Waveform]
    ) -> Proposal:
        """The next candidate of the finishing stage. Candidates of the search still in flight are not considered."""
        settings = problem.config.finish
        budget = problem.config.campaign.budget
        search = [o for o in history if o.index < budget]
        finished = [o for o in history if o.index >= budget]
        place = index - budget
        basins = distinct_basins(problem, search, settings.n_basins, settings.distance)
        if not basins:
            point = problem.space.canonical(problem.generator("finish", index).random(problem.space.dim))
            return _proposal(problem, problem.space.waveform(point), EXTRA, note="the search left nothing to finish")
        if place < len(basins):
            return _proposal(problem, basins[place], RERANK)
        with threadpool_limits(limits=1):
            return self._polish(problem, index, finished, pending, basins)

    def _polish(
        self,
        problem: Problem,
        index: int,
        finished: Sequence[Observation],
        pending: Sequence[Waveform],
        basins: Sequence[Waveform],
    ) -> Proposal:
        settings = problem.config.finish
        ranked = sorted((o for o in finished if o.usable and o.origin == RERANK), key=lambda o: (o.g_cm_s, o.index))
        best = [problem.space.unit(o.waveform, clip=True) for o in ranked]
        best = best or [problem.space.unit(basins[0], clip=True)]
        point: FloatArray | None = None
        centre = best[0]
        if settings.method == "surrogate":
            from softclose.propose.skopt_engine import polish  # imported where it is used: skopt is slow to import

            point = polish(problem, index, finished, pending)
        else:
            answers = Answers(problem.space, finished)
            for start in best:
                if settings.method == "cmaes":
                    run = CmaStart(point=start, sigma=settings.sigma, population=0)
                    rng = problem.generator("finish", _key(start))
                    point, centre = cma_points(run, answers, pending, problem.space, rng)
                else:
                    point = next_point(partial(_nelder_mead, start=start, settings=settings), answers)
                if point is not None or pending:
                    break
        if point is None or any(problem.space.waveform(point) == w for w in pending):
            step = problem.generator("beside", index).standard_normal(problem.space.dim)
            beside = np.clip(centre + 0.5 * settings.sigma * step, 0.0, 1.0)
            return _proposal(problem, problem.space.waveform(beside), EXTRA)
        return _proposal(problem, problem.space.waveform(point), POLISH)


def _key(point: FloatArray) -> int:
    """A number that identifies a start, for its random stream."""
    return int(np.frombuffer(np.ascontiguousarray(point).tobytes(), dtype=np.uint32).sum(dtype=np.uint64))


def _nelder_mead(g: object, start: FloatArray, settings: FinishSection) -> None:
    simplex = np.clip(start + settings.sigma * np.vstack([np.zeros(len(start)), np.eye(len(start))]), 0.0, 1.0)
    simplex[1:] -= 2.0 * settings.sigma * np.eye(len(start)) * (simplex[1:] >= 1.0)
    minimize(
        g, start, method="Nelder-Mead", bounds=[(0.0, 1.0)] * len(start),
        options={"initial_simplex": simplex, "adaptive": True, "xatol": 1e-4, "fatol": 1e-4, "maxfev": 100_000},
    )  # fmt: skip


def distinct_basins(problem: Problem, search: Sequence[Observation], n: int, distance: float) -> list[Waveform]:
    """The waveforms of the best records, each farther than `distance` (largest coordinate) from every better one."""
    chosen: list[Waveform] = []
    points: list[FloatArray] = []
    for o in sorted((o for o in search if o.usable), key=lambda o: (o.g_cm_s, o.index)):
        try:
            point = problem.space.unit(o.waveform, clip=True)
        except SpaceError:
            continue
        if all(np.abs(point - other).max() > distance for other in points):
            chosen.append(o.waveform)
            points.append(point)
        if len(chosen) == n:
            break
    return chosen


def _proposal(problem: Problem, waveform: Waveform, origin: str, note: str = "") -> Proposal:
    return Proposal(waveform=waveform, origin=origin, n_switches=problem.config.finish.n_switches, note=note)
