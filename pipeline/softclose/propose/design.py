"""Owns the design: the points from which the engines start, space-filling among waveforms that may land the lot.

Most of the cube cannot: its pulses alone slam the mean switch or hardly move it, or its hold lets half of the lot go.
Which points those are follows from the free swing of a few switches and from statics, without an evaluation (ADR 034).
Nothing is excluded from the search, only from its start.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from softclose.propose.protocol import Problem
from softclose.propose.sobol import sobol_points
from softclose.propose.swing import free_swing

FloatArray = NDArray[np.float64]

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


def design_point(problem: Problem, place: int, stream: str = "initial", attempt: int = 0) -> FloatArray:
    """(d,) the point at `place` of the design `stream`, repaired to an admissible one.

    attempt: number of the descent that it is for. Every second one catches the plate at its second turn where two
    pulses are all there is; the scatter that a third has taken out would be back by then.
    """
    block, within = divmod(place, BLOCK)
    turn = attempt % 2 if problem.space.n_pulses == 2 else 0
    known = problem.design_blocks
    if (stream, block, turn) not in known:
        known[stream, block, turn] = _block(problem, stream, block, turn)
    return problem.space.canonical(known[stream, block, turn][within])


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
