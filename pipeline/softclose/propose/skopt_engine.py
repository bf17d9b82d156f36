"""Owns the skopt engine: a Gaussian process in a trust region, a pure function of the history.

Composed from `skopt.learning` and `skopt.acquisition` rather than `skopt.Optimizer`, whose state lives across calls,
whose `tell` refuses points outside its space, and whose `space_constraint` turns the acquisition search into plain
sampling. Method: a design where the lot may land, then Matérn-5/2 with one length scale per input plus white noise and
expected improvement in a trust region around the incumbent (everywhere only every `optimiser.global_every` proposals);
see ADR 031 and 034 to 036 for what was measured.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from skopt.acquisition import gaussian_ei
from threadpoolctl import threadpool_limits

from softclose.propose.design import design_point
from softclose.propose.inputs import SWING
from softclose.propose.protocol import Observation, Problem, Proposal, search_history
from softclose.propose.sobol import sobol_points
from softclose.propose.surrogate import SurrogateData, believe, collect, fit, surrogate_inputs, warped
from softclose.propose.trust_region import DESIGN, GLOBAL, LOCAL, RESTART, TrustRegion, TrustRegionRules, replay
from softclose.waveform import Waveform

FloatArray = NDArray[np.float64]

FALLBACK = "fallback"
POLISH = "finish-polish"

DESCENT = 50
"""Candidates that a descent needs as a rule: with fewer left, the trust region opens again around the best instead."""

STEPS = (0.15, 0.06, 0.024)
"""Rounds of looking around the best candidates: standard deviations, in widths of the box."""

N_REFINED, N_AROUND = 5, 60
"""Candidates that are looked around in a round, and points around each."""

N_FINAL = 8
"""Candidates that are mapped exactly, repair included, before one is chosen."""


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
    data = collect(problem, search_history(problem, history))
    if len(data.g) < 2:
        return _proposal(problem, design_point(problem, place), FALLBACK, note="fewer than two usable candidates")
    region = replay(data.g.tolist(), data.origins, _rules(problem))
    since = index - (int(data.indices[region.begin - 1]) + 1 if region.begin else 0)
    if region.begin and (since < settings.n_restart or region.incumbent is None):
        return _proposal(problem, design_point(problem, since, f"again{region.restarts}", region.restarts), RESTART)
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
    data = collect(problem, finished)
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


def _acquire(
    problem: Problem,
    data: SurrogateData,
    region: TrustRegion,
    pending: Sequence[Waveform],
    everywhere: bool,
    rng: np.random.Generator,
) -> tuple[FloatArray, dict[str, float]]:
    """Largest expected improvement over a few thousand admissible points, then around the best of them."""
    space, settings = problem.space, problem.config.optimiser
    y, per_cm_s = warped(data.g, settings.warp)
    noise = settings.noise_share * (data.se * per_cm_s) ** 2
    nearest = region.incumbent if region.incumbent is not None else int(np.argmin(data.g))
    centre = data.points[nearest]
    model = fit(data.inputs, y, noise, settings.fit_iterations, data.inputs[nearest], settings.n_fit)
    hyper = model.kernel_.get_params()
    names = (*space.names, *SWING)
    scales = np.broadcast_to(np.asarray(hyper["k1__k2__length_scale"], dtype=np.float64), (len(names),))
    beliefs = {f"length_scale_{name}": float(v) for name, v in zip(names, scales, strict=True)}
    beliefs |= {"noise": float(model.noise_ or 0.0), "amplitude": float(hyper["k1__k1__constant_value"])}
    model = believe(problem, model, data, y, noise, pending)

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
        return points, np.asarray(gaussian_ei(surrogate_inputs(problem, points), model, target, xi=0.0))

    candidates, score = admissible(candidates)
    if not len(candidates):
        raise ValueError("no admissible candidate in the trust region")
    for step_length in STEPS:
        best = candidates[np.argsort(-score, kind="stable")[:N_REFINED]].repeat(N_AROUND, axis=0)
        away = rng.standard_normal(best.shape) * (rng.random(best.shape) < 0.5)
        around, gain = admissible(np.clip(best + step_length * (high - low) * away, low, high))
        candidates, score = np.concatenate([candidates, around]), np.concatenate([score, gain])
    finals = np.array([space.canonical(c) for c in candidates[np.argsort(-score, kind="stable")[:N_FINAL]]])
    inputs = surrogate_inputs(problem, finals)
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
