"""Claims about engines: pure functions of the history, admissible, unharmed by failures and by candidates in flight."""

from __future__ import annotations

import dataclasses
import itertools
import math
import random
import sys

import numpy as np
import pytest

from softclose import plugins
from softclose.config import load_config
from softclose.propose import replay as cmaes_replay
from softclose.propose.finish import shares
from softclose.propose.protocol import EngineError, Observation, Problem, Proposal, load_engine

SPACE_OF = {"paper": "two-pulse-paper"}
ENGINES = ("sobol", "skopt", "cmaes", "direct", "paper")


def problem_of(engine="skopt", budget=24, finish=0, **optimiser):
    return Problem(
        load_config(
            {
                "campaign": {"seed": 5, "budget": budget},
                "population": {"n_switches": 50},
                "waveform": {"space": SPACE_OF.get(engine, "two-pulse-full")},
                "optimiser": {"engine": engine, "n_initial": 8, "n_candidates": 128} | optimiser,
                "finish": {"budget": finish, "n_switches": 100, "n_basins": 3},
            }
        )
    )


def observe(problem, i, proposal, *, failed=False):
    """A smooth stand-in for the simulation: a bowl around 0.4 in the cube, in cm/s."""
    w = proposal.waveform
    try:
        x = problem.space.unit(w, clip=True)
        g = 15.0 + 60.0 * float(((x - 0.4) ** 2).mean())
    except ValueError:
        g = 85.0
    g = math.nan if failed else g
    return Observation(
        index=i,
        waveform=w,
        origin=proposal.origin,
        n_switches=proposal.n_switches,
        g_cm_s=g,
        g_se_cm_s=0.5,
        v_u_cm_s=g,
        mean_cm_s=g,
        p_nc=0.0,
        p_contact=min(1.0, w.pulses[0].peak_us / 10.0),
        failed=failed,
    )


def run(problem, engine, *, failing=(), lag=1):
    search, finish = load_engine(engine), load_engine("finish")
    history, proposals = [], []
    for i in range(problem.config.total_budget):
        seen = history[: max(i - lag + 1, 0)]
        pending = [o.waveform for o in history[len(seen) :]]
        who = search if i < problem.config.campaign.budget else finish
        proposal = who.propose(problem, i, seen, pending)
        proposal.waveform.check(150.0, 250.0)
        proposals.append(proposal)
        history.append(observe(problem, i, proposal, failed=i in failing))
    return history, proposals


@pytest.mark.parametrize("engine", ENGINES)
def test_a_proposal_is_a_pure_function_of_the_history(engine):
    problem = problem_of(engine, budget=50 if engine == "paper" else 24)
    history, proposals = run(problem, engine)
    for i in (0, 7, 8, 17, len(history) - 1):
        random.seed(i)
        np.random.seed(i)  # noqa: NPY002 - whatever state a library's global generator is in
        fresh = problem_of(engine, budget=problem.config.campaign.budget)
        again = load_engine(engine).propose(fresh, i, history[:i], ())
        assert again.waveform.rows().tobytes() == proposals[i].waveform.rows().tobytes()
        assert again == proposals[i]


@pytest.mark.parametrize("engine", ENGINES)
def test_proposing_leaves_the_global_generator_alone(engine):
    problem = problem_of(engine, budget=12)
    np.random.seed(1)  # noqa: NPY002
    before = np.random.get_state()[1].copy()  # noqa: NPY002
    run(problem, engine)
    assert (np.random.get_state()[1] == before).all()  # noqa: NPY002


@pytest.mark.parametrize("engine", ["skopt", "cmaes", "direct"])
def test_failed_candidates_poison_nothing(engine):
    _, proposals = run(problem_of(engine, budget=30), engine, failing={3, 9, 10, 11, 20})
    assert len({p.waveform.rows().tobytes() for p in proposals}) == len(proposals)
    assert not any(p.origin == "fallback" for p in proposals)


def test_skopt_survives_a_history_of_failures_only():
    _, proposals = run(problem_of(budget=14), "skopt", failing=set(range(14)))
    assert proposals[-1].origin == "fallback"
    assert "usable" in proposals[-1].note


@pytest.mark.parametrize("engine", ["skopt", "cmaes", "direct"])
def test_candidates_in_flight_are_not_proposed_twice(engine):
    _, proposals = run(problem_of(engine, budget=24), engine, lag=4)
    assert len({p.waveform.rows().tobytes() for p in proposals}) == len(proposals)


def test_skopt_finds_the_bottom_of_a_bowl_that_sobol_only_surrounds():
    best = {e: min(o.g_cm_s for o in run(problem_of(e, budget=40), e)[0]) for e in ("skopt", "sobol")}
    assert best["skopt"] < 15.05 < best["sobol"]


def test_skopt_reports_what_its_surrogate_believed():
    _, proposals = run(problem_of(budget=12), "skopt")
    beliefs = proposals[-1].surrogate
    assert {"noise", "amplitude", "trust_region_length", "length_scale_delay2"} <= set(beliefs)
    assert all(math.isfinite(v) for v in beliefs.values())


def test_waveforms_of_another_form_in_the_history_are_passed_over():
    problem = problem_of(budget=12)
    history, _ = run(problem, "skopt")
    from softclose.waveform import Pulse, Waveform

    other = observe(problem, 0, Proposal(waveform=Waveform([Pulse(0, 0, math.inf, 100)]), origin="x", n_switches=50))
    load_engine("skopt").propose(problem, 12, [other, *history[1:]], ())


@pytest.mark.parametrize("method", ["surrogate", "cmaes", "nelder-mead"])
def test_the_finish_evaluates_distinct_basins_again_then_improves_on_them(method):
    problem = problem_of("sobol", budget=16, finish=30)
    problem = Problem(load_config(problem.config.to_dict(), [f"finish.method={method}", "finish.sigma=0.1"]))
    history, proposals = run(problem, "sobol")
    finish = history[16:]
    assert [o.origin for o in finish[:3]] == ["finish-rerank"] * 3
    assert all(o.n_switches == 100 for o in finish)
    search = {o.waveform.rows().tobytes() for o in history[:16]}
    assert all(o.waveform.rows().tobytes() in search for o in finish[:3])
    assert min(o.g_cm_s for o in finish[3:]) < min(o.g_cm_s for o in finish[:3])
    again = load_engine("finish").propose(problem, 30, history[:30], ())
    assert again == proposals[30]


def test_the_paper_engine_widens_pulse_1_then_walks_its_grid():
    _, proposals = run(problem_of("paper", budget=50), "paper")
    assert [p.origin for p in proposals[:8]] == ["paper-widen"] * 8
    assert [p.origin for p in proposals[8:44]] == ["paper-grid"] * 36
    assert proposals[44].origin == "paper-simplex"
    assert all(len(p.waveform.pulses) == 1 for p in proposals[:8])
    assert proposals[7].waveform.pulses[0].peak_us == pytest.approx(0.5, abs=0.2)  # 5 % touch at 0.5 µs in the stand-in


def test_the_paper_engine_refuses_other_spaces():
    problem = Problem(load_config({"waveform": {"space": "two-pulse-full"}, "optimiser": {"engine": "paper"}}))
    with pytest.raises(EngineError, match="two-pulse-paper only"):
        load_engine("paper").propose(problem, 0, [], ())


def test_an_unknown_engine_names_the_nearest():
    with pytest.raises(EngineError, match="did you mean 'cmaes'"):
        load_engine("cmae")
    assert "finish" not in plugins.ENGINES.names()


def test_botorch_is_optional_and_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "botorch", None)
    with pytest.raises(EngineError, match=r"softclose\[botorch\]"):
        load_engine("botorch")


def test_descents_share_the_candidates_and_the_better_half_goes_on() -> None:
    table = shares(600, 8)
    assert [(s.begin, s.end) for s in table[:2]] == [(0, 25), (25, 50)]
    assert [len([s for s in table if s.round_begin == begin]) for begin in (0, 200, 400)] == [8, 4, 2]
    assert table[-1].end == 600
    assert all(a.end == b.begin for a, b in itertools.pairwise(table))


@pytest.mark.parametrize("lag", [1, 3])
def test_descents_continued_from_the_cache_propose_what_a_replay_from_the_start_proposes(lag, monkeypatch):
    def campaign():
        problem = Problem(
            load_config(
                {
                    "campaign": {"seed": 5, "budget": 2, "lag": lag},
                    "population": {"n_switches": 50},
                    "optimiser": {"engine": "sobol"},
                    "finish": {"budget": 260, "explore": 260, "n_descents": 2},
                }
            )
        )
        return [p.waveform for p in run(problem, "sobol", lag=lag)[1]]

    with_cache = campaign()
    cmaes_replay._descents.clear()
    monkeypatch.setattr(cmaes_replay, "_MOST_DESCENTS", 0)
    assert campaign() == with_cache


@pytest.mark.parametrize("lag", [1, 3])
def test_the_first_descent_goes_on_from_the_best_that_its_first_candidate_sees(lag: int) -> None:
    """The newest records that a later candidate sees besides must not move the start of a descent under way."""
    problem = Problem(
        load_config(
            {
                "campaign": {"seed": 5, "budget": 20, "lag": lag},
                "population": {"n_switches": 50},
                "optimiser": {"engine": "sobol"},
                "finish": {"budget": 40, "explore": 40, "n_descents": 1},
            }
        )
    )
    history, proposals = run(problem, "sobol", lag=lag)
    best = min(history[: 20 - lag + 1], key=lambda o: o.g_cm_s)
    start = problem.space.unit(best.waveform)
    first = np.array([problem.space.unit(p.waveform, clip=True) for p in proposals[20:26]])
    assert np.median(np.abs(first - start)) < 0.12
    changed = [dataclasses.replace(o, g_cm_s=-1.0) if 20 - lag + 1 <= o.index < 20 else o for o in history[: 31 - lag]]
    pending = [o.waveform for o in history[31 - lag : 30]]
    again = load_engine("finish").propose(problem, 30, changed, pending)
    assert again.waveform == proposals[30].waveform
