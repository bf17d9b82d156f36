"""Owns confidence intervals of proportions and quantiles from independent draws (Eq. 11 and its companions).

None of them holds for quasi-random samples, whose points are not independent.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np

from softclose.arrays import FloatArray

Interval = tuple[float, float]

NO_INTERVAL: Interval = (math.nan, math.nan)


@dataclass(frozen=True, slots=True, kw_only=True)
class Proportion:
    """A proportion `count / n` with three intervals; NaN throughout where n is 0."""

    count: int
    """Draws that have the property."""
    n: int
    """Draws in all: the denominator."""
    estimate: float
    """count / n."""
    wald: Interval
    """Eq. 11, as published: estimate ± z sqrt(p (1 - p) / n). Not clipped; of no width at 0 and 1."""
    wilson: Interval
    """Wilson's score interval: close to its nominal coverage on average."""
    clopper_pearson: Interval
    """Clopper and Pearson's interval: at least its nominal coverage, always."""

    @property
    def half_width(self) -> float:
        """The `a` of Eq. 11."""
        return 0.5 * (self.wald[1] - self.wald[0])


def proportion(count: int, n: int, confidence: float = 0.95) -> Proportion:
    """All three intervals of count out of n at once. Raises ValueError unless 0 <= count <= n."""
    return Proportion(
        count=count,
        n=n,
        estimate=count / n if n else math.nan,
        wald=wald(count, n, confidence),
        wilson=wilson(count, n, confidence),
        clopper_pearson=clopper_pearson(count, n, confidence),
    )


def wald(count: int, n: int, confidence: float = 0.95) -> Interval:
    """Eq. 11. The printed 1.96 is the exact normal quantile here (1.959964 at 0.95)."""
    _check(count, n, confidence)
    if n == 0:
        return NO_INTERVAL
    p = count / n
    a = normal_quantile(confidence) * math.sqrt(p * (1.0 - p) / n)
    return p - a, p + a


def wilson(count: int, n: int, confidence: float = 0.95) -> Interval:
    """Wilson's score interval, without continuity correction."""
    _check(count, n, confidence)
    if n == 0:
        return NO_INTERVAL
    p, z = count / n, normal_quantile(confidence)
    shrink = 1.0 + z * z / n
    centre = (p + z * z / (2.0 * n)) / shrink
    a = z * math.sqrt(p * (1.0 - p) / n + (z / (2.0 * n)) ** 2) / shrink
    # The ends at 0 and n are exactly 0 and 1; rounding must not move them past the estimate.
    return (0.0 if count == 0 else max(centre - a, 0.0)), (1.0 if count == n else min(centre + a, 1.0))


@functools.lru_cache(maxsize=4096)
def clopper_pearson(count: int, n: int, confidence: float = 0.95) -> Interval:
    """The exact interval from Beta quantiles."""
    _check(count, n, confidence)
    if n == 0:
        return NO_INTERVAL
    from scipy.special import betaincinv

    tail = 0.5 * (1.0 - confidence)
    lower = 0.0 if count == 0 else float(betaincinv(count, n - count + 1, tail))
    upper = 1.0 if count == n else float(betaincinv(count + 1, n - count, 1.0 - tail))
    return lower, upper


def quantile_rank(n: int, level: float) -> int:
    """Rank k (1-based) of the order statistic that is the level-quantile of n draws: smallest k with k/n >= level.

    This is the inverse of the empirical distribution function, Eq. 9 as written (numpy's "inverted_cdf"); the
    tolerance keeps 0.9 * 10 at 9 where rounding would make it 10.
    """
    return min(max(math.ceil(n * level - 1e-9), 1), n)


@functools.lru_cache(maxsize=4096)
def order_statistic_ranks(n: int, level: float, confidence: float = 0.95) -> tuple[int, int]:
    """Ranks (1-based) of the draws that enclose the level-quantile with at least this confidence.

    Distribution-free: the number of draws below the quantile is binomial(n, level), so P(X_(l) <= q <= X_(u)) is at
    least P(l <= B <= u - 1). Each tail gets half of 1 - confidence. Rank 0, or n + 1: no draw bounds it on that side.
    """
    from scipy.special import bdtr

    if n == 0:
        return 0, 1
    tail = 0.5 * (1.0 - confidence)
    first, last = likely_counts(n, level, n * level)
    cdf = bdtr(np.arange(first, last + 1, dtype=np.float64), n, level)  # P(B <= k), k = first..last
    lower = first + int(np.searchsorted(cdf, tail, side="right"))  # largest l with P(B <= l - 1) <= tail
    upper = first + int(np.searchsorted(cdf, 1.0 - tail, side="left")) + 1  # smallest u with P(B >= u) <= tail
    return lower, upper


def quantile_interval(ordered: FloatArray, level: float, confidence: float = 0.95) -> Interval:
    """Order-statistic interval of the level-quantile. ordered: (n,) ascending; -inf or inf where nothing bounds it."""
    lower, upper = order_statistic_ranks(ordered.size, level, confidence)
    return (
        float(ordered[lower - 1]) if lower >= 1 else -math.inf,
        float(ordered[upper - 1]) if upper <= ordered.size else math.inf,
    )


def quantile_estimate(ordered: FloatArray, level: float, confidence: float = 0.95) -> tuple[float, Interval]:
    """The level-quantile of Eqs. 8-9 and its order-statistic interval. ordered: (n,) ascending, n >= 1."""
    value = float(ordered[quantile_rank(ordered.size, level) - 1])
    return value, quantile_interval(ordered, level, confidence)


def quantile_jumps(ordered: FloatArray, level: float, confidence: float = 0.95) -> tuple[float, float]:
    """Largest step between two neighbouring draws below and above the level-quantile, within its interval.

    ordered: (n,) ascending, n >= 1. Small beside the interval where the density at the quantile is; all of it where the
    draws have a gap there, over which the estimate jumps.
    """
    lower, upper = order_statistic_ranks(ordered.size, level, confidence)
    k = quantile_rank(ordered.size, level)
    below, above = np.diff(ordered[max(lower, 1) - 1 : k]), np.diff(ordered[k - 1 : upper])
    return float(below.max(initial=0.0)), float(above.max(initial=0.0))


def least_for_quantile_interval(level: float, confidence: float = 0.95) -> int:
    """Fewest draws that bound the level-quantile from above with this confidence: 36 at 90 % and 95 %."""
    n = 1
    while order_statistic_ranks(n, level, confidence)[1] > n:
        n += 1
    return n


def quantile_standard_error(ordered: FloatArray, level: float) -> float:
    """Maritz and Jarrett's standard error of the level-quantile. ordered: (n,) ascending; NaN for fewer than 2 draws.

    It is the bootstrap's own answer in closed form (no resampling, no seed): under resampling, the k-th of n draws is
    the i-th value with probability I(i/n; k, n-k+1) - I((i-1)/n; k, n-k+1).
    """
    n = ordered.size
    if n < 2:
        return math.nan
    from scipy.special import betainc

    k = quantile_rank(n, level)
    first, last = likely_counts(n, level, k)
    weight = np.diff(betainc(k, n - k + 1, np.arange(first, last + 1) / n))
    values = ordered[first:last]
    mean = weight @ values / weight.sum()
    return math.sqrt(float(weight @ (values - mean) ** 2 / weight.sum()))


def likely_counts(n: int, level: float, centre: float) -> tuple[int, int]:
    """Counts within ten standard deviations of binomial(n, level); those beyond carry no weight that matters."""
    reach = 10.0 * math.sqrt(n * level * (1.0 - level)) + 10.0
    return max(int(centre - reach), 0), min(int(centre + reach), n)


def student_interval(values: FloatArray, confidence: float = 0.95) -> Interval:
    """Student's interval of the mean of draws that are about normal, such as replicates. (n,); NaN for fewer than 2."""
    n = values.size
    if n < 2:
        return NO_INTERVAL
    mean = float(values.mean())
    a = student_quantile(confidence, n - 1) * float(values.std(ddof=1)) / math.sqrt(n)
    return mean - a, mean + a


def mean_interval(values: FloatArray, confidence: float = 0.95) -> Interval:
    """Interval of the mean of draws of any distribution. values: (n,); NaN for fewer than 2.

    Student's, each end moved out to that of Hall's transformed t (1992, eq. 3.6) where skewness puts it further out.
    Hall's takes the skewness out of t by a monotone cubic, to the order of the bootstrap-t and without resampling;
    Student's keeps the other end where a small sample shows less skewness than there is. Coverage:
    docs/measurements/coverage.md. No interval knows of what no draw has shown: see `unseen_share`.
    """
    lower, upper = student_interval(values, confidence)
    n = values.size
    spread = float(values.std()) if n > 2 else 0.0
    if not spread > 0.0:
        return lower, upper
    mean = float(values.mean())
    z = (values - mean) / spread
    skewness = float((z * z * z).mean()) * math.sqrt(n * (n - 1.0)) / (n - 2.0)  # a power takes ten times as long
    slope = skewness / math.sqrt(n)
    if abs(slope) < 1e-6:  # the cubic is a straight line
        return lower, upper
    se = spread / math.sqrt(n - 1.0)
    t = student_quantile(confidence, n - 1)

    def untransformed(x: float) -> float:
        return 3.0 / slope * (math.cbrt(1.0 + slope * (x - slope / 6.0)) - 1.0)

    return min(lower, mean - se * untransformed(t)), max(upper, mean - se * untransformed(-t))


def unseen_share(n: int, confidence: float = 0.95) -> float:
    """Largest share of a lot that n draws may have missed altogether, at this confidence: about 3 / n at 95 %.

    What a group of that size does to a mean, no interval from these draws can know.
    """
    return 1.0 if n == 0 else -math.expm1(math.log1p(-confidence) / n)


def student_quantile(confidence: float, degrees: int) -> float:
    """Two-sided quantile of Student's distribution."""
    from scipy.special import stdtrit

    return float(stdtrit(degrees, 0.5 * (1.0 + confidence)))


@functools.cache
def normal_quantile(confidence: float) -> float:
    """Two-sided standard normal quantile: 1.96 at 0.95."""
    from statistics import NormalDist

    return NormalDist().inv_cdf(0.5 * (1.0 + confidence))


def _check(count: int, n: int, confidence: float) -> None:
    if not 0 <= count <= n:
        raise ValueError(f"count is {count} of n = {n}; it must lie between 0 and n")
    if not 0.0 < confidence < 1.0:
        raise ValueError(f"confidence is {confidence:g}; it must lie between 0 and 1 (0.95 is usual)")
