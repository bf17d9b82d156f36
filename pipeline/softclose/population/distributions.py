"""Owns the bounded distribution of one switch parameter, and how design and process changes move it (Eqs. 14-15).

Every parameter is a Beta variable on an interval; uniform is Beta(1, 1), and an interval of no width is a fixed
value. Eqs. 14 and 15 are affine, so a changed parameter is again one of these, with other bounds.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Annotated

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from softclose.allowed.tables import TABLE, Number, refuses_with
from softclose.arrays import FloatArray

_N_NODES = 40  # Gauss quadrature; E[M] of the widest population agrees with 200 nodes to the last bit


Area = Annotated[Number, Field(gt=0)]
"""Of a plate [µm²]."""


class PopulationError(ValueError):
    """A population, or a file describing one, that is malformed or unphysical."""


@refuses_with(PopulationError)
@dataclass(frozen=True, slots=True, kw_only=True, config=TABLE)
class Bounded:
    """Beta(alpha, beta) stretched over [lower, upper]."""

    lower: Number
    """Smallest possible value, in the parameter's unit."""
    upper: Number
    """Largest possible value; equal to `lower` for a fixed value."""
    alpha: Number = 1.0
    """First shape parameter, above 0."""
    beta: Number = 1.0
    """Second shape parameter, above 0."""

    def __post_init__(self) -> None:
        if self.upper < self.lower:
            raise PopulationError(f"upper is {self.upper:g}, below lower, {self.lower:g}; exchange them")
        if self.alpha <= 0.0 or self.beta <= 0.0:
            raise PopulationError(f"alpha is {self.alpha:g} and beta {self.beta:g}; both must be above 0")

    @classmethod
    def from_mean(cls, lower: float, upper: float, mean: float, shape_sum: float) -> Bounded:
        """Beta on [lower, upper] with this mean and alpha + beta == shape_sum."""
        if not lower < mean < upper:
            raise PopulationError(f"mean is {mean:g}; it must lie between lower, {lower:g}, and upper, {upper:g}")
        if not shape_sum > 0.0:
            raise PopulationError(f"shape_sum is {shape_sum:g}; alpha + beta must be above 0 (the paper's fit: 4)")
        alpha = shape_sum * (mean - lower) / (upper - lower)
        return cls(lower=lower, upper=upper, alpha=alpha, beta=shape_sum - alpha)

    def to_dict(self) -> dict[str, float]:
        """Keyword arguments that make an equal distribution."""
        return {"lower": self.lower, "upper": self.upper, "alpha": self.alpha, "beta": self.beta}

    @property
    def mean(self) -> float:
        """Expectation."""
        return self.lower + (self.upper - self.lower) * self.alpha / (self.alpha + self.beta)

    @property
    def sd(self) -> float:
        """Standard deviation."""
        s = self.alpha + self.beta
        return (self.upper - self.lower) * math.sqrt(self.alpha * self.beta / (s + 1.0)) / s

    @property
    def is_uniform(self) -> bool:
        """True where every value of the interval is equally likely."""
        return self.alpha == 1.0 and self.beta == 1.0

    def quantile(self, p: FloatArray) -> FloatArray:
        """Values not exceeded with probability p in [0, 1]; any shape. Elementwise, so slices agree bit for bit."""
        if self.upper == self.lower:
            return np.full_like(p, self.lower)
        if self.is_uniform:
            z = p
        else:
            from scipy.special import betaincinv  # 0.1 s to import: not for those who only read a population

            z = betaincinv(self.alpha, self.beta, p)
        # The clip takes back the last bit that rounding may add beyond a bound.
        return np.clip(self.lower + (self.upper - self.lower) * z, self.lower, self.upper)

    def density(self, y: FloatArray) -> FloatArray:
        """Probability density at y, per unit of the parameter; any shape; 0 outside the bounds."""
        from scipy.stats import beta

        return np.asarray(beta.pdf(y, self.alpha, self.beta, loc=self.lower, scale=self.upper - self.lower))

    def expect(self, f: Callable[[FloatArray], FloatArray]) -> float:
        """E[f(Y)] by Gauss-Jacobi quadrature (Gauss-Legendre where uniform): exact for smooth f."""
        if self.upper == self.lower:
            return float(f(np.array([self.lower]))[0])
        nodes, weights = _nodes(self.alpha, self.beta)
        return float(weights @ f(self.lower + (self.upper - self.lower) * nodes))

    def shift_mean(self, delta: float) -> Bounded:
        """Eq. 14: Y' = (1 + delta/mean) Y. The mean moves by delta, the coefficient of variation stays."""
        scale = mean_scale(self.mean, delta)
        return replace(self, lower=scale * self.lower, upper=scale * self.upper)

    def scale_spread(self, factor: float) -> Bounded:
        """Eq. 15: Y'' = mean (1 - factor) + factor Y. The mean stays, the spread is multiplied by factor."""
        check_repeatability(factor)
        offset = self.mean * (1.0 - factor)
        return replace(self, lower=offset + factor * self.lower, upper=offset + factor * self.upper)


def mean_scale(mean: float, delta: float) -> float:
    """What Eq. 14 multiplies by. Raises PopulationError where it would move the mean to 0 or below."""
    scale = 1.0 + delta / mean
    if not scale > 0.0:
        raise PopulationError(f"shift_mean is {delta:g}; it must stay above minus the mean, {-mean:g}")
    return scale


def check_repeatability(factor: float) -> None:
    """Raise PopulationError unless Eq. 15 may multiply a spread by it."""
    if not (math.isfinite(factor) and factor >= 0.0):
        raise PopulationError(f"repeatability is {factor:g}; Eq. 15 needs a factor of 0 or more (the paper's: 0.5)")


def portable(x: float) -> float:
    """x to 12 digits: what the last bit of quadrature nodes (LAPACK) cannot change from one machine to another."""
    return float(f"{x:.12g}")


@functools.cache
def _nodes(alpha: float, beta: float) -> tuple[FloatArray, FloatArray]:
    if alpha == 1.0 and beta == 1.0:
        x, w = np.polynomial.legendre.leggauss(_N_NODES)
    else:
        from scipy.special import roots_jacobi

        x, w = roots_jacobi(_N_NODES, beta - 1.0, alpha - 1.0)
    return 0.5 * (1.0 + x), w / w.sum()
