"""Owns paired comparisons: how much softer one waveform is than another on the very same switches, with intervals.

The same switches under both waveforms: what they share cancels in the difference; independent ensembles cannot do that.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from softclose.arrays import FloatArray
from softclose.metrics import intervals
from softclose.metrics.intervals import Interval, Proportion
from softclose.metrics.objective import CM_S, Assessment, Response, in_time, is_read, those_read


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """A design against a reference on the same switches. Differences are design minus reference: negative is better."""

    v_u_cm_s: float
    """Difference of the upper velocities [cm/s]; NaN where one is undefined."""
    v_u_interval: Interval
    """Its interval (counts of switches below both); open where too few touch to bound a v_u."""
    mean_cm_s: float
    """Difference of V, averaged over the switches that touch under both [cm/s]."""
    mean_interval: Interval
    """Its interval, of the pairs (`intervals.mean_interval`)."""
    p_nc: float
    """Difference of the fractions not closed."""
    p_nc_interval: Interval
    """Its interval, from the switches that close under one waveform only (Bonett and Price): never of no width."""
    softer: Proportion
    """Switches with the smaller V under the design, among those that touch under both."""

    def to_dict(self) -> dict[str, Any]:
        """Nested plain values."""
        return asdict(self)


def compare(
    design: tuple[Response, Assessment], reference: tuple[Response, Assessment], confidence: float = 0.95
) -> Comparison:
    """Compare two waveforms on the same switches. Each is its response (n switches, same order) and its assessment.

    v_u: see `quantile_difference`. No resampling, no seed; a test has the bootstrap.
    """
    (a, left), (b, right) = design, reference
    if np.shape(a.closed) == np.shape(b.closed):  # a switch that was read under one of them makes no pair
        kept = is_read(a) & is_read(b)
        a, b = those_read(a, kept), those_read(b, kept)
    n = len(np.asarray(a.closed))
    v_u = left.v_u_cm_s - right.v_u_cm_s

    va, vb = np.asarray(a.max_contact_speed) * CM_S, np.asarray(b.max_contact_speed) * CM_S
    both = ~(np.isnan(va) | np.isnan(vb))
    pairs = va[both] - vb[both]

    open_a, open_b = ~in_time(a, left.closed_by_us), ~in_time(b, right.closed_by_us)
    only_a, only_b = int((open_a & ~open_b).sum()), int((open_b & ~open_a).sum())
    return Comparison(
        v_u_cm_s=v_u,
        v_u_interval=_v_u_difference(va, left, vb, right, confidence),
        mean_cm_s=float(pairs.mean()) if pairs.size else math.nan,
        mean_interval=intervals.mean_interval(pairs, confidence),
        p_nc=(only_a - only_b) / n,
        p_nc_interval=proportion_difference(only_a, only_b, n, confidence),
        softer=intervals.proportion(int((pairs < 0.0).sum()), pairs.size, confidence),
    )


def proportion_difference(only_a: int, only_b: int, n: int, confidence: float = 0.95) -> Interval:
    """Interval of the difference of two proportions of the same n, from those that only one of them counts.

    Bonett and Price (2012): Wald's after one more of each kind, so that rare differences have a width; Wald's own has
    none where no switch differs, and Tango's score interval covers 93 % where about four do, all on one side.
    """
    a, b, m = only_a + 1, only_b + 1, n + 2
    reach = intervals.normal_quantile(confidence) * math.sqrt(a + b - (a - b) ** 2 / m) / m
    return max((a - b) / m - reach, -1.0), min((a - b) / m + reach, 1.0)


def _v_u_difference(va: FloatArray, left: Assessment, vb: FloatArray, right: Assessment, confidence: float) -> Interval:
    if math.isnan(left.v_u_cm_s) or math.isnan(right.v_u_cm_s):
        return intervals.NO_INTERVAL
    a, b = (_exceeding(v, assessment) for v, assessment in ((va, left), (vb, right)))
    spread = float(a.std() * b.std())
    shared = float(((a - a.mean()) * (b - b.mean())).mean()) / spread if spread > 0.0 else 0.0
    contact_a, contact_b = (np.sort(v[~np.isnan(v)]) for v in (va, vb))
    return quantile_difference(contact_a, contact_b, left.level, shared, confidence)


def quantile_difference(
    a: FloatArray, b: FloatArray, level: float, correlation: float, confidence: float = 0.95
) -> Interval:
    """Interval of the difference of the level-quantiles of draws that come in pairs. a, b: ascending, (n_a,), (n_b,).

    correlation: that of which draws lie above both quantiles. How many draws lie below each quantile is binomial, and
    these counts bound it by order statistics, as in `intervals.quantile_interval`; here the two counts are drawn
    together, by a normal copula of that correlation, at fixed and equally likely nodes, and the interval has the middle
    `confidence` of the differences. So shifts cancel, and gaps, atoms and clusters need no density. The correlation is
    taken down by one pair more on each side that differs, as in `proportion_difference`.
    """
    from scipy.special import bdtr, ndtr, ndtri

    n = min(a.size, b.size)
    rho = min(max(correlation - 1.0 / (n * level * (1.0 - level)), -1.0), 1.0)
    x = ndtri((np.arange(_NODES) + 0.5) / _NODES)
    y = rho * x[:, None] + math.sqrt(1.0 - rho * rho) * x

    def bounds(ordered: FloatArray, normal: FloatArray) -> tuple[FloatArray, FloatArray]:
        size = ordered.size
        first, last = intervals.likely_counts(size, level, size * level)
        cdf = bdtr(np.arange(first, last + 1, dtype=np.float64), size, level)
        below = np.minimum(first + np.searchsorted(cdf, ndtr(normal)), size)
        ends = np.concatenate([[-math.inf], ordered, [math.inf]])
        return ends[below], ends[below + 1]

    (a_low, a_high), (b_low, b_high) = bounds(a, x[:, None]), bounds(b, y)
    skipped = int(0.5 * (1.0 - confidence) * y.size)
    low = np.partition((a_low - b_high).ravel(), skipped)[skipped]
    high = np.partition((a_high - b_low).ravel(), y.size - 1 - skipped)[y.size - 1 - skipped]
    return float(low), float(high)


_NODES = 128


def _exceeding(v: FloatArray, assessment: Assessment) -> FloatArray:
    """(n,) influence of each switch on v_u but for its scale: contact·(level - 1{V <= v_u})."""
    return np.where(np.isnan(v), 0.0, assessment.level - (v <= assessment.v_u_cm_s))


def v_u_influence(response: Response, assessment: Assessment) -> FloatArray:
    """(n,) influence of each switch on v_u [cm/s], scaled so that its standard deviation over sqrt(n) is the error."""
    v = np.asarray(response.max_contact_speed) * CM_S
    contact = ~np.isnan(v)
    raw = _exceeding(v, assessment)
    spread = float(raw.std())
    if spread == 0.0:
        return np.full(v.shape, math.nan)
    se = intervals.quantile_standard_error(np.sort(v[contact]), assessment.level)
    return raw * (se * math.sqrt(v.size) / spread)


def spread_at(ordered: FloatArray, level: float, n: int, confidence: float = 0.95) -> Interval:
    """Range of the level-quantile's estimates from ensembles of only n draws. ordered: (m,) ascending, m much larger.

    Exact but for the m draws standing for the population: the k-th of n uniform draws is Beta(k, n-k+1). It says which
    published figure from n draws agrees with a certified one.
    """
    from scipy.special import betaincinv

    if ordered.size == 0:
        return intervals.NO_INTERVAL
    k = intervals.quantile_rank(n, level)
    tail = 0.5 * (1.0 - confidence)
    at = betaincinv(k, n - k + 1, np.array([tail, 1.0 - tail]))
    index = (at * ordered.size).astype(int)
    return float(ordered[index[0]]), float(ordered[index[1]])
