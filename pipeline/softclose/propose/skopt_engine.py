"""Owns the skopt engine: a Gaussian process in a trust region, a pure function of the history.

Composed from `skopt.learning` and `skopt.acquisition` rather than `skopt.Optimizer`, whose state lives across calls,
whose `tell` refuses points outside its space, and whose `space_constraint` turns the acquisition search into plain
sampling. Method: a design where the lot may land, then Matérn-5/2 with one length scale per input plus white noise and
expected improvement in a trust region around the best candidate;
see ADR 031 and 034 to 036 for what was measured.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from softclose.arrays import FloatArray
from softclose.propose.design import design_point
from softclose.propose.deviation import FACTOR, PREDICTED, PREDICTED_SD, too_sure
from softclose.propose.inputs import SWING
from softclose.propose.origins import FALLBACK, LOCAL, POLISH, RESTART, SOBOL
from softclose.propose.protocol import Observation, Problem, Proposal, Wave, search_history
from softclose.propose.regions import REGION
from softclose.propose.sobol import sobol_points
from softclose.propose.starts import Starts, starts_of
from softclose.propose.trust_region import TrustRegion, TrustRegionRules, replay
from softclose.waveform import Waveform

if TYPE_CHECKING:
    from softclose.propose.surrogate import SurrogateData

Beliefs = dict[str, float]

DESCENT = 50
"""Candidates that a descent needs as a rule: with fewer left, the trust region opens again around the best instead."""

STEPS = (0.15, 0.06, 0.024)
"""Rounds of looking around the best candidates: standard deviations, in widths of the box."""

N_REFINED, N_AROUND = 5, 60
"""Candidates that are looked around in a round, and points around each."""


class SkoptEngine:
    """Bayesian optimisation with skopt's Gaussian process."""

    def wave_sizes(self, problem: Problem, budget: int) -> list[int]:
        """All of the initial design, in which the user's own waveforms take the first places, then batches."""
        settings = problem.config.optimiser
        if problem.config.has_prior:
            first = min(problem.n_initial_waveforms + settings.n_regions, budget)
        else:
            first = min(settings.n_initial, budget)
        return [first, *(min(settings.batch, budget - begin) for begin in range(first, budget, settings.batch))]

    def propose_wave(
        self, problem: Problem, wave: Wave, history: Sequence[Observation], pending: Sequence[Waveform]
    ) -> list[Proposal]:
        """Initial design first, then expected improvement in the trust region."""
        basins = problem.basins
        if basins is not None and basins.waveforms:
            from softclose.propose.led import propose_led  # imported where it is used: skopt is slow to import

            return propose_led(problem, basins, wave, history, pending)
        gone = f"no prior: {basins.failure}"[:200] if basins is not None and wave.index == 0 else ""
        settings, space = problem.config.optimiser, problem.space

        def proposals(
            points: FloatArray, origin: str, beliefs: Sequence[Beliefs] = (), note: str = gone
        ) -> list[Proposal]:
            surrogate = [*beliefs, *({} for _ in range(wave.size - len(beliefs)))]
            return [
                Proposal(waveform=w, origin=origin, n_switches=wave.n_switches, surrogate=b, note=note)
                for w, b in zip(space.waveforms(points), surrogate, strict=True)
            ]

        def design(place: int, stream: str = "initial", attempt: int = 0) -> FloatArray:
            return np.array([design_point(problem, place + k, stream, attempt) for k in range(wave.size)])

        if wave.start < settings.n_initial:
            return proposals(design(wave.start), SOBOL)
        search = search_history(problem, history)
        if len(search) < settings.n_initial:  # the design is in flight: more of it
            return proposals(design(wave.start), SOBOL)
        from softclose.propose.surrogate import collect  # not before a process is asked: skopt takes 1.5 s to import

        data = collect(problem, search)
        if len(data.g) < 2:
            return proposals(design(wave.start), FALLBACK, note="fewer than two usable candidates")
        starts = starts_of(problem, data, _rules(problem), start=wave.start, size=wave.size, pending=pending)
        region = starts.regions[starts.first]
        since = wave.start - (int(data.indices[region.begin - 1]) + 1 if region.begin else 0)
        if region.begin and (since < settings.n_restart or region.incumbent is None):
            return proposals(design(since, f"again{region.restarts}", region.restarts % 2), RESTART)
        draw = problem.generator("acquire", wave.start)
        try:
            factor = too_sure([o for o in search if o.usable])
            points, beliefs = _acquire(problem, data, starts, pending, draw, factor)
        except (np.linalg.LinAlgError, ValueError, FloatingPointError) as e:
            best = data.points[int(np.argmin(data.g))]
            near = best + 0.25 * region.length * draw.standard_normal((wave.size, space.dim))
            return proposals(near, FALLBACK, note=f"surrogate failed ({type(e).__name__}: {e})"[:200])
        return proposals(points, LOCAL, beliefs)


def _acquire(
    problem: Problem,
    data: SurrogateData,
    starts: Starts,
    pending: Sequence[Waveform],
    draw: np.random.Generator,
    factor: float,
) -> tuple[FloatArray, list[Beliefs]]:
    """The points of each region, those of the regions before it in flight, and what is believed of them."""
    found = np.empty((0, problem.space.dim))
    beliefs: list[Beliefs] = []
    for number in sorted(starts.dealt):
        in_flight = [*pending, *problem.space.waveforms(found)]
        points, own = acquire(problem, data, starts.regions[number], in_flight, starts.dealt[number], draw, factor)
        found = np.vstack([found, points])
        beliefs += [b | {REGION: float(number)} for b in own]
    return found, beliefs


def polish(problem: Problem, wave: Wave, finished: Sequence[Observation], pending: Sequence[Waveform]) -> FloatArray:
    """(n, d) the next points of the finishing stage: a small trust region around its best record; none where it
    fails."""
    from softclose.propose.surrogate import collect  # imported where it is used: skopt is slow to import

    data = collect(problem, finished)
    nothing = np.empty((0, problem.space.dim))
    if len(data.g) < 2:
        return nothing
    settings = problem.config.finish
    rules = replace(_rules(problem), initial=8.0 * settings.sigma, smallest=1e-4, largest=0.8)
    region = replay(data.g.tolist(), [LOCAL if o == POLISH else o for o in data.origins], rules, data.waves)
    region = replace(region, incumbent=int(np.argmin(data.g)), begin=0)
    draw = problem.generator("polish", wave.start)
    try:
        return acquire(problem, data, region, pending, wave.size, draw)[0]
    except (np.linalg.LinAlgError, ValueError, FloatingPointError):
        return nothing


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


def acquire(
    problem: Problem,
    data: SurrogateData,
    region: TrustRegion,
    pending: Sequence[Waveform],
    n: int,
    draw: np.random.Generator,
    factor: float = 1.0,
) -> tuple[FloatArray, list[Beliefs]]:
    """(n, d) points of largest expected improvement, each with those before it taken on trust: over a few thousand
    admissible points, then around the best of them."""
    from softclose.propose.surrogate import Screened, fit, logarithmic, of_logarithm, surrogate_inputs

    space, settings = problem.space, problem.config.optimiser
    y, per_cm_s = logarithmic(data.g)
    nearest = region.incumbent if region.incumbent is not None else int(np.argmin(data.g))
    centre = data.points[nearest]
    with warnings.catch_warnings():
        # Convergence of the likelihood is not required, and bounds are met often.
        warnings.simplefilter("ignore")
        model = fit(data.inputs, y, settings.fit_iterations, data.inputs[nearest], settings.n_fit)
        hyper = model.kernel_.get_params()
        names = (*space.names, *SWING)
        scales = np.broadcast_to(np.asarray(hyper["k1__k2__length_scale"], dtype=np.float64), (len(names),))
        common = {f"length_scale_{name}": float(v) for name, v in zip(names, scales, strict=True)}
        common |= {"noise": float(model.noise_ or 0.0), "amplitude": float(hyper["k1__k1__constant_value"])}
        flying = np.clip(space.coordinates_of_all(pending)[0], 0.0, 1.0)
        for inputs in surrogate_inputs(problem, flying) if len(flying) else ():
            model.believe(inputs)

        middle = np.clip(centre, 0.0, 1.0)
        low, high = region.box(middle, scales[: space.dim])
        target = float(y.min() if region.incumbent is None else y[region.incumbent])

        def screen(points: FloatArray) -> Screened:
            points = space.canonical(points)
            return Screened(model, points, surrogate_inputs(problem, points))

        candidates = low + (high - low) * sobol_points(space.dim, settings.n_candidates, draw)
        n_near = len(candidates) * 3 // 4
        # Most candidates move some coordinates only, and less far: in ten dimensions hardly a point of a box is near
        # its centre, and the ridges of g are narrow.
        moved = draw.random((n_near, space.dim)) < np.linspace(0.15, 1.0, n_near)[:, None]
        step = 4.0 ** -draw.integers(0, 3, n_near)[:, None]
        candidates[:n_near] = centre + (candidates[:n_near] - centre) * moved * step
        screened = screen(candidates)
        known = np.vstack([data.points, flying])
        chosen: list[FloatArray] = []
        beliefs: list[Beliefs] = []
        for _ in range(n):
            for step_length in STEPS:
                order = np.argsort(-screened.improvement(target), kind="stable")[:N_REFINED]
                best = screened.points[order].repeat(N_AROUND, axis=0)
                away = draw.standard_normal(best.shape) * (draw.random(best.shape) < 0.5)
                screened.join(screen(np.clip(best + step_length * (high - low) * away, low, high)))
            values = screened.improvement(target)
            # A point already evaluated, or in flight, would answer the same again.
            fresh = (
                int(i)
                for i in np.argsort(-values, kind="stable")
                if ((known - screened.points[i]) ** 2).sum(axis=1).min() > 1e-14
            )
            i = next(fresh)
            mean, sd = screened.predict(None)
            expected, deviation = of_logarithm(data.g, mean[i : i + 1], factor * sd[i : i + 1])
            beliefs.append(
                common
                | {
                    "expected_improvement_cm_s": float(max(values[i], 0.0) / per_cm_s),
                    PREDICTED: float(expected[0]),
                    PREDICTED_SD: float(deviation[0]),
                    FACTOR: factor,
                    "trust_region_length": region.length,
                }
            )
            chosen.append(screened.points[i])
            known = np.vstack([known, chosen[-1]])
            screened.believe(screened.inputs[i])
    return np.array(chosen), beliefs
