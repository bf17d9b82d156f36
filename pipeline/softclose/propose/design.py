"""Owns the design: the points from which the engines start, space-filling among waveforms that may land the lot.

Most of the cube cannot: its pulses alone slam the mean switch or hardly move it, or its hold lets half of the lot go.
Which points those are follows from the free swing of a few switches and from statics, without an evaluation (ADR 034).
Nothing is excluded from the search, only from its start.
"""

from __future__ import annotations

import numpy as np

from softclose.arrays import FloatArray
from softclose.propose.protocol import Problem
from softclose.propose.sobol import sobol_points
from softclose.propose.swing import free_swing

BLOCK = 32
"""Points drawn together: of four times as many, for each pulse that can compensate, those that bring the lot to the
half-risen hold in the most similar states."""

_POOL = 4096

LEAST_REACH, MOST_REACH = 0.35, 1.0
"""Mean switch: the finite pulses carry it a third of its travel at least, and do not close it by themselves."""

ARRIVALS = ((0.1, 0.45), (1.1, 1.45))
"""Delay of the last pulse [periods]: it is half up when the plate turns, about a quarter of a period after the last
kick, later where the field softens the spring; or when it turns for the second time."""

COMPENSATION = (7.0 / 12.0, 11.0 / 12.0)
"""Delay between finite pulses [periods]. Together they carry to |1 + a·exp(iωτ)|, which grows with ω as -sin(ωτ): there
the stiffer switches, which each pulse alone carries less far, gain at least half of the most they can."""

MOST_REACH_OF_LOT = 1.1
"""Every switch of the lot: hardly any is closed by the finite pulses alone."""


SLOW_RISES, SLOW_VOLTS = (0.2, 0.5), (0.1, 0.5)
"""Slow designs: rises of the finite pulses in horizons, their voltages in pull-in voltages. A soft bump lifts the plate
while the hold rises over the whole horizon, and nothing is ever in a hurry."""

SLOW_HOLD_RISES, SLOW_START = (0.7, 1.0), 0.1
"""Rise of their hold, and the latest start of a pulse, in horizons."""


def design_point(problem: Problem, place: int, stream: str = "initial", attempt: int = 0) -> FloatArray:
    """(d,) the point at `place` of the design `stream`, repaired to an admissible one.

    attempt: number of the descent that it is for; see `_family`.
    """
    block, within = divmod(place, BLOCK)
    family = _family(problem, attempt)
    known = problem.design_blocks
    if (stream, block, family) not in known:
        make = _slow_block if family == SLOW else _block
        known[stream, block, family] = make(problem, stream, block, family)
    return problem.space.canonical(known[stream, block, family][within])


FIRST_TURN, SECOND_TURN, SLOW = 0, 1, 2
"""Families of designs: the hold catches the plate at its first or second turn, or everything is slow."""


def _family(problem: Problem, attempt: int) -> int:
    """With two pulses every second attempt catches the plate at its second turn: the scatter that a third pulse has
    taken out would be back by then. Every fourth attempt is slow, where every pulse is free and the last one holds."""
    space = problem.space
    if attempt % 4 == 3 and space.holds and not space.fixed:
        return SLOW
    return SECOND_TURN if attempt % 2 and space.n_pulses == 2 else FIRST_TURN


def _slow_block(problem: Problem, stream: str, block: int, family: int) -> FloatArray:
    """(BLOCK, d) Sobol points among soft bumps under a hold that rises over the horizon."""
    space, lot = problem.space, problem.lot
    s = space.scales
    draws = sobol_points(space.dim, BLOCK, problem.generator(stream, block))
    rows = np.empty((BLOCK, space.n_pulses, 4))
    begin, column = np.zeros(BLOCK), iter(draws.T)
    for j in range(space.n_pulses):
        last = j == space.n_pulses - 1
        rise, volts = (SLOW_HOLD_RISES, (0.0, 0.0)) if last else (SLOW_RISES, SLOW_VOLTS)
        if j:
            begin = begin + next(column) * SLOW_START * s.horizon_us
        rows[:, j, 0] = begin
        rows[:, j, 1] = (rise[0] + next(column) * (rise[1] - rise[0])) * s.horizon_us
        if last:
            weak, strong = min(lot.weak_hold_volts, s.max_volts), min(1.2 * lot.strong_hold_volts, s.max_volts)
            rows[:, j, 2], rows[:, j, 3] = np.inf, weak + next(column) * (strong - weak)
        else:
            rows[:, j, 2] = next(column) * SLOW_START * s.horizon_us
            rows[:, j, 3] = (volts[0] + next(column) * (volts[1] - volts[0])) * s.pull_in_volts
    return np.clip(space.coordinates_of_rows(rows), 0.0, 1.0)


def _block(problem: Problem, stream: str, block: int, turn: int) -> FloatArray:
    """(BLOCK, d) Sobol points that may land the lot, of those the ones that scatter it least."""
    space, lot = problem.space, problem.lot
    draws = sobol_points(space.dim, _POOL, problem.generator(stream, block))
    points = space.core(draws)
    for j in range(2, space.n_pulses + 1):
        delay = space.names.index(f"delay{j}")
        early, late = ARRIVALS[turn] if j == space.n_pulses else COMPENSATION
        points[:, delay] = space.coordinates[delay].unit(early + draws[:, delay] * (late - early))
    hold = space.names.index(f"volts{space.n_pulses}")
    low = min(lot.weak_hold_volts, 0.9 * space.scales.max_volts)
    high = min(max(lot.strong_hold_volts, low), space.scales.max_volts)
    points[:, hold] = np.clip(space.coordinates[hold].unit(low + draws[:, hold] * (high - low)), 0.0, 1.0)
    rows = space.rows(points)
    swing = free_swing(rows, lot, instant_us=rows[:, -1, 0] + 0.5 * rows[:, -1, 1])
    mean_switch = swing.reach[:, 0]
    violation = (
        np.maximum(LEAST_REACH - mean_switch, 0.0)
        + np.maximum(mean_switch - MOST_REACH, 0.0)
        + np.maximum(swing.reach.max(axis=1) - MOST_REACH_OF_LOT, 0.0)
    )
    # One finite pulse has nothing to compensate with: choosing by scatter would only choose by reach.
    n_kept = BLOCK * 4 ** (space.n_pulses - 2)
    kept = np.argsort(violation, kind="stable")[:n_kept]
    return np.asarray(points[np.sort(kept[np.argsort(swing.scatter[kept], kind="stable")[:BLOCK]])])
