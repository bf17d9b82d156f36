"""Owns how the switches that stay open split: never touched, touched and not held, held too late, not integrated.

A contact that is missed and one that is made and lost have different cures: more drive, or more hold.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from softclose.metrics.objective import Response, arrays_of, in_time, those_read


@dataclass(frozen=True, slots=True, kw_only=True)
class OpenKinds:
    """How many switches count as open, and why."""

    n: int
    """Switches in all."""
    n_open: int
    """Those that count as open: the sum of the four kinds."""
    never_touch: int
    """Without a contact within the simulated time."""
    not_held: int
    """Touch, and are not in contact at the end: they bounce on, or fell back."""
    too_late: int
    """In contact at the end, and not yet at `closed_by_us`."""
    not_integrated: int
    """What they would have done is not known."""
    closed_by_us: float
    """Instant from which a switch must be held [µs]; 0: from any."""

    @property
    def sentence(self) -> str:
        """`3,480 of 100,000 switches stay open: 1,510 never touch, 1,970 touch and are not held at the end`."""
        if not self.n_open:
            return f"none of the {self.n:,} switches stays open"
        kinds = (
            (self.never_touch, "never touch"),
            (self.not_held, "touch and are not held at the end"),
            (self.too_late, f"are held later than {self.closed_by_us:g} µs"),
            (self.not_integrated, "could not be integrated"),
        )
        each = ", ".join(f"{count:,} {words}" for count, words in kinds if count)
        return f"{self.n_open:,} of {self.n:,} switches stay open: {each}"

    def to_dict(self) -> dict[str, float]:
        """Plain values."""
        return asdict(self)


def open_kinds(response: Response, closed_by_us: float = 0.0) -> OpenKinds:
    """How the switches that stay open split.

    Parameters
    ----------
    response : Response
        What n switches did.
    closed_by_us : float
        As of the objective [µs].

    Returns
    -------
    OpenKinds
    """
    response = those_read(response)
    speed, held, n_failed = arrays_of(response, 0.0)
    status = np.asarray(getattr(response, "status", np.zeros(speed.size)))
    integrated = status == 0
    touched = ~np.isnan(speed)
    late = held & ~in_time(response, closed_by_us)
    never, not_held = integrated & ~touched & ~held, touched & ~held
    return OpenKinds(
        n=speed.size,
        n_open=int(never.sum() + not_held.sum() + late.sum()) + n_failed,
        never_touch=int(never.sum()),
        not_held=int(not_held.sum()),
        too_late=int(late.sum()),
        not_integrated=n_failed,
        closed_by_us=closed_by_us,
    )
