"""Owns paired comparisons: how much softer one waveform is than another on the very same switches, with intervals.

The same switches under both waveforms: what they share cancels in the difference; independent ensembles cannot do that.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softclose.metrics import intervals
from softclose.metrics.intervals import Interval, Proportion
from softclose.metrics.objective import CM_S, Assessment, Response

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """A design against a reference on the same switches. Differences are design minus reference: negative is better."""

    v_u_cm_s: float
    """Difference of the upper velocities [cm/s]; NaN where one is undefined."""
    v_u_interval: Interval
    """Its interval."""
    mean_cm_s: float
    """Difference of V, averaged over the switches that touch under both [cm/s]."""
    mean_interval: Interval
    """Its interval (Student, of the pairs)."""
    p_nc: float
    """Difference of the fractions not closed."""
    p_nc_interval: Interval
    """Its interval, from the switches that close under one waveform only."""
    softer: Proportion
    """Switches with the smaller V under the design, among those that touch under both."""

    def to_dict(self) -> dict[str, Any]:
        """Nested plain values."""
        return asdict(self)


def compare(
    design: tuple[Response, Assessment], reference: tuple[Response, Assessment], confidence: float = 0.95
) -> Comparison:
    """Compare two waveforms on the same switches. Each is its response (n switches, same order) and its assessment.

    v_u: the two estimates are asymptotically normal with the influence of switch i on each proportional to
    contact·(level - 1{V <= v_u}), scaled to Maritz and Jarrett's standard error; the error of the difference is the
    standard deviation of the influences' difference over sqrt(n). No resampling, no seed; a test has the bootstrap.
    """
    z = intervals.normal_quantile(confidence)
    (a, left), (b, right) = design, reference
    n = left.n
    v_u = left.v_u_cm_s - right.v_u_cm_s
    a_v_u = z * float(np.std(v_u_influence(a, left) - v_u_influence(b, right))) / math.sqrt(n)

    va, vb = np.asarray(a.max_contact_speed) * CM_S, np.asarray(b.max_contact_speed) * CM_S
    both = ~(np.isnan(va) | np.isnan(vb))
    pairs = va[both] - vb[both]

    open_a, open_b = ~np.asarray(a.closed), ~np.asarray(b.closed)
    only_a, only_b = int((open_a & ~open_b).sum()), int((open_b & ~open_a).sum())
    p = (only_a - only_b) / n
    a_p = z * math.sqrt(only_a + only_b - (only_a - only_b) ** 2 / n) / n
    return Comparison(
        v_u_cm_s=v_u,
        v_u_interval=(v_u - a_v_u, v_u + a_v_u),
        mean_cm_s=float(pairs.mean()) if pairs.size else math.nan,
        mean_interval=intervals.mean_interval(pairs, confidence),
        p_nc=p,
        p_nc_interval=(p - a_p, p + a_p),
        softer=intervals.proportion(int((pairs < 0.0).sum()), pairs.size, confidence),
    )


def v_u_influence(response: Response, assessment: Assessment) -> FloatArray:
    """(n,) influence of each switch on v_u [cm/s], scaled so that its standard deviation over sqrt(n) is the error."""
    v = np.asarray(response.max_contact_speed) * CM_S
    contact = ~np.isnan(v)
    raw: FloatArray = np.where(contact, assessment.level - (v <= assessment.v_u_cm_s), 0.0)
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
