"""Owns the release of a closed lot: how it swings after the drop, and a braking pulse that calms it.

A switch that is let go falls back from the contact and, with little damping, swings beyond its rest and up to the
contact again. A pulse at the right instant pulls while it moves away, and takes that energy out.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from softclose.arrays import FloatArray
from softclose.conditions.streams import BRAKE
from softclose.evaluate.chain import cases_of, chain_of, drives_of
from softclose.evaluate.pieces import Mapper, Sent, here
from softclose.evaluate.respond import respond_each
from softclose.metrics.intervals import Interval, Proportion, proportion, quantile_estimate
from softclose.population.lot import Lot
from softclose.propose.descents import strategy
from softclose.settings import CampaignConfig
from softclose.switch.plate import holding_voltage
from softclose.waveform import Pulse, Waveform

if TYPE_CHECKING:
    from softclose.device.simulate import Responses

BAND = 0.05
"""A switch has settled where its displacement stays within this part of its travel."""
AT_REST = 1e-6
"""Speed [µm/µs] up to which a switch in a rigid contact is at rest: rounding."""
AT_REST_SOFT = 1e-3
"""Speed [µm/µs] up to which it is in a compliant one, whose last ringing fades without end: 0.1 cm/s."""
LOOKS = 800
"""Sampling instants after release."""
WATCHED = 2000
"""Switches whose motion is in memory at once."""
GENERATION = 12
"""CMA-ES population size of the brake's search."""
LEAST_HELD = 10
"""Switches that have to be held when the fall begins, for a lot to be judged."""
TOO_HIGH = 10.0
"""What a brake pays that would need more than the campaign's largest voltage."""
REBOUND_COST = 1.0
"""What a brake pays for each switch that touches again, in travels of overshoot."""


class OpeningError(ValueError):
    """A release that cannot be judged."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Released:
    """What each switch did after the drop."""

    waveform: Waveform
    """The whole drive: closing, holding, release."""
    held: NDArray[np.bool_]
    """(n,) held when the fall began; of the others nothing is said."""
    stuck: NDArray[np.bool_]
    """(n,) held, and never leaving the contact."""
    rebound: NDArray[np.bool_]
    """(n,) touching the contact again after it left."""
    overshoot: FloatArray
    """(n,) largest displacement beyond rest, in travels D; NaN where it was not held."""
    rest_us: FloatArray
    """(n,) time from the begin of the fall to |x| within `BAND` D for good [µs], seen for half a period of its own or
    more; inf: not in time, NaN: not held."""
    times_us: FloatArray
    """(n_time,) instants from the begin of the fall [µs]."""
    quantiles: FloatArray
    """(3, n_time) 5 %, 50 % and 95 % quantiles of x / D of those that were held; NaN where none was."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Opening:
    """How a lot that was closed opens."""

    released: Released
    """Its switches."""
    n: int
    """Switches that were held when the fall began; the others are not judged."""
    p_stuck: Proportion
    """Of those, never leaving the contact."""
    p_rebound: Proportion
    """Of those, touching the contact again after they left it."""
    overshoot: float
    """Level-quantile of the largest displacement beyond rest, in travels D."""
    overshoot_interval: Interval
    """Distribution-free, by order statistics."""
    rest_us: float
    """Level-quantile of the time from the begin of the fall to |x| within `BAND` D for good [µs]; inf: not in time."""
    rest_interval: Interval
    """Distribution-free, by order statistics [µs]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Openings:
    """One lot's opening, without and with a brake."""

    at_us: float
    """Begin of the fall [µs]."""
    plain: Opening
    """The holding pulse falls."""
    braked: Opening | None
    """None where there is no brake."""


def opened(waveform: Waveform, at_us: float) -> Waveform:
    """The waveform whose holding pulse begins to fall at an instant [µs], as fast as it rose."""
    last = waveform.pulses[-1]
    top = last.start_us + last.rise_us
    if not math.isinf(last.peak_us):
        raise OpeningError("the waveform lets go by itself: its last pulse does not hold; judge one that does")
    if at_us < top:
        raise OpeningError(f"the release is asked for at {at_us:g} µs; the holding pulse is up at {top:g} µs: later")
    return Waveform([*waveform.pulses[:-1], replace(last, peak_us=at_us - top)])


def judge_opening(
    config: CampaignConfig, switches: Lot | FloatArray, waveform: Waveform, *, at_us: float, mapper: Mapper = here
) -> Opening:
    """Judge a release: `let_go`, then `assess_opening`; parameters and errors are theirs."""
    return assess_opening(config, let_go(config, switches, waveform, at_us=at_us, mapper=mapper))


def let_go(
    config: CampaignConfig, switches: Lot | FloatArray, waveform: Waveform, *, at_us: float, mapper: Mapper = here
) -> Released:
    """Simulate a release, and `opening.watch_us` after the fall began.

    Parameters
    ----------
    config : CampaignConfig
        Device model.
    switches : Lot
        As `softclose.evaluate.draw` gives them. Where the times of its drive are scaled, so is all of its opening.
    waveform : Waveform
        The whole drive, its fall from `at_us` on.
    at_us : float
        Begin of the fall [µs].
    mapper : Mapper
        Who simulates, `WATCHED` switches a piece.

    Returns
    -------
    Released

        Of each switch its worst, where the campaign tries several temperatures; the motion is that of the first piece.
    """
    lot, sent = Lot.of(switches), Sent(config)
    pieces = [
        _Let(sent, lot.rows(slice(start, start + WATCHED)), waveform, at_us) for start in range(0, len(lot), WATCHED)
    ]
    return joined(list(mapper(_let_go, pieces)))


@dataclass(frozen=True, slots=True)
class Trial:
    """A waveform that is tried in the search for a brake."""

    number: int
    """0: without a brake."""
    sent: Sent
    lot: Lot
    waveform: Waveform
    at_us: float

    @property
    def is_allowed(self) -> bool:
        """Whether the campaign's largest voltage is kept; what does not is not simulated."""
        return self.waveform.max_voltage(self.at_us + 1e4) <= self.sent.config.waveform.max_volts


@dataclass(frozen=True, slots=True)
class Tried:
    """What came of a trial."""

    cost: float
    """What the brake pays."""
    kept: Mapping[str, str] = field(default_factory=dict)
    """Whatever the attempt says beside it."""


@dataclass(frozen=True, slots=True)
class _Let:
    """Switches that are let go at once."""

    sent: Sent
    lot: Lot
    waveform: Waveform
    at_us: float


def _let_go(piece: _Let) -> Released:
    return watched(piece.sent.config, piece.lot, piece.waveform, piece.at_us)[0]


def watched(
    config: CampaignConfig, lot: Lot, waveform: Waveform, at_us: float, *, further_modes: bool = False
) -> tuple[Released, list[Responses]]:
    """What switches do after the drop, and in each case their motion at `looks_us` after it; see `let_go`."""
    times = looks_us(config)
    each = respond_each(
        config,
        lot,
        waveform,
        horizon_us=at_us + float(times[-1]),
        times_us=at_us + times,
        max_impacts=256,
        **({"further_modes": True} if further_modes else {}),
    )
    chain = chain_of(config)
    slower = drives_of(chain, lot, waveform).times
    cases = zip(cases_of(chain, lot), each, strict=True)
    modes = chain.device.modes
    soft = modes is not None and modes.contact is not None
    seen = [_seen(waveform, case, found, at_us, times, slower, soft) for case, found in cases]
    return reduce(_worse, seen), each


def looks_us(config: CampaignConfig) -> FloatArray:
    """Instants at which a lot is watched, from the begin of the fall [µs]."""
    return np.linspace(0.0, config.opening.watch_us, LOOKS + 1)


def _seen(
    waveform: Waveform,
    lot: Lot,
    found: Responses,
    at_us: float,
    times: FloatArray,
    slower: FloatArray | None,
    soft: bool,
) -> Released:
    """What switches did in one case. A drive that is b times as slow is let go, and watched, b times as late."""
    assert found.x is not None
    assert found.v is not None
    assert found.impact_time_us is not None
    b = np.ones(len(lot)) if slower is None else slower
    x = np.asarray(found.x, dtype=np.float64) / lot["D"][:, None]
    # In contact is at the travel or, by a compliant contact's indentation, beyond it.
    slow = np.abs(np.asarray(found.v)[:, 0]) < (AT_REST_SOFT if soft else AT_REST)
    held = (x[:, 0] > 1.0 - 1e-6) & slow & (found.status == 0)
    away = x < 1.0 - 1e-6
    left = away.any(axis=1)
    leaves = b * (at_us + times[np.where(left, away.argmax(axis=1), 0)])
    later = np.asarray(found.impact_time_us) > leaves[:, None]
    outside = np.abs(x) > BAND
    last = np.where(outside.any(axis=1), times.size - 1 - outside[:, ::-1].argmax(axis=1), 0)
    # A switch that swings for ever crosses the band once in half a period: only half a period inside it is rest.
    half_us = math.pi * np.sqrt(lot["M"] / (1e-3 * lot["K"]))
    rest = np.where(b * (times[-1] - times[last]) < half_us, math.inf, b * times[last])
    return Released(
        waveform=waveform,
        held=held,
        stuck=held & ~left,
        rebound=held & left & later.any(axis=1),
        overshoot=np.where(held, np.maximum(-x.min(axis=1), 0.0), math.nan),
        rest_us=np.where(held, rest, math.nan),
        times_us=times,
        quantiles=np.quantile(x[held], (0.05, 0.5, 0.95), axis=0) if held.any() else np.full((3, times.size), math.nan),
    )


def _worse(a: Released, b: Released) -> Released:
    """Of each switch its worse case: judged where it is held in both; the motion drawn is that of the first."""
    held = a.held & b.held
    return replace(
        a,
        held=held,
        stuck=held & (a.stuck | b.stuck),
        rebound=held & (a.rebound | b.rebound),
        overshoot=np.where(held, np.fmax(a.overshoot, b.overshoot), math.nan),
        rest_us=np.where(held, np.fmax(a.rest_us, b.rest_us), math.nan),
    )


def joined(parts: Sequence[Released]) -> Released:
    """One release of several lots of switches; the quantiles of the motion are the first's."""
    return replace(
        parts[0],
        held=np.concatenate([part.held for part in parts]),
        stuck=np.concatenate([part.stuck for part in parts]),
        rebound=np.concatenate([part.rebound for part in parts]),
        overshoot=np.concatenate([part.overshoot for part in parts]),
        rest_us=np.concatenate([part.rest_us for part in parts]),
    )


def assess_opening(config: CampaignConfig, released: Released) -> Opening:
    """The opening of a lot, with the level and confidence of the objective.

    Raises OpeningError where fewer than ten switches were held when the fall began.
    """
    held = released.held
    n = int(held.sum())
    if n < LEAST_HELD:
        raise OpeningError(f"{n} of {held.size} switches are held when the fall begins; open later, or hold higher")
    level, confidence = config.objective.level, config.objective.confidence
    overshoot, overshoot_interval = quantile_estimate(np.sort(released.overshoot[held]), level, confidence)
    rest_us, rest_interval = quantile_estimate(np.sort(released.rest_us[held]), level, confidence)
    return Opening(
        released=released,
        n=n,
        p_stuck=proportion(int(released.stuck.sum()), n, confidence),
        p_rebound=proportion(int(released.rebound.sum()), n, confidence),
        overshoot=overshoot,
        overshoot_interval=overshoot_interval,
        rest_us=rest_us,
        rest_interval=rest_interval,
    )


def _brake_unit_us(lot: Lot) -> float:
    """What bounds a brake's begin, rise and top [µs]: the median switch's period over √1000 (ADR 130).

    Wider boxes hold better brakes, which the budgets that are used do not find.
    """
    return float(2e3 * math.pi * math.sqrt(np.median(lot["M"] / lot["K"]) / 1e6))


def design_brake(
    config: CampaignConfig,
    switches: Lot | FloatArray,
    waveform: Waveform,
    *,
    at_us: float,
    budget: int = 300,
    seed: int = 1,
    mapper: Mapper = here,
    attempt: Callable[[Trial], Tried] | None = None,
    told: Callable[[Trial, Tried], None] | None = None,
    listener: Callable[[int, int], None] | None = None,
) -> Waveform:
    """A braking pulse after the fall, by CMA-ES on one training ensemble: start, rise, top and volts.

    It minimises the level-quantile of the overshoot in travels plus `REBOUND_COST` times the part that touches again or
    stays. Closing is as it was: the pulse begins no earlier than the fall.

    Parameters
    ----------
    config, switches, waveform, at_us
        See `judge_opening`; the waveform without a brake.
    budget : int
        Waveforms to try.
    seed : int
        Of the search.
    mapper : Mapper
        Who simulates: the waveforms of a generation are a piece each.
    attempt : callable, optional
        What tries a waveform, wherever the mapper has it done; `tried`, where it is to do nothing beside.
    told : callable, optional
        Told each trial and what came of it, in order; the first is the waveform without a brake.
    listener : callable, optional
        Told (done, all).

    Returns
    -------
    Waveform
        With the brake as its last pulse; as it was where none is better.
    """
    released = waveform.pulses[-1]
    lot = Lot.of(switches)
    unit_us = _brake_unit_us(lot)
    highest = min(config.waveform.max_volts, 1.5 * float(np.median(holding_voltage(lot.switches))) + 60.0)
    low = np.array([0.0, config.waveform.min_rise_us, 0.0, 0.0])
    high = np.array([released.rise_us + unit_us, config.waveform.min_rise_us + 0.5 * unit_us, 0.5 * unit_us, highest])

    def drive(p: Any) -> Waveform:
        start, rise, peak, volts = low + np.asarray(p) * (high - low)
        return Waveform([*waveform.pulses, Pulse(at_us + start, rise, peak, volts)])

    sent = Sent(config)

    def costs_of(first: int, candidates: Sequence[Waveform]) -> Iterator[float]:
        trials = [Trial(first + i, sent, lot, candidate, at_us) for i, candidate in enumerate(candidates)]
        for trial, found in zip(trials, mapper(attempt or tried, trials), strict=True):
            if told is not None:
                told(trial, found)
            yield found.cost

    draw = np.random.default_rng(np.random.SeedSequence([seed, BRAKE]))
    best, least, done = waveform, next(costs_of(0, [waveform])), 1
    descent = strategy(np.array([0.4, 0.3, 0.2, 0.4]), np.ones(4), 0.25, GENERATION, draw)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        while done + GENERATION <= budget and not descent.stop():
            points = descent.ask()
            candidates = [drive(p) for p in points]
            costs = []
            for candidate, found in zip(candidates, costs_of(done, candidates), strict=True):
                costs.append(found)
                done += 1
                if found < least:
                    best, least = candidate, found
                if listener is not None:
                    listener(done, budget)
            descent.tell(points, costs)
    return best


def tried(trial: Trial) -> Tried:
    """Try a brake."""
    config = trial.sent.config
    if not trial.is_allowed:
        return Tried(TOO_HIGH)
    return Tried(cost_of(judge_opening(config, trial.lot, trial.waveform, at_us=trial.at_us)))


def cost_of(o: Opening) -> float:
    """What a brake pays that opens a lot so."""
    return o.overshoot + REBOUND_COST * (o.p_rebound.estimate + o.p_stuck.estimate)
