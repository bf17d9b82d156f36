"""Owns what a certificate says of a drive, or a model, that is a little off: the best candidate at ±1 and ±3 %.

A model that has the pull-in voltage 1 % too high is a drive that is 1 % too strong.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from softclose.evaluate.pieces import Mapper, here
from softclose.uncertainty.tolerance import DriveError, DriveTolerance
from softclose_workflows.analyses.certification import Certification
from softclose_workflows.analyses.chosen import choose
from softclose_workflows.analyses.drive_errors import tolerance_of
from softclose_workflows.tell.console import wide_console
from softclose_workflows.tell.plain import finite
from softclose_workflows.tell.tables import share, with_interval

GAINS = (-0.03, -0.01, 0.01, 0.03)
"""Relative errors of the drive's volts."""
MOST = 4_000
"""New switches at most: the question is by how much the figures move, not what they are."""
QUICK_S = 5.0
"""What is computed in this process, about [s]: no cluster is started for it."""


def off_by_drive(path: str, result: Certification, *, mapper: Mapper = here) -> tuple[DriveTolerance, ...]:
    """The best certified candidate with every drive too low or too high, after the drive as it is.

    path: of the store; result: its certification, whose first switches they are. mapper: whom to ask where the device
    model says that it takes longer than a cluster takes to start.
    """
    chosen = choose(path, result.best.candidate)
    errors = [DriveError(gain=gain) for gain in GAINS]
    n = min(result.n_switches, MOST)
    quick = (len(errors) + 1) * n * chosen.config.seconds_a_switch < QUICK_S
    return tuple(tolerance_of(chosen, errors, n_switches=n, mapper=here if quick else mapper))


def drive_off_to_json(rows: Sequence[DriveTolerance]) -> list[dict[str, Any]]:
    """One object a row; undefined numbers are null."""
    return [
        finite(
            {
                "gain": row.error.gain,
                "n": row.assessment.n,
                "v_u_cm_s": row.assessment.v_u_cm_s,
                "v_u_interval": list(row.assessment.v_u_interval),
                "p_nc": row.assessment.p_nc,
                "p_nc_interval": list(row.assessment.p_nc_intervals.wilson),
            }
        )
        for row in rows
    ]


def print_drive_off(rows: Sequence[DriveTolerance]) -> None:
    """One line a row, for people."""
    console = wide_console()
    console.print(f"the best, where drive or model is off ({rows[0].assessment.n:,} of the new switches):")
    for row in sorted(rows, key=lambda r: r.error.gain):
        a, gain = row.assessment, 100.0 * row.error.gain
        speed = with_interval(a.v_u_cm_s, *a.v_u_interval)
        open_ = share(a.p_nc, *a.p_nc_intervals.wilson)
        name = f"volts {gain:+g} %" if gain else "as it is"
        console.print(f"  {name:>11}: v_u {speed} cm/s, left open {open_}")
