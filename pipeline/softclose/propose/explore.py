"""Owns exploring: CMA-ES descents from points of the design, on the search's ensemble, the better ones going on.

Basins are narrow, and a descent ends in whichever it meets; a few hundred candidates tell which are worth finishing
(ADR 033, 036). A wave is one generation of every descent whose turn it is: they are independent, and that is where the
workers come from (ADR 037).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from softclose.arrays import FloatArray
from softclose.propose.basins import distinct_basins
from softclose.propose.descents import Beginning
from softclose.propose.design import design_point
from softclose.propose.following import Following, Sharing
from softclose.propose.known import column
from softclose.propose.ladder import Course, Ladder, build_ladder, courses, owner
from softclose.propose.origins import BY_HAND, EXPLORE, FALLBACK, SCOUT
from softclose.propose.protocol import Observation, Problem, Proposal, Wave
from softclose.waveform import Waveform


def explore_ladder(problem: Problem) -> Ladder:
    """The steps of the exploring stage. The first descent goes on from the best of the search, where there is one."""
    s = problem.config.explore
    return build_ladder(
        s.budget,
        n_descents=s.n_descents,
        generation=s.generation,
        n_scouts=s.n_scouts,
        rounds=s.rounds,
        turns=s.turns,
        goes_on=problem.config.campaign.budget > 0,
    )


class ExploreEngine:
    """Scouts of every descent, then their generations."""

    def wave_sizes(self, problem: Problem, budget: int) -> list[int]:
        """Those of the ladder."""
        return [step.size for step in explore_ladder(problem).steps]

    def propose_wave(
        self, problem: Problem, wave: Wave, history: Sequence[Observation], pending: Sequence[Waveform]
    ) -> list[Proposal]:
        """The scouts, or the next generation, of every descent whose turn it is."""
        ladder = explore_ladder(problem)
        begin = problem.config.campaign.budget
        number = ladder.step_at(wave.start - begin)
        if ladder.steps[number].round < 0:
            scouted = ladder.scouted(ladder.steps[number].turn)
            origin = SCOUT
            points = np.array([_scout(problem, who, i) for who in scouted for i in range(ladder.n_scouts)])
        else:
            origin = EXPLORE
            points = np.concatenate([s.points(problem) for s in _sharing(problem, number, history, wave.start)])
        waveforms = problem.space.waveforms(points[: wave.size])
        return [Proposal(waveform=w, origin=origin, n_switches=wave.n_switches) for w in waveforms]


def stage_g(problem: Problem, history: Sequence[Observation], begin: int, end: int) -> FloatArray:
    """(n,) ranks of the records from `begin` to before `end` [cm/s]; inf where a candidate has none or was not asked
    for."""
    return column(problem, ("rank", begin), history[begin:end], _g)


def _g(o: Observation) -> float:
    return o.rank_cm_s if o.usable and not o.origin.startswith((FALLBACK, BY_HAND)) else np.inf


def _sharing(problem: Problem, number: int, history: Sequence[Observation], end: int) -> list[Sharing]:
    """The descents that share a step of the ladder, from the records before candidate `end`."""
    ladder, begin = explore_ladder(problem), problem.config.campaign.budget
    known, sharing = courses(ladder, ladder.steps[number].turn, number, stage_g(problem, history, begin, end))
    return [
        Sharing(beginning=_beginning(problem, ladder, who, known[who], history), told=tuple(known[who].told))
        for who in sharing
    ]


def following(problem: Problem, wave: Wave, history: Sequence[Observation]) -> Following | None:
    """The descents that share a wave of this stage, and what follows it; None of a wave of another kind.

    history: the records before the wave, which is being evaluated.
    """
    ladder, begin = explore_ladder(problem), problem.config.campaign.budget
    if ladder.turns > 1 or not begin <= wave.start < begin + problem.config.explore.budget:
        return None
    number = ladder.step_at(wave.start - begin)
    if not ladder.is_whole(number):
        return None
    return Following(sharing=_sharing(problem, number, history, wave.start), n_left=ladder.n_alike(number))


def past(
    problem: Problem, history: Sequence[Observation], index: int
) -> tuple[Beginning, tuple[FloatArray, ...]] | None:
    """Of a record that belongs to a descent: how that began, and all that it was told; None for a record of another
    kind, or of a descent without a generation."""
    begin = problem.config.campaign.budget
    place = index - begin
    if not 0 <= place < problem.config.explore.budget:
        return None
    ladder = explore_ladder(problem)
    g = stage_g(problem, history, begin, begin + problem.config.explore.budget)
    who = owner(ladder, place, g)
    course = courses(ladder, who % ladder.turns, len(ladder.steps), g)[0][who]
    if not course.told:
        return None
    return _beginning(problem, ladder, who, course, history), tuple(course.told)


def _start(problem: Problem, ladder: Ladder, who: int, course: Course, history: Sequence[Observation]) -> FloatArray:
    """(d,) where a descent begins: at the best of the search, or at the best of its scouts."""
    if ladder.goes_on and who == 0:
        search = history[: problem.config.campaign.budget]
        best = distinct_basins(problem, search, 1, problem.config.finish.distance)
        if best:
            return problem.space.unit(best[0].waveform, clip=True)
    return _scout(problem, who, int(np.argmin(course.scouts)) if len(course.scouts) else 0)


def _beginning(problem: Problem, ladder: Ladder, who: int, course: Course, history: Sequence[Observation]) -> Beginning:
    settings = problem.config.explore
    return Beginning(
        stream="descent",
        who=who,
        start=_start(problem, ladder, who, course, history),
        sigma=settings.sigma,
        generation=settings.generation,
    )


def _scout(problem: Problem, who: int, place: int) -> FloatArray:
    """(d,) a point of the design from which a descent may start."""
    return design_point(problem, who * problem.config.explore.n_scouts + place, "scout", who)
