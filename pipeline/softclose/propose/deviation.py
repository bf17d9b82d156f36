"""Owns how sure a process is: prediction and deviation of g itself, in cm/s, and by how much it was too sure so far."""

from __future__ import annotations

import math
from collections.abc import Sequence

from softclose.propose.protocol import Observation

PREDICTED, PREDICTED_SD = "predicted_g_cm_s", "predicted_sd_cm_s"
"""What a proposal says of the g that it expects, and of its standard deviation [cm/s]."""

FACTOR = "deviation_factor"
"""What the deviation was multiplied with."""

TOO_SURE, COUNTS_AS, LAST, FARTHEST = 1.5, 8, 40, 4.0
"""A deviation is multiplied with the root mean square of the last errors, in deviations, none counted as more than
FARTHEST, held at TOO_SURE as if by COUNTS_AS earlier ones."""


def too_sure(records: Sequence[Observation]) -> float:
    """By how much deviations have been too small so far: root mean square error, in deviations as the process has
    them, of the last candidates that it predicted."""
    errors = [
        min(abs(o.g_cm_s - o.beliefs[PREDICTED]) * o.beliefs[FACTOR] / o.beliefs[PREDICTED_SD], FARTHEST)
        for o in records
        if o.beliefs.get(PREDICTED_SD, 0.0) > 0.0 and FACTOR in o.beliefs
    ][-LAST:]
    squares = COUNTS_AS * TOO_SURE**2 + sum(e * e for e in errors)
    return math.sqrt(squares / (COUNTS_AS + len(errors)))
