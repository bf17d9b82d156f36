"""Claims about every interval of a figure: it holds as often as it says, for hard distributions too.

A small version of benchmarks/interval_coverage.py, whose tables are in docs/measurements/coverage.md.
"""

from __future__ import annotations

import itertools
import math
from types import SimpleNamespace

import numpy as np
import pytest

from benchmark_files import benchmark
from examples import in_turn, is_whole
from softclose.metrics.intervals import unseen_share
from softclose.metrics.objective import assess
from softclose.metrics.paired import compare, proportion_difference

coverage = benchmark("interval_coverage")
analyses = benchmark("coverage_of_analyses")
N_REPETITIONS = 200
LEAST = 0.95 - 3.5 * math.sqrt(0.95 * 0.05 / N_REPETITIONS)
"""What 95 % of 200 may come out as by chance, once in some thousand cells: 0.896."""
ON_AVERAGE = ("p_nc", "p_exceed")
"""Wilson's: right on average over p, less at some; their exact coverage is enumerated in test_intervals."""


@pytest.mark.parametrize(
    ("name", "n"), in_turn((pytest.param(name, n) for n in (50, 200) for name in coverage.LOTS), 3)
)
def test_every_interval_of_a_figure_holds(name: str, n: int) -> None:
    lot = coverage.LOTS[name]
    unseen = 0.0 < lot.group < unseen_share(n)
    for figure, (held, _) in coverage.figures(name, n, N_REPETITIONS).items():
        if figure not in ON_AVERAGE and not (unseen and figure in coverage.NEED_ALL):
            assert held >= LEAST, f"{figure} of {name} at n = {n}: {held:.3f}"


@pytest.mark.parametrize(
    ("name", "n"), in_turn((pytest.param(name, n) for n in (50, 200) for name in coverage.PAIRS), 5)
)
def test_every_interval_of_a_difference_holds(name: str, n: int) -> None:
    pair = coverage.PAIRS[name]
    for figure, (held, _) in coverage.pairs(name, n, N_REPETITIONS).items():
        if not (figure == "mean V" and 0.0 < pair.group < unseen_share(n)):
            assert held >= LEAST, f"{figure} of {name} at n = {n}: {held:.3f}"


@pytest.mark.parametrize(
    ("name", "kind"),
    in_turn(
        (
            pytest.param(name, kind)
            for name in ("normal", "lognormal", "slam of 5 %", "gap at the level")
            for kind in coverage.CHEAP
        ),
        6,
    ),
)
def test_every_interval_with_a_control_variate_holds(name: str, kind: str) -> None:
    for figure, (held, _) in coverage.controls(name, kind, coverage.LEAST, N_REPETITIONS).items():
        assert held >= LEAST, f"{figure} of {name}, cheap model {kind}: {held:.3f}"


@pytest.mark.parametrize("n", [40, 300])
@pytest.mark.parametrize(("only_a", "only_b"), [(0.1, 0.0), (2.0, 0.0), (4.0, 0.0), (0.5, 0.5), (5.0, 0.5), (8.0, 8.0)])
def test_a_difference_of_rare_proportions_holds_by_enumeration(n: int, only_a: float, only_b: float) -> None:
    """only_a, only_b: expected numbers of switches that stay open under one waveform only."""
    from scipy.stats import multinomial

    p = np.array([only_a, only_b, n - only_a - only_b]) / n
    held = 0.0
    for a in range(min(n, 40)):
        for b in range(min(n - a, 40)):
            low, high = proportion_difference(a, b, n)
            if low <= p[0] - p[1] <= high:
                held += multinomial.pmf([a, b, n - a - b], n, p)
    assert held >= 0.948


def test_none_above_a_limit_bounds_no_excess() -> None:
    """Of 50 switches none exceeds it: the expected excess is anything, for one of a thousand may be far above."""
    rng = np.random.default_rng(3)
    slow = coverage.judged(10.0 + rng.random(50), np.ones(50, dtype=bool))
    assert assess(slow).p_exceed[0].excess_interval == (0.0, math.inf)
    five = coverage.judged(np.r_[np.full(45, 10.0), np.full(5, 30.0)], np.ones(50, dtype=bool))
    low, high = assess(five).p_exceed[0].excess_interval
    assert 0.0 <= low < 1.03 < high < 5.0


def test_fewer_than_five_beyond_v_u_bound_no_tail() -> None:
    rng = np.random.default_rng(4)
    v = rng.exponential(10.0, 49)
    few, enough = (coverage.judged(x, np.ones(x.size, dtype=bool)) for x in (v, np.r_[v, v]))
    assert assess(few).cvar_interval[1] == math.inf
    assert math.isfinite(assess(enough).cvar_interval[1])
    assert assess(few, risk="cvar").g_interval[1] == math.inf


def test_too_few_switches_bound_no_difference_of_v_u() -> None:
    rng = np.random.default_rng(5)
    pair = [coverage.judged(rng.exponential(10.0, 20), np.ones(20, dtype=bool)) for _ in range(2)]
    a, b = ((r, assess(r)) for r in pair)
    assert compare(a, b).v_u_interval == (-math.inf, math.inf)


def test_races_hold_where_p_nc_rarely_differs() -> None:
    assert coverage.races(1e-3, 100) >= 0.94


def test_scramblings_are_shared_only_where_they_are_too_few() -> None:
    rng = np.random.default_rng(0)
    assert sorted(coverage.chosen(64, 4, rng).ravel()) == list(range(64))
    shared = coverage.chosen(40, 30, rng)
    assert shared.shape == (30, 16)
    assert all(len(set(row)) == 16 for row in shared)
    assert set(shared.ravel()) == set(range(40))


def test_an_ensemble_put_together_of_scramblings_is_the_product_s(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each scrambling used once, in its order: the very ensembles that a campaign draws, and their figures."""
    from softclose.evaluate import draw, respond
    from softclose.settings import load_config
    from softclose.waveform import Waveform

    seen = []

    def kept(response: object, **settings: object) -> object:
        if settings["sampling"] == "replicated":
            seen.append(response)
        return assess(response, **settings)  # type: ignore[arg-type]

    monkeypatch.setattr(coverage, "assess", kept)
    monkeypatch.setattr(coverage, "GROUPS", 2)
    scramblings, found = coverage.replicated(256, 4, ["soft"], n_truth=1024)
    assert scramblings == 4 * 16
    assert set(found["soft"]) == set(coverage.REPLICATED)
    config = load_config("current")
    soft = Waveform.from_rows(coverage.WAVEFORMS["soft"])
    for seed, ours in enumerate(seen):
        theirs = respond(config, draw(config, 256, seed=seed, sampling="replicated"), soft)
        np.testing.assert_allclose(ours.max_contact_speed, theirs.max_contact_speed, rtol=1e-14)
        np.testing.assert_array_equal(ours.closed, theirs.closed)
    assert len(seen) == 4


@pytest.mark.sampled
def test_lots_left_out_once_it_is_clear_change_no_verdict() -> None:
    n = 8 if is_whole() else 4
    of = [list(itertools.islice(analyses.devices_hold(12, 20, 200, all_lots=every), n)) for every in (False, True)]
    np.testing.assert_array_equal(*of)
    values = np.array([1.0, 2.0, 3.0, 7.0])
    asked = []

    def judged(lot: object) -> SimpleNamespace:
        asked.append(lot)
        return SimpleNamespace(v=values[(len(asked) - 1) % 4])

    one = SimpleNamespace(population=analyses.load_population("current"))
    *_, last = analyses.judged_until_clear({"v": 2.5}, 20)(judged, [None, *[one] * 20])
    assert len(asked) == 4, "two lots on either side leave nothing open, of twenty"
    assert last.v in values
    asked.clear()
    assert len(list(analyses.judged_until_clear({"v": 8.0}, 20)(judged, [None, *[one] * 20]))) == 21
    assert len(asked) == 20
