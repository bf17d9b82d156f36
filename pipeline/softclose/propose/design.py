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
from softclose.swing import free_swing

FloatArray = NDArray[np.float64]

BLOCK = 32
"""Points drawn together: the low-dispersion quarter, for each pulse that can compensate, of four times as many."""

_POOL = 4096

LEAST_REACH, MOST_REACH = 0.35, 1.0
"""Mean switch: the finite pulses carry it a third of its travel at least, and do not close it by themselves."""

ARRIVAL = (0.1, 0.45)
"""Delay of the last pulse [periods]: it is half up when the plate turns, about a quarter of a period after the last
kick, later where the field softens the spring."""

MOST_REACH_OF_LOT = 1.1
"""Every switch of the lot: hardly any is closed by the finite pulses alone."""


def design_point(problem: Problem, place: int, stream: str = "initial") -> FloatArray:
    """(d,) the point at `place` of the design `stream`, repaired to an admissible one."""
    block, within = divmod(place, BLOCK)
    known = problem.design_blocks
    if (stream, block) not in known:
        known[stream, block] = _block(problem, stream, block)
    return problem.space.canonical(known[stream, block][within])


def _block(problem: Problem, stream: str, block: int) -> FloatArray:
    """(BLOCK, d) Sobol points that may land the lot, of those the ones that disperse it least."""
    space, lot = problem.space, problem.lot
    draws = sobol_points(space.dim, _POOL, problem.generator(stream, block))
    points = space.core(draws)
    arrival = space.names.index(f"delay{space.n_pulses}")
    early, late = ARRIVAL
    points[:, arrival] = space.coordinates[arrival].unit(early + draws[:, arrival] * (late - early))
    hold = space.names.index(f"volts{space.n_pulses}")
    low = min(lot.weak_hold_volts, 0.9 * space.scales.max_volts)
    high = min(max(lot.strong_hold_volts, low), space.scales.max_volts)
    points[:, hold] = np.clip(space.coordinates[hold].unit(low + draws[:, hold] * (high - low)), 0.0, 1.0)
    swing = free_swing(space.rows(points), lot)
    mean_switch = swing.reach[:, 0]
    violation = (
        np.maximum(LEAST_REACH - mean_switch, 0.0)
        + np.maximum(mean_switch - MOST_REACH, 0.0)
        + np.maximum(swing.reach.max(axis=1) - MOST_REACH_OF_LOT, 0.0)
    )
    # One finite pulse has nothing to compensate with: choosing by dispersion would only choose by reach.
    n_kept = BLOCK * 4 ** (space.n_pulses - 2)
    kept = np.argsort(violation, kind="stable")[:n_kept]
    dispersion = swing.sd[kept] / swing.mean[kept]
    return np.asarray(points[np.sort(kept[np.argsort(dispersion, kind="stable")[:BLOCK]])])
