"""How often does each interval that Softclose prints hold what it is about? Prints tables of coverage.

python benchmarks/interval_coverage.py                        # everything, 10,000 repetitions
python benchmarks/interval_coverage.py figures --repetitions 500

Every interval comes from the function that the commands print it from; truths are closed forms or quadratures of the
quantile functions. A cell in brackets: the group that matters is smaller than `unseen_share(n)`, so that it can be
missing from all draws; the commands say so where they print the interval.
"""

from __future__ import annotations

import argparse
import functools
import math
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri
from scipy.stats import binom

from softclose import Waveform
from softclose.evaluate import draw, respond
from softclose.evaluate.scoring import OF_CONTROL, objective_settings
from softclose.metrics import intervals
from softclose.metrics.control import LEAST, Control, controlled
from softclose.metrics.intervals import Interval, unseen_share
from softclose.metrics.objective import Assessment, Judged, assess
from softclose.metrics.paired import compare
from softclose.metrics.race import race, sizes
from softclose.metrics.replicates import REPLICATES
from softclose.population import Sampling
from softclose.settings import CampaignConfig, load_config

FloatArray = NDArray[np.float64]
Quantile = Callable[[FloatArray], FloatArray]

LEVEL, LIMIT_CM_S, C1_CM_S = 0.9, 19.7, 25.0
SIZES = (20, 50, 200, 2000)


@dataclass(frozen=True, slots=True, kw_only=True)
class Lot:
    """A distribution of V [cm/s] by its quantile function, continuous from the left."""

    quantile: Quantile
    group: float = 0.0
    """Share of its rarest group that matters; 0: none."""

    def expect(self, f: Callable[[FloatArray], FloatArray]) -> float:
        """E[f(V)], finer towards the tail."""
        w = (np.arange(400_000) + 0.5) / 400_000
        return float((2.0 * w * f(self.quantile(1.0 - w**2))).mean())

    def truth(self, open_: float) -> dict[str, float]:
        """What the intervals are about. open_: share of the switches that stay open, whatever their V."""
        v_u = float(self.quantile(np.array([LEVEL]))[0])
        beyond = self.expect(lambda v: np.maximum(v - v_u, 0.0)) / (1.0 - LEVEL)
        return {
            "v_u": v_u,
            "mean V": self.expect(lambda v: v),
            "CVaR": v_u + beyond,
            "g": v_u + C1_CM_S * open_,
            "g of CVaR": v_u + beyond + C1_CM_S * open_,
            "excess": self.expect(lambda v: np.maximum(v - LIMIT_CM_S, 0.0)),
            "p_exceed": self.expect(lambda v: (v > LIMIT_CM_S).astype(float)),
            "p_nc": open_,
        }


def _steps(*parts: tuple[float, Quantile]) -> Quantile:
    """Quantile function of a mixture of parts that follow one another: (share, its own quantile function)."""

    def of(u: FloatArray) -> FloatArray:
        out, start = np.zeros_like(u), 0.0
        for k, (share, quantile) in enumerate(parts):
            last = k == len(parts) - 1
            here = (u > start if k else u >= 0.0) & (u <= (1.0 if last else start + share))
            out[here] = quantile(np.clip((u[here] - start) / share, 1e-12, 1.0 - 1e-12))
            start = round(start + share, 12)
        return out

    return of


def _even(low: float, high: float) -> Quantile:
    return lambda u: low + (high - low) * u


LOTS: dict[str, Lot] = {
    "normal": Lot(quantile=lambda u: 12.0 + 2.0 * ndtri(np.clip(u, 1e-9, 1.0 - 1e-15))),
    "exponential": Lot(quantile=lambda u: -10.0 * np.log1p(-np.clip(u, 0.0, 1.0 - 1e-15))),
    "lognormal": Lot(quantile=lambda u: 10.0 * np.exp(0.8 * ndtri(np.clip(u, 1e-15, 1.0 - 1e-15)))),
    "heavy tail": Lot(quantile=lambda u: 8.0 * (1.0 - np.clip(u, 0.0, 1.0 - 1e-15)) ** (-1.0 / 3.0)),
    "two clusters": Lot(quantile=_steps((0.8, _even(8.0, 12.0)), (0.2, _even(28.0, 32.0))), group=0.2),
    "slam of 5 %": Lot(quantile=_steps((0.95, _even(8.0, 12.0)), (0.05, _even(50.0, 60.0))), group=0.05),
    "slam of 2 %": Lot(quantile=_steps((0.98, _even(8.0, 12.0)), (0.02, _even(50.0, 60.0))), group=0.02),
    "gap at the level": Lot(quantile=_steps((0.9, _even(8.0, 12.0)), (0.1, _even(30.0, 40.0))), group=0.1),
    "atom over the level": Lot(
        quantile=_steps((0.7, _even(2.0, 10.0)), (0.22, _even(12.0, 12.0)), (0.08, _even(12.0, 30.0)))
    ),
    "atom up to the level": Lot(quantile=_steps((0.9, _even(9.0, 9.0)), (0.1, _even(15.0, 30.0))), group=0.1),
    "whole cm/s": Lot(quantile=lambda u: np.ceil(15.0 + 4.0 * ndtri(np.clip(u, 1e-4, 1.0 - 1e-15)))),
}
OPEN = {"normal": 0.001, "exponential": 0.05}
"""Share of the switches that stay open; of the others 1 %."""


def judged(v_cm_s: FloatArray, closed: NDArray[np.bool_], settling_us: FloatArray | None = None) -> Judged:
    """A response of these."""
    status = np.zeros(v_cm_s.shape, dtype=np.int8)
    return Judged(max_contact_speed=v_cm_s / 100.0, closed=closed, status=status, settling_us=settling_us)


def holds(interval: Interval, truth: float) -> bool:
    """Whether the truth is in it, but for rounding."""
    slack = 1e-9 * max(abs(truth), 1.0)
    return interval[0] - slack <= truth <= interval[1] + slack


def figures(name: str, n: int, repetitions: int, seed: int = 0) -> dict[str, tuple[float, float]]:
    """Coverage of every interval of one assessment, and how often each is open above."""
    lot, open_ = LOTS[name], OPEN.get(name, 0.01)
    truth = _truth(name)
    rng = np.random.default_rng((seed, n, list(LOTS).index(name)))
    held, unbounded = dict.fromkeys(truth, 0), dict.fromkeys(truth, 0)
    for _ in range(repetitions):
        closed = rng.random(n) >= open_
        settling = np.where(closed, 60.0 + rng.exponential(20.0, n), math.inf)
        response = judged(lot.quantile(rng.random(n)), closed, settling)
        for figure, interval in _intervals(response).items():
            held[figure] += holds(interval, truth[figure])
            unbounded[figure] += interval[1] == math.inf
    return {figure: (held[figure] / repetitions, unbounded[figure] / repetitions) for figure in truth}


@functools.cache
def _truth(name: str) -> dict[str, float]:
    open_ = OPEN.get(name, 0.01)
    return LOTS[name].truth(open_) | {"closing": 60.0 - 20.0 * math.log(1.0 - LEVEL / (1.0 - open_))}


def _intervals(response: Judged) -> dict[str, Interval]:
    a = assess(response, level=LEVEL, limits_cm_s=(LIMIT_CM_S,), c1_cm_s=C1_CM_S)
    tail = assess(response, level=LEVEL, limits_cm_s=(), c1_cm_s=C1_CM_S, risk="cvar")
    return {
        "v_u": a.v_u_interval,
        "mean V": a.mean_interval,
        "CVaR": a.cvar_interval,
        "g": a.g_interval,
        "g of CVaR": tail.g_interval,
        "excess": a.p_exceed[0].excess_interval,
        "p_exceed": a.p_exceed[0].probability.wilson,
        "p_nc": a.p_nc_intervals.wilson,
        "closing": a.closing_interval,
    }


@dataclass(frozen=True, slots=True, kw_only=True)
class Pair:
    """Two waveforms on the same switches."""

    draw: Callable[[np.random.Generator, int], tuple[FloatArray, FloatArray]]
    """(V under one, V under the other) [cm/s] of n switches."""
    v_u: float
    """True difference of v_u [cm/s]."""
    mean: float
    """True difference of mean V [cm/s]."""
    open_: tuple[float, float] = (0.01, 0.01)
    """Share that stays open under one only, under the other only."""
    group: float = 0.0
    """Share of the rarest group that matters to the mean; 0: none."""


def _normal_pair(own: float, shared: float, middle: float = 20.0) -> Pair:
    """20 + 3 x against middle + shared x + own y; never near 0."""

    def draw(rng: np.random.Generator, n: int) -> tuple[FloatArray, FloatArray]:
        x, y = rng.standard_normal((2, n))
        return 20.0 + 3.0 * x, middle + shared * x + own * y

    there = 20.0 + 3.0 * float(ndtri(LEVEL)) - middle - math.hypot(shared, own) * float(ndtri(LEVEL))
    return Pair(draw=draw, v_u=there, mean=20.0 - middle)


def _slams(share: float, then: float) -> Pair:
    """Even from 8 to 12; under the other a share of the switches, at random, is faster by `then`."""

    def draw(rng: np.random.Generator, n: int) -> tuple[FloatArray, FloatArray]:
        a = 8.0 + 4.0 * rng.random(n)
        return a, a + then * (rng.random(n) < share)

    slow = LEVEL / (1.0 - share) if share < 1.0 - LEVEL else 1.0 - (1.0 - LEVEL) / share
    other = 8.0 + 4.0 * slow + (0.0 if share < 1.0 - LEVEL else then)
    return Pair(draw=draw, v_u=11.6 - other, mean=-share * then, open_=(0.002, 0.0), group=share)


PAIRS: dict[str, Pair] = {
    "correlated": _normal_pair(1.5, 3.0),
    "shifted": _normal_pair(0.05, 3.0, 22.0),
    "scaled": _normal_pair(0.0, 3.9, 26.0),
    "independent": _normal_pair(3.0, 0.0),
    "opposed": _normal_pair(0.0, -3.0),
    "clusters, 15 %": _slams(0.15, 30.0),
    "clusters, 8 %": _slams(0.08, 30.0),
    "rarely different": _slams(0.03, 10.0),
}


def pairs(name: str, n: int, repetitions: int, seed: int = 0) -> dict[str, tuple[float, float]]:
    """Coverage of the intervals of a paired comparison."""
    pair = PAIRS[name]
    truth = {"v_u": pair.v_u, "mean V": pair.mean, "p_nc": pair.open_[0] - pair.open_[1]}
    rng = np.random.default_rng((seed, n, list(PAIRS).index(name)))
    held, unbounded = dict.fromkeys(truth, 0), dict.fromkeys(truth, 0)
    for _ in range(repetitions):
        a, b = pair.draw(rng, n)
        u = rng.random(n)
        one, other = judged(a, u >= pair.open_[0]), judged(b, u < 1.0 - pair.open_[1])
        c = compare((one, _plain(one)), (other, _plain(other)))
        for figure, interval in zip(truth, (c.v_u_interval, c.mean_interval, c.p_nc_interval), strict=True):
            held[figure] += holds(interval, truth[figure])
            unbounded[figure] += interval[1] == math.inf
    return {figure: (held[figure] / repetitions, unbounded[figure] / repetitions) for figure in truth}


def _plain(response: Judged) -> Assessment:
    return assess(response, level=LEVEL, limits_cm_s=())


CHEAP: dict[str, Callable[[np.random.Generator, FloatArray], FloatArray]] = {
    "shifted": lambda rng, v: 0.9 * v + 1.0,
    "noisy": lambda rng, v: np.maximum(v + rng.standard_normal(v.size), 0.0),
    "blind above": lambda rng, v: np.minimum(v, 12.0),
    "unrelated": lambda rng, v: 15.0 + rng.standard_normal(v.size),
}
"""V of a cheap model [cm/s] of switches whose costly V is known. It leaves open what the costly one does, four of five,
and one in two hundred of the others."""
MANY = 8192
"""Switches of the cheap model beyond those of the costly one."""


def controls(name: str, kind: str, n: int, repetitions: int, seed: int = 0) -> dict[str, tuple[float, float]]:
    """(coverage, root mean square error over that without) of each figure that a control variate changes."""
    lot, open_ = LOTS[name], OPEN.get(name, 0.01)
    truth = {figure: _truth(name)[figure] for figure in ("v_u", "mean V", "p_nc", "g")}
    rng = np.random.default_rng((seed, n, list(LOTS).index(name), list(CHEAP).index(kind)))
    held, errors = dict.fromkeys(truth, 0), {figure: np.zeros(2) for figure in truth}

    def both(size: int) -> tuple[Judged, Judged]:
        v, closed = lot.quantile(rng.random(size)), rng.random(size) >= open_
        other = np.where(closed, rng.random(size) >= 0.005, rng.random(size) < 0.2)
        return judged(v, closed), judged(CHEAP[kind](rng, v), other)

    settings = objective_settings(load_config("current"))
    settings |= {"level": LEVEL, "c1_cm_s": C1_CM_S, "sampling": "monte-carlo", "max_open": 1.0}
    for _ in range(repetitions):
        own, same = both(n)
        plain = assess(own, **settings)
        found = controlled(plain, own, Control(same=same, many=both(MANY)[1]), **{k: settings[k] for k in OF_CONTROL})
        ends = (found.v_u_interval, found.mean_interval, found.p_nc_intervals.wilson, found.g_interval)
        each = [(a.v_u_cm_s, a.mean_cm_s, a.p_nc, a.g_cm_s) for a in (found, plain)]
        for k, figure in enumerate(truth):
            held[figure] += holds(ends[k], truth[figure])
            errors[figure] += [(values[k] - truth[figure]) ** 2 for values in each]
    return {f: (held[f] / repetitions, math.sqrt(errors[f][0] / max(errors[f][1], 1e-300))) for f in truth}


def _print_controls(repetitions: int) -> None:
    print("\n## A cheap model as control variate: coverage, and the error over that without\n")
    print("| costly lot | cheap model | n | v_u | mean V | p_nc | g |")
    print("| --- | --- | ---: | ---: | ---: | ---: | ---: |")
    for name in LOTS:
        for kind in CHEAP:
            for n in (LEAST, 256):
                cells = [f"{h:.3f}, {e:.2f}" for h, e in controls(name, kind, n, repetitions).values()]
                print(f"| {name} | {kind} | {n} | " + " | ".join(cells) + " |", flush=True)


def proportions(n: int) -> dict[str, tuple[float, float]]:
    """(mean, least) coverage of the three intervals of a proportion, over p from 0.1/n to 1/2, by enumeration."""
    k = np.arange(n + 1)
    p = np.geomspace(0.1 / n, 0.5, 400)
    weight = binom.pmf(k[:, None], n, p)
    out = {}
    for kind in ("wald", "wilson", "clopper_pearson"):
        ends = np.array([getattr(intervals, kind)(int(c), n) for c in k])
        inside = (ends[:, :1] <= p) & (p <= ends[:, 1:])
        coverage = (weight * inside).sum(axis=0)
        out[kind] = float(coverage.mean()), float(coverage.min())
    return out


def races(rare: float, repetitions: int, seed: int = 0) -> float:
    """Share of races that hold: the better one stays in, or the margin says what is lost. p_nc differs rarely."""
    held = 0
    for k in range(repetitions):
        rng = np.random.default_rng((seed, k))
        v = 15.0 + rng.standard_normal(4000)
        one = judged(v, rng.random(4000) >= rare)
        other = judged(v + 0.1, np.ones(4000, dtype=bool))
        field = [one, other]

        def respond(i: int, n: int, field: Sequence[Judged] = field) -> Judged:
            return judged(100.0 * field[i].max_contact_speed[:n], field[i].closed[:n])

        last = race(2, sizes(500, 4000), respond, tolerance_cm_s=0.05, c1_cm_s=0.4 / rare).laps[-1]
        held += not (1 in last.out or (last.best == 0 and last.margin_cm_s < 0.3))
    return held / repetitions


WAVEFORMS: dict[str, list[tuple[float, float, float | None, float]]] = {
    "soft": [(0.0, 4.0, 4.78, 84.95), (32.46, 4.33, 6.2, 149.76), (45.94, 13.24, None, 75.39)],
    "hard": [(0.0, 4.0, None, 100.0)],
    "p_nc near 0": [(0.0, 4.0, 3.2, 150.0), (25.0, 20.0, None, 95.0)],
    "near the jump": [(0.0, 4.0, 3.2, 150.0), (25.0, 20.0, None, 66.0)],
}
"""(start, rise, peak, volts) of each pulse [µs, V]."""
REPLICATED = ("p_nc", "v_u", "mean V", "g", "CVaR")


GROUPS = 20
"""Groups of repetitions that share no scrambling: what their coverages differ by is the standard error."""
MOST_DRAWN = 5_120_000
"""Switches of a size. Where they are fewer than all repetitions need, repetitions share scramblings."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Held:
    """What is told of one figure's interval."""

    coverage: float
    """Share of the repetitions in which it holds the truth."""
    error: float
    """Standard error of that."""
    width: float
    """Median width over that of as many independent draws."""
    spread: float
    """True spread of one Sobol sample over that of independent draws."""


def chosen(scramblings: int, repetitions: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """(repetitions, 16) which scramblings each repetition has: any sixteen, as those of an ensemble are independent.

    Each is used once where there are enough of them.
    """
    if scramblings >= repetitions * REPLICATES:
        return np.arange(repetitions * REPLICATES).reshape(repetitions, REPLICATES)
    return np.array([rng.choice(scramblings, REPLICATES, replace=False) for _ in range(repetitions)])


@functools.cache
def _current() -> CampaignConfig:
    return load_config("current")


def _responses(
    names: Sequence[str], seed: int, size: int, sampling: Sampling
) -> list[tuple[FloatArray, NDArray[np.bool_]]]:
    """(V [µm/µs], closed) of an ensemble of the lot `current` under each waveform."""
    config, waveforms = _current(), [Waveform.from_rows(WAVEFORMS[name]) for name in names]
    parts = []
    for start in range(0, size, 2**16):
        lot = draw(config, min(2**16, size - start), seed=seed, sampling=sampling, start=start)
        parts.append([respond(config, lot, waveform) for waveform in waveforms])
    return [
        (np.concatenate([r.max_contact_speed for r in of]), np.concatenate([r.closed for r in of]))
        for of in zip(*parts, strict=True)
    ]


@functools.cache
def _truths(names: tuple[str, ...], n: int) -> list[FloatArray]:
    """The figures of each waveform, from points of another scrambling."""
    return [_figures(*r, "sobol")[0] for r in _responses(names, 10_000, n, "sobol")]


def _figures(v: FloatArray, closed: NDArray[np.bool_], sampling: str) -> tuple[FloatArray, FloatArray]:
    """(5,) the figures of an ensemble, and (5, 2) their intervals."""
    a = assess(judged(100.0 * v, closed), sampling=sampling, min_contact=0.0, limits_cm_s=())
    ends = (a.p_nc_intervals.wilson, a.v_u_interval, a.mean_interval, a.g_interval, a.cvar_interval)
    return np.array([a.p_nc, a.v_u_cm_s, a.mean_cm_s, a.g_cm_s, a.cvar_cm_s]), np.array(ends)


def replicated(
    n: int, repetitions: int, names: Sequence[str] = tuple(WAVEFORMS), *, most: int = MOST_DRAWN, n_truth: int = 2**20
) -> tuple[int, dict[str, dict[str, Held]]]:
    """How many independent scramblings were drawn, and what is told of each figure of each waveform.

    Ensembles of n switches in 16 independent scramblings, in 20 groups of repetitions. A repetition takes 16 of those
    of its group. All waveforms drive the same switches.
    """
    truths = _truths(tuple(names), n_truth)
    of_group = -(-repetitions // GROUPS)
    ensembles = min(of_group, max(most // (n * GROUPS), 2))
    inside = np.empty((len(names), GROUPS, of_group, len(REPLICATED)), dtype=np.bool_)
    widths: list[list[FloatArray]] = [[] for _ in names]
    errors: list[list[FloatArray]] = [[] for _ in names]
    for group in range(GROUPS):
        drawn = [_responses(names, group * ensembles + k, n, "replicated") for k in range(ensembles)]
        which = chosen(ensembles * REPLICATES, of_group, np.random.default_rng((n, group)))
        singles = [_responses(names, 2 * group + k, n, "sobol") for k in range(2)]
        for i, truth in enumerate(truths):
            # Switch j of an ensemble is of scrambling j mod 16: (scrambling, switch).
            v, closed = (np.concatenate([r[i][k].reshape(-1, REPLICATES).T for r in drawn]) for k in (0, 1))
            for k, rows in enumerate(which):
                pair = v[rows].T.ravel(), closed[rows].T.ravel()
                ends = _figures(*pair, "replicated")[1]
                inside[i, group, k] = (ends[:, 0] <= truth) & (truth <= ends[:, 1])
                if k < 20:
                    plain = _figures(*pair, "monte-carlo")[1]
                    widths[i].append((ends[:, 1] - ends[:, 0]) / (plain[:, 1] - plain[:, 0]))
                if k < 2:
                    one = _figures(*singles[k][i], "sobol")[0]
                    errors[i].append((one - truth) / (0.5 * (plain[:, 1] - plain[:, 0]) / 1.96))
        so_far = inside[:, : group + 1].mean(axis=(1, 2)).round(3).tolist()
        print(f"{n} switches, group {group + 1} of {GROUPS}: {dict(zip(names, so_far, strict=True))}", file=sys.stderr)
    found = {}
    for i, name in enumerate(names):
        by_group = inside[i].mean(axis=1)
        columns = (
            by_group.mean(axis=0),
            by_group.std(axis=0, ddof=1) / math.sqrt(GROUPS),
            np.median(widths[i], axis=0),
            np.sqrt((np.array(errors[i]) ** 2).mean(axis=0)),
        )
        found[name] = {
            figure: Held(coverage=float(c), error=float(e), width=float(w), spread=float(s))
            for figure, c, e, w, s in zip(REPLICATED, *columns, strict=True)
        }
    return GROUPS * ensembles * REPLICATES, found


def _print_replicated(repetitions: int, sizes: Sequence[int] = (512, 4096, 32768)) -> None:
    print("\n## Sixteen scramblings: coverage, width and (one Sobol sample's) spread over Monte Carlo's\n")
    print("| waveform | N | repetitions | of scramblings | " + " | ".join(REPLICATED) + " | standard error, at most |")
    print("| --- | ---: | ---: | ---: |" + " ---: |" * (len(REPLICATED) + 1))
    for n in sizes:
        scramblings, found = replicated(n, repetitions)
        for name, of in found.items():
            done = GROUPS * -(-repetitions // GROUPS)
            cells = [f"{held.coverage:.3f}, {held.width:.2f}, {held.spread:.2f}" for held in of.values()]
            cells.append(f"{max(held.error for held in of.values()):.4f}")
            print(f"| {name} | {n:,} | {done:,} | {scramblings:,} | " + " | ".join(cells) + " |", flush=True)


def _table(title: str, found: Iterator[tuple[str, float, Mapping[int, Mapping[str, tuple[float, float]]]]]) -> None:
    """found: (name, share of its rarest group, {n: {figure: (coverage, how often open above)}})."""
    print(f"\n## {title}\n")
    for i, (name, group, by_size) in enumerate(found):
        of_figures = list(next(iter(by_size.values())))
        if i == 0:
            print("| | n | " + " | ".join(of_figures) + " |")
            print("| --- | ---: |" + " ---: |" * len(of_figures))
        for n, at in by_size.items():
            cells = []
            for figure, (coverage, unbounded) in at.items():
                text = f"{coverage:.3f}" + (f" (open {unbounded:.0%})" if unbounded >= 0.005 else "")
                missing = 0.0 < group < unseen_share(n) and figure in NEED_ALL
                cells.append(f"[{text}]" if missing else text)
            print(f"| {name} | {n:,} | " + " | ".join(cells) + " |", flush=True)


NEED_ALL = ("mean V", "CVaR", "g of CVaR", "excess")
"""Figures that a group which no draw shows can change by any amount."""


def main() -> None:
    import coverage_of_analyses as analyses  # beside this file, which tests load by its path

    sections: dict[str, Callable[[int], None]] = {
        "figures": lambda r: _table(
            "Figures of one waveform",
            ((name, lot.group, {n: figures(name, n, r) for n in SIZES}) for name, lot in LOTS.items()),
        ),
        "pairs": lambda r: _table(
            "Differences of two waveforms on the same switches (independent draws)",
            ((name, pair.group, {n: pairs(name, n, r) for n in SIZES}) for name, pair in PAIRS.items()),
        ),
        "proportions": _print_proportions,
        "replicated": _print_replicated,
        "controls": _print_controls,
        "races": lambda r: print(
            "\n## Races\n\n| rare p_nc | hold |\n| ---: | ---: |\n"
            + "\n".join(f"| {rare:g} | {races(rare, r):.3f} |" for rare in (2e-3, 1e-3, 5e-4))
        ),
    }
    sections |= {
        "tails": analyses.print_tails,
        "sensitivity": analyses.print_sensitivity,
        "fitted": analyses.print_fitted,
        "devices": analyses.print_devices,
    }
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sections", nargs="*", help=f"which of {', '.join(sections)} [all]")
    parser.add_argument("--repetitions", type=int, default=10_000)
    options = parser.parse_args()
    for name in options.sections or sections:
        sections[name](options.repetitions)


def _print_proportions(_: int) -> None:
    print("\n## Proportions, by enumeration: mean (least) over p from 0.1/n to 1/2\n")
    print("| n | Wald, Eq. 11 | Wilson | Clopper–Pearson |\n| ---: | ---: | ---: | ---: |")
    for n in SIZES:
        print(f"| {n:,} | " + " | ".join(f"{mean:.3f} ({least:.3f})" for mean, least in proportions(n).values()) + " |")


if __name__ == "__main__":
    main()
