"""Owns the finishing stage: the best distinct basins again on a larger ensemble, then polished there.

The training score of the best is optimistic (by 0.5-1.1 cm/s at N = 200), so ranking starts again here:
one wave, all basins. Then the best few are polished at once, the better half of them to the end (ADR 032, 037).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from softclose.arrays import FloatArray
from softclose.propose.basins import distinct_basins
from softclose.propose.descents import Beginning
from softclose.propose.explore import past, stage_g
from softclose.propose.following import Following, Sharing
from softclose.propose.ladder import Ladder, build_ladder, courses
from softclose.propose.origins import EXTRA, POLISH, RERANK
from softclose.propose.protocol import Observation, Problem, Proposal, Wave
from softclose.propose.replay import Answers, next_point
from softclose.waveform import Waveform

if TYPE_CHECKING:
    from softclose.settings.search import FinishSection


class FinishEngine:
    """Re-rank, then polish, by the method of `finish.method`."""

    def wave_sizes(self, problem: Problem, budget: int) -> list[int]:
        """All basins, then generations of those that are polished, batches of the surrogate, or one at a time."""
        settings = problem.config.finish
        first = min(settings.n_basins, budget)
        rest = budget - first
        if settings.method == "cmaes":
            return [first, *(step.size for step in _polish_ladder(problem).steps)]
        each = problem.config.optimiser.batch if settings.method == "surrogate" else 1
        return [first, *([each] * (rest // each)), *([rest % each] if rest % each else [])]

    def propose_wave(
        self, problem: Problem, wave: Wave, history: Sequence[Observation], pending: Sequence[Waveform]
    ) -> list[Proposal]:
        """The basins again, or the next steps of the polish."""
        settings, begin = problem.config.finish, _begin_of_stage(problem)
        basins = distinct_basins(problem, history[:begin], settings.n_basins, settings.distance)
        if wave.start == begin:
            found = [Proposal(waveform=o.waveform, origin=RERANK, n_switches=wave.n_switches) for o in basins]
            return (found + _beside(problem, wave, next(iter(basins), None)))[: wave.size]
        finished = [o for o in history[begin:] if o.usable]
        if settings.method == "cmaes":
            shares = [s.points(problem) for s in _sharing(problem, wave, history, basins)]
            points = np.concatenate(shares) if shares else np.empty((0, problem.space.dim))
        elif settings.method == "surrogate":
            from softclose.propose.skopt_engine import polish  # imported where it is used: skopt is slow to import

            points = polish(problem, wave, finished, pending)
        else:
            points = _walk(problem, finished)
        waveforms = problem.space.waveforms(points[: wave.size]) if len(points) else []
        found = [Proposal(waveform=w, origin=POLISH, n_switches=wave.n_switches) for w in waveforms]
        best = min(finished or basins[:1], key=lambda o: (o.rank_cm_s, o.index), default=None)
        return (found + _beside(problem, wave, best))[: wave.size]


def _begin_of_stage(problem: Problem) -> int:
    return problem.config.campaign.budget + problem.config.explore.budget


def _polish_ladder(problem: Problem) -> Ladder:
    s = problem.config.finish
    return build_ladder(
        max(s.budget - s.n_basins, 0),
        n_descents=min(s.n_polished, s.n_basins),
        generation=problem.config.explore.generation,
        n_scouts=0,
        rounds=s.n_polished,
        turns=1,
    )


def _beside(problem: Problem, wave: Wave, around: Observation | None) -> list[Proposal]:
    """As many points as the wave has, near a record or, where nothing is usable, anywhere."""
    space = problem.space
    draw = problem.generator("beside", wave.start)
    if around is not None:
        centre = space.unit(around.waveform, clip=True)
        points = centre + 0.5 * problem.config.finish.sigma * draw.standard_normal((wave.size, space.dim))
    else:
        points = draw.random((wave.size, space.dim))
    note = "" if around is not None else "no usable candidate to finish"
    return [Proposal(waveform=w, origin=EXTRA, n_switches=wave.n_switches, note=note) for w in space.waveforms(points)]


def following(problem: Problem, wave: Wave, history: Sequence[Observation]) -> Following | None:
    """The descents that share a wave of this stage, and what follows it; None of a wave of another kind.

    history: the records before the wave, which is being evaluated.
    """
    settings, begin = problem.config.finish, _begin_of_stage(problem)
    place = wave.start - begin - min(settings.n_basins, settings.budget)
    if settings.method != "cmaes" or place < 0:
        return None
    ladder = _polish_ladder(problem)
    number = ladder.step_at(place)
    if not ladder.is_whole(number):
        return None
    basins = distinct_basins(problem, history[:begin], settings.n_basins, settings.distance)
    sharing = _sharing(problem, wave, history, basins)
    return Following(sharing=sharing, n_left=ladder.n_alike(number)) if sharing else None


def _sharing(
    problem: Problem, wave: Wave, history: Sequence[Observation], basins: Sequence[Observation]
) -> list[Sharing]:
    """The descents that share a wave of the polish, each from a basin, best first in the second wave."""
    settings, begin = problem.config.finish, _begin_of_stage(problem)
    ladder = _polish_ladder(problem)
    first = begin + min(settings.n_basins, settings.budget)
    again = stage_g(problem, history, begin, first)[: len(basins)]
    ranked = [basins[i] for i in np.argsort(again, kind="stable")]
    number = ladder.step_at(wave.start - first)
    known, sharing = courses(ladder, 0, number, stage_g(problem, history, first, wave.start))
    if not ranked:
        return []
    beginnings: list[Beginning] = []
    claimed: set[int] = set()
    for who in range(ladder.n_descents):
        basin = ranked[min(who, len(ranked) - 1)]
        found = past(problem, history, basin.index)
        if found is not None and found[0].who not in claimed:
            earlier, told = found
            claimed.add(earlier.who)
            # The descent that found it goes on, with the shape that it has learnt, on the larger ensemble.
            beginnings.append(replace(earlier, before=told, goes_on_at=settings.sigma))
        else:  # of another stage, or its descent goes on already: this one begins afresh
            beginnings.append(
                Beginning(
                    stream="polish",
                    who=who,
                    start=problem.space.unit(basin.waveform, clip=True),
                    sigma=settings.sigma,
                    generation=problem.config.explore.generation,
                )
            )
    return [Sharing(beginning=beginnings[who], told=tuple(known[who].told)) for who in sharing]


def _walk(problem: Problem, finished: Sequence[Observation]) -> FloatArray:
    """(1, d) the next step of a simplex from the best basin, or from the next one where it has come to an end."""
    answers = Answers(problem.space, finished)
    ranked = sorted((o for o in finished if o.origin == RERANK), key=lambda o: (o.rank_cm_s, o.index))
    for o in ranked:
        start = problem.space.unit(o.waveform, clip=True)
        point = next_point(partial(_nelder_mead, start=start, settings=problem.config.finish), answers)
        if point is not None:
            return point[None]
    return np.empty((0, problem.space.dim))


def _nelder_mead(g: object, start: FloatArray, settings: FinishSection) -> None:
    from scipy.optimize import minimize  # where it is used: it takes 0.2 s to import

    simplex = np.clip(start + settings.sigma * np.vstack([np.zeros(len(start)), np.eye(len(start))]), 0.0, 1.0)
    simplex[1:] -= 2.0 * settings.sigma * np.eye(len(start)) * (simplex[1:] >= 1.0)
    minimize(
        g,
        start,
        method="Nelder-Mead",
        bounds=[(0.0, 1.0)] * len(start),
        options={"initial_simplex": simplex, "adaptive": True, "xatol": 1e-4, "fatol": 1e-4, "maxfev": 100_000},
    )
