"""Owns the surrogate: skopt's Gaussian process over a space's coordinates and what the free swing adds to them.

Matérn-5/2 with one length scale per input plus white noise, hyperparameters by maximum a posteriori from a fixed start:
a pure function of the records.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.optimize import minimize
from scipy.spatial.distance import cdist
from skopt.acquisition import gaussian_ei
from skopt.learning import GaussianProcessRegressor
from skopt.learning.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel

from softclose.arrays import FloatArray
from softclose.metrics.ranking import levelled
from softclose.propose.evidence import Evidence
from softclose.propose.protocol import Observation, Problem
from softclose.propose.regions import REGION
from softclose.propose.swing import FARTHEST, free_swing

JITTER = 1e-8
"""Added to the diagonal of the covariance."""


class Surrogate(GaussianProcessRegressor):  # type: ignore[misc]
    """skopt's GP with a prediction whose cost is one triangular solve, and points that it takes on trust.

    skopt's own contracts K* K⁻¹ K* with an unoptimised einsum: 120 ms for 3,000 points at n = 200, against 10 ms.
    """

    L_: FloatArray
    alpha_: FloatArray
    X_train_: FloatArray
    y_train_: FloatArray

    def predict(self, X: Any, return_std: bool = False, **options: Any) -> Any:
        if not return_std or options:
            return super().predict(X, return_std=return_std, **options)
        mean, half, prior = self.projected(np.asarray(X, dtype=np.float64))
        return mean, _deviation(prior - np.einsum("ij,ij->j", half, half))

    def projected(self, inputs: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        """(m,) mean at the inputs, (n, m) L⁻¹K with the factor L of the training covariance, and the prior variance."""
        cross = self.covariance(self.X_train_, inputs)
        half = solve_triangular(self.L_, cross, lower=True, check_finite=False)
        return self.alpha_ @ cross, half, self._hyper()[0]

    def covariance(self, a: FloatArray, b: FloatArray) -> FloatArray:
        """(n, m) the kernel without its noise, which scikit-learn builds through a temporary for each of its parts."""
        amplitude, scales = self._hyper()
        r = cdist(a / scales, b / scales)
        r *= math.sqrt(5.0)
        return np.asarray(amplitude * (1.0 + r + r**2 / 3.0) * np.exp(-r))

    def _hyper(self) -> tuple[float, FloatArray]:
        found = self.kernel_.get_params()
        return float(found["k1__k1__constant_value"]), np.asarray(found["k1__k2__length_scale"], dtype=np.float64)

    def believe(self, inputs: FloatArray) -> FloatArray:
        """Kriging believer: count one point (d,) as evaluated, with what is expected of it, and the same
        hyperparameters. Returns the (n + 1,) new row of the factor.

        What is expected leaves every mean as it was: only the factor grows.
        """
        _, half, prior = self.projected(inputs[None])
        rest = prior + float(self.noise_ or 0.0) + JITTER - float(half[:, 0] @ half[:, 0])
        row = np.append(half[:, 0], math.sqrt(max(rest, JITTER)))
        factor = np.zeros((len(row), len(row)))
        factor[:-1, :-1], factor[-1] = self.L_, row
        self.L_, self.alpha_ = factor, np.append(self.alpha_, 0.0)
        self.X_train_ = np.vstack([self.X_train_, inputs])
        return row


class Screened:
    """Points at which the acquisition was evaluated, and what the surrogate makes of them as it takes on more."""

    def __init__(self, model: Surrogate, points: FloatArray, inputs: FloatArray) -> None:
        self._model = model
        self.points, self.inputs = points, inputs
        self._mean, self._half, prior = model.projected(inputs)
        self._variance = prior - np.einsum("ij,ij->j", self._half, self._half)

    def predict(self, X: Any, return_std: bool = True) -> tuple[FloatArray, FloatArray]:
        """(m,) mean and standard deviation at `inputs`: what skopt's acquisition functions ask a model for."""
        return self._mean, _deviation(self._variance)

    def improvement(self, target: float) -> FloatArray:
        """(m,) expected improvement below the target."""
        return np.asarray(gaussian_ei(self.inputs, self, target, xi=0.0))

    def join(self, other: Screened) -> None:
        """Take in the points of another one of the same surrogate."""
        self.points = np.concatenate([self.points, other.points])
        self.inputs = np.concatenate([self.inputs, other.inputs])
        self._mean = np.concatenate([self._mean, other._mean])
        self._half = np.concatenate([self._half, other._half], axis=1)
        self._variance = np.concatenate([self._variance, other._variance])

    def believe(self, inputs: FloatArray) -> None:
        """The surrogate takes one point (d,) on trust; what it makes of the others follows by one row."""
        row = self._model.believe(inputs)
        cross = self._model.covariance(inputs[None], self.inputs)[0]
        fresh = (cross - row[:-1] @ self._half) / row[-1]
        self._half = np.vstack([self._half, fresh])
        self._variance = self._variance - fresh**2


def _deviation(variance: FloatArray) -> FloatArray:
    return np.sqrt(np.maximum(variance, 1e-18))


@dataclass(frozen=True, slots=True, kw_only=True)
class SurrogateData:
    """What the surrogate learns from: canonical points, its inputs there and g, beyond `max_open` as `levelled`."""

    points: FloatArray
    inputs: FloatArray
    g: FloatArray
    origins: tuple[str, ...]
    indices: NDArray[np.int64]
    waves: tuple[int, ...]
    regions: FloatArray
    """(n,) number of the trust region that each was proposed for; NaN where it was for none."""


def collect(problem: Problem, history: Sequence[Observation]) -> SurrogateData:
    """The usable records that are points of the space; a failed candidate or one of another form teaches nothing."""
    usable = [o for o in history if o.usable]
    points, places = problem.space.coordinates_of_all([o.waveform for o in usable])
    near = np.isfinite(points).all(axis=1) & (np.abs(points - 0.5) <= 1.0).all(axis=1)
    points, kept = points[near], [usable[place] for place in places[near]]
    return SurrogateData(
        points=points,
        inputs=surrogate_inputs(problem, points),
        g=levelled([o.rank_cm_s for o in kept]),
        origins=tuple(o.origin for o in kept),
        indices=np.array([o.index for o in kept], dtype=np.int64),
        waves=tuple(o.wave for o in kept),
        regions=np.array([o.beliefs.get(REGION, math.nan) for o in kept]),
    )


def surrogate_inputs(problem: Problem, points: FloatArray) -> FloatArray:
    """(n, d + 4) what the surrogate sees: the coordinates, then reach and dispersion of the lot's free swing and the
    state of the mean switch when the last pulse begins, each in about [0, 1]."""
    rows = problem.space.rows(points)
    swing = free_swing(rows, problem.lot, instant_us=rows[:, -1, 0])
    phase = np.clip(np.stack([swing.x[:, 0], swing.v[:, 0]], axis=1) / (2.0 * FARTHEST) + 0.5, 0.0, 1.0)
    return np.column_stack([points, swing.mean / FARTHEST, np.log(swing.sd + 0.01) / math.log(30.0) + 1.2, phase])


def logarithmic(g: FloatArray) -> tuple[FloatArray, float]:
    """The logarithm of g above the best, its spread about 1, and how much of it is 1 cm/s at the best.

    What is far above the median says only "bad".
    """
    best, scale, middle, spread = _of_logarithm(g)
    return (np.log1p((g - best) / scale) - middle) / spread, 1.0 / (scale * spread)


def of_logarithm(g: FloatArray, mean: FloatArray, sd: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean and standard deviation of g itself [cm/s] where `logarithmic(g)` is normal: those of a shifted lognormal."""
    best, scale, middle, spread = _of_logarithm(g)
    # Farther than this from the best nothing is told apart, and the exponentials would overflow.
    m, s2 = np.clip(middle + spread * mean, -8.0, 8.0), np.minimum(spread * sd, 3.0) ** 2
    grown = np.exp(m + 0.5 * s2)
    return best + scale * (grown - 1.0), scale * grown * np.sqrt(np.expm1(s2))


def _of_logarithm(g: FloatArray) -> tuple[float, float, float, float]:
    """Best and width of the scale [cm/s], and what of its logarithm is 0 and 1."""
    best = float(g.min())
    scale = max(0.25 * (float(np.median(g)) - best), 1e-3)
    y = np.log1p((g - best) / scale)
    return best, scale, float(y.mean()), max(float(y.std()), 1e-9)


def clipped(g: FloatArray) -> tuple[FloatArray, float]:
    """g cut off as far above the median as the best is below it, its spread about 1, and how much of it is 1 cm/s."""
    best, middle = float(g.min()), float(np.median(g))
    y = np.minimum(g, max(middle + (middle - best), best + 1e-3))
    spread = max(float(y.std()), 1e-9)
    return (y - y.mean()) / spread, 1.0 / spread


def fit(
    points: FloatArray,
    y: FloatArray,
    max_iterations: int,
    centre: FloatArray | None = None,
    n_fit: int = 200,
) -> Surrogate:
    """Hyperparameters by maximum likelihood from a fixed start: nothing is carried over from earlier proposals."""
    dim = points.shape[1]
    kernel = ConstantKernel(1.0, (0.05, 50.0)) * Matern(
        length_scale=np.full(dim, 0.5), length_scale_bounds=(0.05, 4.0), nu=2.5
    ) + WhiteKernel(1e-3, (1e-6, 0.2))
    if centre is None:
        centre = points[int(np.argmin(y))]
    near = np.argsort(((points - centre) ** 2).sum(axis=1), kind="stable")[:n_fit]
    evidence = Evidence(points[near], y[near], np.full(len(near), JITTER))
    centre_of_prior = np.log([1.0, *([0.5] * dim), 1e-3])
    width_of_prior = np.array([1.0, *([0.8] * dim), 2.0])

    def posterior(t: FloatArray) -> tuple[float, FloatArray]:
        value, gradient = evidence(t)
        pull = (t - centre_of_prior) / width_of_prior
        return value + 0.5 * float(pull @ pull), gradient + pull / width_of_prior

    def optimise(_: Callable[..., Any], theta: FloatArray, bounds: FloatArray) -> tuple[FloatArray, float]:
        found = minimize(
            posterior, theta, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": max_iterations}
        )
        return found.x, float(found.fun)

    model = Surrogate(kernel, alpha=JITTER, optimizer=optimise, noise="gaussian")
    model.fit(points[near], y[near])
    if len(near) == len(points):
        return model
    everything = Surrogate(model.kernel_, alpha=float(model.noise_ or 0.0) + JITTER, optimizer=None)
    everything.fit(points, y)
    everything.noise_ = model.noise_
    return everything
