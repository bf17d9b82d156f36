"""Owns the finishing stage: the best distinct basins again on a larger ensemble, then polished there.

An engine like any other: its candidates are the last `finish.budget` of a campaign, its state is read from the records.
What looked best on the search's ensemble flatters itself (by 0.5-1.1 cm/s at N = 200), so ranking starts again here.
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from threadpoolctl import threadpool_limits

from softclose.propose.design import design_point
from softclose.propose.protocol import Observation, Problem, Proposal, seen_by
from softclose.propose.replay import Answers, CmaStart, cma_points, next_point
from softclose.waveform import Waveform
from softclose.waveform.spaces import SpaceError

if TYPE_CHECKING:
    from softclose.config import FinishSection

FloatArray = NDArray[np.float64]

EXPLORE = "finish-explore"
"""Origin of a step of a descent."""

ROUNDS = 3
"""Rounds of successive halving."""

N_SCOUTS = 40
"""Points from which a descent takes its start."""

GENERATION = 20
"""Points in a generation of a descent: twice the library's choice for ten parameters, for noise and narrow basins."""

DESCENT_SIGMA = 0.12
"""Standard deviation of its first generation, in units of the cube: a good start is to be kept (ADR 034)."""

RERANK, POLISH, EXTRA = "finish-rerank", "finish-polish", "finish-extra"
"""Origins: a basin of the search again, a step of the polish, a point beside it while the polish waits."""


MOST_RANKED = 500
"""Records among which basins are looked for, best first."""


class FinishEngine:
    """Re-rank, then polish, by the method of `finish.method`."""

    def propose(
        self, problem: Problem, index: int, history: Sequence[Observation], pending: Sequence[Waveform]
    ) -> Proposal:
        """The next candidate of the finishing stage. Candidates of the search still in flight are not considered."""
        settings = problem.config.finish
        begin = problem.config.campaign.budget + min(settings.explore, settings.budget)
        if index < begin:
            return _explore(problem, index, history, pending)
        search = [o for o in history if o.index < begin]
        finished = [o for o in history if o.index >= begin]
        place = index - begin
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
                    run = CmaStart(point=tuple(start.tolist()), sigma=settings.sigma, population=0)
                    generator = partial(problem.generator, "finish", _key(start))
                    identity = ("finish", problem.config.campaign.seed)
                    point, centre = cma_points(run, answers, pending, problem.space, generator, identity)
                else:
                    point = next_point(partial(_nelder_mead, start=start, settings=settings), answers)
                if point is not None or pending:
                    break
        if point is None or any(problem.space.waveform(point) == w for w in pending):
            step = problem.generator("beside", index).standard_normal(problem.space.dim)
            beside = np.clip(centre + 0.5 * settings.sigma * step, 0.0, 1.0)
            return _proposal(problem, problem.space.waveform(beside), EXTRA)
        return _proposal(problem, problem.space.waveform(point), POLISH)


@dataclass(frozen=True, slots=True)
class Share:
    """Candidates of `explore` that one descent gets in one round."""

    begin: int
    """First place in the finishing stage."""
    end: int
    """One past the last."""
    round_begin: int
    """First place of its round."""
    rank: int
    """Which descent: its number in the first round, afterwards its rank by what the rounds before found."""


def shares(explore: int, n_descents: int) -> tuple[Share, ...]:
    """Successive halving: every round has an equal part of `explore`, and half as many descents as the one before."""
    counts = [n_descents]
    while counts[-1] > 1 and len(counts) < ROUNDS:
        counts.append(max(counts[-1] // 2, 1))
    edges = [explore * k // len(counts) for k in range(len(counts) + 1)]
    found = []
    for begin, end, n in zip(edges[:-1], edges[1:], counts, strict=True):
        cuts = [begin + (end - begin) * k // n for k in range(n + 1)]
        found += [Share(cuts[k], cuts[k + 1], begin, k) for k in range(n) if cuts[k + 1] > cuts[k]]
    return tuple(found)


def _explore(problem: Problem, index: int, history: Sequence[Observation], pending: Sequence[Waveform]) -> Proposal:
    """A step of one of several CMA-ES descents; the better ones go on, the others end.

    The first goes on from the search's best. Basins are narrow and a descent ends in whichever it meets, so the others
    begin at fresh points; the first few hundred candidates tell which are worth finishing (ADR 033, 036).
    """
    settings, budget = problem.config.finish, problem.config.campaign.budget
    table = shares(min(settings.explore, settings.budget), settings.n_descents)
    owners = _owners(table, history, budget, problem.config.campaign.lag)
    here = next(k for k, share in enumerate(table) if share.begin <= index - budget < share.end)
    descent = owners[here]
    own = [share for share, who in zip(table[: here + 1], owners, strict=False) if who == descent]
    records = [o for share in own for o in history[budget + share.begin : budget + share.end]]
    begin = _search_best(problem, history) if descent == 0 else None
    n_scouts = N_SCOUTS if begin is None else 0
    if begin is None:
        begin = _best_scout(problem, descent, records)
    start = CmaStart(point=tuple(begin.tolist()), sigma=DESCENT_SIGMA, population=GENERATION)
    place = sum(min(share.end, index - budget) - share.begin for share in own)
    if place < n_scouts:
        point = design_point(problem, descent * N_SCOUTS + place, "scout", descent)
    else:
        generator = partial(problem.generator, "descent", descent)
        identity = ("descent", problem.config.campaign.seed, descent)
        answers = Answers(problem.space, records)
        wanted, mean = cma_points(start, answers, pending, problem.space, generator, identity)
        # None: it converged early, or its generation is in flight.
        step = problem.generator("descpad", index).standard_normal(problem.space.dim)
        point = np.clip(mean + 0.1 * step, 0.0, 1.0) if wanted is None else wanted
    return Proposal(
        waveform=problem.space.waveform(point), origin=EXPLORE, n_switches=problem.config.population.n_switches
    )


def _search_best(problem: Problem, history: Sequence[Observation]) -> FloatArray | None:
    """The best point of the search, as far as the first candidate of the stage sees it; None where there is none."""
    seen = seen_by(problem.config.campaign.budget, history, problem.config.campaign.lag)
    best = distinct_basins(problem, seen, 1, problem.config.finish.distance)
    return problem.space.unit(best[0], clip=True) if best else None


def _best_scout(problem: Problem, descent: int, records: Sequence[Observation]) -> FloatArray:
    """The best of the descent's own scouts, points of the design."""
    scouts = [o.g_cm_s if o.usable else np.inf for o in records[:N_SCOUTS]]
    best = int(np.argmin(scouts)) if scouts else 0
    return design_point(problem, descent * N_SCOUTS + best, "scout", descent)


def _owners(table: Sequence[Share], history: Sequence[Observation], begin: int, lag: int) -> list[int]:
    """The descent that owns each share. Ranks count only records that every proposal of the round can see.

    Shares of rounds whose predecessors are not recorded yet get a descent of no meaning; nobody asks for them.
    """
    owners: list[int] = []
    best: dict[int, float] = {}
    ranking: list[int] = []
    ranked_at, scored = 0, 0
    for share in table:
        if share.round_begin != ranked_at:
            ranked_at = share.round_begin
            seen = history[begin : max(begin + ranked_at - lag + 1, begin)]
            while scored < len(owners) and table[scored].round_begin < ranked_at:
                values = [o.g_cm_s for o in seen[table[scored].begin : table[scored].end] if o.usable]
                best[owners[scored]] = min([best.get(owners[scored], np.inf), *values])
                scored += 1
            ranking = sorted(best, key=lambda who: (best[who], who))
        owners.append(ranking[share.rank] if share.round_begin else share.rank)
    return owners


def _key(point: FloatArray) -> int:
    """A number that identifies a start, for its random stream."""
    return int(np.frombuffer(np.ascontiguousarray(point).tobytes(), dtype=np.uint32).sum(dtype=np.uint64))


def _nelder_mead(g: object, start: FloatArray, settings: FinishSection) -> None:
    simplex = np.clip(start + settings.sigma * np.vstack([np.zeros(len(start)), np.eye(len(start))]), 0.0, 1.0)
    simplex[1:] -= 2.0 * settings.sigma * np.eye(len(start)) * (simplex[1:] >= 1.0)
    minimize(
        g,
        start,
        method="Nelder-Mead",
        bounds=[(0.0, 1.0)] * len(start),
        options={"initial_simplex": simplex, "adaptive": True, "xatol": 1e-4, "fatol": 1e-4, "maxfev": 100_000},
    )


def distinct_basins(problem: Problem, search: Sequence[Observation], n: int, distance: float) -> list[Waveform]:
    """The waveforms of the best records, each farther than `distance` (largest coordinate) from every better one."""
    chosen: list[Waveform] = []
    points: list[FloatArray] = []
    # Thousands of records would be mapped in vain: what is far down the ranking is no basin worth another look.
    for o in heapq.nsmallest(MOST_RANKED, (o for o in search if o.usable), key=lambda o: (o.g_cm_s, o.index)):
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
