"""Claims about engines: pure functions of the history, admissible, unharmed by failures and by candidates in flight."""

from __future__ import annotations

import math
import random
import sys

import numpy as np
import pytest

from bowl import bits, observe, problem_of, run, with_g
from examples import in_turn
from softclose import plugins
from softclose.propose.origins import FALLBACK, LOCAL, ORIGINS
from softclose.propose.plan import plan
from softclose.propose.proposer import Proposer
from softclose.propose.protocol import EngineError, Problem, Proposal, load_engine, seen_by
from softclose.settings import load_config

ENGINES = ("sobol", "skopt", "cmaes", "direct", "paper")


@pytest.mark.parametrize("lag", in_turn([1, 2], 2, 1))
@pytest.mark.parametrize("engine", ENGINES)
def test_a_wave_is_a_pure_function_of_the_history(engine, lag):
    budget = 50 if engine == "paper" else 24
    problem = problem_of(engine, budget, campaign={"lag": lag})
    history, proposals = run(problem)
    assert not any(p.origin == FALLBACK for p in proposals)
    for wave in plan(problem)[:: 7 if engine == "paper" else 2]:
        random.seed(wave.index)
        np.random.seed(wave.index)  # noqa: NPY002 - whatever state a library's global generator is in
        again = Proposer(Problem(problem.config)).from_history(wave, history[: wave.start])
        assert bits(again) == bits(proposals[wave.start : wave.stop])
        assert list(again) == proposals[wave.start : wave.stop]


@pytest.mark.parametrize("engine", ENGINES)
def test_a_wave_does_not_see_what_is_newer_than_its_lag(engine):
    """Whatever the answers of the waves in flight are, and whether they have come in."""
    problem = problem_of(engine, 50 if engine == "paper" else 24, campaign={"lag": 3})
    history, proposals = run(problem)
    wave = plan(problem)[-1]
    assert wave.sees == max(wave.index - 2, 0)
    changed = [with_g(o, -1.0, p_contact=1.0) if o.wave >= wave.sees else o for o in history]
    again = Proposer(Problem(problem.config)).from_history(wave, changed[: wave.start])
    assert list(again) == proposals[wave.start : wave.stop]
    assert len(seen_by(wave, history)) < wave.start


@pytest.mark.parametrize("engine", ENGINES)
def test_proposing_leaves_the_global_generator_alone(engine):
    problem = problem_of(engine, 12)
    np.random.seed(1)  # noqa: NPY002
    before = np.random.get_state()[1].copy()  # noqa: NPY002
    run(problem)
    assert (np.random.get_state()[1] == before).all()  # noqa: NPY002


@pytest.mark.parametrize("engine", ["skopt", "cmaes", "direct"])
def test_failed_candidates_poison_nothing(engine):
    _, proposals = run(problem_of(engine, 30), failing={3, 9, 10, 11, 20})
    assert len(set(bits(proposals))) == len(proposals)
    assert not any(p.origin == FALLBACK for p in proposals)


def test_skopt_survives_a_history_of_failures_only():
    _, proposals = run(problem_of(budget=14), failing=set(range(14)))
    assert proposals[-1].origin == FALLBACK
    assert "usable" in proposals[-1].note


@pytest.mark.parametrize("engine", ["skopt", "cmaes", "direct"])
def test_candidates_in_flight_are_not_proposed_twice(engine):
    _, proposals = run(problem_of(engine, 24, campaign={"lag": 4}))
    assert len(set(bits(proposals))) == len(proposals)


def test_the_candidates_of_a_batch_know_of_each_other_and_of_those_in_flight():
    """Each is taken on trust by the next: without that, all of a batch would be the same point."""
    problem = problem_of(budget=24, batch=4, n_starts=1)
    history, proposals = run(problem)
    wave = plan(problem)[-1]
    points = np.array([problem.space.unit(p.waveform, clip=True) for p in proposals[wave.start : wave.stop]])
    apart = np.abs(points[:, None] - points[None]).max(axis=2)[np.triu_indices(4, 1)]
    assert apart.min() > 1e-3
    flying = [proposals[wave.start].waveform]
    beside = Proposer(Problem(problem.config)).propose(wave, history[: wave.start], flying)
    assert flying[0] not in [p.waveform for p in beside]


def test_skopt_finds_the_bottom_of_a_bowl_that_sobol_only_surrounds():
    best = {e: min(o.g_cm_s for o in run(problem_of(e, 60))[0]) for e in ("skopt", "sobol")}
    assert best["skopt"] < 15.05 < best["sobol"]


def test_skopt_reports_what_its_surrogate_believed():
    _, proposals = run(problem_of(budget=12))
    beliefs = proposals[-1].surrogate
    assert {"noise", "amplitude", "trust_region_length", "length_scale_delay2"} <= set(beliefs)
    assert all(math.isfinite(v) for v in beliefs.values())


def test_waveforms_of_another_form_in_the_history_are_passed_over():
    problem = problem_of(budget=12)
    history, _ = run(problem)
    from softclose.waveform import Pulse, Waveform

    wave = plan(problem)[-1]
    other = Proposal(waveform=Waveform([Pulse(0, 0, math.inf, 100)]), origin="x", n_switches=50)
    changed = [observe(problem, plan(problem)[0], 0, other), *history[1 : wave.start]]
    found = Proposer(problem).from_history(wave, changed)
    assert {p.origin for p in found} == {LOCAL}


def test_every_origin_that_is_written_is_listed():
    written = set()
    for engine in ENGINES:
        problem = problem_of(
            engine,
            70,
            explore={"budget": 48 if engine == "sobol" else 0},
            finish={"budget": 12},
            waveform={"initial": [[[0, 4, 3, 100], [20, 5, "hold", 80]]]} if engine == "sobol" else None,
            n_starts=1,
            length_min=0.3,
            failure_tolerance=1,
            improvement_cm_s=100.0,
            batch=1,
        )
        written |= {o.origin for o in run(problem)[0]}
    written |= {o.origin for o in run(problem_of(budget=10), failing=set(range(10)))[0]}
    few = {"model": "single-mode", "n_switches": 8, "n_exploring": 8, "budget": 24, "polish": 0, "looks": 12}
    written |= {o.origin for o in run(problem_of(budget=4, prior=few, n_regions=2))[0]}
    extended = problem_of("sobol", 8, explore={"budget": 48}, campaign={"extensions": [6, [3, 7]]})
    observed = run(extended)[0]
    assert [o.waveform for o in observed[-2:]] == [observed[i].waveform for i in (3, 7)]
    written |= {o.origin for o in observed}
    assert written <= set(ORIGINS)
    assert set(ORIGINS) - written <= {"botorch", "nsga2", "parego", "finish-extra", "by-hand"}


def test_the_paper_engine_widens_pulse_1_then_walks_its_grid():
    _, proposals = run(problem_of("paper", 50))
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
    with pytest.raises(EngineError, match="pip install botorch"):
        load_engine("botorch")


def test_an_extension_starts_from_the_best_on_the_largest_ensemble():
    """What a candidate promises on fewer switches is no place to start from, however good."""
    problem = problem_of("sobol", 8, explore={"budget": 24}, finish={"budget": 9}, campaign={"extensions": [6]})
    waves = plan(problem)
    extension = waves[-1]
    before = [o for o in run(problem)[0] if o.index < extension.start]
    most = max(o.n_switches for o in before)
    few = next(o for o in before if o.n_switches < most)
    assert min(o.n_switches for o in before) < most

    proposer = Proposer(problem)

    def proposed(g_cm_s):
        history = [with_g(o, g_cm_s) if o.index == few.index else o for o in before]
        return bits(proposer.from_history(extension, history))

    assert proposed(1.0) == proposed(80.0)
    best = min((o for o in before if o.n_switches == most), key=lambda o: o.g_cm_s)
    middle = np.mean([problem.space.unit(p.waveform, clip=True) for p in proposer.from_history(extension, before)], 0)
    apart = [np.linalg.norm(middle - problem.space.unit(o.waveform, clip=True)) for o in (best, few)]
    assert apart[0] < apart[1]


def test_an_extension_begins_around_the_best_and_goes_on_from_what_it_found():
    problem = problem_of("sobol", 8, explore={"budget": 24}, finish={"budget": 9}, campaign={"extensions": [12]})
    first, second = plan(problem)[-2:]
    whole = run(problem)[0]
    before = [o for o in whole if o.index < first.start]
    most = max(o.n_switches for o in before)
    largest = [o for o in before if o.n_switches == most]
    proposer = Proposer(problem)

    def middle(history):
        return np.mean([problem.space.unit(p.waveform, clip=True) for p in proposer.from_history(first, history)], 0)

    far = max(largest, key=lambda o: np.linalg.norm(problem.space.unit(o.waveform, clip=True) - 0.5))
    best = [with_g(o, 0.1) if o is far else o for o in before]
    assert np.linalg.norm(middle(best) - problem.space.unit(far.waveform, clip=True)) < 0.2
    none = [with_g(o, math.nan, failed=True) for o in before]
    assert np.linalg.norm(middle(none) - 0.5) < 0.2, "around the middle of the cube where nothing is known"
    seen = [o for o in whole if o.index < second.start]
    other = [with_g(o, 90.0 - o.g_cm_s) if o.index >= first.start else o for o in seen]
    assert bits(proposer.from_history(second, seen)) != bits(proposer.from_history(second, other))
