"""Owns the skopt engine: a Gaussian process in a trust region, a pure function of the history. The only skopt import.

Composed from `skopt.learning` and `skopt.acquisition` rather than `skopt.Optimizer`, whose state lives across calls,
whose `tell` refuses points outside its space, and whose `space_constraint` turns the acquisition search into plain
sampling. Method: Matérn-5/2 with one length scale per axis plus white noise; expected improvement, alternately in a
trust region around the incumbent and everywhere; see ADR 031, 034 and 035 for what was measured.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.optimize import minimize
from skopt.acquisition import gaussian_ei
from skopt.learning import GaussianProcessRegressor
from skopt.learning.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel
from threadpoolctl import threadpool_limits

from softclose.propose.design import design_point
from softclose.propose.protocol import Observation, Problem, Proposal, search_history
from softclose.propose.sobol import sobol_points
from softclose.propose.trust_region import DESIGN, GLOBAL, LOCAL, RESTART, TrustRegion, TrustRegionRules, replay
from softclose.spaces import SpaceError
from softclose.swing import FARTHEST, free_swing
from softclose.waveform import Waveform

FloatArray = NDArray[np.float64]

FALLBACK = "fallback"
POLISH = "finish-polish"

DESCENT = 50
"""Candidates that a descent needs as a rule: with fewer left, the trust region opens again around the best instead."""

SWING = ("reach", "dispersion", "x_last", "v_last")
"""Names of the surrogate's inputs beyond the coordinates."""

STEPS = (0.15, 0.06, 0.024)
"""Rounds of looking around the best candidates: standard deviations, in widths of the box."""

N_REFINED, N_AROUND = 5, 60
"""Candidates that are looked around in a round, and points around each."""

N_FINAL = 8
"""Candidates that are mapped exactly, repair included, before one is chosen."""


class _Surrogate(GaussianProcessRegressor):  # type: ignore[misc]
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
class _Data:
    """What the surrogate learns from: canonical points, its inputs there, g and the noise of g."""

    points: FloatArray
    inputs: FloatArray
    g: FloatArray
    se: FloatArray
    origins: tuple[str, ...]
    indices: NDArray[np.int64]


class SkoptEngine:
    """Bayesian optimisation with skopt's Gaussian process."""

    def propose(
        self, problem: Problem, index: int, history: Sequence[Observation], pending: Sequence[Waveform]
    ) -> Proposal:
        """Initial design first, then expected improvement in the trust region, every few proposals everywhere."""
        with threadpool_limits(limits=1):  # the order of a threaded sum would show in the last bits
            return _propose(problem, index, history, pending)


def _propose(problem: Problem, index: int, history: Sequence[Observation], pending: Sequence[Waveform]) -> Proposal:
    settings = problem.config.optimiser
    place = index - problem.n_initial_waveforms
    if place < settings.n_initial:
        return _proposal(problem, design_point(problem, place), DESIGN)
    data = _collect(problem, search_history(problem, history))
    if len(data.g) < 2:
        return _proposal(problem, design_point(problem, place), FALLBACK, note="fewer than two usable candidates")
    region = replay(data.g.tolist(), data.origins, _rules(problem))
    since = index - (int(data.indices[region.begin - 1]) + 1 if region.begin else 0)
    if region.begin and (since < settings.n_restart or region.incumbent is None):
        return _proposal(problem, design_point(problem, since, f"again{region.restarts}"), RESTART)
    everywhere = settings.global_every > 0 and (place - settings.n_initial) % settings.global_every == (
        settings.global_every - 1
    )
    rng = problem.generator("acquire", index)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # convergence of the likelihood is not required, and bounds are met often
            point, beliefs = _acquire(problem, data, region, pending, everywhere, rng)
    except (np.linalg.LinAlgError, ValueError, FloatingPointError) as e:
        best = data.points[int(np.argmin(data.g))]
        near = np.clip(best + 0.25 * region.length * rng.standard_normal(problem.space.dim), 0.0, 1.0)
        return _proposal(problem, near, FALLBACK, note=f"surrogate failed ({type(e).__name__}: {e})"[:200])
    return _proposal(problem, point, GLOBAL if everywhere else LOCAL, beliefs)


def polish(
    problem: Problem, index: int, finished: Sequence[Observation], pending: Sequence[Waveform]
) -> FloatArray | None:
    """The next point of the finishing stage: a small trust region around its best record; None where it fails."""
    data = _collect(problem, finished)
    if len(data.g) < 2:
        return None
    settings = problem.config.finish
    rules = replace(_rules(problem), initial=8.0 * settings.sigma, smallest=1e-4, largest=0.8)
    region = replay(data.g.tolist(), [LOCAL if o == POLISH else o for o in data.origins], rules)
    region = replace(region, incumbent=int(np.argmin(data.g)), begin=0)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return _acquire(problem, data, region, pending, False, problem.generator("polish", index))[0]
    except (np.linalg.LinAlgError, ValueError, FloatingPointError):
        return None


def _proposal(
    problem: Problem, point: FloatArray, origin: str, beliefs: dict[str, float] | None = None, note: str = ""
) -> Proposal:
    return Proposal(
        waveform=problem.space.waveform(point),
        origin=origin,
        n_switches=problem.config.population.n_switches,
        surrogate=beliefs or {},
        note=note,
    )


def _rules(problem: Problem) -> TrustRegionRules:
    s = problem.config.optimiser
    return TrustRegionRules(
        initial=s.length_initial,
        smallest=s.length_min,
        largest=s.length_max,
        successes=s.success_tolerance,
        failures=s.failure_tolerance or problem.space.dim,
        fresh_every=s.fresh_every,
        fresh_before=problem.config.campaign.budget - DESCENT,
        improvement_cm_s=s.improvement_cm_s,
    )


def _collect(problem: Problem, history: Sequence[Observation]) -> _Data:
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
    return _Data(
        points=table,
        inputs=_inputs(problem, table),
        g=np.array(g),
        se=np.array(se),
        origins=tuple(origins),
        indices=np.array(indices, dtype=np.int64),
    )


def _inputs(problem: Problem, points: FloatArray) -> FloatArray:
    """(n, d + 4) what the surrogate sees: the coordinates, then reach and dispersion of the lot's free swing and the
    state of the mean switch when the last pulse begins, each in about [0, 1]."""
    swing = free_swing(problem.space.rows(points), problem.lot)
    phase = np.clip(np.stack([swing.x, swing.v], axis=1) / (2.0 * FARTHEST) + 0.5, 0.0, 1.0)
    return np.column_stack([points, swing.mean / FARTHEST, np.log(swing.sd + 0.01) / math.log(30.0) + 1.2, phase])


def _warp(g: FloatArray, mode: str) -> tuple[FloatArray, float]:
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


def _fit(
    points: FloatArray,
    y: FloatArray,
    noise: FloatArray,
    max_iterations: int,
    centre: FloatArray | None = None,
    n_fit: int = 200,
) -> _Surrogate:
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
    model = _Surrogate(kernel, alpha=noise[near] + 1e-8, optimizer=optimise, noise="gaussian")
    model.fit(points[near], y[near])
    if len(near) == len(points):
        return model
    hyper = model.kernel_
    everything = _Surrogate(hyper, alpha=noise + float(model.noise_ or 0.0) + 1e-8, optimizer=None)
    everything.fit(points, y)
    everything.noise_ = model.noise_
    return everything


def _acquire(
    problem: Problem,
    data: _Data,
    region: TrustRegion,
    pending: Sequence[Waveform],
    everywhere: bool,
    rng: np.random.Generator,
) -> tuple[FloatArray, dict[str, float]]:
    """Largest expected improvement over a few thousand admissible points, then around the best of them."""
    space, settings = problem.space, problem.config.optimiser
    y, per_cm_s = _warp(data.g, settings.warp)
    noise = settings.noise_share * (data.se * per_cm_s) ** 2
    nearest = region.incumbent if region.incumbent is not None else int(np.argmin(data.g))
    centre = data.points[nearest]
    model = _fit(data.inputs, y, noise, settings.fit_iterations, data.inputs[nearest], settings.n_fit)
    hyper = model.kernel_.get_params()
    names = (*space.names, *SWING)
    scales = np.broadcast_to(np.asarray(hyper["k1__k2__length_scale"], dtype=np.float64), (len(names),))
    beliefs = {f"length_scale_{name}": float(v) for name, v in zip(names, scales, strict=True)}
    beliefs |= {"noise": float(model.noise_ or 0.0), "amplitude": float(hyper["k1__k1__constant_value"])}
    model = _believe(problem, model, data, y, noise, pending)

    middle = np.clip(centre, 0.0, 1.0)
    low, high = (np.zeros(space.dim), np.ones(space.dim)) if everywhere else region.box(middle, scales[: space.dim])
    target = float(y.min() if everywhere or region.incumbent is None else y[region.incumbent])
    candidates = low + (high - low) * sobol_points(space.dim, settings.n_candidates, rng)
    if not everywhere:
        n_near = len(candidates) * 3 // 4
        # Most candidates move some coordinates only, and less far: in ten dimensions hardly a point of a box is near
        # its centre, and the ridges of g are narrow.
        moved = rng.random((n_near, space.dim)) < np.linspace(0.15, 1.0, n_near)[:, None]
        step = 4.0 ** -rng.integers(0, 3, n_near)[:, None]
        candidates[:n_near] = centre + (candidates[:n_near] - centre) * moved * step

    def admissible(points: FloatArray) -> tuple[FloatArray, FloatArray]:
        points, fits = space.settle(points)
        points = points[fits]
        if not len(points):
            return points, np.zeros(0)
        return points, np.asarray(gaussian_ei(_inputs(problem, points), model, target, xi=0.0))

    candidates, score = admissible(candidates)
    if not len(candidates):
        raise ValueError("no admissible candidate in the trust region")
    for step_length in STEPS:
        best = candidates[np.argsort(-score, kind="stable")[:N_REFINED]].repeat(N_AROUND, axis=0)
        away = rng.standard_normal(best.shape) * (rng.random(best.shape) < 0.5)
        around, gain = admissible(np.clip(best + step_length * (high - low) * away, low, high))
        candidates, score = np.concatenate([candidates, around]), np.concatenate([score, gain])
    finals = np.array([space.canonical(c) for c in candidates[np.argsort(-score, kind="stable")[:N_FINAL]]])
    inputs = _inputs(problem, finals)
    values = gaussian_ei(inputs, model, target, xi=0.0)
    distance = np.sqrt(((finals[:, None, :] - data.points[None]) ** 2).sum(axis=2)).min(axis=1)
    values = np.where(distance > 1e-7, values, -1.0)  # a point already evaluated would answer the same again
    chosen = int(np.argmax(values))
    mean, std = model.predict(inputs[[chosen, chosen]], return_std=True)
    beliefs |= {
        "expected_improvement_cm_s": float(max(values.max(), 0.0) / per_cm_s),
        "predicted_std_cm_s": float(std[0] / per_cm_s),
        "predicted_change_cm_s": float((mean[0] - target) / per_cm_s),
        "trust_region_length": region.length,
    }
    return finals[chosen], beliefs


def _believe(
    problem: Problem, model: _Surrogate, data: _Data, y: FloatArray, noise: FloatArray, pending: Sequence[Waveform]
) -> _Surrogate:
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
    lies = _inputs(problem, np.array(points))
    expected = model.predict(lies)
    kernel = model.kernel_  # its white noise was set to 0 by skopt after the fit
    believer = _Surrogate(
        kernel,
        alpha=np.concatenate([noise, np.zeros(len(lies))]) + float(model.noise_ or 0.0) + 1e-8,
        optimizer=None,
    )
    believer.fit(np.concatenate([data.inputs, lies]), np.concatenate([y, expected]))
    return believer
