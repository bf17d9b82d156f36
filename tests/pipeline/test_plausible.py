"""Claims about lots that a handful of devices may have come from: each is moved as its own fit is onto ours."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from softclose.arrays import FloatArray
from softclose.population.distributions import Bounded
from softclose.population.plausible import FitKind, Lots, Plausible, cramer_von_mises, plausible

FITTED = Bounded(lower=2.0, upper=5.0, alpha=1.4, beta=2.6)
N, N_LOTS = 12, 40


class Moments:
    """A fit by mean and spread, which moves and stretches with its draws, and by skewness; it keeps what it saw."""

    def __init__(self, *, skewed: bool = True) -> None:
        self.draws: list[FloatArray] = []
        self.skewed = skewed

    def __call__(self, x: FloatArray, kind: FitKind, bounds: tuple[float, float] | None) -> Bounded:
        self.draws.append(x)
        low, high = bounds or (x.min() - 0.1 * np.ptp(x), x.max() + 0.1 * np.ptp(x))
        if kind == "uniform":
            return Bounded(lower=low, upper=high)
        if bounds is not None:
            mean, total = (x.mean() - low) / (high - low), 3.0 + np.ptp(x)
            return Bounded(lower=low, upper=high, alpha=total * mean, beta=total * (1.0 - mean))
        alpha = 2.0 + (0.9 * math.tanh((x.mean() - np.median(x)) / x.std()) if self.skewed else 0.0)
        return Bounded(lower=low, upper=high, alpha=alpha, beta=4.0 - alpha)


def tried(
    kind: FitKind,
    *,
    bounds: tuple[float, float] | None = None,
    fitted: Bounded = FITTED,
    seed: int = 3,
    stream: int = 1,
) -> tuple[Plausible, Moments]:
    estimate = Moments()
    found = plausible(fitted, N, kind, estimate, bounds=bounds, n_lots=N_LOTS, seed=seed, stream=stream)
    return found, estimate


def test_many_lots_are_what_each_is() -> None:
    each = [Bounded(lower=0.0, upper=2.0, alpha=1.5, beta=2.5), FITTED, Bounded(lower=-1.0, upper=4.0)]
    lots = Lots.of(each)
    assert len(lots) == 3
    assert [lots[i] for i in range(3)] == each
    assert [lots.only(np.array([2, 0]))[i] for i in range(2)] == [each[2], each[0]]
    np.testing.assert_allclose(lots.mean, [b.mean for b in each], rtol=1e-12)
    np.testing.assert_allclose(lots.sd, [b.sd for b in each], rtol=1e-12)


def test_the_distance_from_a_distribution_is_scipys() -> None:
    x = np.sort(np.random.default_rng(1).uniform(1.9, 5.2, (2, 9)))  # some lie outside
    other = Bounded(lower=1.0, upper=6.0)
    law = stats.beta(1.4, 2.6, loc=2.0, scale=3.0)
    assert float(cramer_von_mises(x[0], FITTED)) == pytest.approx(stats.cramervonmises(x[0], law.cdf).statistic)
    both = cramer_von_mises(x, Lots.of([FITTED, other]))
    second = stats.cramervonmises(x[1], stats.uniform(1.0, 5.0).cdf).statistic
    np.testing.assert_allclose(both, [float(cramer_von_mises(x[0], FITTED)), second])


@pytest.mark.parametrize(("kind", "alpha"), [("uniform", 1.0), ("beta", 1.4), ("beta", 2.6)])
def test_each_lot_is_moved_and_stretched_until_its_fit_has_our_mean_and_spread(kind: FitKind, alpha: float) -> None:
    ours = Bounded(lower=2.0, upper=5.0, alpha=alpha, beta=4.0 - alpha if kind == "beta" else 1.0)
    found, estimate = tried(kind, fitted=ours)
    draws = estimate.draws
    assert {x.shape for x in draws} == {(N,)}
    fits = [Moments()(x, kind, None) for x in draws]
    if kind == "beta":  # twice as many are tried, and those are kept whose fit has our shape
        assert len(fits) == 2 * N_LOTS
        kept = sorted(sorted(range(len(fits)), key=lambda i: abs(fits[i].alpha - ours.alpha))[:N_LOTS])
    else:
        kept = list(range(N_LOTS))
        assert len(fits) == N_LOTS
    assert len(found.lots) == N_LOTS
    for lot, i in zip([found.lots[k] for k in range(N_LOTS)], kept, strict=True):
        moved = Moments()(lot.lower + (lot.upper - lot.lower) * draws[i], kind, None)
        assert moved.mean == pytest.approx(ours.mean)
        assert moved.sd == pytest.approx(ours.sd)
    np.testing.assert_allclose(
        found.distances, cramer_von_mises(np.array(draws)[kept], Lots.of([fits[i] for i in kept]))
    )


def test_lots_of_every_shape_are_tried_and_those_at_the_ends_of_the_range_more_often() -> None:
    none = Moments(skewed=False)  # whose shapes tell nothing, so that none is chosen by it
    lots = plausible(FITTED, N, "beta", none, bounds=None, n_lots=400, seed=3, stream=1).lots
    np.testing.assert_allclose(lots.alpha + lots.beta, 4.0)
    assert (lots.alpha.min(), lots.alpha.max()) == (1.0, 3.0)
    inside = lots.alpha[(lots.alpha > 1.0) & (lots.alpha < 3.0)]
    assert 0.7 < inside.size / 400 < 0.9, "a quarter of a half-width on either side: one in five"
    assert stats.kstest(inside, stats.uniform(1.0, 2.0).cdf).pvalue > 0.01


def test_draws_are_those_of_their_lot() -> None:
    found, estimate = tried("uniform")
    everything = np.array(estimate.draws).ravel()
    assert stats.kstest(everything, "uniform").pvalue > 0.01
    assert all((np.diff(x) > 0.0).all() for x in estimate.draws), "in order"
    _, estimate = tried("beta", bounds=(2.0, 5.0))
    assert stats.kstest(np.array(estimate.draws).ravel(), stats.beta(1.4, 2.6, loc=2.0, scale=3.0).cdf).pvalue > 0.01
    assert len(found.lots) == N_LOTS


def test_within_known_bounds_the_logit_of_the_mean_and_the_sum_of_the_shapes_are_mirrored() -> None:
    found, estimate = tried("beta", bounds=(2.0, 5.0))
    assert len(found.lots) == N_LOTS
    fits = [Moments()(x, "beta", (2.0, 5.0)) for x in estimate.draws]
    for i, fit in enumerate(fits):
        lot = found.lots[i]
        assert (lot.lower, lot.upper) == (2.0, 5.0)
        total = fit.alpha + fit.beta
        assert math.log(lot.alpha + lot.beta) + math.log(total) == pytest.approx(2.0 * math.log(4.0))
        error = math.log(fit.alpha / fit.beta) - math.log(1.4 / 2.6)
        # The error in units of the spread of a mean, which goes with one over the root of the sum and 1.
        away = math.log(1.4 / 2.6) - math.log(lot.alpha / lot.beta)
        assert away == pytest.approx(error * math.sqrt((total + 1.0) / 5.0))
    np.testing.assert_allclose(found.distances, cramer_von_mises(np.array(estimate.draws), Lots.of(fits)))


def test_a_uniform_within_known_bounds_is_itself() -> None:
    ours = Bounded(lower=2.0, upper=5.0)
    found, _ = tried("uniform", bounds=(2.0, 5.0), fitted=ours)
    assert [found.lots[i] for i in range(len(found.lots))] == [ours] * N_LOTS


@pytest.mark.parametrize("bounds", [None, (2.0, 5.0)])
def test_draws_are_those_of_the_seed_and_of_the_stream(bounds: tuple[float, float] | None) -> None:
    first, again, other, beside = (
        tried("beta", bounds=bounds, seed=seed, stream=stream)[0].distances
        for seed, stream in ((3, 1), (3, 1), (4, 1), (3, 2))
    )
    np.testing.assert_array_equal(first, again)
    assert (first != other).all()
    assert (first != beside).all()
