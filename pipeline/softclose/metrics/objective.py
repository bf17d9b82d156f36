"""Owns the metrics of one waveform on one ensemble: Eqs. 7-11, in cm/s, each with its interval.

Works from the contact speeds and closed flags alone, so stored responses can be assessed again with other settings.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, fields, replace
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from softclose.arrays import FloatArray
from softclose.glance import as_table, as_text, ranged
from softclose.metrics import intervals, replicates
from softclose.metrics.intervals import Interval, Proportion
from softclose.metrics.joined import joint, reach
from softclose.metrics.limit import Limit, limit_on
from softclose.metrics.ranking import open_warning, rank_cm_s

Form = Literal["penalty", "chance"]

CM_S = 100.0
"""cm/s in one µm/µs."""
MAX_FAILED = 0.05
"""Largest share of switches that could not be integrated for which g is defined: they count as open, and what they
would have done is not known."""
MISSING = 127
"""Status of a switch of which nothing was read: it is not counted, as if it were not there."""
FORMS: tuple[str, ...] = ("penalty", "chance")
Risk = Literal["quantile", "cvar"]
RISKS: tuple[str, ...] = ("quantile", "cvar")
SAMPLINGS: tuple[str, ...] = ("monte-carlo", "sobol", "replicated")
LEAST_BEYOND = 5
"""Fewest draws beyond a speed that bound from above how far the rest go: with fewer, the interval is open above."""


class ObjectiveError(ValueError):
    """A setting of the objective that is out of range, or a response that cannot be assessed."""


class Response(Protocol):
    """What `assess` needs.

    An optional `status` (n,) marks the switches that could not be integrated: not 0. `MISSING` marks those that do not
    count. Of an optional `settling_us` (n,) follows the closing time.
    """

    @property
    def max_contact_speed(self) -> FloatArray:
        """V of Eq. 7 for each switch [µm/µs], (n,); NaN where it never touches."""

    @property
    def closed(self) -> NDArray[np.bool_]:
        """Held in contact at the horizon, (n,)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """The least that is judged of a response: gathered from several, fresh, or read back from a store."""

    max_contact_speed: FloatArray
    """(n,) V of Eq. 7 [µm/µs]; NaN where the switch never touches."""
    closed: NDArray[np.bool_]
    """(n,) held in contact at the horizon."""
    status: NDArray[np.int8]
    """(n,) 0 where the switch was integrated."""
    settling_us: FloatArray | None = None
    """(n,) instant from which it is held to the horizon [µs]; inf: never; None: not known."""
    asked: FloatArray | None = None
    """(n, k) what else a campaign asks for of each switch, NaN where it has none; None: not known."""
    first_contact_us: FloatArray | None = None
    """(n,) instant of the first impact [µs]; inf: never; None: not known."""
    n_impacts: NDArray[np.int32] | None = None
    """(n,) impacts within the horizon; None: not known."""

    def first(self, n: int) -> Judged:
        """What is judged of the first n switches."""
        columns: dict[str, Any] = {}
        for field in fields(self):
            values = getattr(self, field.name)
            columns[field.name] = None if values is None else values[:n]
        return Judged(**columns)


@dataclass(frozen=True, slots=True, kw_only=True)
class Exceedance:
    """P(V > limit) among the switches that made contact."""

    limit_cm_s: float
    """The limit [cm/s]."""
    probability: Proportion
    """Its estimate and intervals."""
    excess_cm_s: float
    """Expected excess E[max(V - limit, 0)] over the switches in contact; NaN where none touched."""
    excess_interval: Interval
    """Its interval (`intervals.mean_interval`), 0 at least; open above where fewer than five draws exceed the limit."""


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Assessment:
    """Eqs. 7-11 for one ensemble. Velocities in cm/s; intervals are (lower, upper)."""

    n: int
    """Switches simulated or measured, failed ones included, missing readings not."""
    n_contact: int
    """Switches that touched at least once, at a known speed."""
    n_closed: int
    """Switches held in contact at the horizon."""
    n_failed: int
    """Switches that could not be integrated: counted as not closed and without contact."""
    g_cm_s: float
    """The objective, Eq. 10 or its chance-constrained form. Finite, or NaN where more than `MAX_FAILED` of the
    switches could not be integrated."""
    g_interval: Interval
    """Interval of g; inf above where too few switches touched to bound v_u."""
    g_se_cm_s: float
    """Standard error of g; where v_u is undefined, of its p_nc term only."""
    rank_cm_s: float
    """What candidates are ranked by: g, and where more than max_open stay open, p_nc behind every g (`ranking`)."""
    feasible: bool
    """The interval of p_nc lies below p_max; always True in the penalty form."""
    limit: Limit | None
    """What this ensemble says of p_nc <= p_max; None in the penalty form."""
    v_u_cm_s: float
    """Upper velocity: level-quantile of V over the switches in contact, Eqs. 8-9. NaN where undefined."""
    v_u_interval: Interval
    """Distribution-free order-statistic interval."""
    cvar_cm_s: float
    """Conditional value at risk: mean V of the switches in contact above the quantile; NaN where undefined."""
    cvar_interval: Interval
    """That of a mean (`intervals.mean_interval`); open above where fewer than five draws exceed v_u."""
    mean_cm_s: float
    """Mean V over the switches in contact; NaN where none touched."""
    mean_interval: Interval
    """Student's interval, widened where V is skewed (`intervals.mean_interval`)."""
    max_cm_s: float
    """Largest V of the ensemble; NaN where none touched."""
    p_nc: float
    """Fraction of all switches not closed at the horizon."""
    p_nc_intervals: Proportion
    """p_nc with Eq. 11, Wilson and Clopper-Pearson."""
    closing_us: float
    """Closing time of the lot: level-quantile, over all switches, of the instant from which each is held [µs]; inf
    where more stay open, NaN where it is not known."""
    closing_interval: Interval
    """Distribution-free order-statistic interval [µs]."""
    p_contact: float
    """Fraction of all switches that touched."""
    p_above_v_u: float
    """Fraction of the switches in contact with V > v_u; NaN where undefined."""
    p_above_v_u_half_width: float
    """The `a` of Eq. 11 for it."""
    p_exceed: tuple[Exceedance, ...]
    """P(V > limit) for each limit."""
    level: float
    """The quantile's level."""
    confidence: float
    """Confidence of every interval."""
    closed_by_us: float
    """A switch counts as closed where it is held from this instant on [µs]; 0: from any instant."""
    intervals_valid: bool
    """False for one quasi-random sample, whose points are not independent: it has no intervals, NaN throughout."""

    max_open: float
    """Largest share open up to which g ranks it."""
    warn_open: float
    """Largest share open that is told without a warning."""

    def _lines(self) -> list[tuple[str, str]]:
        low, high = (100.0 * end for end in self.p_nc_intervals.wilson)
        if not self.intervals_valid:
            low = high = math.nan
        return [
            ("upper velocity v_u", ranged(self.v_u_cm_s, *self.v_u_interval, "cm/s")),
            ("left open", ranged(100.0 * self.p_nc, low, high, "%")),
            ("mean speed", ranged(self.mean_cm_s, *self.mean_interval, "cm/s")),
            ("objective g", ranged(self.g_cm_s, *self.g_interval, "cm/s")),
        ]

    def __repr__(self) -> str:
        return as_text(f"Assessment on {self.n:,} switches", self._lines())

    def _repr_html_(self) -> str:
        return as_table(f"Assessment on {self.n:,} switches", self._lines())

    @property
    def open_warning(self) -> str:
        """A sentence where more than `warn_open` of the switches stay open; else ""."""
        return open_warning(self.p_nc, max_open=self.max_open, warn_open=self.warn_open)

    def to_dict(self) -> dict[str, Any]:
        """Nested plain values, for JSON and stores."""
        return asdict(self)


def assess(
    response: Response,
    *,
    c1_cm_s: float = 25.0,
    level: float = 0.9,
    limits_cm_s: Sequence[float] = (19.7,),
    sampling: str = "monte-carlo",
    form: Form = "penalty",
    risk: Risk = "quantile",
    p_max: float | None = None,
    assured: bool = False,
    closed_by_us: float = 0.0,
    chance_penalty_cm_s: float = 500.0,
    min_contact: float = 0.1,
    undefined_v_u_cm_s: float = 60.0,
    max_open: float = 0.1,
    warn_open: float = 0.05,
    confidence: float = 0.95,
) -> Assessment:
    """Assess one waveform: g, v_u, mean V, p_nc and P(V > limit), each with its interval.

    P(V > limit) has the switches in contact as denominator, as v_u has: a waveform cannot pass by not closing.

    Parameters
    ----------
    response : Response
        max_contact_speed [cm/s] and closed, (n,) each.
    c1_cm_s : float
        Weight of p_nc in g (Eq. 10) [cm/s].
    level : float
        Level of the quantile v_u.
    limits_cm_s : sequence of float
        Speeds [cm/s] whose probability of being exceeded is wanted.
    sampling : str
        How the ensemble was drawn: "monte-carlo", independent draws; "replicated", independent scramblings, switch i of
        scrambling i mod R; "sobol", one quasi-random sample, for which no interval holds (NaN).
    form : {"penalty", "chance"}
        "penalty": g = v_u + c1 p_nc (Eq. 10). "chance" (minimise v_u subject to p_nc <= p_max):
        g = v_u + chance_penalty max(0, p_nc - p_max), an exact penalty: where it outweighs what v_u gains per unit of
        p_nc (about 25 cm/s at the published optimum) the minimum of g is the constrained one.
    risk : {"quantile", "cvar"}
        What g is made of: v_u, or the mean V above it (`cvar_cm_s`), which sees how far the tail reaches.
    p_max : float, optional
        Largest p_nc of the form "chance". g has the estimate of p_nc; whether p_max is met is decided by its interval
        (`limit`, `feasible`).
    assured : bool
        The form "chance" counts the upper end of Wilson's interval of p_nc instead of its estimate: an optimum found so
        keeps p_max on other switches too.
    closed_by_us : float
        A switch counts as closed where it is held from this instant on [µs]; 0: from any instant.
    chance_penalty_cm_s : float
        Weight of that penalty [cm/s].
    min_contact : float
        Where a smaller part of the switches touches, v_u counts as undefined_v_u in g and is reported as NaN.
    undefined_v_u_cm_s : float
        See min_contact [cm/s].
    max_open : float
        Waveforms that leave a larger fraction open are ranked behind all others, by that fraction (`rank_cm_s`).
    warn_open : float
        Waveforms that leave a larger fraction open are told with a warning (`Assessment.open_warning`).
    confidence : float
        Of every interval.

    Returns
    -------
    Assessment

    Notes
    -----
    The speeds by default are those of the published study's lot; for another lot they are `objective_settings` of a
    campaign of it, where they scale with the lot.

    Raises
    ------
    ObjectiveError
        For values outside these limits, or a response with unsuccessful switches.
    """
    _check(locals())
    if sampling not in SAMPLINGS:
        raise ObjectiveError(f"sampling is {sampling!r}; it must be one of {', '.join(SAMPLINGS)}")
    response = those_read(response)
    speed, closed, n_failed = arrays_of(response, closed_by_us)
    closing_us, closing_interval = _closing(response, level, confidence)
    n = speed.size
    contact = ~np.isnan(speed)
    v = speed[contact] * CM_S
    ordered = np.sort(v)
    n_contact, n_closed = ordered.size, int(closed.sum())
    p_nc = intervals.proportion(n - n_closed, n, confidence)

    defined = n_contact > 0 and n_contact >= min_contact * n
    v_u, v_u_interval, v_u_se, association = math.nan, intervals.NO_INTERVAL, 0.0, 0.0
    above = math.nan, math.nan
    if defined:
        v_u, (lower, upper) = intervals.quantile_estimate(ordered, level, confidence)
        v_u_interval = max(lower, 0.0), upper  # a speed: 0 bounds it where no draw does
        v_u_se = intervals.quantile_standard_error(ordered, level) if n_contact > 1 else 0.0
        association = _association(v, ~closed[contact], v_u, level, p_nc.estimate, n)
        tail = intervals.proportion(int((v > v_u).sum()), n_contact, confidence)
        above = tail.estimate, tail.half_width
    shortfall = _shortfall(v, v_u, v_u_interval[0], level, confidence)
    value, value_interval, value_se = v_u, v_u_interval, v_u_se
    if risk == "cvar":
        value, value_interval, value_se = shortfall.estimate, shortfall.interval, shortfall.se
        association = _shared(shortfall.influence, contact, ~closed)

    def penalty(p: float) -> float:
        return penalty_cm_s(p, form=form, c1_cm_s=c1_cm_s, chance_penalty_cm_s=chance_penalty_cm_s, p_max=p_max)

    counted = p_nc.wilson[1] if assured and form == "chance" else p_nc.estimate
    g = (value if defined else undefined_v_u_cm_s) + penalty(counted)
    if n_failed > MAX_FAILED * n:
        g = math.nan
    q_range = (value - value_interval[0], value_interval[1] - value) if defined else (0.0, 0.0)
    jumps = intervals.quantile_jumps(ordered, level, confidence) if defined and risk == "quantile" else (0.0, 0.0)
    # Wilson's interval is too short for a rare event: below ten of a kind, Clopper and Pearson's.
    rare = min(p_nc.count, n - p_nc.count) < 10
    lower, upper = p_nc.clopper_pearson if rare else p_nc.wilson
    p_range = penalty(p_nc.estimate) - penalty(lower), penalty(upper) - penalty(p_nc.estimate)
    p_lower, p_upper = p_nc.wilson
    # Half of Wilson's width over z is the standard error of p_nc, and stays above 0 where none or all closed.
    p_se = (penalty(p_upper) - penalty(p_lower)) / (2.0 * intervals.normal_quantile(confidence))

    found = Assessment(
        n=n,
        n_contact=n_contact,
        n_closed=n_closed,
        n_failed=n_failed,
        g_cm_s=g,
        g_interval=(
            g - reach(q_range[0], p_range[0], association, jumps[0]),
            g + reach(q_range[1], p_range[1], association, jumps[1]),
        ),
        g_se_cm_s=joint(value_se, p_se, association),
        rank_cm_s=rank_cm_s(g, p_nc.estimate, max_open),
        feasible=True,
        limit=None,
        v_u_cm_s=v_u,
        v_u_interval=v_u_interval,
        cvar_cm_s=shortfall.estimate,
        cvar_interval=shortfall.interval,
        mean_cm_s=float(v.mean()) if n_contact else math.nan,
        mean_interval=intervals.mean_interval(v, confidence),
        max_cm_s=float(ordered[-1]) if n_contact else math.nan,
        p_nc=p_nc.estimate,
        p_nc_intervals=p_nc,
        closing_us=closing_us,
        closing_interval=closing_interval,
        p_contact=int((contact | closed).sum()) / n,
        p_above_v_u=above[0],
        p_above_v_u_half_width=above[1],
        p_exceed=tuple(_exceedance(v, float(limit), confidence) for limit in limits_cm_s),
        level=level,
        confidence=confidence,
        closed_by_us=closed_by_us,
        intervals_valid=sampling != "sobol",
        max_open=max_open,
        warn_open=warn_open,
    )
    if sampling == "replicated":
        found = _sectioned(found, speed, closed, _settling(response), risk, penalty, defined)
    elif sampling == "sobol":
        found = _without_intervals(found)
    if form != "chance":
        return found
    limit = limit_on(found.p_nc_intervals, float(p_max or 0.0), confidence, valid=found.intervals_valid)
    return replace(found, limit=limit, feasible=limit.verdict == "met")


def _without_intervals(a: Assessment) -> Assessment:
    """The same figures of one quasi-random sample, which has no interval; the standard error stays, as a scale."""
    none = intervals.NO_INTERVAL

    def bare(p: Proportion) -> Proportion:
        return replace(p, wald=none, wilson=none, clopper_pearson=none)

    return replace(
        a,
        g_interval=none,
        v_u_interval=none,
        cvar_interval=none,
        mean_interval=none,
        closing_interval=none,
        p_nc_intervals=bare(a.p_nc_intervals),
        p_above_v_u_half_width=math.nan,
        p_exceed=tuple(replace(e, probability=bare(e.probability), excess_interval=none) for e in a.p_exceed),
    )


def _sectioned(
    a: Assessment,
    speed: FloatArray,
    closed: NDArray[np.bool_],
    settling: FloatArray | None,
    risk: str,
    penalty: Callable[[float], float],
    defined: bool,
) -> Assessment:
    """The same figures with intervals and standard error from independent scramblings (`softclose.metrics.replicates`).

    speed: (n,) [µm/µs]; penalty: what p_nc adds to g [cm/s].
    """
    limits = [e.limit_cm_s for e in a.p_exceed]
    parts = replicates.sections(speed * CM_S, closed, settling, level=a.level, limits=limits)
    c = a.confidence

    def speeds(pooled: float, of: FloatArray, beyond: float, independent: Interval) -> Interval:
        lower, upper = replicates.about(pooled, of, c, otherwise=independent)
        return max(lower, 0.0) if lower == lower else lower, math.inf if beyond < LEAST_BEYOND else upper

    n_beyond = int((speed * CM_S > a.v_u_cm_s).sum())
    p_nc = replicates.proportion(a.n - a.n_closed, a.n, parts.p_nc, c)
    value, of_value = (a.cvar_cm_s, parts.cvar) if risk == "cvar" else (a.v_u_cm_s, parts.v_u)
    rare = min(a.n_closed, a.n - a.n_closed) < replicates.RARE
    of_g = of_value + np.array([penalty(float(p)) for p in parts.p_nc])
    g = value + penalty(a.p_nc)
    if not defined:
        of_g, g = of_g - of_value, penalty(a.p_nc)
    low, high = replicates.about(g, of_g, c)
    se = replicates.standard_error(g, of_g) if low == low else a.g_se_cm_s
    reach_low, reach_high = g - low, high - g
    if low != low:  # a scrambling by itself has no such figure
        reach_low, reach_high = a.g_cm_s - a.g_interval[0], a.g_interval[1] - a.g_cm_s
    elif rare or any(penalty(p) == 0.0 for p in p_nc.wilson):  # p_nc may be more than the scramblings saw of it
        spread = value - replicates.about(value, of_value, c)[0] if defined else 0.0
        ends = [penalty(p) - penalty(a.p_nc) for p in p_nc.wilson]
        reach_low, reach_high = joint(spread, -ends[0], 0.0), joint(spread, ends[1], 0.0)
        se = max(se, 0.5 * (ends[1] - ends[0]) / intervals.normal_quantile(c))
    if risk == "cvar" and n_beyond < LEAST_BEYOND:
        reach_high = math.inf
    exceed = [
        replace(
            e,
            probability=replicates.proportion(e.probability.count, e.probability.n, parts.exceed[:, k], c),
            excess_interval=speeds(e.excess_cm_s, parts.excess[:, k], e.probability.count, e.excess_interval),
        )
        for k, e in enumerate(a.p_exceed)
    ]
    closing = replicates.about(a.closing_us, parts.closing, c, otherwise=a.closing_interval)
    mean_low, mean_high = speeds(a.mean_cm_s, parts.mean, LEAST_BEYOND, a.mean_interval)
    missing = a.n - a.n_contact
    if missing < replicates.RARE and math.isfinite(mean_low):
        # The mean of a smooth V is known better than how many switches, of the slowest, do not touch: 0 of n may be 3.
        more = intervals.clopper_pearson(missing, a.n, c)[1] - missing / a.n
        more *= a.mean_cm_s - float(np.nanmin(speed)) * CM_S
        mean_low, mean_high = (
            a.mean_cm_s - joint(a.mean_cm_s - mean_low, more, 0.0),
            a.mean_cm_s + joint(mean_high - a.mean_cm_s, more, 0.0),
        )
    return replace(
        a,
        g_interval=(a.g_cm_s - reach_low, a.g_cm_s + reach_high),
        g_se_cm_s=se,
        v_u_interval=speeds(a.v_u_cm_s, parts.v_u, LEAST_BEYOND, a.v_u_interval),
        cvar_interval=speeds(a.cvar_cm_s, parts.cvar, n_beyond, a.cvar_interval),
        mean_interval=(mean_low, mean_high),
        p_nc_intervals=p_nc,
        closing_interval=closing,
        p_exceed=tuple(exceed),
    )


def _settling(response: Response) -> FloatArray | None:
    """(n,) instants from which switches are held [µs]; inf of one that could not be integrated; None: not known."""
    known, status = getattr(response, "settling_us", None), getattr(response, "status", None)
    if known is None:
        return None
    settling = np.asarray(known, dtype=np.float64)
    if settling.shape != np.shape(response.closed):
        raise ObjectiveError(
            f"settling_us has shape {settling.shape}; it must be {np.shape(response.closed)}, as closed"
        )
    return settling if status is None else np.where(np.asarray(status) != 0, math.inf, settling)


def _closing(response: Response, level: float, confidence: float) -> tuple[float, Interval]:
    """Closing time of the lot and its interval; a switch that could not be integrated never closes."""
    settling = _settling(response)
    if settling is None:
        return math.nan, intervals.NO_INTERVAL
    ordered = np.sort(settling)
    if np.isnan(ordered).any():
        return math.nan, intervals.NO_INTERVAL
    value, (lower, upper) = intervals.quantile_estimate(ordered, level, confidence)
    return value, (max(lower, 0.0), upper)


def _exceedance(v: FloatArray, limit_cm_s: float, confidence: float) -> Exceedance:
    excess = np.maximum(v - limit_cm_s, 0.0)
    lower, upper = intervals.mean_interval(excess, confidence)
    count = int((v > limit_cm_s).sum())
    return Exceedance(
        limit_cm_s=limit_cm_s,
        probability=intervals.proportion(count, v.size, confidence),
        excess_cm_s=float(excess.mean()) if v.size else math.nan,
        excess_interval=(max(lower, 0.0), upper if count >= LEAST_BEYOND or not v.size else math.inf),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Shortfall:
    estimate: float
    interval: Interval
    se: float
    influence: FloatArray
    """(n_contact,) what each switch moves the estimate by, times their number."""


def _shortfall(v: FloatArray, v_u: float, v_u_lower: float, level: float, confidence: float) -> _Shortfall:
    """CVaR = v_u + E[max(V - v_u, 0)] / (1 - level) (Rockafellar and Uryasev 2000), whose first-order error is that of
    the mean alone: v_u minimises it."""
    if math.isnan(v_u):
        return _Shortfall(estimate=math.nan, interval=intervals.NO_INTERVAL, se=0.0, influence=np.zeros(v.size))
    z = tail_terms(v, v_u, level)
    estimate = float(z.mean())
    se = float(z.std(ddof=1)) / math.sqrt(z.size) if z.size > 1 else 0.0
    lower, upper = intervals.mean_interval(z, confidence) if z.size > 1 else (-math.inf, math.inf)
    if math.isfinite(v_u_lower):
        # The estimate is the least of many means, too low where V has a gap or an atom at the level: the lower end is
        # that at the lower order statistic too.
        lower = min(lower, intervals.mean_interval(tail_terms(v, v_u_lower, level), confidence)[0])
    if int((v > v_u).sum()) < LEAST_BEYOND:
        upper = math.inf
    return _Shortfall(estimate=estimate, interval=(max(lower, 0.0), upper), se=se, influence=z - estimate)


def tail_terms(v: FloatArray, threshold: float, level: float) -> FloatArray:
    """(n,) terms whose mean is the CVaR where the threshold is v_u, and no less than it at any other."""
    return np.asarray(threshold + np.maximum(v - threshold, 0.0) / (1.0 - level))


def _shared(influence: FloatArray, contact: NDArray[np.bool_], open_: NDArray[np.bool_]) -> float:
    """Correlation of an estimate over the switches in contact with that of p_nc, from their influence functions."""
    whole = np.zeros(contact.size)
    whole[contact] = influence
    spread = float(whole.std() * open_.std())
    return float(((whole - whole.mean()) * (open_ - open_.mean())).mean()) / spread if spread > 0.0 else 0.0


def _association(v: FloatArray, open_: NDArray[np.bool_], v_u: float, level: float, p_nc: float, n: int) -> float:
    """Asymptotic correlation of the estimates of v_u and p_nc, from their influence functions.

    A switch moves v_u by (level - 1{V <= v_u}) / (f P(contact)) and p_nc by 1{open} - p_nc; the density f cancels.
    """
    if not 0.0 < p_nc < 1.0:
        return 0.0
    covariance = float((level - (v[open_] <= v_u)).sum()) / n
    spread = math.sqrt(level * (1.0 - level) * v.size / n * p_nc * (1.0 - p_nc))
    # Not above 1: at most 1 - level of the switches lie above v_u. Rounding v_u's rank up can take it below -1.
    return max(covariance / spread, -1.0)


def is_read(response: Response) -> NDArray[np.bool_]:
    """(n,) False for switches of which nothing was read."""
    status = getattr(response, "status", None)
    return np.ones(np.shape(response.closed), dtype=np.bool_) if status is None else np.asarray(status) != MISSING


def those_read(response: Response, kept: NDArray[np.bool_] | None = None) -> Response:
    """The response of the switches that count: those that were read, or `kept` (n,). Raises ObjectiveError for none."""
    if getattr(response, "status", None) is None and kept is None:
        return response
    kept = is_read(response) if kept is None else kept
    if kept.all() or kept.shape != np.shape(response.closed):  # other shapes are refused where they are compared
        return response
    if not kept.any():
        raise ObjectiveError("no switch was measured: every reading is missing")
    status, settling, asked = (getattr(response, name, None) for name in ("status", "settling_us", "asked"))
    return Judged(
        max_contact_speed=np.asarray(response.max_contact_speed, dtype=np.float64)[kept],
        closed=np.asarray(response.closed, dtype=np.bool_)[kept],
        status=np.zeros(int(kept.sum()), dtype=np.int8) if status is None else np.asarray(status)[kept],
        settling_us=None if settling is None else np.asarray(settling, dtype=np.float64)[kept],
        asked=None if asked is None else np.asarray(asked, dtype=np.float64)[kept],
    )


def in_time(response: Response, closed_by_us: float) -> NDArray[np.bool_]:
    """(n,) which switches of a response count as closed: held at the horizon, and from `closed_by_us` on [µs].

    0 leaves the instant open. Raises ObjectiveError where the response does not tell it.
    """
    closed = np.asarray(response.closed, dtype=np.bool_)
    if not closed_by_us:
        return closed
    settling = getattr(response, "settling_us", None)
    if settling is None:
        raise ObjectiveError(
            f"closed_by_us is {closed_by_us:g} µs, and the response does not tell when its switches are held "
            "(settling_us): leave closed_by_us 0"
        )
    return closed & (np.asarray(settling, dtype=np.float64) <= closed_by_us)


def penalty_cm_s(p: float, *, form: Form, c1_cm_s: float, chance_penalty_cm_s: float, p_max: float | None) -> float:
    """What a share of open switches adds to g [cm/s]: c1 p of Eq. 10, or so much for what is beyond p_max."""
    slope, floor = (c1_cm_s, 0.0) if form == "penalty" else (chance_penalty_cm_s, float(p_max or 0.0))
    return slope * max(0.0, p - floor)


def arrays_of(response: Response, closed_by_us: float) -> tuple[FloatArray, NDArray[np.bool_], int]:
    """(n,) speeds [µm/µs], NaN without contact, (n,) which switches count as closed, and how many failed, which neither
    touched nor closed. Raises ObjectiveError for a response that cannot be assessed."""
    if not (hasattr(response, "max_contact_speed") and hasattr(response, "closed")):
        raise ObjectiveError(f"{response!r} is no response; give what simulate returns: max_contact_speed and closed")
    speed = np.asarray(response.max_contact_speed, dtype=np.float64)
    closed = in_time(response, closed_by_us)
    if speed.ndim != 1 or speed.size == 0 or closed.shape != speed.shape:
        raise ObjectiveError(
            f"max_contact_speed has shape {speed.shape} and closed {closed.shape}; "
            "both must be (n,), one entry for each of one or more switches"
        )
    status = getattr(response, "status", None)
    failed = np.zeros(speed.shape, dtype=np.bool_) if status is None else np.asarray(status) != 0
    if failed.shape != speed.shape:
        raise ObjectiveError(f"status has shape {failed.shape}; it must be {speed.shape}, as max_contact_speed")
    if failed.any():
        speed, closed = np.where(failed, np.nan, speed), closed & ~failed
    if np.isinf(speed).any() or (speed < 0.0).any():
        raise ObjectiveError("max_contact_speed has infinite or negative entries; it is 0 or more, NaN without contact")
    return speed, closed, int(failed.sum())


def _check(a: dict[str, Any]) -> None:
    def number(name: str, value: Any) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not math.isfinite(value):
            raise ObjectiveError(f"{name} is {value!r}; it must be a finite number")
        return float(value)

    for name in ("c1_cm_s", "chance_penalty_cm_s", "undefined_v_u_cm_s", "closed_by_us"):
        if number(name, a[name]) < 0.0:
            raise ObjectiveError(f"{name} is {a[name]:g}; it must be 0 or more")
    for name in ("level", "confidence"):
        if not 0.0 < number(name, a[name]) < 1.0:
            raise ObjectiveError(f"{name} is {a[name]:g}; it must lie between 0 and 1 (0.9 is 90 %)")
    for name in ("min_contact", "max_open", "warn_open"):
        if not 0.0 <= number(name, a[name]) <= 1.0:
            raise ObjectiveError(f"{name} is {a[name]:g}; it is a fraction, from 0 to 1")
    if isinstance(a["limits_cm_s"], str) or not isinstance(a["limits_cm_s"], Iterable):
        raise ObjectiveError(f"limits_cm_s is {a['limits_cm_s']!r}; give a sequence of speeds, such as (19.7,)")
    for limit in a["limits_cm_s"]:
        if number("a limit in limits_cm_s", limit) < 0.0:
            raise ObjectiveError(f"limits_cm_s has {limit:g}; a speed limit is 0 or more")
    if a["risk"] not in RISKS:
        raise ObjectiveError(f"risk is {a['risk']!r}; it must be one of {', '.join(RISKS)}")
    if a["form"] not in FORMS:
        raise ObjectiveError(f"form is {a['form']!r}; it must be one of {', '.join(FORMS)}")
    if a["form"] == "chance":
        if a["p_max"] is None:
            raise ObjectiveError("form 'chance' needs p_max, the largest allowed fraction of switches not closed")
        if not 0.0 <= number("p_max", a["p_max"]) < 1.0:
            raise ObjectiveError(f"p_max is {a['p_max']:g}; it is a fraction, from 0 to below 1")
    elif a["p_max"] is not None:
        raise ObjectiveError("p_max is given, but form is 'penalty', which has no limit on p_nc; use form 'chance'")
