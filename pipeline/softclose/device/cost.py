"""Owns what a trajectory costs, as the device model states it: work is cut by it, never by a clock.

A stated cost is a round figure. It decides how large a piece of work is, and so must not depend on the machine.
"""

from __future__ import annotations

import math

from softclose.plugins import MEASURED, MODELS, REDUCED_ORDER, SINGLE_MODE, ModelError

PIECE_S = 0.05
"""What a piece of work should take [s]: on a local cluster all processes together spend some 10 ms on each."""

LARGE_PIECE_S = 0.2
"""The same of work that is so large that its pieces are many."""

PLAIN_S, LOSSY_S, MODAL_S = 4e-6, 8e-6, 3e-5
"""A trajectory of Eqs. 1-2, one with losses, one of a reduced-order model [s]: of two modes 1.5e-5, with a table of
capacitances 3e-5 to 5e-5, on a compliant contact, which has no series, 1e-4."""

DELIVERED = 1.6
"""How many times as long one takes behind an amplifier that is not ideal."""

UNSTATED_S = 1e-3
"""A trajectory of somebody else's model that states none [s]."""

SLOW_PIECE_S, SLOW_ROWS = 1.0, 16
"""What a piece of work takes of a model so slow that fewer than so many switches fill an ordinary piece: what one costs
beside its simulation, some ten milliseconds of storing, is paid that much less often."""

MOST_ROWS = 10_000
"""Switches of the largest piece: its responses are in memory at once."""


def seconds_a_trajectory(model: str, *, lossless: bool, ideal: bool) -> float:
    """What one trajectory takes, about [s]: of somebody else's model its attribute `seconds_a_trajectory`.

    lossless: without damping, film or adhesion; ideal: what is commanded arrives.
    """
    if model in (SINGLE_MODE, MEASURED, REDUCED_ORDER):
        own = MODAL_S if model == REDUCED_ORDER else PLAIN_S if lossless else LOSSY_S
        return own if ideal else own * DELIVERED
    try:
        stated = getattr(MODELS.load(model), "seconds_a_trajectory", UNSTATED_S)
    except ModelError:  # whoever only reads a configuration may lack the package
        return UNSTATED_S
    return float(stated) if isinstance(stated, int | float) and 0.0 < stated < math.inf else UNSTATED_S


def rows_a_piece(seconds_a_switch: float, *, n_waveforms: int = 1, piece_s: float = PIECE_S) -> int:
    """Switches of a piece of work that simulates each of them under so many waveforms.

    piece_s: what it should take [s].
    """
    each = seconds_a_switch * n_waveforms
    return min(max(math.floor(piece_s / each), fewest_rows(each)), MOST_ROWS)


def fewest_rows(seconds_a_row: float) -> int:
    """Rows of the smallest piece that is worth a task."""
    return min(max(math.floor(SLOW_PIECE_S / seconds_a_row), 1), SLOW_ROWS)
