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
    history = run(problem)[:12]
    changed = [
        replace(history[0], v_u_cm_s=math.nan),
        replace(history[1], rank_cm_s=BEYOND_CM_S + 0.5),
        *history[2:],
    ]
    values = scaled_values(problem, changed)
    assert values[0, 0] > values[2:, 0].max()
    assert (values[1] > np.delete(values, 1, axis=0).max(axis=0)).all()
    assert values.min() == 0.0
