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
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

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
class Lots:
    """Many distributions at once, (m,) each: objects of their own would take longer than everything else."""

    lower: FloatArray
    """See `Bounded`."""
    upper: FloatArray
    """See `Bounded`."""
    alpha: FloatArray
    """See `Bounded`."""
    beta: FloatArray
    """See `Bounded`."""

    @classmethod
    def of(cls, each: Sequence[Bounded]) -> Lots:
        """Those that are objects."""
        lower, upper, alpha, beta = np.array([(b.lower, b.upper, b.alpha, b.beta) for b in each]).T
        return cls(lower=lower, upper=upper, alpha=alpha, beta=beta)

    def __len__(self) -> int:
        return self.lower.size

    def __getitem__(self, i: int) -> Bounded:
        low, high, alpha, beta = (float(x[i]) for x in (self.lower, self.upper, self.alpha, self.beta))
        return Bounded(lower=low, upper=high, alpha=alpha, beta=beta)

    def only(self, kept: NDArray[np.intp]) -> Lots:
        """Some of them."""
        return Lots(lower=self.lower[kept], upper=self.upper[kept], alpha=self.alpha[kept], beta=self.beta[kept])

    @property
    def mean(self) -> FloatArray:
        """Expectations."""
        return self.lower + (self.upper - self.lower) * self.alpha / (self.alpha + self.beta)

    @property
    def sd(self) -> FloatArray:
        """Standard deviations."""
        s = self.alpha + self.beta
        return np.asarray((self.upper - self.lower) * np.sqrt(self.alpha * self.beta / (s + 1.0)) / s)


@dataclass(frozen=True, slots=True, kw_only=True)
class Plausible:
    """Lots that a fit may stand for."""

    lots: Lots
    """Equally likely ones."""
    distances: FloatArray
    """For each the Cramér-von Mises distance of its draws from what they were fitted by: what a good fit looks like."""


def cramer_von_mises(ordered: FloatArray, b: Bounded | Lots) -> FloatArray:
    """Cramér-von Mises statistic of ascending values against a distribution, (n,), or of m against theirs, (m, n)."""
    from scipy.special import betainc

    n = ordered.shape[-1]
    lower, upper, alpha, beta = (np.asarray(x)[..., None] for x in (b.lower, b.upper, b.alpha, b.beta))
    cdf = betainc(alpha, beta, np.clip((ordered - lower) / (upper - lower), 0.0, 1.0))
    return np.asarray(1.0 / (12.0 * n) + ((cdf - (np.arange(n) + 0.5) / n) ** 2).sum(axis=-1))


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
    units, fits, distances = _tried(n, kind, estimate, n_lots, seed, stream)
    kept = np.sort(np.argsort(np.abs(fits.alpha - fitted.alpha), kind="stable")[:n_lots])
    return Plausible(lots=_moved(units.only(kept), fits.only(kept), fitted), distances=distances[kept])


@functools.lru_cache(maxsize=16)
def _tried(
    n: int, kind: FitKind, estimate: Estimator, n_lots: int, seed: int, stream: int
) -> tuple[Lots, Lots, FloatArray]:
    """Lots on [0, 1], what fits n draws from each, and how well: the same for any data."""
    rng = _generator(seed, stream)
    if kind == "uniform":
        units = [Bounded(lower=0.0, upper=1.0)] * n_lots
    else:
        reach = 1.0 + _AT_THE_ENDS
        middle, half = 0.5 * SHAPE_SUM, 0.5 * SHAPE_SUM - 1.0
        shapes = middle + half * reach * (2.0 * rng.random(_TRIED * n_lots) - 1.0)
        shapes = np.clip(shapes, middle - half, middle + half)
        units = [Bounded(lower=0.0, upper=1.0, alpha=a, beta=SHAPE_SUM - a) for a in shapes.tolist()]
    draws = np.array([np.sort(unit.quantile(rng.random(n))) for unit in units])
    fits = Lots.of([estimate(x, kind, None) for x in draws])
    return Lots.of(units), fits, cramer_von_mises(draws, fits)


def _generator(seed: int, stream: int) -> np.random.Generator:
    return np.random.Generator(np.random.Philox(np.random.SeedSequence(seed, spawn_key=(stream,))))


def _moved(lots: Lots, fits: Lots, onto: Bounded) -> Lots:
    """Each lot under the map that takes mean and spread of its fit to those of another."""
    scale = onto.sd / fits.sd
    offset = onto.mean - scale * fits.mean
    return replace(lots, lower=offset + scale * lots.lower, upper=offset + scale * lots.upper)


def _within(
    fitted: Bounded,
    n: int,
    kind: FitKind,
    estimate: Estimator,
    bounds: tuple[float, float],
    n_lots: int,
    rng: np.random.Generator,
) -> Plausible:
    draws = np.array([np.sort(fitted.quantile(rng.random(n))) for _ in range(n_lots)])
    fits = [estimate(x, kind, bounds) for x in draws]
    lots = [fitted] * n_lots if kind == "uniform" else [_mirrored(f, fitted) for f in fits]
    return Plausible(lots=Lots.of(lots), distances=cramer_von_mises(draws, Lots.of(fits)))


def _mirrored(fit: Bounded, at: Bounded) -> Bounded:
    """A fit of draws from `at`, taken to the other side of it: where it stood to `at`, `at` stands to the lot."""
    total, again = at.alpha + at.beta, fit.alpha + fit.beta
    middle = math.log(at.alpha / at.beta)
    # The mean errs by the spread, which goes with the root of the sum: a fit that is too narrow errs by less.
    away = (middle - math.log(fit.alpha / fit.beta)) * math.sqrt((again + 1.0) / (total + 1.0))
    mean = 1.0 / (1.0 + math.exp(-(middle + away)))
    total = total * total / again
    return replace(at, alpha=total * mean, beta=total * (1.0 - mean))
