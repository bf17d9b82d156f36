"""Owns proposals that a prior leads: the basins of the prior first, then what a process in each promises.

In every trust region, evolution with the shape of the descent that found the basin looks for the least of prior and
process together: a look costs a few switches of the cheap model and no candidate. Of all that was looked at, the
points of largest expected improvement become candidates.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence

import numpy as np

from softclose.arrays import FloatArray
from softclose.metrics.ranking import levelled
from softclose.propose.correction import Correction, Known, Looks
from softclose.propose.descents import strategy
from softclose.propose.deviation import FACTOR, PREDICTED, PREDICTED_SD, too_sure
from softclose.propose.inputs import SWING
from softclose.propose.origins import BASIN, FALLBACK, LOCAL
from softclose.propose.promises import Basins
from softclose.propose.protocol import Observation, Problem, Proposal, Wave, search_history
from softclose.propose.regions import REGION, Region, nearest, region_of, rounds_of, shares
from softclose.propose.surrogate import surrogate_inputs
from softclose.settings import CampaignConfig
from softclose.waveform import Waveform

PRIOR_G = "prior_g_cm_s"
"""What every proposal of a campaign with a prior says: the prior's g [cm/s]."""

GENERATION = 12
"""Points of a generation of a search."""

REACH = 1.0
"""Half the width of what a search may reach, in lengths of its region."""

WORST = 100.0
"""What a point without an answer counts as, on the scale of the process."""

WIDTHS = (0.0, 0.5, 1.0, 2.0)
"""Standard deviations below the mean that the searches of a region go for, in turn: sure ones and curious ones."""


class _Search:
    """One search for a candidate: CMA-ES from the incumbent, along the shape of its basin."""

    def __init__(
        self,
        problem: Problem,
        region: Region,
        correction: Correction,
        shape: FloatArray,
        centre: FloatArray,
        width: float,
        draw: np.random.Generator,
    ) -> None:
        """width: standard deviations below the mean that it goes for."""
        self.region, self.correction = region, correction
        self.looks: Looks | None = None
        self._problem, self._shape, self._centre, self._width = problem, shape, centre, width
        dim = len(centre)
        # In directions of the shape, a step is half a length; 1 is the middle of its cube, `REACH` lengths wide.
        self._strategy = strategy(np.full(dim, 0.5), np.ones(dim), 0.25 / REACH, GENERATION, draw)
        self._span = 2.0 * REACH * region.length

    def ask(self) -> FloatArray:
        """(GENERATION, d) canonical points of the next generation."""
        self._asked = self._strategy.ask()
        points = self._centre + self._span * ((np.array(self._asked) - 0.5) @ self._shape.T)
        self._points = self._problem.space.canonical(np.clip(points, 0.0, 1.0))
        return self._points

    def tell(self, prior_g_cm_s: FloatArray) -> None:
        """What the prior says of them."""
        fresh = self.correction.screen(self._points, prior_g_cm_s)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            self._strategy.tell(self._asked, np.minimum(fresh.bound(self._width), WORST).tolist())
        if self.looks is None:
            self.looks = fresh
        else:
            self.looks.join(fresh)


def propose_led(
    problem: Problem, basins: Basins, wave: Wave, history: Sequence[Observation], pending: Sequence[Waveform]
) -> list[Proposal]:
    """The candidates of a wave: the prior's basins, or those of largest expected improvement in each region."""
    first = problem.n_initial_waveforms
    known, numbers, places = _collect(problem, basins, history)
    if wave.start < first + problem.config.optimiser.n_regions or not len(places):
        return _basins(problem, basins, wave, wave.start - first)
    draw = problem.generator("led", wave.start)
    records = [history[i] for i in places]
    flying = np.clip(problem.space.coordinates_of_all(pending)[0], 0.0, 1.0)
    dealt = shares(
        rounds_of(problem),
        start=wave.start,
        size=wave.size,
        numbers=numbers,
        g=known.g_cm_s,
        indices=[o.index for o in records],
        in_flight=[numbers[nearest(known.points, x)] for x in flying],
    )
    try:
        return _search(problem, basins, wave, known, numbers, records, dealt, flying, draw)
    except (np.linalg.LinAlgError, FloatingPointError, ValueError) as e:
        best = known.points[int(np.argmin(known.g_cm_s))]
        shape = basins.shapes[numbers[int(np.argmin(known.g_cm_s))]]
        points = best + 0.01 * draw.standard_normal((wave.size, problem.space.dim)) @ shape.T
        note = f"process failed ({type(e).__name__}: {e})"[:200]
        return [
            Proposal(waveform=w, origin=FALLBACK, n_switches=wave.n_switches, note=note)
            for w in problem.space.waveforms(points)
        ]


def _basins(problem: Problem, basins: Basins, wave: Wave, place: int) -> list[Proposal]:
    """The basins from `place` on; beyond the last, and while nothing is known of them, points around them."""
    space, draw = problem.space, problem.generator("basins", wave.start)
    n = len(basins.waveforms)
    numbers = [(place + k) % n for k in range(wave.size)]
    points = space.coordinates_of_all([basins.waveforms[i] for i in numbers])[0]
    away = 0.01 * draw.standard_normal(points.shape)
    beside = [np.clip(p + basins.shapes[i] @ d, 0.0, 1.0) for p, i, d in zip(points, numbers, away, strict=True)]
    waveforms = [basins.waveforms[i] if place + k < n else space.waveform(beside[k]) for k, i in enumerate(numbers)]
    asked = [w for k, w in enumerate(waveforms) if place + k >= n]
    said = iter(problem.prior_values(asked).g_cm_s if asked else ())
    promised = [float(basins.g_cm_s[i]) if place + k < n else float(next(said)) for k, i in enumerate(numbers)]
    return [
        Proposal(
            waveform=w,
            origin=BASIN,
            n_switches=wave.n_switches,
            surrogate={REGION: float(i), PRIOR_G: g, PREDICTED: g} if math.isfinite(g) else {REGION: float(i)},
        )
        for w, i, g in zip(waveforms, numbers, promised, strict=True)
    ]


def _collect(problem: Problem, basins: Basins, history: Sequence[Observation]) -> tuple[Known, list[int], list[int]]:
    """What is known, the region of each of it, and its places in the history."""
    usable = [o for o in search_history(problem, history) if o.usable]
    coordinates, kept = problem.space.coordinates_of_all([o.waveform for o in usable])
    records = [usable[i] for i in kept]
    points = np.clip(coordinates, 0.0, 1.0)
    prior = np.array([o.beliefs.get(PRIOR_G, math.nan) for o in records])
    unsaid = [i for i, o in enumerate(records) if PRIOR_G not in o.beliefs]
    if unsaid:  # the user's own waveforms, and what stood in for a proposal that failed
        prior[unsaid] = problem.prior_values([records[i].waveform for i in unsaid]).g_cm_s
    answered = np.isfinite(prior)
    records = [o for o, yes in zip(records, answered, strict=True) if yes]
    points, prior = points[answered], prior[answered]
    known = Known(
        points=points,
        inputs=surrogate_inputs(problem, points) if len(points) else np.empty((0, problem.space.dim + len(SWING))),
        g_cm_s=levelled([o.rank_cm_s for o in records]),
        prior_g_cm_s=prior,
    )
    middles = np.clip(problem.space.coordinates_of_all(basins.waveforms)[0], 0.0, 1.0)
    numbers = [
        int(o.beliefs[REGION]) if REGION in o.beliefs else nearest(middles, x)
        for o, x in zip(records, points, strict=True)
    ]
    return known, numbers, [o.index for o in records]


def looks_of(config: CampaignConfig) -> int:
    """Waveforms that are tried on the prior for each candidate: whole generations."""
    return max(round(config.prior.looks / GENERATION), 1) * GENERATION


def _search(
    problem: Problem,
    basins: Basins,
    wave: Wave,
    known: Known,
    numbers: Sequence[int],
    records: Sequence[Observation],
    dealt: dict[int, int],
    flying: FloatArray,
    draw: np.random.Generator,
) -> list[Proposal]:
    space, n_looks = problem.space, looks_of(problem.config)
    searches: list[_Search] = []
    for number in sorted(dealt):
        region = region_of(number, numbers=numbers, g=known.g_cm_s, waves=[o.wave for o in records])
        correction = Correction(problem, known, region.incumbent)
        correction.believe(flying)
        searches += [
            _Search(
                problem,
                region,
                correction,
                basins.shapes[number],
                known.points[region.incumbent],
                WIDTHS[k % len(WIDTHS)],
                draw,
            )
            for k in range(dealt[number])
        ]
    for _ in range(n_looks // GENERATION):
        asked = np.concatenate([search.ask() for search in searches])
        said = problem.prior_values(space.waveforms(asked)).g_cm_s
        for k, search in enumerate(searches):
            search.tell(said[k * GENERATION : (k + 1) * GENERATION])
    taken = np.vstack([known.points, flying])
    factor = too_sure(records)
    found: list[Proposal] = []
    for number in sorted(dealt):
        own = [search for search in searches if search.region.number == number]
        looks, region, correction = own[0].looks, own[0].region, own[0].correction
        assert looks is not None
        for other in own[1:]:
            assert other.looks is not None
            looks.join(other.looks)
        for _ in range(dealt[number]):
            value = looks.improvement()
            place = next(
                (
                    int(i)
                    for i in np.argsort(-value, kind="stable")
                    if np.isfinite(value[i]) and ((taken - looks.points[i]) ** 2).sum(axis=1).min() > 1e-14
                ),
                None,
            )
            if place is None:
                raise ValueError("the prior has no answer to any waveform that was looked at")
            mean, sd = looks.z()
            g, deviation = correction.scale.g(mean[place : place + 1], factor * sd[place : place + 1])
            found.append(
                Proposal(
                    waveform=space.waveform(looks.points[place]),
                    origin=LOCAL,
                    n_switches=wave.n_switches,
                    surrogate=_hyperparameters(problem, correction)
                    | {
                        REGION: float(number),
                        PRIOR_G: float(looks.prior_g_cm_s[place]),
                        PREDICTED: float(g[0]),
                        PREDICTED_SD: float(deviation[0]),
                        FACTOR: factor,
                        "expected_improvement_cm_s": float(value[place] * correction.scale.width_cm_s),
                        "trust_region_length": region.length,
                        "rho": correction.rho,
                        "looks": float(n_looks),
                    },
                )
            )
            taken = np.vstack([taken, looks.points[place]])
            looks.believe(place)
    return found


def _hyperparameters(problem: Problem, correction: Correction) -> dict[str, float]:
    hyper = correction.model.kernel_.get_params()
    names = (*problem.space.names, *SWING)
    scales = np.broadcast_to(np.asarray(hyper["k1__k2__length_scale"], dtype=np.float64), (len(names),))
    return {f"length_scale_{name}": float(v) for name, v in zip(names, scales, strict=True)} | {
        "noise": float(correction.model.noise_ or 0.0),
        "amplitude": float(hyper["k1__k1__constant_value"]),
    }
