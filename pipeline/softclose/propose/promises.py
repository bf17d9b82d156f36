"""Owns what a prior says: g of waveforms, its basins, and whoever can be asked for them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from softclose.arrays import FloatArray
from softclose.waveform import Waveform


class PriorError(Exception):
    """The prior could not be asked, for a fault of the machine: no engine's failure, and never recorded as one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PriorValues:
    """What the prior says of n waveforms."""

    g_cm_s: FloatArray
    """(n,) the objective on the prior's switches [cm/s], above that of any lot that closes where more than
    `objective.max_open` stay open; NaN where the prior's model has no answer."""
    failure: str = ""
    """Why, of the first of those; empty where there is none."""


Ask = Callable[[Sequence[Waveform], int], PriorValues]
"""Who evaluates waveforms on so many switches of the prior: this process, or workers."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Basins:
    """What the prior promises: its best basins, the best first."""

    waveforms: tuple[Waveform, ...]
    """The best of each; none where the prior failed."""
    g_cm_s: FloatArray
    """(n,) what the prior promises of each [cm/s]."""
    shapes: FloatArray
    """(n, d, d) which way each runs: lower factors of the steps of the descents that found them, determinant 1."""
    n_tried: int
    """Waveforms that were tried on the prior."""
    failure: str = ""
    """Why the prior has no answer, where it has none."""


class PriorHelp(Protocol):
    """Whoever knows the basins of a campaign's prior, and evaluates waveforms on it."""

    def basins(self) -> Basins:
        """The basins: `find_basins` of the configuration."""
        ...

    def values(self, waveforms: Sequence[Waveform], n_switches: int | None = None) -> PriorValues:
        """`Prior.values` of the waveforms."""
        ...
