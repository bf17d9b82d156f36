"""Owns rare failures of a lot under one waveform: P(V > limit) and the fraction that stays open, down to 1e-6.

Brute force beside the methods of structural reliability, which OpenTURNS (extra `tails`) computes: first and second
order at the most probable point of failure, importance sampling around it, subset sampling. The space is standard
normal: one number for each variable of the lot, and for each that a condition draws: errors of measurement, gain and
clock of the drive, temperature.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from scipy.special import ndtr

from softclose.arrays import FloatArray
from softclose.conditions.streams import Ensemble
from softclose.device.status import not_integrated
from softclose.evaluate import coordinates, draw, realise, respond
from softclose.evaluate.pieces import Mapper, Sent, here, rows_of_pieces
from softclose.metrics.intervals import Interval, clopper_pearson, normal_quantile
from softclose.metrics.objective import CM_S, in_time
from softclose.population.lot import Lot
from softclose.settings import CampaignConfig
from softclose.waveform import Waveform

if TYPE_CHECKING:
    import openturns as ot

RareEvent = Literal["fast", "open"]
Method = Literal["brute", "form", "sorm", "importance", "subset"]

EVENTS: tuple[RareEvent, ...] = ("fast", "open")
METHODS: tuple[Method, ...] = ("brute", "form", "sorm", "importance", "subset")

LEAST = 1e-12
"""A probability below it is none: distributions with bounds have an end."""

_NEVER = "no failure was met: the lot ends before the limit, or it is rarer than this method sees"
_LEVELS = 4
_SCOUTS = 4096
_STARTS = 8
_AGAIN = 3
"""Times that chains are drawn anew at most."""
_INWARDS = np.linspace(0.7, 0.99, 16)[:, None]
"""Parts of the way to a failing point at which a nearer one is looked for."""


class TailError(ValueError):
    """A question about a tail that cannot be answered as asked."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Tail:
    """One method's answer."""

    method: Method
    probability: float
    """Of failure; NaN where the method finds no answer."""
    interval: Interval
    """Of sampling methods, at the confidence asked for; NaN for FORM and SORM, whose error is not of sampling."""
    n_switches: int
    """Switches simulated for it."""
    beta: float = math.nan
    """FORM: distance of the most probable point of failure from the mean switch, in standard deviations."""
    point: tuple[float, ...] = ()
    """FORM: that point, in standard normal coordinates."""
    note: str = ""
    """Why there is no answer."""


def tail(
    config: CampaignConfig,
    waveform: Waveform,
    event: RareEvent,
    *,
    limit_cm_s: float = 19.7,
    methods: Sequence[Method] = METHODS,
    n_switches: int = 1_000_000,
    relative_error: float = 0.05,
    confidence: float = 0.95,
    seed: int = 0,
    mapper: Mapper = here,
) -> tuple[Tail, ...]:
    """The probability of a failure by each method.

    Parameters
    ----------
    config : CampaignConfig
        Lot, device model and drive limits.
    waveform : Waveform
        What the lot is driven with.
    event : {"fast", "open"}
        "fast": V of Eq. 7 above the limit (a switch that never touches has V = 0), of all switches. "open": not held
        in contact at the horizon.
    limit_cm_s : float
        The limit of "fast" [cm/s].
    methods : sequence
        Which; those but "brute" need OpenTURNS.
    n_switches : int
        Switches of brute force.
    relative_error : float
        Coefficient of variation at which importance and subset sampling end.
    confidence : float
        Of the intervals.
    seed : int
        Of all random numbers.
    mapper : Mapper
        Who simulates.

    Returns
    -------
    tuple of Tail
        In the order of `methods`.

    Raises
    ------
    TailError
        For another event or method, or without OpenTURNS.
    """
    if event not in EVENTS:
        raise TailError(f"the event is {event!r}; it must be one of {', '.join(EVENTS)}")
    unknown = [m for m in methods if m not in METHODS]
    if unknown:
        raise TailError(f"{unknown[0]!r} is no method; choose from {', '.join(METHODS)}")
    if not 0.0 < limit_cm_s < math.inf:
        raise TailError(f"the limit is {limit_cm_s:g} cm/s; it must be above 0")
    if n_switches < 1:
        raise TailError(f"{n_switches} switches say nothing; give 1 or more")
    if not 0.0 < relative_error < 1.0:
        raise TailError(f"the relative error is {relative_error:g}; it must lie between 0 and 1 (0.05 is usual)")
    if not 0.0 < confidence < 1.0:
        raise TailError(f"the confidence is {confidence:g}; it must lie between 0 and 1 (0.95 is usual)")
    if any(method != "brute" for method in methods):
        _openturns()  # before anything is simulated
    space = _Space(config, waveform, event, limit_cm_s, mapper)
    found = []
    for method in methods:
        space.n_failed = 0
        if method == "brute":
            row = _brute(space, n_switches, confidence, seed)
        else:
            row = _reliability(space, method, relative_error, confidence, seed)
            if space.fault is not None:
                raise space.fault
        found.append(_with_failures(row, space))
    return tuple(found)


def _with_failures(row: Tail, space: _Space) -> Tail:
    """The row; where switches could not be integrated, with a note of how many, and what they count as."""
    if not space.n_failed:
        return row
    counted = "not fast" if space.event == "fast" else "open"
    told = f"{not_integrated(space.n_failed, row.n_switches)}, counted as {counted}"
    return replace(row, note=f"{row.note}; {told}" if row.note else told)


def _none(space: _Space, method: Method, note: str) -> Tail:
    """The row of a method that finds no answer, so that the others keep theirs."""
    return Tail(
        method=method, probability=math.nan, interval=(math.nan, math.nan), n_switches=space.n, note=note
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class _Asked:
    """What is asked of a switch."""

    sent: Sent
    waveform: Waveform
    event: RareEvent
    threshold: float


def _measure(asked: _Asked, lot: Lot) -> tuple[FloatArray, int]:
    """(n,) V [cm/s], or how open a switch is: failure is a value above the threshold; and how many failed to integrate.

    A switch that could not be integrated is open, and has no V.
    """
    config = asked.sent.config
    r = respond(config, lot, asked.waveform)
    n_failed = int((np.asarray(r.status) != 0).sum())
    if asked.event == "fast":
        return np.nan_to_num(r.max_contact_speed * CM_S, nan=0.0), n_failed
    limit = config.objective.closed_by_us or config.model.horizon_us
    # Closed: by how much of the time too early; open: by how much of its travel too far. It jumps in between.
    missing = np.clip(1.0 - np.nan_to_num(r.final_x, nan=0.0) / lot["D"], 1e-3, None)
    closed = in_time(r, config.objective.closed_by_us)
    return np.where(closed, np.minimum(r.settling_us / limit - 1.0, 0.0), missing), n_failed


def _measured(piece: tuple[_Asked, FloatArray]) -> tuple[FloatArray, int]:
    """What is measured at (n, dim) standard normal coordinates."""
    asked, u = piece
    return _measure(asked, _lot_at(asked.sent.config, u))


def _lot_at(config: CampaignConfig, u: FloatArray) -> Lot:
    """The switches at (n, dim) standard normal coordinates."""
    drawn = coordinates(config)
    parts = np.split(ndtr(u), np.cumsum([len(c.parts) for c in drawn])[:-1], axis=1)
    return realise(config, {c.name: p for c, p in zip(drawn, parts, strict=True)})


def _counted(piece: tuple[_Asked, int, range]) -> tuple[int, int]:
    """Of the switches `rows` of the ensemble of a seed: how many fail, and how many failed to integrate."""
    asked, seed, rows = piece
    lot = draw(asked.sent.config, len(rows), seed=seed, start=rows.start, ensemble=Ensemble.TAIL)
    values, n_failed = _measure(asked, lot)
    return int((values > asked.threshold).sum()), n_failed


class _Space:
    """Standard normal coordinates of a lot, and how far a switch is from failing."""

    def __init__(
        self, config: CampaignConfig, waveform: Waveform, event: RareEvent, limit_cm_s: float, mapper: Mapper
    ) -> None:
        self.config, self.event, self.mapper = config, event, mapper
        self.threshold = limit_cm_s if event == "fast" else 0.0
        self.asked = _Asked(Sent(config), waveform, event, self.threshold)
        self.dim = sum(len(c.parts) for c in coordinates(config))
        self.n = self.n_failed = 0
        self.fault: BaseException | None = None
        """What a mapper raised inside OpenTURNS, which makes a text of it."""

    def __call__(self, u: Any) -> FloatArray:
        """(n, 1) an array, always: OpenTURNS 1.27 never frees rows of any other kind, 80 KB for a thousand."""
        points = _points(u, self.dim)
        pieces = [
            (self.asked, np.ascontiguousarray(points[rows.start : rows.stop]))
            for rows in rows_of_pieces(self.config, len(points))
        ]
        try:
            found = list(self.mapper(_measured, pieces))
        except BaseException as e:
            self.fault = e
            raise
        self.n += len(points)
        self.n_failed += sum(n for _, n in found)
        return np.concatenate([values for values, _ in found])[:, None]


def _points(u: Any, dim: int) -> FloatArray:
    """(n, dim) of an array, or of the rows that OpenTURNS hands over: tuples, twice as slow to read as one by one."""
    if isinstance(u, tuple) and u and isinstance(u[0], tuple):
        return np.fromiter(itertools.chain.from_iterable(u), dtype=np.float64, count=len(u) * dim).reshape(-1, dim)
    return np.asarray(u, dtype=np.float64).reshape(-1, dim)


def _brute(space: _Space, n: int, confidence: float, seed: int) -> Tail:
    count = 0
    for failing, n_failed in space.mapper(
        _counted, ((space.asked, seed, rows) for rows in rows_of_pieces(space.config, n))
    ):
        count += failing
        space.n_failed += n_failed
    return Tail(method="brute", probability=count / n, interval=clopper_pearson(count, n, confidence), n_switches=n)


def _reliability(space: _Space, method: Method, relative_error: float, confidence: float, seed: int) -> Tail:
    ot = _openturns()
    space.n = 0
    ot.RandomGenerator.SetSeed(seed)
    function = ot.PythonFunction(space.dim, 1, func_sample=space)
    event = ot.ThresholdEvent(
        ot.CompositeRandomVector(function, ot.RandomVector(ot.Normal(space.dim))), ot.Greater(), space.threshold
    )
    with _quiet(ot):
        if method == "subset":
            return _subset(ot, space, event, relative_error, confidence)
        points = _failure_points(space, seed)
        if points is None:
            return _none(
                space, method, "no failure was found to search its most probable point from; use brute or subset"
            )
        if method == "importance":
            return _importance(ot, space, event, points, relative_error, confidence)
        return _first_or_second_order(ot, space, method, event, points[0])


def _failure_points(space: _Space, seed: int) -> FloatArray | None:
    """(k, dim) points of failure nearest to the origin that a wide sample and bisections towards it find, one for each
    direction, nearest first; None where nothing fails."""
    rng = np.random.default_rng(seed)
    for spread in (1.5, 2.0, 2.6):
        u = spread * rng.standard_normal((_SCOUTS, space.dim))
        failing = u[space(u)[:, 0] > space.threshold]
        if len(failing):
            break
    else:
        return None
    order = np.argsort((failing**2).sum(axis=1))
    chosen: list[FloatArray] = []
    directions: list[FloatArray] = []
    for point in failing[order]:
        direction = point / np.linalg.norm(point)
        if all(float(direction @ other) < 0.8 for other in directions):
            chosen.append(point)
            directions.append(direction)
        if len(chosen) == _STARTS:
            break
    return np.array(sorted((_nearest(space, point, rng) for point in chosen), key=lambda x: float(x @ x)))


def _nearest(space: _Space, point: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Walks from a failing point to the nearest one that it finds: random steps of shrinking size, never outwards.

    It needs no gradient, which a response with jumps does not have.
    """
    best, step = point, 0.5
    for _ in range(14):
        trial = best + step * rng.standard_normal((64, space.dim))
        trial = np.concatenate([trial, best * _INWARDS])
        nearer = trial[(trial**2).sum(axis=1) < float(best @ best)]
        failing = nearer[space(nearer)[:, 0] > space.threshold] if len(nearer) else nearer
        if len(failing):
            best = failing[np.argmin((failing**2).sum(axis=1))]
        else:
            step *= 0.6
    return best


def _first_or_second_order(ot: Any, space: _Space, method: Method, event: Any, start: FloatArray) -> Tail:
    solver = ot.AbdoRackwitz()
    solver.setMaximumIterationNumber(200)
    solver.setCheckStatus(False)
    try:
        algorithm = (ot.FORM if method == "form" else ot.SORM)(solver, event, ot.Point(start))
        algorithm.run()
        result = algorithm.getResult()
        point = tuple(float(x) for x in result.getStandardSpaceDesignPoint())
        beta = float(result.getHasoferReliabilityIndex())
        probability = float(result.getEventProbability() if method == "form" else result.getEventProbabilityBreitung())
    except (RuntimeError, TypeError, ValueError) as e:
        return _none(space, method, _reason(e))
    return Tail(
        method=method, probability=probability, interval=(math.nan, math.nan), n_switches=space.n, beta=beta,
        point=point,
    )  # fmt: skip


def _importance(
    ot: Any, space: _Space, event: Any, points: FloatArray, relative_error: float, confidence: float
) -> Tail:
    """Normal distributions around every point of failure found, and the lot's own, so that no mode has weight 0."""
    parts = [ot.Normal(ot.Point(point), ot.CovarianceMatrix(space.dim)) for point in points]
    weights = np.exp(-0.5 * ((points**2).sum(axis=1) - float(points[0] @ points[0])))
    weights = np.maximum(weights / weights.sum(), 0.05)
    mixture = ot.Mixture([*parts, ot.Normal(space.dim)], [*(0.9 * weights / weights.sum()), 0.1])
    algorithm = ot.ProbabilitySimulationAlgorithm(event, ot.ImportanceSamplingExperiment(mixture))
    algorithm.setMaximumCoefficientOfVariation(relative_error)
    algorithm.setBlockSize(1000)
    algorithm.setMaximumOuterSampling(2000)
    algorithm.run()
    return _sampled(space, "importance", algorithm.getResult(), confidence)


def _subset(ot: Any, space: _Space, event: Any, relative_error: float, confidence: float) -> Tail:
    """Subset sampling. Its first level is a plain sample, of whose variation OpenTURNS reports nothing.

    Where the first level is the only one, failures are counted in it: Clopper and Pearson. Else its variation is that
    of the share beyond its threshold, and joins that of the chains of the other levels. Once in some thousand times
    chains are so much against one another that OpenTURNS estimates a variance below 0, and stops: they are drawn anew.
    """
    again = 0
    while True:
        algorithm = ot.SubsetSampling(event)
        algorithm.setBlockSize(1000)
        # A level of n switches, a tenth of which goes on, is known to sqrt(9 / n), and chains halve what they tell.
        algorithm.setMaximumOuterSampling(max(4, math.ceil(9.0 * _LEVELS * 2.0 / relative_error**2 / 1000.0)))
        algorithm.setMaximumCoefficientOfVariation(relative_error)
        algorithm.setMinimumProbability(LEAST)
        try:
            algorithm.run()
            break
        except (RuntimeError, TypeError) as e:
            if space.fault is None and "variance" in str(e) and again < _AGAIN:
                again += 1
            elif "too small" in str(e):
                return Tail(
                    method="subset", probability=0.0, interval=(0.0, math.nan), n_switches=space.n, note=_NEVER
                )  # fmt: skip
            else:
                return _none(space, "subset", _reason(e))
    found = _of_levels(space, algorithm, confidence)
    return (
        replace(found, note=f"drawn {again + 1} times: before, the variance of the chains came out below 0")
        if again
        else found
    )


def _of_levels(space: _Space, algorithm: Any, confidence: float) -> Tail:
    """What subset sampling found, and from how many levels."""
    result, steps = algorithm.getResult(), int(algorithm.getStepsNumber())
    n = int(result.getOuterSampling()) * int(algorithm.getBlockSize()) // steps  # of a level
    first = float(algorithm.getProbabilityEstimatePerStep()[0])
    if steps == 1:
        interval = clopper_pearson(round(first * n), n, confidence)
        return Tail(method="subset", probability=first, interval=interval, n_switches=space.n)
    return _sampled(
        space, "subset", result, confidence, math.hypot(math.sqrt((1.0 - first) / (n * first)), _of_chains(algorithm))
    )


def _of_chains(algorithm: Any) -> float:
    """Coefficient of variation of subset sampling's later levels, which err alike: one's chains start from another's.

    Au and Beck's (2001) upper bound: the sum over the levels instead of the root of the sum of squares.
    """
    whole = np.asarray(algorithm.getCoefficientOfVariationPerStep(), dtype=np.float64).reshape(-1)
    return float(np.sqrt(np.maximum(np.diff(whole**2), 0.0)).sum())


def _reason(e: Exception) -> str:
    """The first line of what OpenTURNS says."""
    return re.sub(r"^\w*Exception : ", "", str(e).splitlines()[0]).split(":")[0]


def _sampled(space: _Space, method: Method, result: Any, confidence: float, variation: float | None = None) -> Tail:
    """The interval is on the logarithm: a probability's relative error is what these methods control."""
    p = float(result.getProbabilityEstimate())
    variation = float(result.getCoefficientOfVariation()) if variation is None else variation
    if p <= LEAST:
        return Tail(
            method=method, probability=0.0, interval=(0.0, math.nan), n_switches=space.n,
            note=_NEVER,
        )  # fmt: skip
    factor = math.exp(normal_quantile(confidence) * variation)
    return Tail(method=method, probability=p, interval=(p / factor, min(p * factor, 1.0)), n_switches=space.n)


def _openturns() -> Any:
    try:
        import openturns
    except ImportError as e:
        raise TailError(
            "FORM, SORM, importance and subset sampling need OpenTURNS: pip install openturns, or choose the "
            "method brute"
        ) from e
    return openturns


@contextmanager
def _quiet(ot: ot) -> Iterator[None]:
    """OpenTURNS warns on its own log where a search ends early; what came of it is in the result."""
    before = ot.Log.Flags()
    ot.Log.Show(ot.Log.NONE)
    try:
        yield
    finally:
        ot.Log.Show(before)
