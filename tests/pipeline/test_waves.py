"""Claims about waves: the plan, the descents that take turns, who goes on, and the stages that build on each other."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bowl import bits, observe, problem_of, run, with_g
from examples import examples, in_turn
from softclose.propose.descents import AGAIN, Descent
from softclose.propose.design import design_point
from softclose.propose.explore import explore_ladder
from softclose.propose.ladder import build_ladder, courses, owner
from softclose.propose.origins import EXPLORE, EXTRA, FALLBACK, INITIAL, POLISH, RERANK, SCOUT, SOBOL
from softclose.propose.plan import plan
from softclose.propose.proposer import Proposer
from softclose.propose.protocol import EngineError, Problem
from softclose.settings import ConfigError, load_config

EXPLORING = {"budget": 150, "n_descents": 4, "turns": 2, "rounds": 2}


def exploring(turns=2, budget=8, **explore):
    return problem_of("sobol", budget, explore=EXPLORING | {"turns": turns} | explore)


# The plan.


@settings(max_examples=examples(60), deadline=None)
@given(
    search=st.integers(0, 70),
    explore=st.integers(0, 400),
    finish=st.integers(0, 90),
    engine=st.sampled_from(["sobol", "skopt", "cmaes", "direct"]),
    lag=st.integers(1, 4),
    turns=st.integers(1, 5),
    n_descents=st.integers(1, 9),
    rounds=st.integers(1, 4),
    method=st.sampled_from(["cmaes", "surrogate", "nelder-mead"]),
)
def test_the_plan_covers_every_budget_exactly_and_in_order(
    search, explore, finish, engine, lag, turns, n_descents, rounds, method
):
    if not search + explore:
        search = 1
    problem = problem_of(
        engine,
        search,
        campaign={"lag": lag, "wave": 3},
        explore={"budget": explore, "turns": turns, "n_descents": n_descents, "rounds": rounds},
        finish={"budget": finish, "method": method},
    )
    waves = plan(problem)
    assert [w.index for w in waves] == list(range(len(waves)))
    assert waves[0].start == 0
    assert waves[-1].stop == problem.config.total_budget
    assert all(a.stop == b.start for a, b in itertools.pairwise(waves))
    assert all(w.size >= 1 for w in waves)
    for stage, budget in (("search", search), ("explore", explore), ("finish", finish)):
        assert sum(w.size for w in waves if w.stage == stage) == budget
    assert [w.stage for w in waves] == sorted((w.stage for w in waves), key=["search", "explore", "finish"].index)
    assert {w.n_switches for w in waves if w.stage == "finish"} <= {100}
    assert {w.n_switches for w in waves if w.stage != "finish"} <= {50}
    sees = [w.sees for w in waves]
    assert sees == sorted(sees)
    assert all(
        0 <= w.sees <= w.index and w.index - w.sees < max(lag, turns, 4 if engine == "sobol" else 1) for w in waves
    )
    assert plan(Problem(load_config(problem.config.to_dict()))) == waves


def test_waves_of_descents_are_whole_generations():
    """So that a block of `generation` candidates never straddles two waves."""
    problem = exploring(n_scouts=12)
    assert all(w.size % 6 == 0 for w in plan(problem) if w.stage == "explore")


def test_the_users_own_waveforms_take_the_first_places_and_change_no_size():
    rows = [[[0, 4, 3, 100], [20 + k, 5, "hold", 80]] for k in range(10)]
    for engine, size in (("skopt", 8), ("sobol", 20), ("cmaes", 19)):
        problem = problem_of(engine, 40, waveform={"initial": rows})
        history, _ = run(problem)
        assert [o.origin == INITIAL for o in history] == [True] * 10 + [False] * 30
        assert plan(problem)[0].size == size
        assert FALLBACK not in {o.origin for o in history}


def test_a_plan_that_misses_its_budget_is_refused_by_name():
    class Short:
        def wave_sizes(self, problem, budget):
            return [budget - 1]

        def propose_wave(self, problem, wave, history, pending):
            return []

    with pytest.raises(EngineError, match=r"plans waves of \[23\]; .* 24 in all"):
        plan(problem_of(), Short())


def test_an_engine_that_returns_too_few_or_another_ensemble_is_replaced_and_says_so():
    class Odd:
        def wave_sizes(self, problem, budget):
            return [budget]

        def propose_wave(self, problem, wave, history, pending):
            found = Proposer(problem_of("sobol")).propose(wave, history, pending)
            return [dataclasses.replace(found[0], n_switches=7), *found[1:]]

    problem = problem_of(budget=5)
    (wave,) = plan(problem, Odd())
    first, *others = Proposer(problem, Odd()).propose(wave, [], [])
    assert (first.origin, first.n_switches) == (FALLBACK, 50)
    assert "7 switches for a wave of 50" in first.note
    assert {p.origin for p in others} == {SOBOL}
    short = Proposer(problem, Odd()).propose(dataclasses.replace(wave, size=4), [], [])
    assert len(short) == 4


# Successive halving.


def test_rounds_have_equal_shares_and_the_better_half_of_every_set_goes_on():
    ladder = build_ladder(1240, n_descents=8, generation=5, n_scouts=5, rounds=3, turns=2)
    spent = {r: sum(s.size for s in ladder.steps if s.round == r) for r in (-1, 0, 1, 2)}
    assert spent == {-1: 40, 0: 400, 1: 400, 2: 400}
    assert [{s.n_descents for s in ladder.steps if s.round == r} for r in (0, 1, 2)] == [{4}, {2}, {1}]
    rng = np.random.default_rng(1)
    g = rng.random(1240) + 20.0
    last = len(ladder.steps) - 1
    for turn in (0, 1):
        known, alive = courses(ladder, turn, max(k for k in (last, last - 1) if ladder.steps[k].turn == turn), g)
        assert set(known) == set(range(turn, 8, 2))
        half = sorted(known, key=lambda who: min(x.min() for x in (known[who].scouts, *known[who].told[:20])))
        assert alive[0] in half[:2]
        assert len(known[alive[0]].told) > max(len(known[who].told) for who in half[2:])


def test_who_goes_on_is_decided_by_visible_records_only():
    """A record that a wave cannot see, were it ever so good, does not change who shares it."""
    ladder = build_ladder(400, n_descents=4, generation=5, n_scouts=5, rounds=2, turns=2)
    number = next(k for k, s in enumerate(ladder.steps) if s.round == 1)
    step = ladder.steps[number]
    g = np.random.default_rng(2).random(400) + 20.0
    _, alive = courses(ladder, step.turn, number, g)
    unseen = g.copy()
    unseen[step.start :] = 0.0
    for k, other in enumerate(ladder.steps[:number]):
        if k > step.before:
            unseen[other.start : other.start + other.size] = 0.0
    assert courses(ladder, step.turn, number, unseen)[1] == alive
    loser = next(who for who in ladder.members(step.turn) if who not in alive)
    seen = next(k for k, s in enumerate(ladder.steps) if s.round == 0 and s.turn == step.turn)
    place = ladder.steps[seen].start + 5 * ladder.members(step.turn).index(loser)
    changed = g.copy()
    changed[place] = 0.0
    assert owner(ladder, place, g) == loser
    assert courses(ladder, step.turn, number, changed)[1] == [loser]


# Descents.


def test_a_descent_that_has_converged_begins_again_around_its_mean():
    run_ = Descent(problem_of().space, np.full(6, 0.5), 0.1, 8, np.random.default_rng(1))
    widths = []
    for _ in range(250):
        points = run_.points()
        assert np.abs(points - 0.3).max() < 0.7
        widths.append(points.std(axis=0).mean())
        run_.tell(15.0 + ((points - 0.3) ** 2).sum(axis=1))
    converged = int(np.argmin(widths))
    assert widths[converged] < 1e-5
    assert max(widths[converged:]) > 0.3 * AGAIN * 0.1


@pytest.mark.parametrize("turns", in_turn([1, 2, 3], 3, 2))
def test_exploring_is_a_pure_function_of_the_records_with_the_cache_dropped(turns):
    problem = exploring(turns)
    history, proposals = run(problem)
    assert not any(p.origin == FALLBACK for p in proposals)
    for wave in plan(problem)[1::3]:
        fresh = Proposer(Problem(problem.config))
        assert bits(fresh.from_history(wave, history[: wave.start])) == bits(proposals[wave.start : wave.stop])
    # A cache that was told something else is not believed.
    kept = Proposer(problem)
    wave = plan(problem)[-1]
    before = [o for o in history if o.wave < wave.index]
    other = [with_g(o, 40.0 - o.g_cm_s) for o in before]
    assert bits(kept.from_history(wave, other)) != bits(proposals[wave.start : wave.stop])
    assert bits(kept.from_history(wave, before)) == bits(proposals[wave.start : wave.stop])


@pytest.mark.parametrize("turns", in_turn([2, 3], 2))
def test_descents_do_not_see_the_wave_that_is_in_flight_beside_them(turns):
    problem = exploring(turns)
    history, proposals = run(problem)
    for wave in [w for w in plan(problem) if w.stage == "explore"][turns::2]:
        assert wave.sees == wave.index - turns + 1
        changed = [with_g(o, -1.0) if o.wave >= wave.sees else o for o in history]
        again = Proposer(Problem(problem.config)).from_history(wave, changed[: wave.start])
        assert bits(again) == bits(proposals[wave.start : wave.stop])


def test_descents_begin_at_the_best_of_the_search_and_of_their_own_scouts():
    problem = exploring(turns=1, sigma=0.01)
    history, _ = run(problem)
    scouts = [o for o in history if o.origin == SCOUT]
    assert len(scouts) == 18  # of three descents: the first goes on from the search
    steps = [o for o in history if o.origin == EXPLORE][:24]

    def at(o):
        return problem.space.unit(o.waveform, clip=True)

    starts = [min(history[:8], key=lambda o: o.g_cm_s)]
    starts += [min(scouts[k : k + 6], key=lambda o: o.g_cm_s) for k in (0, 6, 12)]
    for who, start in enumerate(starts):
        assert max(np.abs(at(o) - np.clip(at(start), 0.01, 0.99)).max() for o in steps[6 * who : 6 * who + 6]) < 0.06


def test_without_a_search_every_descent_has_scouts():
    problem = exploring(budget=0)
    history, _ = run(problem)
    assert sum(o.origin == SCOUT for o in history) == 24
    assert explore_ladder(problem).goes_on is False


def test_failed_candidates_and_fallbacks_teach_a_descent_nothing():
    problem = exploring()
    history, proposals = run(problem, failing=set(range(8, 60, 3)))
    assert not any(p.origin == FALLBACK for p in proposals)
    wave = next(w for w in plan(problem) if w.stage == "explore" and w.start > 80)
    replaced = [dataclasses.replace(o, origin=FALLBACK) if o.index == 40 else o for o in history[: wave.start]]
    lost = [dataclasses.replace(o, failed=True) if o.index == 40 else o for o in history[: wave.start]]
    proposer = Proposer(problem)
    assert bits(proposer.from_history(wave, replaced)) == bits(proposer.from_history(wave, lost))


def test_descents_find_the_bottom_of_a_bowl():
    history, _ = run(exploring(budget=0, n_descents=2, turns=1, generation=10, n_scouts=10))
    assert min(o.g_cm_s for o in history) < 15.1 < min(o.g_cm_s for o in history if o.origin == SCOUT)


@pytest.mark.parametrize("space", ["two-pulse-full", "three-pulse-full"])
def test_every_fourth_descent_begins_slowly_where_the_last_pulse_holds(space):
    problem = problem_of("sobol", waveform={"space": space})
    horizon = problem.config.model.horizon_us
    for attempt, slow in ((0, False), (1, False), (2, False), (3, True), (7, True)):
        waveforms = problem.space.waveforms([design_point(problem, k, "scout", attempt) for k in range(40)])
        assert all((w.pulses[-1].rise_us > 0.69 * horizon) is slow for w in waveforms)
    paper = problem_of("paper")
    assert all(w.pulses[0].rise_us == 4.0 for w in paper.space.waveforms([design_point(paper, 0, "scout", 3)]))


def test_a_descent_in_the_tail_of_an_axis_searches_the_tail():
    """A rise over the horizon lies in the last fiftieth of its axis: steps of the core's width would all leave it."""
    space = problem_of("sobol").space
    start = np.full(space.dim, 0.5)
    rise = space.names.index("rise2")
    start[rise] = 0.99
    points = Descent(space, start, 0.12, 40, np.random.default_rng(1)).points()
    assert points[:, rise].min() > 0.98
    assert points[:, rise].std() > 0.0005
    assert points[:, 0].std() > 0.05


# The finishing stage.


@pytest.mark.parametrize("method", ["surrogate", "cmaes", "nelder-mead"])
def test_the_finish_evaluates_distinct_basins_again_then_improves_on_them(method):
    problem = problem_of("sobol", 16, finish={"budget": 40, "method": method, "sigma": 0.1})
    history, proposals = run(problem)
    finish = history[16:]
    assert [o.origin for o in finish[:3]] == [RERANK] * 3
    assert {o.origin for o in finish[3:]} == {POLISH}
    search = {o.waveform.rows().tobytes() for o in history[:16]}
    assert all(o.waveform.rows().tobytes() in search for o in finish[:3])
    assert min(o.g_cm_s for o in finish[3:]) < min(o.g_cm_s for o in finish[:3])
    for wave in plan(problem)[-3:]:
        again = Proposer(Problem(problem.config)).from_history(wave, history[: wave.start])
        assert bits(again) == bits(proposals[wave.start : wave.stop])


def test_basins_that_the_search_does_not_have_are_made_up_beside_the_best():
    problem = problem_of("sobol", 4, finish={"budget": 8, "n_basins": 8})
    history, _ = run(problem)
    assert [o.origin for o in history[4:]] == [RERANK] * 4 + [EXTRA] * 4


def test_a_single_basin_is_polished_twice_where_two_were_asked_for():
    problem = problem_of("sobol", 1, finish={"budget": 27, "n_basins": 3, "n_polished": 2})
    history, _ = run(problem)
    assert [o.origin for o in history[1:]] == [RERANK] + [EXTRA] * 2 + [POLISH] * 24


def test_where_nothing_is_usable_the_finish_says_so():
    problem = problem_of("sobol", 4, finish={"budget": 12})
    _, proposals = run(problem, failing=set(range(16)))
    assert {p.origin for p in proposals[4:]} == {EXTRA}
    assert "no usable candidate" in proposals[-1].note


def test_a_polish_goes_on_with_the_shape_that_its_descent_has_learnt():
    """A descent along a narrow valley is polished along the valley; begun afresh it would step across it."""
    problem = problem_of(
        "sobol",
        0,
        explore={"budget": 620, "n_descents": 1, "turns": 1, "generation": 10, "n_scouts": 10},
        finish={"budget": 13, "n_polished": 1, "sigma": 0.05},
    )
    axis = np.ones(problem.space.dim) / np.sqrt(problem.space.dim)

    def valley(o):
        away = problem.space.unit(o.waveform, clip=True) - 0.4
        along = float(away @ axis)
        across = float(((away - along * axis) ** 2).sum())
        return with_g(o, 15.0 + 10.0 * along**2 + 3000.0 * across)

    proposer, history = Proposer(problem), []
    for wave in plan(problem):
        new = proposer.from_history(wave, history)
        history += [valley(observe(problem, wave, wave.start + k, p)) for k, p in enumerate(new)]
    polish = np.array([problem.space.unit(o.waveform, clip=True) for o in history if o.origin == POLISH])
    steps = polish - polish.mean(axis=0)
    along = (steps @ axis).std()
    across = np.sqrt(((steps - np.outer(steps @ axis, axis)) ** 2).sum(axis=1).mean() / (problem.space.dim - 1))
    assert along > 3.0 * across


# What a configuration may ask for.


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("explore.generation=3", "explore.generation is 3"),
        ("explore.sigma=0.7", "explore.sigma is 0.7"),
        ("explore.turns=0", "explore.turns is 0"),
        ("campaign.budget=0", "campaign.budget and explore.budget are both 0"),
        ("optimiser.batch=0", "optimiser.batch is 0"),
        ("finish.explore=3000", "unknown key finish.explore; did you mean"),
        ("explore.n_scouts=200", "a wave of 12800 candidates; at most 4096"),
    ],
)
def test_what_no_wave_can_be_made_of_is_refused_by_name(override, message):
    settings_ = ["explore.n_descents=64", "explore.turns=1"] if "n_scouts" in override else []
    with pytest.raises(ConfigError, match=message):
        load_config({}, [*settings_, override])
