"""Owns whether a limit on p_nc holds: the interval decides, not the estimate.

p_nc of 0 in 200 switches is no proof of 1 %: a lot of which 1.8 % stay open shows none in 200 just as well.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from softclose.metrics.intervals import Proportion

Verdict = Literal["met", "exceeded", "not established"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Limit:
    """A limit on p_nc, and what an ensemble says of it."""

    p_max: float
    """Largest admissible p_nc."""
    verdict: Verdict
    """met or exceeded where all of Clopper and Pearson's interval lies on that side; else not established."""
    count: int
    """Switches not closed."""
    n: int
    """Switches in all."""
    upper: float
    """Upper end of the interval; NaN where none holds."""
    confidence: float
    """Its confidence."""

    @property
    def sentence(self) -> str:
        """`at most 1 % left open is not established: 0 of 200 open, up to 1.83 % at 95 % confidence; …`."""
        said = {"met": "is met", "exceeded": "is exceeded", "not established": "is not established"}[self.verdict]
        text = f"at most {100.0 * self.p_max:g} % left open"
        if math.isnan(self.upper):
            return f"{text} {said}: the switches are quasi-random, no interval holds; certify"
        text += f" {said}: {self.count:,} of {self.n:,} open, up to {100.0 * self.upper:.2f} % at "
        text += f"{100.0 * self.confidence:g} % confidence"
        if self.verdict == "not established":
            least = least_for_limit(self.p_max, self.confidence)
            text += "; no ensemble can establish 0" if least is None else f"; at least {least:,} switches are needed"
        return text


def limit_on(p: Proportion, p_max: float, confidence: float, *, valid: bool) -> Limit:
    """Judge a limit by the interval of p. valid: the draws are independent, so that intervals hold."""
    lower, upper = p.clopper_pearson if valid else (math.nan, math.nan)
    verdict: Verdict = "met" if upper <= p_max else "exceeded" if lower > p_max else "not established"
    return Limit(p_max=p_max, verdict=verdict, count=p.count, n=p.n, upper=upper, confidence=confidence)


def least_for_limit(p_max: float, confidence: float) -> int | None:
    """Fewest switches that can establish p_nc <= p_max, if all of them close; None for a limit of 0."""
    if p_max <= 0.0:
        return None
    return math.ceil(math.log(0.5 * (1.0 - confidence)) / math.log1p(-p_max))
