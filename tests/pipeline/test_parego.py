"""Claims about the ParEGO engine: weightings that reach a whole front, no state beside the records."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from bowl import proposed
from softclose.metrics.ranking import BEYOND_CM_S
from softclose.propose.parego import AUGMENTED, SLICES, scaled_values, tchebycheff, weights
from softclose.propose.plan import plan
from softclose.propose.proposer import Proposer
from softclose.propose.protocol import Observation, Problem
from softclose.settings import load_config


def problem_of(budget: int, **optimiser: Any) -> Problem:
    return Problem(
        load_config(
            {
                "campaign": {"budget": budget, "seed": 4},
                "population": {"n_switches": 50},
                "waveform": {"space": "two-pulse-full"},
                "optimiser": {"engine": "parego", "n_initial": 12, "batch": 4, "n_candidates": 128} | optimiser,
            }
        )
    )


def observed(index: int, wave: int, p: Any, v_u: float, p_nc: float, *, failed: bool = False) -> Observation:
    g = math.nan if failed else v_u + 25.0 * p_nc
    return proposed(index, wave, p, g, v_u=v_u, p_nc=p_nc, failed=failed)


def run(problem: Problem, *, failing: frozenset[int] = frozenset()) -> list[Observation]:
    """Two bowls, one for each objective: the front lies between their middles."""
    proposer, history = Proposer(problem), list[Observation]()
    for wave in plan(problem):
        for i, p in enumerate(proposer.from_history(wave, history), start=wave.start):
            x = problem.space.unit(p.waveform, clip=True)
            v_u, p_nc = (float(a + b * ((x - c) ** 2).mean()) for a, b, c in ((15, 60, 0.35), (0, 1, 0.55)))
            history.append(observed(i, wave.index, p, v_u, p_nc, failed=i in failing))
    return history


def test_the_front_is_reached_along_its_whole_length() -> None:
    history = run(problem_of(80), failing=frozenset({3, 20}))
    found = np.array([(o.v_u_cm_s, o.p_nc) for o in history if o.usable])
    assert {o.origin for o in history} == {"sobol", "parego"}
    # On the front both coordinates of every axis lie between the middles: v_u from 15 to 17.4, p_nc from 0.04 to 0.
    for part in (0.15, 0.5, 0.85):
        at = np.array([15.0 + 60.0 * (0.2 * part) ** 2, (0.2 * (1.0 - part)) ** 2])
        nearest = np.abs((found - at) / [2.4, 0.04]).max(axis=1).min()
        designed = np.abs((found[:12] - at) / [2.4, 0.04]).max(axis=1).min()
        assert nearest < 0.35 < designed


def test_proposals_are_a_function_of_the_records_alone() -> None:
    problem = problem_of(32)
    history = run(problem)
    for wave in plan(problem)[1::2]:
        again = Proposer(problem_of(32)).from_history(wave, history)
        assert [p.waveform for p in again] == [o.waveform for o in history[wave.start : wave.stop]]


@pytest.mark.parametrize("k", [2, 3])
def test_weights_add_up_to_one_and_differ(k: int) -> None:
    draw = np.random.default_rng(1)
    found = np.array([weights(k, number, draw) for number in range(SLICES)])
    np.testing.assert_allclose(found.sum(axis=1), 1.0)
    assert (found > 0.0).all()
    assert len({tuple(w) for w in found}) == SLICES
    assert found[:, 0].min() < 0.2 < 0.6 < found[:, 0].max()


def test_the_norm_prefers_what_dominates() -> None:
    values = np.array([[0.2, 0.5], [0.2, 0.6], [0.9, 0.1]])
    for number in range(SLICES):
        norm = tchebycheff(values, weights(2, number, np.random.default_rng(1)))
        assert norm[0] < norm[1]
    assert np.argmin(tchebycheff(values, np.array([0.05, 0.95]))) == 2
    assert tchebycheff(np.array([[1.0, 1.0]]), np.array([0.5, 0.5]))[0] == pytest.approx(0.5 + AUGMENTED)


def test_what_is_undefined_or_leaves_too_many_open_is_worst_in_every_objective() -> None:
    problem = problem_of(32)
    history = run(problem_of(12))
    changed = [
        replace(history[0], v_u_cm_s=math.nan),
        replace(history[1], rank_cm_s=BEYOND_CM_S + 0.5),
        *history[2:],
    ]
    values = scaled_values(problem, changed)
    assert values[0, 0] > values[2:, 0].max()
    assert (values[1] > np.delete(values, 1, axis=0).max(axis=0)).all()
    assert values.min() == 0.0


def test_the_design_comes_first_and_batches_share_the_rest() -> None:
    from softclose.propose.parego import ParegoEngine

    engine, problem = ParegoEngine(), problem_of(31)
    assert engine.wave_sizes(problem, 31) == [12, 4, 4, 4, 4, 3]
    assert engine.wave_sizes(problem, 12) == [12]
    assert engine.wave_sizes(problem, 5) == [5]


def test_values_are_0_at_the_least_1_at_the_median_and_grow_as_a_logarithm_beyond() -> None:
    speeds = [20.0, 12.0, 16.0, 26.0, 14.0]
    proposals = list(Proposer(problem_of(32)).from_history(plan(problem_of(32))[0], []))[:5]
    records = [observed(i, 0, p, v_u, v_u / 100) for i, (v_u, p) in enumerate(zip(speeds, proposals, strict=True))]
    values = scaled_values(problem_of(32), records)
    np.testing.assert_allclose(values[:, 0], np.log2(1.0 + (np.array(speeds) - 12.0) / 4.0))
    np.testing.assert_allclose(values[:, 1], values[:, 0])
    alike = scaled_values(problem_of(32), [replace(o, v_u_cm_s=20.0) for o in records])
    np.testing.assert_array_equal(alike[:, 0], 0.0, err_msg="where all are alike none is better")


def test_each_candidate_has_a_weighting_of_its_own_and_all_of_them_come_in_turn() -> None:
    draw = np.random.default_rng(1)
    first = [float(weights(2, number, draw)[0]) for number in range(2 * SLICES)]
    assert first[:SLICES] == first[SLICES:]
    np.testing.assert_allclose(sorted(first[:SLICES]), (np.arange(SLICES) + 0.5) / SLICES)
    assert np.abs(np.diff(first)).min() > 0.3, "neighbours look at other parts of the front"
    drawn = np.array([weights(3, 0, draw) for _ in range(400)])
    np.testing.assert_allclose(drawn.mean(axis=0), 1.0 / 3.0, atol=0.04)


def test_fewer_than_two_usable_candidates_tell_no_process_anything() -> None:
    problem = problem_of(32)
    history = run(problem_of(12), failing=frozenset(range(1, 12)))
    found = Proposer(problem).from_history(plan(problem)[1], history)
    assert {p.origin for p in found} == {"fallback"}
    assert {p.note for p in found} == {"fewer than two usable candidates"}
    assert len({p.waveform for p in found}) == 4


def test_a_process_that_fails_is_said_and_the_best_by_the_weighting_is_stepped_away_from(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from softclose.propose import skopt_engine

    def fails(*_: object) -> None:
        raise np.linalg.LinAlgError("not positive " + 300 * "!")

    problem = problem_of(32)
    history = run(problem_of(12))
    monkeypatch.setattr(skopt_engine, "acquire", fails)
    found = Proposer(problem).from_history(plan(problem)[1], history)
    assert {p.origin for p in found} == {"fallback"}
    assert found[0].note.startswith("surrogate failed (LinAlgError: not positive")
    assert len(found[0].note) == 200
    points = np.array([problem.space.unit(o.waveform, clip=True) for o in history])
    values = scaled_values(problem, history)
    for number, p in enumerate(found, start=12):
        best = points[np.argmin(tchebycheff(values, weights(2, number, np.random.default_rng(1))))]
        away = problem.space.unit(p.waveform, clip=True) - best
        assert 0.0 < np.sqrt((away**2).mean()) < 0.12


def test_boxes_of_three_widths_are_searched_in_turn_around_the_best_by_the_weighting(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from softclose.propose import skopt_engine

    seen: list[tuple[float, int, int, int, int]] = []

    def watched(problem: Problem, data: Any, region: Any, flying: Any, n: int, draw: Any) -> Any:
        seen.append((region.length, len(flying), n, region.incumbent, int(np.argmin(data.g))))
        return draw.random((n, problem.space.dim)), None

    monkeypatch.setattr(skopt_engine, "acquire", watched)
    run(problem_of(72))
    lengths = [length for length, *_ in seen]
    assert lengths == [0.05] * 4 + [0.2] * 16 + [0.8] * 16 + [0.05] * 16 + [0.2] * 8
    assert [flying for _, flying, *_ in seen] == [0, 1, 2, 3] * 15, "each sees those that were proposed before it"
    assert {n for _, _, n, *_ in seen} == {1}
    assert all(incumbent == best for *_, incumbent, best in seen)
