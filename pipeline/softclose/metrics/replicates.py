"""Owns intervals of figures from R independent scramblings of one low-discrepancy ensemble (ADR 092).

Switch i belongs to scrambling i mod R. Points of one scrambling are not independent, R scramblings are. An interval
is sectioned about the pooled value (Asmussen and Glynn 2007, III.5; Nakayama 2014): the figure of all switches, give or
take Student's quantile of R - 1 degrees times the root mean square deviation of the R scramblings' own figures from
it. The mean of these figures, about which batches would be taken, is biased for quantiles.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from softclose.arrays import FloatArray
from softclose.metrics import intervals
from softclose.metrics.intervals import Interval, Proportion

REPLICATES = 16
"""R. With 8 the intervals are wider and hold no better; with 32 each scrambling has too few switches."""
FEWEST = 10
"""Switches of a scrambling below which its own quantiles say nothing: those of independent draws hold instead."""
RARE = 10
"""Switches of a kind below which scramblings differ by luck alone: Clopper and Pearson's interval instead."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sections:
    """Figures of each scrambling by itself, (R,) each; NaN where one is undefined."""

    v_u: FloatArray
    """level-quantile of the speeds."""
    cvar: FloatArray
    """Mean speed beyond it."""
    mean: FloatArray
    """Mean speed."""
    p_nc: FloatArray
    """Fraction not closed."""
    closing: FloatArray
    """level-quantile of the closing times; NaN where they are not known, or a scrambling may well not have one."""
    exceed: FloatArray
    """(R, n_limits) fraction of the switches in contact beyond each limit."""
    excess: FloatArray
    """(R, n_limits) expected excess over each."""


def sections(
    speed: FloatArray,
    closed: NDArray[np.bool_],
    settling: FloatArray | None,
    *,
    level: float,
    limits: Sequence[float],
) -> Sections:
    """The figures of each scrambling. speed: (n,), NaN without contact; settling: (n,) [µs], inf: never."""
    v = _by_replicate(speed)
    ordered = np.sort(v, axis=1)  # those without contact, and the places beyond the last switch, come last
    count = (~np.isnan(v)).sum(axis=1)
    v_u = _quantiles(ordered, count, level)
    v_u = np.where(count.min() < FEWEST, math.nan, v_u)
    with np.errstate(invalid="ignore", divide="ignore"):
        beyond = np.nansum(np.maximum(v - v_u[:, None], 0.0), axis=1) / count
        over = [np.nansum(np.maximum(v - limit, 0.0), axis=1) / count for limit in limits]
        share = [(v > limit).sum(axis=1) / count for limit in limits]
        mean = np.nansum(v, axis=1) / count
        open_ = _by_replicate((~closed).astype(np.float64))
        p_nc = np.nansum(open_, axis=1) / (~np.isnan(open_)).sum(axis=1)
    closing = np.full(REPLICATES, math.nan)
    if settling is not None:
        times = _by_replicate(settling)
        count = (~np.isnan(times)).sum(axis=1)
        closing = _quantiles(np.sort(times, axis=1), count, level)
        never = float(np.isinf(times).sum()) / settling.size
        # By the whole lot's share: where it hung on the scramblings drawn, the lucky ones would not hold.
        if count.min() < FEWEST or never + 3.0 * math.sqrt(never / count.min()) > 1.0 - level:
            closing = np.full(REPLICATES, math.nan)
    return Sections(
        v_u=v_u,
        cvar=v_u + beyond / (1.0 - level),
        mean=mean,
        p_nc=p_nc,
        closing=closing,
        exceed=np.stack(share, axis=1) if share else np.zeros((REPLICATES, 0)),
        excess=np.stack(over, axis=1) if over else np.zeros((REPLICATES, 0)),
    )


def about(
    pooled: float, parts: FloatArray, confidence: float = 0.95, *, otherwise: Interval = intervals.NO_INTERVAL
) -> Interval:
    """Interval about the pooled value from the parts', (R,).

    otherwise: the interval of as many independent draws, for figures of which a scrambling by itself has none, or an
    infinite one: the ensemble is small, or few touch. It is wider, and scrambled points keep it as independent ones do.
    """
    if not (math.isfinite(pooled) and bool(np.isfinite(parts).all())):
        return otherwise
    a = intervals.student_quantile(confidence, parts.size - 1) * standard_error(pooled, parts)
    return pooled - a, pooled + a


def standard_error(pooled: float, parts: FloatArray) -> float:
    """Of the pooled value."""
    return math.sqrt(float(((parts - pooled) ** 2).sum()) / (parts.size * (parts.size - 1)))


def proportion(count: int, n: int, parts: FloatArray, confidence: float = 0.95) -> Proportion:
    """A proportion with its interval by sections in the place of all three, or Clopper and Pearson's where few count.

    That one is for independent draws, of which scrambled points are no worse a sample.
    """
    exact = intervals.clopper_pearson(count, n, confidence)
    low, high = about(count / n if n else math.nan, parts, confidence, otherwise=exact)
    if min(count, n - count) < RARE:
        low, high = exact
    ends = max(low, 0.0) if low == low else low, min(high, 1.0) if high == high else high
    return Proportion(
        count=count, n=n, estimate=count / n if n else math.nan, wald=ends, wilson=ends, clopper_pearson=ends
    )


def _by_replicate(values: FloatArray) -> FloatArray:
    """(R, m) of (n,), value i in row i mod R; NaN beyond the last."""
    m = -(-values.size // REPLICATES)
    padded = np.full(m * REPLICATES, math.nan)
    padded[: values.size] = values
    return padded.reshape(m, REPLICATES).T


def _quantiles(ordered: FloatArray, count: NDArray[np.int64], level: float) -> FloatArray:
    """The level-quantile of the first `count` of each row, as `intervals.quantile_rank` has it; NaN of none."""
    rank = [intervals.quantile_rank(int(k), level) - 1 if k else 0 for k in count]
    return np.where(count > 0, ordered[np.arange(len(rank)), rank], math.nan)
