"""Owns distributions of a parameter beside the bounded ones: truncated normal and lognormal, and a lot's own devices.

All are mapped from uniforms by their quantile function, elementwise, as `Bounded` is: the same rows of an ensemble's
uniforms, the copula, Eqs. 14 and 15 and every method of reliability serve them too.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Discriminator, Tag
from pydantic.dataclasses import dataclass

from softclose.allowed.refusal import Said
from softclose.allowed.tables import TABLE, Number, refuses_with
from softclose.arrays import FloatArray
from softclose.population.distributions import Bounded, PopulationError, check_repeatability, mean_scale

Parent = Literal["normal", "lognormal"]

FEWEST_DEVICES = 5
"""Fewer devices are no distribution."""

Values = Annotated[tuple[Number, ...], Said("a list of finite numbers, one a device")]

_N_NODES = 400
_MOST_SIGMAS = 8.0
"""Truncated further out, a distribution is not truncated: Φ(-8) is 6e-16."""


@refuses_with(PopulationError)
@dataclass(frozen=True, slots=True, kw_only=True, config=TABLE)
class Truncated:
    """Y = offset + factor X, with X normal or lognormal and within [low, high]."""

    kind: Parent
    """Distribution of X before it is truncated."""
    location: Number
    """Mean of X, or of its logarithm, before truncation."""
    scale: Number
    """Standard deviation of X, or of its logarithm, before truncation; above 0."""
    low: Number
    """Smallest X."""
    high: Number
    """Largest X."""
    offset: Number = 0.0
    """What Eq. 15 adds."""
    factor: Number = 1.0
    """What Eqs. 14 and 15 multiply by."""

    def __post_init__(self) -> None:
        if not self.scale > 0.0:
            raise PopulationError(f"scale is {self.scale:g}; it must be above 0 (a value without spread is fixed)")
        if not self.low < self.high:
            raise PopulationError(f"the truncation is from {self.low:g} to {self.high:g}; its upper end must be larger")
        if self.kind == "lognormal" and self.low <= 0.0:
            raise PopulationError(f"the truncation begins at {self.low:g}; a lognormal value is above 0")
        a, b = self._ends
        if b < -_MOST_SIGMAS or a > _MOST_SIGMAS:
            raise PopulationError(
                f"the truncation, {self.low:g} to {self.high:g}, is more than {_MOST_SIGMAS:g} standard deviations "
                "from the mean: nothing is left of the distribution"
            )

    @classmethod
    def from_moments(cls, kind: Parent, mean: float, sd: float, lower: float, upper: float) -> Truncated:
        """A distribution whose mean and standard deviation are these before it is truncated to [lower, upper]."""
        if not sd > 0.0:
            raise PopulationError(f"sd is {sd:g}; it must be above 0 (a value without spread is fixed)")
        if kind == "normal":
            return cls(kind=kind, location=mean, scale=sd, low=lower, high=upper)
        if not mean > 0.0:
            raise PopulationError(f"mean is {mean:g}; that of a lognormal value is above 0")
        variance = math.log1p((sd / mean) ** 2)
        return cls(
            kind=kind, location=math.log(mean) - 0.5 * variance, scale=math.sqrt(variance), low=lower, high=upper
        )

    def to_dict(self) -> dict[str, Any]:
        """Keyword arguments that make an equal distribution."""
        found: dict[str, Any] = {"kind": self.kind, "location": self.location, "scale": self.scale}
        found |= {"low": self.low, "high": self.high}
        return found | (
            {"offset": self.offset, "factor": self.factor} if (self.offset, self.factor) != (0.0, 1.0) else {}
        )

    @property
    def _ends(self) -> tuple[float, float]:
        """The truncation in standard deviations."""
        low, high = (math.log(v) if self.kind == "lognormal" else v for v in (self.low, self.high))
        return (low - self.location) / self.scale, (high - self.location) / self.scale

    @property
    def lower(self) -> float:
        """Smallest possible value."""
        return self.offset + self.factor * self.low

    @property
    def upper(self) -> float:
        """Largest possible value."""
        return self.offset + self.factor * self.high

    @property
    def mean(self) -> float:
        """Expectation, truncation included."""
        return self.expect(lambda y: y)

    @property
    def sd(self) -> float:
        """Standard deviation, truncation included."""
        mean = self.mean
        return math.sqrt(self.expect(lambda y: (y - mean) ** 2))

    def quantile(self, p: FloatArray) -> FloatArray:
        """Values not exceeded with probability p in [0, 1]; any shape. Elementwise, so slices agree bit for bit."""
        from scipy.special import ndtr, ndtri

        a, b = self._ends
        p = np.asarray(p, dtype=np.float64)
        below = ndtri(ndtr(a) + p * (ndtr(b) - ndtr(a)))
        above = -ndtri(ndtr(-b) + (1.0 - p) * (ndtr(-a) - ndtr(-b)))
        z = np.where(below > 0.0, above, below)  # each from its own tail, where probabilities keep their digits
        x = self.location + self.scale * z
        x = np.exp(x) if self.kind == "lognormal" else x
        return np.asarray(self.offset + self.factor * np.clip(x, self.low, self.high))

    def density(self, y: FloatArray) -> FloatArray:
        """Probability density at y, per unit of the parameter; any shape; 0 outside the bounds."""
        if self.factor == 0.0:
            raise PopulationError("a value without spread has no density")
        x = (np.asarray(y, dtype=np.float64) - self.offset) / self.factor
        inside = (x >= self.low) & (x <= self.high)
        return np.where(inside, self._density_of_x(np.where(inside, x, self.low)) / self.factor, 0.0)

    def _density_of_x(self, x: FloatArray) -> FloatArray:
        from scipy.special import ndtr

        a, b = self._ends
        t = np.log(x) if self.kind == "lognormal" else x
        z = (t - self.location) / self.scale
        mass = ndtr(-a) - ndtr(-b) if a > 0.0 else ndtr(b) - ndtr(a)
        jacobian = x if self.kind == "lognormal" else 1.0
        return np.asarray(np.exp(-0.5 * z * z) / (math.sqrt(2.0 * math.pi) * self.scale * mass * jacobian))

    def expect(self, f: Callable[[FloatArray], FloatArray]) -> float:
        """E[f(Y)] by Gauss-Legendre quadrature over the part of the truncation that has any probability."""
        a, b = (min(max(end, -_MOST_SIGMAS), _MOST_SIGMAS) for end in self._ends)
        nodes, weights = _legendre()
        z = a + (b - a) * nodes
        mass = weights * np.exp(-0.5 * (z * z - min(a * a, b * b) * (a * b > 0.0)))
        x = self.location + self.scale * z
        x = np.exp(x) if self.kind == "lognormal" else x
        return float((mass / mass.sum()) @ f(self.offset + self.factor * np.clip(x, self.low, self.high)))

    def shift_mean(self, delta: float) -> Truncated:
        """Eq. 14: Y' = (1 + delta/mean) Y. The mean moves by delta, the coefficient of variation stays."""
        scale = mean_scale(self.mean, delta)
        return replace(self, offset=scale * self.offset, factor=scale * self.factor)

    def scale_spread(self, factor: float) -> Truncated:
        """Eq. 15: Y'' = mean (1 - factor) + factor Y. The mean stays, the spread is multiplied by factor."""
        check_repeatability(factor)
        return replace(self, offset=self.mean * (1.0 - factor) + factor * self.offset, factor=factor * self.factor)


@refuses_with(PopulationError)
@dataclass(frozen=True, slots=True, kw_only=True, config=TABLE)
class Empirical:
    """A lot's own devices: each measured value as likely as every other."""

    values: Values
    """Measured values, in any order."""

    def __post_init__(self) -> None:
        if len(self.values) < FEWEST_DEVICES:
            raise PopulationError(
                f"values has {len(self.values)} devices; {FEWEST_DEVICES} finite ones at least make a distribution"
            )
        object.__setattr__(self, "values", tuple(sorted(self.values)))

    def to_dict(self) -> dict[str, Any]:
        """Keyword arguments that make an equal distribution."""
        return {"values": list(self.values)}

    @property
    def lower(self) -> float:
        """Smallest value."""
        return self.values[0]

    @property
    def upper(self) -> float:
        """Largest value."""
        return self.values[-1]

    @property
    def mean(self) -> float:
        """Mean of the devices."""
        return math.fsum(self.values) / len(self.values)

    @property
    def sd(self) -> float:
        """Standard deviation of the distribution, which is that of the devices with their number as divisor."""
        return float(np.std(self.values))

    def quantile(self, p: FloatArray) -> FloatArray:
        """Values not exceeded with probability p in [0, 1]; any shape: steps, one a device."""
        n = len(self.values)
        return np.asarray(self.values)[np.minimum((np.asarray(p) * n).astype(np.intp), n - 1)]

    def density(self, y: FloatArray) -> FloatArray:
        """A kernel estimate at y, for pictures: the distribution itself has steps. Silverman's width."""
        values = np.asarray(self.values)
        width = 0.9 * max(float(values.std()), 1e-12 * abs(self.mean)) * values.size**-0.2
        z = (np.asarray(y, dtype=np.float64)[..., None] - values) / width
        return np.asarray(np.exp(-0.5 * z * z).mean(axis=-1) / (math.sqrt(2.0 * math.pi) * width))

    def expect(self, f: Callable[[FloatArray], FloatArray]) -> float:
        """E[f(Y)]: the mean over the devices."""
        return float(np.mean(f(np.asarray(self.values))))

    def shift_mean(self, delta: float) -> Empirical:
        """Eq. 14: Y' = (1 + delta/mean) Y."""
        scale = mean_scale(self.mean, delta)
        return Empirical(values=tuple(scale * v for v in self.values))

    def scale_spread(self, factor: float) -> Empirical:
        """Eq. 15: Y'' = mean (1 - factor) + factor Y."""
        check_repeatability(factor)
        return Empirical(values=tuple(self.mean * (1.0 - factor) + factor * v for v in self.values))


def _form(marginal: object) -> str:
    """Which of the three a distribution is, or its `to_dict`."""
    if isinstance(marginal, Mapping):
        return "Empirical" if "values" in marginal else "Truncated" if "kind" in marginal else "Bounded"
    return type(marginal).__name__


Marginal = Annotated[
    Annotated[Bounded, Tag("Bounded")]
    | Annotated[Truncated, Tag("Truncated")]
    | Annotated[Empirical, Tag("Empirical")],
    Discriminator(_form),
]
"""Distribution of one parameter."""


@functools.cache
def _legendre() -> tuple[FloatArray, FloatArray]:
    x, w = np.polynomial.legendre.leggauss(_N_NODES)
    return 0.5 * (1.0 + x), 0.5 * w
