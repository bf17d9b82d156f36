"""Owns with how many digits a figure and its interval are written: always the same, and enough to tell the ends apart.

`14.35 (14.3–14.4)` leaves a reader to guess which of the two is rounded, `0.00 (0.00–0.00)` claims what nobody knows.
"""

from __future__ import annotations

import math

LEAST = 2
"""Digits behind the point of speeds [cm/s], voltages [V] and shares [%], at least."""
_OF_UNIT = {"µs": 1, "1": 0}
_MORE = 4
"""Digits beyond the least ones at most: an interval of rounding errors is none."""


def least_digits(unit: str) -> int:
    """Of a quantity in this unit: 1 of times [µs], 0 of counts ("1"), `LEAST` of all else."""
    return _OF_UNIT.get(unit, LEAST)


def digits_of(value: float, lower: float = math.nan, upper: float = math.nan, least: int = LEAST) -> int:
    """Digits behind the point of a figure and of both ends of its interval, in the unit that is printed.

    `least`, and more where the two ends would look the same and are not; without an interval, more where a value that
    is not 0 would look like 0, until it has two significant digits.
    """
    most = least + _MORE
    if math.isfinite(lower) and math.isfinite(upper) and lower != upper:
        return next((d for d in range(least, most) if f"{lower:z.{d}f}" != f"{upper:z.{d}f}"), most)
    if not math.isfinite(value) or value == 0.0 or float(f"{value:.{least}f}") != 0.0:
        return least
    return min(max(least, 1 - math.floor(math.log10(abs(value)))), most)
