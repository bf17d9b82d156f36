"""Owns figures of a few costly switches with a cheap model as control variate: on the same switches, and on many more.

What the cheap model says of the same switches tells how this sample differs from the lot, of which many cheap switches
know. Each costly switch gets a weight such that the weighted sample has the lot's cheap figures (calibration, Deville
and Särndal 1992): the regression estimator of control variates, once for every figure, quantiles included (Hesterberg
and Nelson 1998). An interval rests on what the regression leaves of each figure's influence function.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from softclose.arrays import FloatArray
from softclose.metrics import intervals, replicates
from softclose.metrics.intervals import Interval
from softclose.metrics.joined import joint, reach
from softclose.metrics.limit import limit_on
from softclose.metrics.objective import (
    CM_S,
    MAX_FAILED,
    Assessment,
    Form,
    Response,
    arrays_of,
    penalty_cm_s,
    those_read,
)
from softclose.metrics.ranking import rank_cm_s

LEAST = 80
"""Costly switches below which intervals by regression hold too rarely: their figures stay as they are."""

PAYS = 0.9
"""A control variate is used where it brings the standard error of g, as stated, to this share or less: a smaller gain
is not worth that figures rest on two models."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Control:
    """What a cheap model says under the waveform of a costly response."""

    same: Response
    """Of the very same switches, in their order."""
    many: Response
    """Of many more of the same lot."""


def gain(plain: Assessment, controlled: Assessment) -> float:
    """Standard error of g with the control variate over that without; NaN where there is none."""
    if controlled is plain or not plain.g_se_cm_s > 0.0:
        return math.nan
    return controlled.g_se_cm_s / plain.g_se_cm_s


def pays(gains: Sequence[float]) -> bool:
    """Whether the control variate is worth it, by what it did for several candidates: in the median."""
    known = [g for g in gains if not math.isnan(g)]
    return bool(known) and float(np.median(known)) <= PAYS


def controlled(
    a: Assessment,
    response: Response,
    control: Control,
    *,
    form: Form,
    c1_cm_s: float,
    chance_penalty_cm_s: float,
    p_max: float | None,
    assured: bool,
    sampling: str,
) -> Assessment:
    """The assessment of a costly response with the cheap model as control variate.

    v_u, mean V, p_nc and g follow, with their intervals. What looks farther into the tail (CVaR, P(V > limit), the
    excess) and the closing time stay those of the costly switches alone. The same assessment where these are too few,
    too few of them touched, or the cheap model's figures do not vary.

    Parameters
    ----------
    a : Assessment
        Of the response alone.
    response : Response
        Of the costly model.
    control : Control
        Of the cheap one.
    form, c1_cm_s, chance_penalty_cm_s, p_max, assured
        As in `assess`; g is made of v_u.
    sampling : str
        "monte-carlo" or "replicated", as in `assess`.

    Returns
    -------
    Assessment

    Raises
    ------
    ObjectiveError
        For a response that cannot be assessed.
    """
    response = those_read(response)
    speed, closed, _ = arrays_of(response, a.closed_by_us)
    cheap, cheap_closed, _ = arrays_of(control.same, a.closed_by_us)
    many, many_closed, n_failed = arrays_of(control.many, a.closed_by_us)
    n, contact = speed.size, ~np.isnan(speed)
    enough = n >= LEAST and cheap.size == n and a.n_failed <= MAX_FAILED * n and n_failed <= MAX_FAILED * many.size
    if not enough or math.isnan(a.v_u_cm_s) or np.isnan(many).all():
        return a
    threshold = float(np.nanquantile(many, a.level, method="inverted_cdf"))
    sample = _Calibrated.of(
        _controls(cheap, cheap_closed, threshold), _controls(many, many_closed, threshold), sampling, a.confidence
    )
    if sample is None:
        return a
    v = np.where(contact, speed * CM_S, 0.0)
    order = np.argsort(v[contact], kind="stable")
    ordered, weights = v[contact][order], sample.weights[contact][order]
    touching = float(weights.sum())
    # Weights may be negative, if hardly ever: the least speed from which a share is reached.
    reached = np.maximum.accumulate(np.cumsum(weights)) / touching if touching > 0.0 else np.zeros(weights.size)

    def quantile(level: float) -> float:
        if level <= 0.0:
            return 0.0
        place = int(np.searchsorted(reached, level - 1e-9))
        return float(ordered[place]) if place < ordered.size else math.inf

    v_u = quantile(a.level)
    if not math.isfinite(v_u):
        return a
    below = np.asarray(contact * (a.level - (v <= v_u)), dtype=np.float64)
    seen, half = (sample.student * sample.error(below, unseen=unseen) / touching for unseen in (0.0, 1.0))
    v_u_interval = quantile(a.level - half), quantile(a.level + half)
    around = ordered[(ordered >= v_u_interval[0]) & (ordered <= v_u_interval[1])]
    step = float(np.ptp(around)) / around.size  # it is one of the costly speeds, however well the level is known
    v_u_se = math.hypot(0.5 * (quantile(a.level + seen) - quantile(a.level - seen)) / sample.student, step)
    mean = float(sample.weights @ v) / touching
    low, high = sample.about(mean, contact * (v - mean) / touching)
    open_ = (~closed).astype(np.float64)
    p_nc = min(max(float(sample.weights @ open_), 0.0), 1.0)
    half = sample.student * sample.error(open_, unseen=2.0)
    p_low, p_high = max(p_nc - half, 0.0), min(p_nc + half, 1.0)
    ends = (p_low, p_high)

    def penalty(p: float) -> float:
        return penalty_cm_s(p, form=form, c1_cm_s=c1_cm_s, chance_penalty_cm_s=chance_penalty_cm_s, p_max=p_max)

    p_se = penalty(p_nc + sample.error(open_)) - penalty(p_nc)
    g = v_u + penalty(p_high if assured and form == "chance" else p_nc)
    association = sample.correlation(below, open_)
    jump = float(np.diff(around).max(initial=0.0))
    down = reach(v_u - v_u_interval[0], penalty(p_nc) - penalty(p_low), association, jump)
    up = reach(v_u_interval[1] - v_u, penalty(p_high) - penalty(p_nc), association, jump)
    found = replace(
        a,
        g_cm_s=g,
        g_interval=(g - down, g + up),
        g_se_cm_s=joint(v_u_se, p_se, association) if math.isfinite(v_u_se) else a.g_se_cm_s,
        rank_cm_s=rank_cm_s(g, p_nc, a.max_open),
        v_u_cm_s=v_u,
        v_u_interval=v_u_interval,
        mean_cm_s=mean,
        mean_interval=(max(low, 0.0), high),
        p_nc=p_nc,
        p_nc_intervals=replace(a.p_nc_intervals, estimate=p_nc, wald=ends, wilson=ends, clopper_pearson=ends),
    )
    if form != "chance":
        return found
    limit = limit_on(found.p_nc_intervals, float(p_max or 0.0), a.confidence, valid=True)
    return replace(found, limit=limit, feasible=limit.verdict == "met")


def _controls(speed: FloatArray, closed: NDArray[np.bool_], threshold: float) -> FloatArray:
    """(n, 4) of the cheap model: touched, how fast, beyond its own quantile or not, closed."""
    contact = ~np.isnan(speed)
    v = np.where(contact, speed, 0.0)
    return np.stack([contact, v, contact & (v <= threshold), closed], axis=1).astype(np.float64)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Calibrated:
    """A sample whose weights give it the cheap figures of the lot."""

    weights: FloatArray
    """(n,) adding up to 1."""
    student: float
    """Quantile of Student's distribution for its errors."""
    _centred: FloatArray
    """(n, k) the controls about their means."""
    _free: FloatArray
    """(n,) what of each switch's figure the regression does not follow, a tenth at least."""
    _spread: FloatArray
    """(k, k) their covariance among the many, over the number of these: what the many do not know either."""
    _degrees: int
    """Switches less what was fitted to them."""
    _confidence: float
    _sectioned: bool
    """The sample consists of independent scramblings, as `replicates` has them."""

    @classmethod
    def of(cls, same: FloatArray, many: FloatArray, sampling: str, confidence: float) -> _Calibrated | None:
        """same: (n, k) controls of the sample, many: (N, k) those of the lot. None where none of them varies."""
        varies = (np.ptp(same, axis=0) > 0.0) & (np.ptp(many, axis=0) > 0.0)
        if not varies.any():
            return None
        scale = many[:, varies].std(axis=0)
        same, many = same[:, varies] / scale, many[:, varies] / scale
        n, middle = len(same), same.mean(axis=0)
        centred = same - middle
        shift, _, rank, _ = np.linalg.lstsq(centred.T @ centred, many.mean(axis=0) - middle, rcond=1e-9)
        degrees = n - int(rank) - 1
        sectioned = sampling == "replicated"
        return cls(
            weights=1.0 / n + centred @ shift,
            student=intervals.student_quantile(confidence, replicates.REPLICATES - 1 if sectioned else degrees),
            _centred=centred,
            _free=np.maximum(1.0 - 1.0 / n - (np.linalg.qr(centred)[0] ** 2).sum(axis=1), 0.1),
            _spread=np.atleast_2d(np.cov(many.T)) / len(many),
            _degrees=degrees,
            _confidence=confidence,
            _sectioned=sectioned,
        )

    def error(self, influence: FloatArray, *, unseen: float = 0.0) -> float:
        """Standard error of a figure with this influence function, (n,).

        unseen: of a figure that counts switches, on how many more than was seen the two models are taken to differ.
        Where they agree on all of a hundred they may differ on three.
        """
        left, slope = self._left(influence)
        left = left / self._free  # errors as if each switch were left out: those of a kind of which there are few
        n = left.size
        square = float(left @ left)
        if self._sectioned:
            r = replicates.REPLICATES
            means = np.array([left[k::r].mean() for k in range(r)])
            square = float(means @ means) / (r * (r - 1)) * n * (n - 1)
        return math.sqrt((square + unseen) / (n * self._degrees) + float(slope @ self._spread @ slope))

    def about(self, estimate: float, influence: FloatArray) -> Interval:
        """Interval of a mean of any distribution with this influence function: see `intervals.mean_interval`."""
        left, slope = self._left(influence)
        n = left.size
        low, high = intervals.mean_interval(left * math.sqrt((n - 1) / self._degrees), self._confidence)
        if self._sectioned or not math.isfinite(low):
            half = self.student * self.error(influence)
            return estimate - half, estimate + half
        unknown = self.student * math.sqrt(float(slope @ self._spread @ slope))
        return estimate - math.hypot(low, unknown), estimate + math.hypot(high, unknown)

    def correlation(self, a: FloatArray, b: FloatArray) -> float:
        """Of the errors of two figures, by their influence functions."""
        left, other = self._left(a)[0], self._left(b)[0]
        spread = math.sqrt(float(left @ left) * float(other @ other))
        return float(left @ other) / spread if spread > 0.0 else 0.0

    def _left(self, influence: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(n,) what the controls do not explain of it, and the coefficients of what they do."""
        about = influence - influence.mean()
        slope = np.linalg.lstsq(self._centred, about, rcond=1e-6)[0]
        return about - self._centred @ slope, slope
