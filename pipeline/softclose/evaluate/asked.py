"""Owns what a campaign asks for beside Eqs. 7-11: further quantities, weighed in g, limited, on a front, or just told.

Quantities of switches and drives are columns beside each response, so that they take the way that responses take: from
worker to store, to certificates and to every analysis. Those of a lot follow from its assessment.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, cast

import numpy as np

from softclose.arrays import FloatArray
from softclose.device.drives import Drives
from softclose.evaluate.chain import Chain
from softclose.evaluate.quantities import Closing, Quantity, Value, held_voltages, quantity
from softclose.evaluate.scoring import score
from softclose.metrics import replicates
from softclose.metrics.control import Control
from softclose.metrics.intervals import NO_INTERVAL, normal_quantile
from softclose.metrics.objective import Assessment, Response
from softclose.metrics.ranking import rank_cm_s
from softclose.plugins import MEASURED, QuantityError
from softclose.population.lot import Lot
from softclose.settings import CampaignConfig
from softclose.waveform import Drive

if TYPE_CHECKING:
    from softclose.device.simulate import Responses


OF_THE_FRONT = ("v_u", "p_nc", "closing", "peak")
"""What a front may weigh of any campaign, from its records and waveforms alone."""


def asked(config: CampaignConfig) -> tuple[Quantity, ...]:
    """The quantities of switches and drives that a campaign asks for, by name, as the columns of its responses.

    Raises QuantityError for a name that there is not, or a use that a quantity has not.
    """
    o = config.objective
    wanted = {
        "objective": o.weights,
        "limit": o.quantity_limits,
        "axis": [name for name in config.optimiser.objectives if name not in OF_THE_FRONT],
        "line": o.lines,
    }
    if not any(wanted.values()):
        return ()
    found: dict[str, Quantity] = {}
    for use, names in wanted.items():
        for name in names:
            found[name] = chosen = quantity(name)
            if use not in chosen.uses:
                raise QuantityError(f"{name} cannot be used as {use}; it may be {', '.join(sorted(chosen.uses))}")
    if config.model.name == MEASURED and any(q.per == "switch" for q in found.values()):
        raise QuantityError(
            f"nobody measures {', '.join(q.name for q in found.values() if q.per == 'switch')}: of devices on a bench "
            "only speed and closing are told; leave it out of objective and optimiser"
        )
    return tuple(found[name] for name in sorted(found) if found[name].per != "lot")


def asked_columns(
    wanted: Sequence[Quantity], chain: Chain, lot: Lot, waveform: Drive, response: Responses, drives: Drives
) -> FloatArray:
    """(n, k) the quantities of each switch under one waveform; what is of the drive stands beside every switch."""
    closing = Closing(
        chain=chain, lot=lot, waveform=waveform, response=response, held_V=held_voltages(chain, lot, waveform, drives)
    )
    columns = np.empty((len(lot), len(wanted)))
    for k, q in enumerate(wanted):
        columns[:, k] = q.values(closing)
    return columns


def worst_columns(wanted: Sequence[Quantity], cases: Sequence[FloatArray | None]) -> FloatArray | None:
    """(n, k) of each switch the worst of several cases, each quantity by itself."""
    tables = [columns for columns in cases if columns is not None]
    if not tables:
        return None
    each = np.stack(tables)
    worst = np.empty(each.shape[1:])
    for k, q in enumerate(wanted):
        worst[:, k] = (np.fmax if q.better == "low" else np.fmin).reduce(each[..., k])
    return worst


def told(config: CampaignConfig, response: Response, a: Assessment, *, fresh: bool = False) -> dict[str, Value]:
    """Every quantity that a campaign asks for, by name: its value and interval at the assessment's confidence.

    Raises QuantityError where the response does not tell one.
    """
    wanted = asked(config)
    columns = getattr(response, "asked", None)
    if wanted and (columns is None or np.shape(columns)[1:] != (len(wanted),)):
        raise QuantityError(
            f"this response does not tell {', '.join(q.name for q in wanted)}, which the campaign asks for: simulate "
            "it with softclose.respond"
        )
    sampling = "monte-carlo" if fresh else config.population.sampling
    return {q.name: value_of(q, np.asarray(columns)[:, k], a, sampling) for k, q in enumerate(wanted)}


def limited(config: CampaignConfig, response: Response, a: Assessment, *, fresh: bool = False) -> dict[str, Value]:
    """The value of every quantity that a campaign limits, by name, with its interval at the assessment's confidence."""
    terms = [term for term in _terms(config) if term.penalty]
    if not terms:
        return {}
    known = {**told(config, response, a, fresh=fresh), **_of_the_lot(terms, a)}
    return {term.name: known[term.name] for term in terms}


def value_of(q: Quantity, column: FloatArray, a: Assessment, sampling: str) -> Value:
    """The value of a quantity of switches or drives.

    Parameters
    ----------
    q : Quantity
        What it is.
    column : ndarray
        (n,) of each switch.
    a : Assessment
        Whose level and confidence apply.
    sampling : str
        How the switches were drawn: one quasi-random sample has no interval.

    Returns
    -------
    Value
    """
    found = q.of_column(column, level=a.level, confidence=a.confidence, has_interval=sampling == "monte-carlo")
    if sampling != "replicated" or q.per == "drive" or math.isnan(found.estimate):
        return found
    parts = [column[r :: replicates.REPLICATES] for r in range(replicates.REPLICATES)]
    each = [q.of_column(p, level=a.level, confidence=a.confidence, has_interval=False).estimate for p in parts]
    return replace(found, interval=replicates.about(found.estimate, np.array(each), a.confidence))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Term:
    """What one quantity adds to g, monotonous in its value."""

    name: str
    weight: float = 0.0
    """Of one unit of it [cm/s]."""
    limit: float = math.nan
    """The most of it, or the least where more is better."""
    better: str = "low"
    penalty: float = 0.0
    """For passing the limit by its own size [cm/s]."""

    def of(self, value: float) -> float:
        """cm/s."""
        if not self.penalty:
            return self.weight * value
        return self.penalty * max(0.0, self.passed(value)) / max(abs(self.limit), 1e-300)

    def passed(self, value: float) -> float:
        """By how much a value is beyond the limit; negative where it keeps it."""
        return value - self.limit if self.better == "low" else self.limit - value


def _terms(config: CampaignConfig) -> list[_Term]:
    o = config.objective
    limits = [
        _Term(name=name, limit=limit, better=quantity(name).better, penalty=o.limit_penalty_cm_s)
        for name, limit in sorted(o.quantity_limits.items())
    ]  # by name: a sum depends on its order, and what is stored has its keys sorted
    return [*(_Term(name=name, weight=weight) for name, weight in sorted(o.weights.items())), *limits]


def weighed(
    config: CampaignConfig,
    response: Response,
    a: Assessment,
    *,
    fresh: bool = False,
    control: Control | None = None,
) -> Assessment:
    """An assessment with what else the campaign weighs in g.

    Each weight adds its quantity times itself; each limit adds a penalty in proportion to how far it is passed, and
    decides with its interval whether the candidate is feasible. g is NaN where one of them is undefined: nothing to
    weigh is no merit. The interval of g is Bonferroni's, the sum of those of its parts, each at a higher confidence.

    Raises QuantityError where the response does not tell one of them.
    """
    terms = _terms(config)
    if not terms:
        return a
    sure = 1.0 - (1.0 - a.confidence) / (1 + len(terms))
    strict = score(config, response, fresh=fresh, control=control, confidence=sure)
    values = {**told(config, response, strict, fresh=fresh), **_of_the_lot(terms, strict)}
    g, feasible = a.g_cm_s, a.feasible
    low, high = strict.g_interval
    half = 0.0
    for term in terms:
        value = values[term.name]
        least, most = sorted(term.of(end) for end in value.interval)
        g += term.of(value.estimate)
        low, high = low + least, high + most
        half += (most - least) / 2.0 if math.isfinite(most - least) else 0.0
        if term.penalty:
            known = [end for end in value.interval if not math.isnan(end)] or [value.estimate]
            feasible = feasible and all(term.passed(end) <= 0.0 for end in known)
    return replace(
        a,
        g_cm_s=g,
        rank_cm_s=rank_cm_s(g, a.p_nc, a.max_open),
        g_interval=(low, high) if a.intervals_valid and math.isfinite(low) else NO_INTERVAL,
        g_se_cm_s=a.g_se_cm_s + half / normal_quantile(sure),
        feasible=feasible,
    )


def _of_the_lot(terms: Sequence[_Term], a: Assessment) -> dict[str, Value]:
    """Those quantities that follow from an assessment."""
    found = {}
    for term in terms:
        q = quantity(term.name)
        if q.per == "lot":
            estimate, low, high = (float(x) for x in q.values(cast("Closing", _Judgement(judged=a))))
            found[term.name] = Value(estimate=estimate, interval=(low, high), n=a.n)
    return found


@dataclass(frozen=True, slots=True, kw_only=True)
class _Judgement:
    """All that quantities of a lot look at of a closing."""

    judged: Assessment
