"""Owns what the descents that share a wave will ask for next: they are independent until the better half goes on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from softclose.arrays import FloatArray
from softclose.propose.descents import Beginning, continued
from softclose.propose.protocol import Problem


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sharing:
    """A descent that has an equal share of a wave."""

    beginning: Beginning
    told: tuple[FloatArray, ...]
    """(generation,) each: what it was told before the wave [cm/s]."""

    def points(self, problem: Problem) -> FloatArray:
        """(generation, d) its share."""
        return continued(problem, self.beginning, self.told).points()

    def after(self, *told: FloatArray) -> Sharing:
        """The same once it is told of more generations."""
        return Sharing(beginning=self.beginning, told=(*self.told, *told))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Following:
    """A wave that is made of whole generations, and what follows it."""

    sharing: Sequence[Sharing]
    """The descents that share it, in their order."""
    n_left: int
    """Waves after this one that the same descents share: what each asks for there follows from its own values."""


def as_told(g_cm_s: FloatArray) -> FloatArray:
    """(n,) what a descent is told of waveforms: those without a value are worse than any [cm/s]."""
    return np.where(np.isfinite(g_cm_s), g_cm_s, np.inf)
