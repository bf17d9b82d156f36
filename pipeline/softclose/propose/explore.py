"""Owns exploring: CMA-ES descents from points of the design, on the search's ensemble, the better ones going on.

Basins are narrow, and a descent ends in whichever it meets; a few hundred candidates tell which are worth finishing
(ADR 033, 036). A wave is one generation of every descent whose turn it is: they are independent, and that is where the
workers come from (ADR 037).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from softclose.arrays import FloatArray
from softclose.propose.basins import distinct_basins
from softclose.propose.descents import Descent, continued
from softclose.propose.design import design_point
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
        turn = ladder.steps[number].turn
        known, sharing = courses(ladder, turn, number, stage_g(problem, history, begin, wave.start))
        if ladder.steps[number].round < 0:
            origin = SCOUT
            points = np.array([_scout(problem, who, i) for who in sharing for i in range(ladder.n_scouts)])
        else:
            origin = EXPLORE
            runs = [descent(problem, ladder, who, known[who], history) for who in sharing]
            points = np.concatenate([run.points() for run in runs])
        waveforms = problem.space.waveforms(points[: wave.size])
        return [Proposal(waveform=w, origin=origin, n_switches=wave.n_switches) for w in waveforms]


def stage_g(problem: Problem, history: Sequence[Observation], begin: int, end: int) -> FloatArray:
    """(n,) ranks of the records from `begin` to before `end` [cm/s]; inf where a candidate has none or was not asked
    for."""
    return column(problem, ("rank", begin), history[begin:end], _g)


def _g(o: Observation) -> float:
    return o.rank_cm_s if o.usable and not o.origin.startswith((FALLBACK, BY_HAND)) else np.inf


def descent(problem: Problem, ladder: Ladder, who: int, course: Course, history: Sequence[Observation]) -> Descent:
    """The run of one descent after its course so far, kept for its next generation."""
    start = _start(problem, ladder, who, course, history)
    return continued(problem, ("explore", who, start.tobytes()), lambda: _begin(problem, who, start), course.told)


class NextGenerations:
    """What descents will ask for next, each as soon as its own values are there: they are independent until the better
    half of them goes on."""

    def __init__(self, problem: Problem, wave: Wave, history: Sequence[Observation]) -> None:
        """history: the records before the wave, which is being evaluated."""
        self._problem, self._history = problem, history
        self._ladder, begin = explore_ladder(problem), problem.config.campaign.budget
        self._known: dict[int, Course] = {}
        self._sharing: list[int] = []
        self.n_shares = 1
        """Equal parts of the wave, each of one descent."""
        if self._ladder.turns > 1 or not begin <= wave.start < begin + problem.config.explore.budget:
            return
        number = self._ladder.step_at(wave.start - begin)
        step, *then = self._ladder.steps[number : number + 2]
        if step.round < 0 or step.size != step.n_descents * self._ladder.generation:
            return
        self.n_shares = step.n_descents
        if then and (then[0].round, then[0].size) == (step.round, step.size):
            g = stage_g(problem, history, begin, wave.start)
            self._known, self._sharing = courses(self._ladder, step.turn, number, g)

    @property
    def are_known(self) -> bool:
        """Whether what each descent asks for next follows from its own values alone."""
        return bool(self._sharing)

    def points(self, share: int, told: Sequence[Observation]) -> FloatArray:
        """(generation, d) what the descent of a share asks for after the records of its share."""
        who = self._sharing[share]
        course = self._known[who]
        after = Course(scouts=course.scouts, told=[*course.told, np.array([_g(o) for o in told])])
        return descent(self._problem, self._ladder, who, after, self._history).points()


def past(
    problem: Problem, history: Sequence[Observation], index: int
) -> tuple[int, tuple[bytes, ...], Callable[[], Descent]] | None:
    """Of a record that belongs to a descent: which one, all that decides its course, and how to run it again to its
    end; None for a record of another kind, or of a descent without a generation."""
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
    start = _start(problem, ladder, who, course, history)

    def run() -> Descent:
        again = _begin(problem, who, start)
        for values in course.told:
            again.tell(values)
        return again

    return who, (start.tobytes(), *(values.tobytes() for values in course.told)), run


def _start(problem: Problem, ladder: Ladder, who: int, course: Course, history: Sequence[Observation]) -> FloatArray:
    """(d,) where a descent begins: at the best of the search, or at the best of its scouts."""
    if ladder.goes_on and who == 0:
        search = history[: problem.config.campaign.budget]
        best = distinct_basins(problem, search, 1, problem.config.finish.distance)
        if best:
            return problem.space.unit(best[0].waveform, clip=True)
    return _scout(problem, who, int(np.argmin(course.scouts)) if len(course.scouts) else 0)


def _begin(problem: Problem, who: int, start: FloatArray) -> Descent:
    settings = problem.config.explore
    return Descent(problem.space, start, settings.sigma, settings.generation, problem.generator("descent", who))


def _scout(problem: Problem, who: int, place: int) -> FloatArray:
    """(d,) a point of the design from which a descent may start."""
    return design_point(problem, who * problem.config.explore.n_scouts + place, "scout", who)
