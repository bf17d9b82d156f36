"""Owns the paper's own procedure: widen pulse 1, a grid over the hold, then Nelder-Mead on four parameters.

Every step is a candidate. Pulse 1 alone is widened by bisection until about 5 % of the switches touch; then 4 × 3 × 3
values of (ts2, tr2, u2); then the simplex from the best of them. Only for the space two-pulse-paper.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from scipy.optimize import minimize

from softclose.arrays import FloatArray
from softclose.propose.origins import FALLBACK, PAPER_GRID, PAPER_SIMPLEX, PAPER_WIDEN, SOBOL
from softclose.propose.protocol import EngineError, Observation, Problem, Proposal, search_history
from softclose.propose.replay import Answers, next_point
from softclose.propose.sobol import initial_point
from softclose.waveform import Pulse, Waveform

TOUCHING = 0.05
"""Fraction of the switches that pulse 1 alone shall bring into contact."""
N_WIDEN = 8
"""Bisections of the width of pulse 1."""
N_GRID = (4, 3, 3)
"""Values of ts2, tr2 and u2."""


class PaperEngine:
    """Grid and simplex, as published."""

    def propose(
        self, problem: Problem, index: int, history: Sequence[Observation], pending: Sequence[Waveform]
    ) -> Proposal:
        """The next step of the procedure. Raises EngineError in any other space than two-pulse-paper."""
        if problem.config.waveform.space != "two-pulse-paper":
            raise EngineError(
                f"engine 'paper' searches the space two-pulse-paper only; waveform.space is "
                f"{problem.config.waveform.space!r}: change one of the two"
            )
        search = search_history(problem, history)
        place = index - problem.n_initial_waveforms
        widen = [o for o in search if o.origin == PAPER_WIDEN]
        if place < N_WIDEN:
            return _proposal(problem, Waveform([_kick(problem, _bisect(problem, widen)[0])]), PAPER_WIDEN)
        grid = _grid(problem, _bisect(problem, widen)[0])
        if place < N_WIDEN + len(grid):
            return _proposal(problem, problem.space.waveform(grid[place - N_WIDEN]), PAPER_GRID)
        tried = [o for o in search if o.usable and o.origin == PAPER_GRID]
        if not tried:
            return _proposal(problem, problem.space.waveform(initial_point(problem, place)), FALLBACK)
        start = problem.space.unit(min(tried, key=lambda o: (o.rank_cm_s, o.index)).waveform, clip=True)
        point = next_point(lambda g: _simplex(g, start), Answers(problem.space, search))
        if point is None or any(problem.space.waveform(point) == w for w in pending):
            return _proposal(problem, problem.space.waveform(initial_point(problem, place)), SOBOL)
        return _proposal(problem, problem.space.waveform(point), PAPER_SIMPLEX)


def _kick(problem: Problem, peak_us: float) -> Pulse:
    s = problem.space.scales
    return Pulse(0.0, s.min_rise_us, peak_us, s.max_volts)


def _bisect(problem: Problem, widen: Sequence[Observation]) -> tuple[float, float]:
    """The next peak time of pulse 1 [µs] and the width of the bracket, from what touched so far."""
    scales = problem.space.scales
    low, high = 0.0, 2.0 * scales.impulse / scales.max_volts**2
    for o in widen:
        peak = o.waveform.pulses[0].peak_us
        if not o.failed and o.p_contact < TOUCHING:
            low = max(low, peak)
        else:
            high = min(high, peak)
    return 0.5 * (low + high), high - low


def _grid(problem: Problem, peak_us: float) -> list[FloatArray]:
    """(36) points: gaps of 0 … ½ period, rises of 1 … 6 shortest, voltages of 1.1 … 1.5 hold voltages."""
    s = problem.space.scales
    first = _kick(problem, peak_us)
    plateau_end = first.rise_us + first.peak_us
    points = []
    for gap, rise, volts in itertools.product(
        np.linspace(0.0, 0.5, N_GRID[0]), np.geomspace(1.0, 6.0, N_GRID[1]), np.linspace(1.1, 1.5, N_GRID[2])
    ):
        hold = Pulse(
            plateau_end + float(gap) * s.period_us,
            s.min_rise_us * float(rise),
            np.inf,
            min(float(volts) * s.hold_volts, s.max_volts),
        )
        points.append(problem.space.canonical(problem.space.unit(Waveform([first, hold]), clip=True)))
    return points


def _simplex(g: object, start: FloatArray) -> None:
    simplex = np.vstack([start, start + 0.05 * np.eye(len(start))])
    simplex = np.where(simplex > 1.0, simplex - 0.1, simplex)
    minimize(
        g,
        start,
        method="Nelder-Mead",
        bounds=[(0.0, 1.0)] * len(start),
        options={"initial_simplex": simplex, "xatol": 1e-4, "fatol": 1e-3, "maxfev": 100_000},
    )


def _proposal(problem: Problem, waveform: Waveform, origin: str) -> Proposal:
    return Proposal(waveform=waveform, origin=origin, n_switches=problem.config.population.n_switches)
