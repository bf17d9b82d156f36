"""Candidates that leave too many switches open rank behind all others, in every engine, front, race and choice."""

from __future__ import annotations

import dataclasses
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, seed, settings
from hypothesis import strategies as st

from bowl import observe, problem_of
from softclose.metrics.objective import assess
from softclose.metrics.race import race
from softclose.metrics.ranking import BEYOND_CM_S, levelled, open_warning, rank_cm_s
from softclose.propose.basins import distinct_basins
from softclose.propose.plan import plan
from softclose.propose.proposer import Proposer
from softclose.propose.protocol import Problem
from softclose.propose.side_by_side import best_so_far, run_engine

shares = st.integers(0, 1000).map(lambda k: k / 1000)
speeds = st.floats(0.0, 2e6)


def response(speed: float, n_open: int, n: int = 200) -> Any:
    """n switches of nearly one speed [µm/µs], of which the first n_open stay open."""
    v = np.full(n, speed) + np.linspace(0.0, 1e-4, n)
    closed = np.arange(n) >= n_open
    return SimpleNamespace(max_contact_speed=np.where(closed, v, np.nan), closed=closed)


@seed(1)
@settings(deadline=None)
@given(st.lists(st.tuples(speeds, shares), min_size=2, max_size=8), shares)
def test_the_order_is_by_g_below_max_open_and_by_the_share_open_behind(
    candidates: list[tuple[float, float]], max_open: float
) -> None:
    ranks = [rank_cm_s(g, p, max_open) for g, p in candidates]
    expected = sorted(candidates, key=lambda c: (c[1] > max_open, c[1] if c[1] > max_open else c[0]))
    got = [candidates[i] for i in np.argsort(ranks, kind="stable")]
    for a, b in zip(got, expected, strict=True):
        beyond = a[1] > max_open
        assert beyond == (b[1] > max_open)
        assert a[1] == b[1] if beyond else a[0] == b[0]


@seed(2)
@settings(deadline=None)
@given(st.lists(st.one_of(st.floats(5.0, 200.0), shares.map(lambda p: BEYOND_CM_S + p)), min_size=1, max_size=12))
def test_levelled_ranks_have_the_same_order_and_no_step(ranks: list[float]) -> None:
    found = levelled(ranks)
    for i, a in enumerate(ranks):
        for j, b in enumerate(ranks):
            if a < b:
                assert found[i] <= found[j]
            if a < b and b < BEYOND_CM_S:
                assert found[i] < found[j]
    within = [v for v in ranks if v < BEYOND_CM_S]
    assert [v for v, rank in zip(found, ranks, strict=True) if rank < BEYOND_CM_S] == within
    reach = max(within, default=0.0) - min(within, default=0.0)
    assert found.max() - found.min() <= 2.0 * max(reach, 1.0) + 1e-9


def test_with_max_open_1_g_decides() -> None:
    a = assess(response(0.05, 190), max_open=1.0, min_contact=0.0)
    assert a.rank_cm_s == a.g_cm_s
    assert assess(response(0.05, 190), min_contact=0.0).rank_cm_s == BEYOND_CM_S + 0.95
    assert math.isnan(rank_cm_s(math.nan, 0.9, 0.1))


def test_what_closes_nothing_does_not_beat_what_closes_hard() -> None:
    """A waveform that closes nothing had g 85, and one that closes a fast lot at 180 cm/s lost against it."""
    nothing, hard = assess(response(0.0, 200)), assess(response(1.8, 4))
    assert nothing.g_cm_s < hard.g_cm_s
    assert hard.rank_cm_s < nothing.rank_cm_s


def test_a_race_is_won_by_one_that_closes_however_soft_the_others() -> None:
    field = [response(0.05, 60, 4000), response(0.02, 1500, 4000), response(0.30, 40, 4000), response(0.01, 900, 4000)]

    def respond(i: int, n: int) -> Any:
        rows = np.random.default_rng(0).permutation(4000)[:n]
        r = field[i]
        return SimpleNamespace(max_contact_speed=r.max_contact_speed[rows], closed=r.closed[rows])

    found = race(4, [500, 1000, 2000], respond, tolerance_cm_s=0.5, max_open=0.1)
    assert found.decided
    assert found.finalists == (0,)
    free = race(4, [500, 1000, 2000], respond, tolerance_cm_s=0.5, max_open=1.0, c1_cm_s=1.0)
    assert free.finalists == (3,)


def test_a_race_of_waveforms_near_max_open_is_not_decided_by_luck() -> None:
    """Two that leave 10 % of a lot open: which of them is within, few switches cannot tell."""
    decided = 0
    for number in range(60):
        rng = np.random.default_rng(number)
        field = []
        for speed in (0.10, 0.30):
            closed = rng.random(400) >= 0.1
            v = np.where(closed, speed, np.nan)
            field.append(SimpleNamespace(max_contact_speed=v, closed=closed))
        found = race(2, [400], lambda i, n, field=field: field[i], tolerance_cm_s=0.5, max_open=0.1)
        decided += found.decided and found.laps[-1].best == 1
    assert decided <= 0.05 * 60


def of_shares(o: Any, g: float, p_nc: float, max_open: float) -> Any:
    return dataclasses.replace(o, g_cm_s=g, p_nc=p_nc, rank_cm_s=rank_cm_s(g, p_nc, max_open))


def walled(problem: Problem, _: Any, wave: Any, i: int, proposal: Any) -> Any:
    """The bowl, and a deeper one beside it in which most switches stay open: 0.3 from the first coordinate up."""
    o = observe(problem, wave, i, proposal)
    try:
        x = problem.space.unit(proposal.waveform, clip=True)
    except ValueError:
        return of_shares(o, 85.0, 1.0, problem.config.objective.max_open)
    p_nc = float(np.clip(2.0 * (x[0] - 0.3), 0.0, 1.0))
    g = 15.0 + 60.0 * float(((x - np.array([0.9, *[0.4] * (len(x) - 1)])) ** 2).mean())
    return of_shares(o, g, p_nc, problem.config.objective.max_open)


@pytest.mark.parametrize("engine", ["skopt", "cmaes", "direct", "sobol", "nsga2"])
def test_every_engine_keeps_to_where_few_stay_open(engine: str) -> None:
    """The deeper bowl is beyond: whoever ranks by g alone ends there."""
    found = {}
    for max_open in (0.1, 1.0):
        problem = problem_of(engine, budget=256 if engine == "nsga2" else 80)
        config = problem.config.revised([f"objective.max_open={max_open}"])
        history, _, _ = run_engine(config, engine, evaluator=walled)
        best = best_so_far(history)[-1]
        assert best is not None
        late = history[-30:]
        found[max_open] = best.p_nc, np.mean([o.p_nc <= 0.1 for o in late])
    assert found[0.1][0] <= 0.1
    assert found[1.0][0] > 0.1
    if engine not in ("sobol", "direct"):
        assert found[0.1][1] > found[1.0][1] + 0.2


def test_basins_are_those_that_close() -> None:
    problem = problem_of("sobol", budget=60)
    history, _, _ = run_engine(problem.config, "sobol", evaluator=walled)
    for o in distinct_basins(problem, history, 3, 0.05):
        assert o.p_nc <= 0.1


def test_proposals_see_ranks_and_not_the_g_beside_them() -> None:
    """The same ranks beside other g: the same proposals, by every engine that this machine has."""
    for engine in ("skopt", "cmaes", "direct"):
        problem = problem_of(engine, budget=40)
        history, _, _ = run_engine(problem.config, engine, evaluator=walled)
        other = [dataclasses.replace(o, g_cm_s=40.0 - o.g_cm_s) for o in history]
        for wave in plan(problem)[-2:]:
            assert Proposer(problem).from_history(wave, history) == Proposer(problem).from_history(wave, other)


@pytest.mark.parametrize(
    ("p_nc", "words"), [(0.0, ""), (0.05, ""), (0.0501, "warn_open (5 %)"), (0.71, "max_open (10 %)"), (math.nan, "")]
)
def test_many_open_switches_are_said(p_nc: float, words: str) -> None:
    said = open_warning(p_nc, max_open=0.1, warn_open=0.05)
    assert words in said
    assert bool(said) == bool(words)
    assert "\n" not in said
