"""Owns what a trajectory costs, as the device model states it: work is cut by it, never by a clock.

A stated cost is a round figure. It decides how large a piece of work is, and so must not depend on the machine.
"""

from __future__ import annotations

import math

from softclose.device.device import Device
from softclose.plugins import MEASURED, MODELS, REDUCED_ORDER, SINGLE_MODE

PIECE_S = 0.05
"""What a piece of work should take [s]: a scheduler spends a millisecond on each."""

PLAIN_S, LOSSY_S, MODAL_S = 4e-6, 6e-5, 1.5e-4
"""A trajectory of Eqs. 1-2, one with losses, one of several modes [s]."""

UNSTATED_S = 1e-3
"""A trajectory of somebody else's model that states none [s]."""

MOST_ROWS = 10_000
"""Switches of the largest piece: its responses are in memory at once."""


def seconds_a_trajectory(device: Device) -> float:
    """What one trajectory takes, about [s]: of somebody else's model its attribute `seconds_a_trajectory`."""
    if device.name in (SINGLE_MODE, MEASURED):
        return PLAIN_S if device.losses.none else LOSSY_S
    if device.name == REDUCED_ORDER:
        return MODAL_S
    stated = getattr(MODELS.load(device.name), "seconds_a_trajectory", UNSTATED_S)
    return float(stated) if isinstance(stated, int | float) and 0.0 < stated < math.inf else UNSTATED_S


def rows_a_piece(device: Device, *, n_waveforms: int = 1, n_cases: int = 1) -> int:
    """Switches of a piece of work that simulates each of them under so many waveforms, in so many cases."""
    each = seconds_a_trajectory(device) * max(n_waveforms, 1) * max(n_cases, 1)
    return min(max(math.floor(PIECE_S / each), 1), MOST_ROWS)
