"""Owns what a campaign's evaluation adds to its prior: a Gaussian process with the prior as its mean.

On the scale z = arsinh((g - best) / width), linear at the best and logarithmic far from it, z of the campaign is
ρ·z of the prior + a constant + a process over the search space (autoregressive co-kriging: Kennedy and O'Hagan 2000,
Le Gratiet 2014). Without a prior the first term is left out.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from softclose.arrays import FloatArray
from softclose.propose.protocol import Problem
from softclose.propose.surrogate import Screened, Surrogate, fit, surrogate_inputs

WIDTH_CM_S = 2.0
"""Width of the linear part of the scale: what differences between basins are about [cm/s]."""

RHO_SD, CONSTANT_SD, RESIDUAL_SD = 0.3, 1.0, 0.3
"""Prior standard deviations of ρ about 1 and of the constant about 0, and of what the two leave, on the scale z."""

LEAST_SPREAD = 0.02
"""Least standard deviation of the process, on the scale z: with few points it would be sure of what it has not seen."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ArsinhScale:
    """z = arsinh((g - best) / width), and back."""

    best_cm_s: float
    width_cm_s: float = WIDTH_CM_S

    def z(self, g_cm_s: FloatArray) -> FloatArray:
        """(n,) of g [cm/s]."""
        return np.asarray(np.arcsinh((g_cm_s - self.best_cm_s) / self.width_cm_s))

    def g(self, mean: FloatArray, sd: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean and standard deviation of g [cm/s] where z is normal: those of a shifted sinh of a normal variable."""
        # Farther than this from the best nothing is told apart, and the exponentials would overflow.
        m, s2 = np.clip(mean, -8.0, 8.0), np.minimum(sd, 3.0) ** 2
        expected = np.sinh(m) * np.exp(0.5 * s2)
        variance = 0.5 * (np.exp(2.0 * s2) * np.cosh(2.0 * m) - 1.0) - expected**2
        return (
            self.best_cm_s + self.width_cm_s * expected,
            self.width_cm_s * np.sqrt(np.maximum(variance, 0.0)),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Known:
    """What a campaign has found: n usable candidates that are points of the search space."""

    points: FloatArray
    """(n, d) canonical."""
    inputs: FloatArray
    """(n, d + 4) what the surrogate sees of them."""
    g_cm_s: FloatArray
    """(n,) the campaign's [cm/s]."""
    prior_g_cm_s: FloatArray
    """(n,) the prior's [cm/s]."""

    def nearest(self, place: int, n: int) -> Known:
        """The n of them that are nearest to one, itself first."""
        near = np.argsort(((self.points - self.points[place]) ** 2).sum(axis=1), kind="stable")[:n]
        return Known(
            points=self.points[near],
            inputs=self.inputs[near],
            g_cm_s=self.g_cm_s[near],
            prior_g_cm_s=self.prior_g_cm_s[near],
        )


class Correction:
    """The process around one incumbent."""

    def __init__(self, problem: Problem, known: Known, incumbent: int) -> None:
        """incumbent: place of the record around which it is local, the best of its trust region."""
        settings = problem.config.optimiser
        near = known.nearest(incumbent, settings.n_fit)
        self._problem = problem
        self.scale = ArsinhScale(best_cm_s=float(near.g_cm_s[0]))
        z, prior = self.scale.z(near.g_cm_s), self.scale.z(near.prior_g_cm_s)
        self.rho, self.constant = trend(z, prior)
        rest = z - self.trend(near.prior_g_cm_s)
        self.spread = max(float(rest.std()), LEAST_SPREAD)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # bounds of the length scales are met often
            self.model: Surrogate = fit(
                near.inputs, rest / self.spread, settings.fit_iterations, near.inputs[0], settings.n_fit
            )

    def trend(self, prior_g_cm_s: FloatArray) -> FloatArray:
        """(n,) what is expected before anything is learnt by points, on the scale z."""
        return np.asarray(self.rho * self.scale.z(prior_g_cm_s) + self.constant)

    def believe(self, points: FloatArray) -> None:
        """Count points (m, d) that are in flight as evaluated, with what is expected of them."""
        for inputs in surrogate_inputs(self._problem, points) if len(points) else ():
            self.model.believe(inputs)

    def screen(self, points: FloatArray, prior_g_cm_s: FloatArray) -> Looks:
        """Points (m, d) that the prior was asked about."""
        return Looks(
            correction=self,
            screened=Screened(self.model, points, surrogate_inputs(self._problem, points)),
            prior_g_cm_s=prior_g_cm_s,
        )


def trend(z: FloatArray, prior: FloatArray) -> tuple[float, float]:
    """ρ and constant by least squares, held near 1 and 0 where few candidates say otherwise; bad ones count little."""
    weight = 1.0 / (1.0 + np.maximum(z, 0.0) ** 2)
    basis = np.column_stack([prior, np.ones_like(prior)])
    weighted = basis.T * weight / RESIDUAL_SD**2
    held = np.diag([RHO_SD**-2, CONSTANT_SD**-2])
    found = np.linalg.solve(weighted @ basis + held, weighted @ z + held @ np.array([1.0, 0.0]))
    return float(found[0]), float(found[1])


@dataclass(slots=True, kw_only=True, eq=False)
class Looks:
    """Points that were looked at with the prior, and what the process makes of them as it takes some on trust."""

    correction: Correction
    screened: Screened
    prior_g_cm_s: FloatArray

    def join(self, other: Looks) -> None:
        """Take in the points of another one of the same process."""
        self.screened.join(other.screened)
        self.prior_g_cm_s = np.concatenate([self.prior_g_cm_s, other.prior_g_cm_s])

    @property
    def points(self) -> FloatArray:
        """(m, d) the points."""
        return self.screened.points

    def z(self) -> tuple[FloatArray, FloatArray]:
        """(m,) mean and standard deviation on the scale z; NaN where the prior has no answer."""
        mean, sd = self.screened.predict(None)
        c = self.correction
        return c.trend(self.prior_g_cm_s) + c.spread * mean, c.spread * sd

    def improvement(self) -> FloatArray:
        """(m,) expected improvement on the incumbent, on the scale z; -inf where the prior has no answer."""
        mean, sd = self.z()
        u = -mean / sd
        found = sd * (u * ndtr(u) + np.exp(-0.5 * u**2) / np.sqrt(2.0 * np.pi))
        # Where none can be expected the better mean is the better choice.
        return np.where(np.isfinite(found), found - 1e-9 * mean, -np.inf)

    def bound(self, width: float) -> FloatArray:
        """(m,) mean less `width` standard deviations, on the scale z; inf where the prior has no answer."""
        mean, sd = self.z()
        return np.where(np.isfinite(mean), mean - width * sd, np.inf)

    def believe(self, place: int) -> None:
        """Count one of the points as evaluated, with what is expected of it."""
        self.screened.believe(self.screened.inputs[place])
