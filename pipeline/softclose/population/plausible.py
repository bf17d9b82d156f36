"""Owns which distributions a handful of devices may have come from, given the one that was fitted to them.

A fit of ten devices is no small error away from the truth, nor a symmetric one: resampling it shows spreads that are
small again, where the truth's is larger. So the question is turned round. A lot that is known is drawn from and fitted;
then lot and fit are moved and stretched together until the fit is ours, and the lot is one that ours may have come
from. For families of location and scale that is exact (Fisher's fiducial distribution; a studentised bootstrap). The
shape has no such group: lots of every shape are tried, and those are kept whose fit has the shape that ours has. Within
known bounds nothing can be moved; there the logit of the mean and the logarithm of alpha + beta are mirrored at the
fit. Measured coverage: docs/measurements/coverage.md.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from softclose.arrays import FloatArray
from softclose.population.distributions import Bounded

FitKind = Literal["beta", "uniform"]

Estimator = Callable[[FloatArray, FitKind, tuple[float, float] | None], Bounded]

SHAPE_SUM = 4.0
"""alpha + beta of a Beta whose bounds are unknown too: 50 devices cannot tell four free numbers apart."""
_TRIED = 2
"""Lots tried for each that is kept, where the shape is fitted."""
_AT_THE_ENDS = 0.25
"""Half-widths of the range of shapes by which tried ones reach beyond it, onto its ends: lots may well be there."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Plausible:
    """Lots that a fit may stand for."""

    lots: tuple[Bounded, ...]
    """Equally likely ones."""
    samples: tuple[tuple[FloatArray, Bounded], ...]
    """For each the draws (n,), ascending, and what they were fitted by: what a good fit looks like."""


def plausible(
    fitted: Bounded,
    n: int,
    kind: FitKind,
    estimate: Estimator,
    *,
    bounds: tuple[float, float] | None,
    n_lots: int,
    seed: int,
    stream: int,
) -> Plausible:
    """n_lots distributions that n devices may have come from which `fitted` was fitted to.

    estimate: (draws, kind, bounds) -> what is fitted to them; bounds: known ones.
    """
    if bounds is not None:
        return _within(fitted, n, kind, estimate, bounds, n_lots, _generator(seed, stream))
    units, draws, fits = _tried(n, kind, estimate, n_lots, seed, stream)
    away = np.abs([f.alpha - fitted.alpha for f in fits])
    kept = np.sort(np.argsort(away, kind="stable")[:n_lots]).tolist()
    return Plausible(
        lots=tuple(_moved(units[i], fits[i], fitted) for i in kept), samples=tuple((draws[i], fits[i]) for i in kept)
    )


@functools.lru_cache(maxsize=16)
def _tried(
    n: int, kind: FitKind, estimate: Estimator, n_lots: int, seed: int, stream: int
) -> tuple[list[Bounded], list[FloatArray], list[Bounded]]:
    """Lots on [0, 1], draws of n from each and what fits these: the same for any data."""
    rng = _generator(seed, stream)
    if kind == "uniform":
        units = [Bounded(lower=0.0, upper=1.0)] * n_lots
    else:
        reach = 1.0 + _AT_THE_ENDS
        middle, half = 0.5 * SHAPE_SUM, 0.5 * SHAPE_SUM - 1.0
        shapes = middle + half * reach * (2.0 * rng.random(_TRIED * n_lots) - 1.0)
        shapes = np.clip(shapes, middle - half, middle + half)
        units = [Bounded(lower=0.0, upper=1.0, alpha=a, beta=SHAPE_SUM - a) for a in shapes.tolist()]
    draws = [np.sort(unit.quantile(rng.random(n))) for unit in units]
    return units, draws, [estimate(x, kind, None) for x in draws]


def _generator(seed: int, stream: int) -> np.random.Generator:
    return np.random.Generator(np.random.Philox(np.random.SeedSequence(seed, spawn_key=(stream,))))


def _moved(lot: Bounded, fit: Bounded, onto: Bounded) -> Bounded:
    """The lot under the map that takes mean and spread of its fit to those of another."""
    scale = onto.sd / fit.sd
    offset = onto.mean - scale * fit.mean
    return replace(lot, lower=offset + scale * lot.lower, upper=offset + scale * lot.upper)


def _within(
    fitted: Bounded,
    n: int,
    kind: FitKind,
    estimate: Estimator,
    bounds: tuple[float, float],
    n_lots: int,
    rng: np.random.Generator,
) -> Plausible:
    draws = [np.sort(fitted.quantile(rng.random(n))) for _ in range(n_lots)]
    fits = [estimate(x, kind, bounds) for x in draws]
    lots = [fitted] * n_lots if kind == "uniform" else [_mirrored(f, fitted) for f in fits]
    return Plausible(lots=tuple(lots), samples=tuple(zip(draws, fits, strict=True)))


def _mirrored(fit: Bounded, at: Bounded) -> Bounded:
    """A fit of draws from `at`, taken to the other side of it: where it stood to `at`, `at` stands to the lot."""
    total, again = at.alpha + at.beta, fit.alpha + fit.beta
    middle = math.log(at.alpha / at.beta)
    # The mean errs by the spread, which goes with the root of the sum: a fit that is too narrow errs by less.
    away = (middle - math.log(fit.alpha / fit.beta)) * math.sqrt((again + 1.0) / (total + 1.0))
    mean = 1.0 / (1.0 + math.exp(-(middle + away)))
    total = total * total / again
    return replace(at, alpha=total * mean, beta=total * (1.0 - mean))
