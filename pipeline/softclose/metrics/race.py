"""Owns races: which of several waveforms is best, on no more switches than it takes to tell.

All run on the same switches, ever more of them. After each round a waveform that another beats with confidence is out,
and the race ends when no waveform left can beat the best by more than a stated tolerance. This is Hoeffding races
(Maron and Moore 1994) with intervals of the paired differences in place of Hoeffding's, every interval of the race at
once at the stated confidence (Bonferroni). A difference of p_nc has the variance of z² switches that differ at least:
a few that happen to differ on one side, or none, show less than there may be.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

from softclose.arrays import FloatArray
from softclose.metrics import intervals
from softclose.metrics.objective import CM_S, Assessment, Response, assess, in_time
from softclose.metrics.paired import v_u_influence


@dataclass(frozen=True, slots=True, kw_only=True)
class Lap:
    """One round of a race."""

    n_switches: int
    """Switches that every waveform in it has run on."""
    racing: tuple[int, ...]
    """Waveforms in it, in the order given."""
    best: int
    """The one of the least rank."""
    margin_cm_s: float
    """No waveform in it is better than `best` by more than this, at the race's confidence [cm/s]."""
    out: tuple[int, ...]
    """Waveforms that another beat."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Race:
    """A finished race."""

    laps: tuple[Lap, ...]
    """Its rounds, at least one."""
    tolerance_cm_s: float
    """What was asked for [cm/s]."""
    confidence: float
    """Of all that the race says, together."""

    @property
    def decided(self) -> bool:
        """Whether the last round's margin is within the tolerance; a race may also run out of switches."""
        return self.laps[-1].margin_cm_s <= self.tolerance_cm_s

    @property
    def finalists(self) -> tuple[int, ...]:
        """Waveforms that nothing beat, in the order given."""
        last = self.laps[-1]
        return tuple(i for i in last.racing if i not in last.out)

    @property
    def trajectories(self) -> int:
        """Trajectories that the race took."""
        before, total = 0, 0
        for lap in self.laps:
            total += (lap.n_switches - before) * len(lap.racing)
            before = lap.n_switches
        return total

    def to_dict(self) -> dict[str, Any]:
        """Nested plain values, what it says included."""
        return asdict(self) | {
            "decided": self.decided,
            "finalists": self.finalists,
            "trajectories": self.trajectories,
        }


def sizes(first: int, limit: int) -> tuple[int, ...]:
    """Switches of each round: doubled from `first`, up to `limit`."""
    found = [min(first, limit)]
    while found[-1] < limit:
        found.append(min(2 * found[-1], limit))
    return tuple(found)


def race(
    n_waveforms: int,
    rounds: Sequence[int],
    respond: Callable[[int, int], Response],
    *,
    tolerance_cm_s: float,
    confidence: float = 0.95,
    max_open: float = 0.1,
    **objective: Any,
) -> Race:
    """Race waveforms 0 to n_waveforms - 1.

    Parameters
    ----------
    n_waveforms : int
        How many.
    rounds : sequence of int
        Switches of each round, ascending (`sizes`).
    respond : callable
        respond(i, n): what waveform i does to the first n switches, the same for every waveform.
    tolerance_cm_s : float
        A difference of g that does not matter [cm/s].
    confidence : float
        That none of the race's intervals fails.
    max_open : float
        As `assess`: waveforms that leave more open rank behind all others. On which side one is counts as known where
        the interval of its p_nc says so.
    **objective
        As `assess`: the g that is raced for.

    Returns
    -------
    Race
    """
    racing = tuple(range(n_waveforms))
    of_shares = n_waveforms * (n_waveforms + 1) // 2 if max_open < 1.0 else 0  # of p_nc, and of its differences
    n_intervals = max(len(rounds) * (n_waveforms * (n_waveforms - 1) // 2 + of_shares), 1)
    z = intervals.normal_quantile(1.0 - (1.0 - confidence) / n_intervals)
    laps: list[Lap] = []
    for n in rounds:
        found = {i: respond(i, n) for i in racing}
        judged = {i: assess(found[i], max_open=max_open, **objective) for i in racing}
        open_p = {i: judged[i].p_nc for i in racing}
        sides = {i: _side(judged[i], max_open, 1.0 - (1.0 - confidence) / n_intervals) for i in racing}
        best = min(racing, key=lambda i: (judged[i].rank_cm_s, i))
        own = g_influence(found[best], judged[best], **objective)
        margin, out = 0.0, []
        for i in racing:
            if i == best:
                continue
            behind = judged[i].g_cm_s - judged[best].g_cm_s
            apart = g_influence(found[i], judged[i], **objective) - own
            closed = [in_time(found[j], judged[j].closed_by_us).astype(float) for j in (i, best)]
            open_apart = closed[0] - closed[1]
            slope = max(penalty_slope(judged[j], **objective) for j in (i, best))
            rare = slope**2 * max(z * z / n - float(np.var(open_apart)), 0.0)
            se = math.sqrt((float(np.var(apart)) + rare) / n)
            by_g = math.inf if math.isnan(se) else z * se - behind
            se_open = math.sqrt(max(float(np.var(open_apart)), z * z / n) / n)
            more_open = open_p[i] - open_p[best] > z * se_open
            lead = _lead(sides[i], sides[best], by_g, more_open)
            if lead < 0.0:
                out.append(i)
            else:
                margin = max(margin, lead)
        laps.append(Lap(n_switches=n, racing=racing, best=best, margin_cm_s=margin, out=tuple(out)))
        if margin <= tolerance_cm_s:
            break
        racing = tuple(i for i in racing if i not in out)
    return Race(laps=tuple(laps), tolerance_cm_s=tolerance_cm_s, confidence=confidence)


def _side(assessment: Assessment, max_open: float, confidence: float) -> Literal["within", "beyond", "unsure"]:
    """On which side of max_open the share open is, with confidence."""
    if max_open >= 1.0:
        return "within"
    count, n = assessment.n - assessment.n_closed, assessment.n
    lower, upper = intervals.clopper_pearson(count, n, confidence)
    return "within" if upper <= max_open else "beyond" if lower > max_open else "unsure"


def _lead(own: str, of_best: str, by_g_cm_s: float, more_open: bool) -> float:
    """By how much a waveform may rank before the best one at most [cm/s]; below 0: it does not.

    own, of_best: their sides. by_g_cm_s: by how much its g may be the smaller one. more_open: it leaves more open,
    with confidence.
    """
    if own != "beyond" and of_best != "within":
        return math.inf  # it may be the one that leaves few enough open
    found = -math.inf
    if own != "beyond":
        found = by_g_cm_s
    if of_best != "within" and not more_open:
        found = math.inf
    return found


def penalty_slope(
    assessment: Assessment,
    *,
    form: str = "penalty",
    c1_cm_s: float = 25.0,
    chance_penalty_cm_s: float = 500.0,
    p_max: float | None = None,
    **_: Any,
) -> float:
    """What g rises by per unit of p_nc [cm/s].

    The chance-constrained form's penalty has a kink at p_max; where the interval of p_nc reaches beyond it, its slope
    counts in full.
    """
    if form == "chance":
        return chance_penalty_cm_s if assessment.p_nc_intervals.wilson[1] > float(p_max or 0.0) else 0.0
    return c1_cm_s


def g_influence(
    response: Response,
    assessment: Assessment,
    *,
    risk: str = "quantile",
    **objective: Any,
) -> FloatArray:
    """(n,) influence of each switch on g [cm/s]: its standard deviation over sqrt(n) is the standard error of g.

    Differences of two of these give the error of a difference of g on common switches. NaN where v_u is undefined.
    """
    open_ = (~in_time(response, assessment.closed_by_us)).astype(float)
    penalty: FloatArray = penalty_slope(assessment, **objective) * (open_ - open_.mean())
    if risk == "cvar":
        v = np.asarray(response.max_contact_speed) * CM_S
        contact = ~np.isnan(v)
        z = assessment.v_u_cm_s + np.maximum(v - assessment.v_u_cm_s, 0.0) / (1.0 - assessment.level)
        value: FloatArray = np.where(contact, z - assessment.cvar_cm_s, 0.0) / max(float(contact.mean()), 1e-300)
        return np.add(value, penalty)
    return np.add(v_u_influence(response, assessment), penalty)
