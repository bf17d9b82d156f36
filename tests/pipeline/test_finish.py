"""Claims about the finishing stage, against a smooth stand-in for the simulation: whom it polishes, from where, how."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.optimize import minimize

from bowl import observe, problem_of, with_g
from examples import in_turn
from softclose.propose.origins import EXTRA, POLISH, RERANK
from softclose.propose.plan import plan
from softclose.propose.proposer import Proposer

NELDER_MEAD = {"budget": 60, "method": "nelder-mead", "sigma": 0.1}


def walked(problem, g, *, polished=10_000):
    """The records of a campaign whose search says what the bowl says and whose finishing stage g(unit point, i)."""
    proposer, history = Proposer(problem), []
    for wave in plan(problem):
        for k, proposal in enumerate(proposer.from_history(wave, history)):
            o = observe(problem, wave, wave.start + k, proposal)
            if wave.stage == "finish":
                o = with_g(o, g(problem.space.unit(o.waveform, clip=True), o.index))
            history.append(o)
        if sum(o.origin == POLISH for o in history) >= polished:
            break
    return history


def polished(problem, history):
    return np.array([problem.space.unit(o.waveform, clip=True) for o in history if o.origin == POLISH])


def bowl(x, _):
    return 15.0 + 60.0 * float(((x - 0.4) ** 2).mean())


def test_nelder_mead_is_scipy_s_from_the_best_basin_as_the_larger_ensemble_ranks_them():
    problem = problem_of("sobol", 16, finish=NELDER_MEAD)
    history = walked(problem, bowl)
    ranked = sorted((o for o in history if o.origin == RERANK), key=lambda o: o.g_cm_s)
    start = problem.space.unit(ranked[0].waveform, clip=True)
    d = len(start)
    simplex = np.vstack([start, *(start + (0.1 if start[i] + 0.1 < 1.0 else -0.1) * np.eye(d)[i] for i in range(d))])
    asked = []

    def g(x):
        asked.append(x.copy())
        return bowl(problem.space.unit(problem.space.waveform(x), clip=True), 0)

    options = {"initial_simplex": simplex, "adaptive": True, "xatol": 1e-4, "fatol": 1e-4, "maxfev": 57}
    minimize(g, start, method="Nelder-Mead", bounds=[(0.0, 1.0)] * d, options=options)
    np.testing.assert_allclose(polished(problem, history)[:50], asked[1:51], atol=1e-9)


def test_a_simplex_at_the_edge_of_the_cube_turns_inwards():
    """Where the best basin is within a step of an upper bound its corner there is a step inside: a full simplex."""
    problem = problem_of("sobol", 16, finish=NELDER_MEAD | {"budget": 12})

    def far(x, i):
        return 15.0 + 60.0 * float(((x - 0.97) ** 2).mean())

    proposer, history = Proposer(problem), []
    for wave in plan(problem):
        for k, proposal in enumerate(proposer.from_history(wave, history)):
            if wave.start + k == 3:
                proposal = dataclasses.replace(proposal, waveform=problem.space.waveform(np.full(6, 0.97)))
            o = observe(problem, wave, wave.start + k, proposal)
            history.append(with_g(o, far(problem.space.unit(o.waveform, clip=True), o.index)))
    start = problem.space.unit(history[3].waveform, clip=True)
    steps = polished(problem, history)[: len(start)] - start
    turned = start + 0.1 >= 1.0
    assert turned.sum() >= 3
    for i in np.flatnonzero(turned):
        assert -0.2 < steps[:, i].min() < -0.05


def test_where_a_simplex_has_come_to_an_end_the_next_basin_is_walked_from():
    """Every point of the walk says the same: the simplex ends once it is small, and the second best begins."""
    problem = problem_of("sobol", 16, finish=NELDER_MEAD | {"budget": 200, "sigma": 0.002})
    history = walked(problem, lambda x, i: 15.0 + 1e-5 * (i - 16 if i < 19 else 3))
    points = polished(problem, history)
    ranked = sorted((o for o in history if o.origin == RERANK), key=lambda o: (o.g_cm_s, o.index))
    first, second = (problem.space.unit(o.waveform, clip=True) for o in ranked[:2])
    began = int(np.argmax(np.linalg.norm(points - second, axis=1) < 0.003))
    assert began > 20
    assert np.linalg.norm(points[began - 1] - first) < 1e-3


def test_a_small_simplex_that_still_improves_goes_on():
    """Differences of a hundredth of a cm/s between its corners are no reason to end."""
    problem = problem_of("sobol", 16, finish=NELDER_MEAD | {"budget": 120, "sigma": 0.002})
    history = walked(problem, bowl)
    ranked = sorted((o for o in history if o.origin == RERANK), key=lambda o: o.g_cm_s)
    others = np.array([problem.space.unit(o.waveform, clip=True) for o in ranked[1:]])
    points = polished(problem, history)
    assert np.linalg.norm(points[:, None] - others, axis=2).min() > 0.003


def test_points_that_fill_a_wave_lie_beside_the_best_basin():
    """Of the search where nothing is finished, of the finishing stage afterwards."""
    problem = problem_of("sobol", 6, finish={"budget": 12, "n_basins": 12, "sigma": 0.05})
    history = walked(problem, bowl)
    best = min(history[:6], key=lambda o: o.g_cm_s)
    made_up = np.array([problem.space.unit(o.waveform, clip=True) for o in history if o.origin == EXTRA])
    assert len(made_up) == 6
    distance = np.abs(made_up - problem.space.unit(best.waveform, clip=True))
    assert 0.005 < distance.mean() < 0.05


@pytest.mark.parametrize("best", in_turn([0, 1, 2], 3, 1))
def test_what_a_stuck_polish_is_given_lies_beside_the_best_finished_candidate(best):
    """All of one g: every simplex ends, and what is left of the budget is spent around the best of the stage."""
    problem = problem_of("sobol", 16, finish=NELDER_MEAD | {"budget": 420, "sigma": 0.002})
    history = walked(problem, lambda x, i: 15.0 - 1e-5 * (i == 16 + best))
    made_up = [o for o in history if o.origin == EXTRA]
    assert len(made_up) > 5
    centre = problem.space.unit(history[16 + best].waveform, clip=True)
    distance = np.array([problem.space.unit(o.waveform, clip=True) for o in made_up]) - centre
    assert 1e-5 < np.abs(distance).mean() < 0.002
    assert not any(o.waveform == made_up[0].waveform for o in made_up[1:])


def cmaes(n_polished=2, **explore):
    explore = {"budget": 200, "n_descents": 2, "turns": 1, "rounds": 1} | explore
    return problem_of(
        "sobol", 0, explore=explore, finish={"budget": 99, "n_basins": 3, "n_polished": n_polished, "sigma": 0.02}
    )


def test_one_descent_goes_on_once_and_what_else_it_found_begins_afresh():
    """Two basins that one descent found: polished by two runs, not twice by the same."""
    problem = cmaes(n_descents=1)
    history = walked(problem, bowl)
    points = polished(problem, history)
    generation = problem.config.explore.generation
    first, second = points[:generation], points[generation : 2 * generation]
    assert not np.isclose(first.mean(axis=0), second.mean(axis=0), atol=1e-3).all()
    assert len(np.unique(points.round(9), axis=0)) == len(points)


def test_the_better_half_of_the_polished_goes_on():
    """As the larger ensemble ranks the basins: the one it prefers gets the later generations."""
    problem, begin = cmaes(), 200
    for favourite in (0, 1, 2):
        centres = {}

        def g(x, i, favourite=favourite, centres=centres):
            if i < begin + 3:
                centres[i - begin] = x
                return 10.0 if i - begin == favourite else 30.0
            return 10.0 + 100.0 * float(((x - centres[favourite]) ** 2).mean())

        points = polished(problem, walked(problem, g))
        last = points[-problem.config.explore.generation :]
        distances = [float(np.linalg.norm(last.mean(axis=0) - centre)) for centre in centres.values()]
        assert int(np.argmin(distances)) == favourite
