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
from skopt.learning import GaussianProcessRegressor
from skopt.learning.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel

from softclose.propose.protocol import Observation, Problem
from softclose.propose.swing import FARTHEST, free_swing
from softclose.waveform import Waveform
from softclose.waveform.spaces import SpaceError

FloatArray = NDArray[np.float64]


class Surrogate(GaussianProcessRegressor):  # type: ignore[misc]
    """skopt's GP with a prediction whose cost is one triangular solve.

    skopt's own contracts K* K⁻¹ K* with an unoptimised einsum: 120 ms for 3,000 points at n = 200, against 10 ms.
    """

    def predict(self, X: Any, return_std: bool = False, **options: Any) -> Any:
        if not return_std or options or len(X) == 1:
            return super().predict(X, return_std=return_std, **options)
        cross = self.kernel_(X, self.X_train_)
        mean = cross @ self.alpha_
        half = solve_triangular(self.L_, cross.T, lower=True, check_finite=False)
        variance = np.maximum(self.kernel_.diag(X) - np.einsum("ij,ij->j", half, half), 1e-18)
        return mean, np.sqrt(variance)


@dataclass(frozen=True, slots=True, kw_only=True)
class SurrogateData:
    """What the surrogate learns from: canonical points, its inputs there, g and the noise of g."""

    points: FloatArray
    inputs: FloatArray
    g: FloatArray
    se: FloatArray
    origins: tuple[str, ...]
    indices: NDArray[np.int64]


def collect(problem: Problem, history: Sequence[Observation]) -> SurrogateData:
    """The usable records that are points of the space; a failed candidate or one of another form teaches nothing."""
    points, g, se, origins, indices = [], [], [], [], []
    for o in history:
        if not o.usable:
            continue
        try:
            point = problem.space.coordinates_of(o.waveform)
        except SpaceError:
            continue
        if not (np.isfinite(point).all() and np.all(np.abs(point - 0.5) <= 1.0)):
            continue
        points.append(point)
        g.append(o.g_cm_s)
        se.append(o.g_se_cm_s if np.isfinite(o.g_se_cm_s) else 0.0)
        origins.append(o.origin)
        indices.append(o.index)
    table = np.array(points, dtype=np.float64).reshape(-1, problem.space.dim)
    return SurrogateData(
        points=table,
        inputs=surrogate_inputs(problem, table),
        g=np.array(g),
        se=np.array(se),
        origins=tuple(origins),
        indices=np.array(indices, dtype=np.int64),
    )


def surrogate_inputs(problem: Problem, points: FloatArray) -> FloatArray:
    """(n, d + 4) what the surrogate sees: the coordinates, then reach and dispersion of the lot's free swing and the
    state of the mean switch when the last pulse begins, each in about [0, 1]."""
    rows = problem.space.rows(points)
    swing = free_swing(rows, problem.lot, instant_us=rows[:, -1, 0])
    phase = np.clip(np.stack([swing.x[:, 0], swing.v[:, 0]], axis=1) / (2.0 * FARTHEST) + 0.5, 0.0, 1.0)
    return np.column_stack([points, swing.mean / FARTHEST, np.log(swing.sd + 0.01) / math.log(30.0) + 1.2, phase])


def warped(g: FloatArray, mode: str) -> tuple[FloatArray, float]:
    """g in units in which its spread is about 1: what is far above the median says only "bad"."""
    best, middle = float(g.min()), float(np.median(g))
    if mode == "log":
        scale = max(0.25 * (middle - best), 1e-3)
        y = np.log1p((g - best) / scale)
        unit = 1.0 / scale
    else:
        ceiling = middle + (middle - best) if mode == "clip" else np.inf
        y = np.minimum(g, max(ceiling, best + 1e-3))
        unit = 1.0
    spread = max(float(y.std()), 1e-9)
    return (y - y.mean()) / spread, unit / spread


def fit(
    points: FloatArray,
    y: FloatArray,
    noise: FloatArray,
    max_iterations: int,
    centre: FloatArray | None = None,
    n_fit: int = 200,
) -> Surrogate:
    """Hyperparameters by maximum likelihood from a fixed start: nothing is carried over from earlier proposals."""
    dim = points.shape[1]
    kernel = ConstantKernel(1.0, (0.05, 50.0)) * Matern(
        length_scale=np.full(dim, 0.5), length_scale_bounds=(0.05, 4.0), nu=2.5
    ) + WhiteKernel(1e-3, (1e-6, 0.2))

    centre_of_prior = np.log([1.0, *([0.5] * dim), 1e-3])
    width_of_prior = np.array([1.0, *([0.8] * dim), 2.0])

    def optimise(objective: Callable[..., Any], theta: FloatArray, bounds: FloatArray) -> tuple[FloatArray, float]:
        def posterior(t: FloatArray) -> tuple[float, FloatArray]:
            value, gradient = objective(t)
            pull = (t - centre_of_prior) / width_of_prior
            return float(value) + 0.5 * float(pull @ pull), gradient + pull / width_of_prior

        found = minimize(
            posterior, theta, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": max_iterations}
        )
        return found.x, float(found.fun)

    if centre is None:
        centre = points[int(np.argmin(y))]
    near = np.argsort(((points - centre) ** 2).sum(axis=1), kind="stable")[:n_fit]
    model = Surrogate(kernel, alpha=noise[near] + 1e-8, optimizer=optimise, noise="gaussian")
    model.fit(points[near], y[near])
    if len(near) == len(points):
        return model
    hyper = model.kernel_
    everything = Surrogate(hyper, alpha=noise + float(model.noise_ or 0.0) + 1e-8, optimizer=None)
    everything.fit(points, y)
    everything.noise_ = model.noise_
    return everything


def believe(
    problem: Problem,
    model: Surrogate,
    data: SurrogateData,
    y: FloatArray,
    noise: FloatArray,
    pending: Sequence[Waveform],
) -> Surrogate:
    """Kriging believer: candidates in flight count as what the surrogate expects of them, with the same
    hyperparameters."""
    points = []
    for waveform in pending:
        try:
            points.append(problem.space.unit(waveform, clip=True))
        except SpaceError:
            continue
    if not points:
        return model
    lies = surrogate_inputs(problem, np.array(points))
    expected = model.predict(lies)
    kernel = model.kernel_  # its white noise was set to 0 by skopt after the fit
    believer = Surrogate(
        kernel,
        alpha=np.concatenate([noise, np.zeros(len(lies))]) + float(model.noise_ or 0.0) + 1e-8,
        optimizer=None,
    )
    believer.fit(np.concatenate([data.inputs, lies]), np.concatenate([y, expected]))
    return believer
