"""Owns what a certificate says of a drive that is a little off: the best candidate at ±1 and ±3 % of its volts.

A model whose pull-in voltages are 1 % too high is answered with it: to such switches the drive is 1 % too strong.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from softclose.evaluate import judge
from softclose.evaluate.pieces import Mapper, Sent, Work, here, respond_to_all
from softclose.metrics.objective import Assessment, Judged
from softclose.population.lot import Lot
from softclose.settings import CampaignConfig
from softclose.uncertainty.tolerance import driven
from softclose.waveform import Waveform
from softclose_workflows.tell.console import wide_console
from softclose_workflows.tell.labels import signed
from softclose_workflows.tell.plain import finite
from softclose_workflows.tell.tables import share, with_interval

GAINS = (-0.03, -0.01, 0.0, 0.01, 0.03)
"""Relative errors of the drive's volts."""
MOST = 4_000
"""New switches at most: the question is by how much the figures move, not what they are."""
ALIKE = "Volts +1 % is also what happens if the device model’s pull-in voltages are 1 % too high"
"""What such a row says of an error of the model."""
QUICK_S = 5.0
"""What is computed in this process, about [s]: no cluster is started for it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveOff:
    """The best candidate at one error of the drive."""

    gain: float
    """Relative error of the volts."""
    response: Judged
    """What the first new switches did."""
    assessment: Assessment
    """How that is judged."""

    @property
    def name(self) -> str:
        """`volts +1 %`; `volts as designed`."""
        return f"volts {signed(100.0 * self.gain, 0)} %" if self.gain else "volts as designed"


def off_by_drive(
    config: CampaignConfig, lot: Lot, waveform: Waveform, response: Judged, *, mapper: Mapper = here
) -> tuple[DriveOff, ...]:
    """A waveform with every drive too weak or too strong, the weakest first.

    lot: new switches; response: what they, and perhaps more behind them, did under the drive as it is. mapper: whom to
    ask where the device model says that it takes longer than a cluster takes to start.
    """
    sent, wrong = Sent(config), [gain for gain in GAINS if gain]
    works = [Work(sent=sent, lot=driven(lot, gain), drive=waveform) for gain in wrong]
    quick = len(wrong) * len(lot) * config.seconds_a_switch < QUICK_S
    found = dict(zip(wrong, respond_to_all(works, here if quick else mapper), strict=True))
    return tuple(drive_off_of(config, gain, found.get(gain, response.first(len(lot)))) for gain in GAINS)


def drive_off_of(config: CampaignConfig, gain: float, response: Judged) -> DriveOff:
    """One error of the drive from what the switches did under it."""
    return DriveOff(gain=gain, response=response, assessment=judge(config, response, fresh=True))


def drive_off_to_json(rows: Sequence[DriveOff]) -> list[dict[str, Any]]:
    """One object a row; undefined numbers are null."""
    return [
        finite(
            {
                "gain": row.gain,
                "n": row.assessment.n,
                "v_u_cm_s": row.assessment.v_u_cm_s,
                "v_u_interval": list(row.assessment.v_u_interval),
                "p_nc": row.assessment.p_nc,
                "p_nc_interval": list(row.assessment.p_nc_intervals.wilson),
            }
        )
        for row in rows
    ]


def drive_off_lines(rows: Sequence[DriveOff], n_switches: int) -> list[str]:
    """A heading and one line a row, for people; [] without any. n_switches: those of the whole certificate."""
    if not rows:
        return []
    n = rows[0].assessment.n
    lines = [f"the best where its volts are off, {on_switches(n, n_switches)}:"]
    for row in rows:
        a = row.assessment
        speed = with_interval(a.v_u_cm_s, *a.v_u_interval)
        lines.append(f"  {row.name:>17}: v_u {speed} cm/s, left open {share(a.p_nc, *a.p_nc_intervals.wilson)}")
    return [*lines, *(f"  {line}" for line in (*few_lines(n, n_switches), ALIKE))]


def on_switches(n: int, n_switches: int) -> str:
    """`on the first 4,000 of the 100,000 new switches`."""
    return f"on all {n:,} new switches" if n >= n_switches else f"on the first {n:,} of the {n_switches:,} new switches"


def few_lines(n: int, n_switches: int) -> list[str]:
    """That figures of some of the new switches are not those of all; [] where they are."""
    if n >= n_switches:
        return []
    return [
        f"Compare these rows with each other: on all {n_switches:,} switches the figures as designed differ a little"
    ]


def print_drive_off(rows: Sequence[DriveOff], n_switches: int) -> None:
    """The same, printed."""
    console = wide_console()
    for line in drive_off_lines(rows, n_switches):
        console.print(line)
