"""Claims about the NSGA-II engine: a growing front, no state beside the records, an optional library."""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from softclose.evaluate import draw, respond
from softclose.metrics.pareto import hypervolume, pareto_front
from softclose.metrics.ranking import BEYOND_CM_S
from softclose.plugins import EngineError
from softclose.propose.objectives import front_values, worst_values
from softclose.propose.plan import plan
from softclose.propose.protocol import Observation, Problem, load_engine
from softclose.propose.side_by_side import evaluate, run_engine
from softclose.propose.sobol import initial_points
from softclose.settings import ConfigError, load_config

pytest.importorskip("pymoo")
N = 256


def _problem(budget: int, **settings: Any) -> Problem:
    return Problem(
        load_config(
            {
                "campaign": {"budget": budget, "seed": 4},
                "population": {"n_switches": N, "sampling": "monte-carlo"},
                "optimiser": {"engine": "nsga2"},
                **settings,
            }
        )
    )


def _run(problem: Problem, engine: str = "nsga2") -> list[Observation]:
    """A whole search on real switches, as a campaign does it; every fiftieth candidate has failed."""

    def evaluator(*arguments: Any) -> Observation:
        found = evaluate(*arguments)
        return replace(found, failed=found.index % 50 == 49)

    return run_engine(problem.config, engine, evaluator=evaluator)[0]


def _volume(problem: Problem, history: list[Observation]) -> float:
    objectives = problem.config.optimiser.objectives
    return hypervolume(front_values(problem.config, history, objectives), worst_values(problem.config, objectives))


@pytest.mark.slow
@pytest.mark.parametrize(
    "objectives",
    [
        ("v_u", "p_nc"),
        pytest.param(("v_u", "closing", "peak"), marks=pytest.mark.long),
        pytest.param(("v_u", "p_nc", "closing", "peak"), marks=pytest.mark.long),
    ],
)
def test_the_front_grows_beyond_that_of_as_many_random_points(objectives: tuple[str, ...]) -> None:
    anything = {"max_open": 1.0}
    problem = _problem(640, optimiser={"engine": "nsga2", "objectives": objectives}, objective=anything)
    history = _run(problem)
    assert {o.origin for o in history} == {"sobol", "nsga2"}
    parts = [_volume(problem, history[:k]) for k in (64, 192, 384, 640)]
    assert parts == sorted(parts)
    assert parts[-1] > 1.1 * parts[0]
    random = _run(_problem(640, optimiser={"engine": "sobol"}, objective=anything), "sobol")
    assert parts[-1] > 1.05 * _volume(problem, random)
    print(parts, _volume(problem, random))
    front = pareto_front(front_values(problem.config, history, objectives))  # type: ignore[arg-type]
    assert len(front) >= 5, "a front, not one point"


def test_objectives_are_what_they_are_called() -> None:
    problem = _problem(64)
    observed = _run(problem)[:20]
    switches = draw(problem.config, N, seed=4)
    values = front_values(problem.config, observed, ("closing", "peak", "p_nc", "v_u"))
    for o, (closing, peak, p_nc, v_u) in zip(observed, values, strict=True):
        settled = np.sort(respond(problem.config, switches, o.waveform).settling_us)
        assert closing == min(settled[int(np.ceil(0.9 * N)) - 1], 250.0)
        assert peak == pytest.approx(o.waveform.voltage(np.linspace(0.0, 250.0, 250_001)).max(), rel=1e-6)
        assert (p_nc, v_u) == (np.isinf(settled).mean(), pytest.approx(o.v_u_cm_s, nan_ok=True))
    assert np.isnan(front_values(problem.config, [replace(observed[0], failed=True)], ("p_nc", "peak"))).all()
    assert {o.closing_us for o in observed} != {np.inf}


@pytest.mark.parametrize("objectives", [["v_u"], ["v_u", "v_u"], ["v_u", "speed"], [], [*"abcde"]])
def test_objectives_that_make_no_front_are_refused(objectives: list[str]) -> None:
    with pytest.raises(
        ConfigError, match=r"optimiser\.objectives.*v_u, p_nc, closing|no quantity; there are v_u, p_nc"
    ):
        _problem(64, optimiser={"engine": "nsga2", "objectives": objectives})


def test_a_generation_is_a_function_of_the_records() -> None:
    problem = _problem(192)
    history = _run(problem)
    last = plan(problem)[-1]
    seen = [o for o in history if o.wave < last.index]
    again = load_engine("nsga2").propose_wave(_problem(192), last, seen, ())  # type: ignore[union-attr]
    assert [p.waveform for p in again] == [o.waveform for o in history[last.start :]]
    np.random.seed(1)  # noqa: NPY002 - pymoo must not draw from it
    more = load_engine("nsga2").propose_wave(problem, last, seen, ())  # type: ignore[union-attr]
    assert more == again
    space = problem.space
    assert len(np.unique(np.round([space.unit(p.waveform, clip=True) for p in more], 9), axis=0)) == last.size


def test_other_objectives_have_other_offspring() -> None:
    problem = _problem(192)
    history, last = _run(problem), plan(problem)[-1]
    seen = [o for o in history if o.wave < last.index]
    engine = load_engine("nsga2")
    found = [
        [p.waveform for p in engine.propose_wave(_problem(192, optimiser=o), last, seen, ())]  # type: ignore[union-attr]
        for o in ({"engine": "nsga2"}, {"engine": "nsga2", "objectives": ["closing", "peak"]})
    ]
    assert found[0] != found[1]


def test_without_pymoo_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pymoo", None)
    with pytest.raises(EngineError, match="pip install pymoo"):
        load_engine("nsga2")


def test_failed_candidates_are_no_parents() -> None:
    """Few enough that all who may be parents are: those that failed make no difference."""
    problem = _problem(192)
    history, last = _run(problem), plan(problem)[-1]
    known = [replace(o, failed=o.index % 3 == 0) for o in history if o.wave < last.index][:90]
    assert sum(not o.failed for o in known) < 64
    engine = load_engine("nsga2")
    with_them = engine.propose_wave(problem, last, known, ())  # type: ignore[union-attr]
    without = engine.propose_wave(problem, last, [o for o in known if not o.failed], ())  # type: ignore[union-attr]
    assert [p.waveform for p in with_them] == [p.waveform for p in without]
    assert {p.origin for p in with_them} == {"nsga2"}


# What the library is handed.


def _records(problem: Problem, n: int, **changed: Any) -> list[Observation]:
    """Of n points of a search: v_u falls with the index, p_nc rises, so that none is better than another."""
    return [
        Observation(
            index=i, wave=0, waveform=w, origin="sobol", n_switches=N, g_cm_s=20.0, rank_cm_s=20.0, g_se_cm_s=0.1,
            v_u_cm_s=30.0 - 0.1 * i, mean_cm_s=10.0, p_nc=0.001 * i, p_contact=1.0, failed=False, **changed,
        )
        for i, w in enumerate(problem.space.waveforms(np.random.default_rng(3).random((n, problem.space.dim))))
    ]  # fmt: skip


def _handed(monkeypatch: pytest.MonkeyPatch, problem: Problem, records: list[Observation]) -> tuple[Any, list[Any]]:
    """The parents and the proposals of the wave behind some records."""
    from pymoo.core.mating import Mating

    seen: list[Any] = []
    mate = Mating.do

    def do(self: Any, cube: Any, parents: Any, *arguments: Any, **named: Any) -> Any:
        seen.append(parents)
        return mate(self, cube, parents, *arguments, **named)

    monkeypatch.setattr(Mating, "do", do)
    found = load_engine("nsga2").propose_wave(problem, plan(problem)[-1], records, ())  # type: ignore[union-attr]
    return seen[0], list(found)


def test_the_better_half_of_the_records_are_the_parents(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = _problem(192)
    records = _records(problem, 128)
    # Every other one is worse than its neighbour in everything.
    records = [replace(o, v_u_cm_s=o.v_u_cm_s + 20.0, p_nc=o.p_nc + 0.2) if o.index % 2 else o for o in records]
    parents, found = _handed(monkeypatch, problem, records)
    expected = np.array([[o.v_u_cm_s, o.p_nc] for o in records[::2]])
    np.testing.assert_array_equal(np.sort(parents.get("F"), axis=0), np.sort(expected, axis=0))
    points = {tuple(np.round(problem.space.coordinates_of_all([o.waveform])[0][0], 12)) for o in records[::2]}
    assert {tuple(np.round(x, 12)) for x in parents.get("X")} == points
    assert len(found) == 64
    assert {p.origin for p in found} == {"nsga2"}


def test_who_leaves_too_many_open_is_worse_in_everything_and_an_undefined_v_u_counts_as_in_g(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    problem = _problem(192)
    records = _records(problem, 40)
    records[3] = replace(records[3], v_u_cm_s=np.nan)
    records[5] = replace(records[5], rank_cm_s=BEYOND_CM_S + 7.0)
    records[8] = replace(records[8], rank_cm_s=BEYOND_CM_S + 9.0)
    parents, _ = _handed(monkeypatch, problem, records)
    f = parents.get("F")
    assert len(f) == 40
    undefined = worst_values(problem.config, ("v_u", "p_nc"))[0]
    highest = np.array([undefined, 0.039])
    far = f[(f > highest).all(axis=1)]
    np.testing.assert_allclose(np.sort(far, axis=0), [highest + 7.0, highest + 9.0])
    np.testing.assert_allclose(f[np.isclose(f[:, 1], 0.003)], [[undefined, 0.003]])


def test_half_a_generation_that_can_be_judged_is_enough_for_parents() -> None:
    problem, engine = _problem(192), load_engine("nsga2")
    for n, origin in ((31, "sobol"), (32, "nsga2")):
        found = engine.propose_wave(problem, plan(problem)[1], _records(problem, n), ())  # type: ignore[union-attr]
        assert {p.origin for p in found} == {origin}


def test_the_first_points_are_those_of_the_sobol_engine_behind_the_user_s_own() -> None:
    own = [[[0.0, 4.0, 5.0, 100.0], [20.0, 8.0, "hold", 80.0]]]
    settings: Any = {"waveform": {"initial": own}}
    problem, plain = _problem(192, **settings), _problem(192, optimiser={"engine": "sobol"})
    engine, waves = load_engine("nsga2"), plan(problem)
    assert [w.size for w in waves] == [65, 64, 63]
    first = replace(waves[0], start=1, size=64)
    found = engine.propose_wave(problem, first, (), ())  # type: ignore[union-attr]
    again = engine.propose_wave(problem, waves[1], (), ())  # type: ignore[union-attr]
    expected = plain.space.waveforms(initial_points(plain, 0, 128))
    assert [p.waveform for p in (*found, *again)] == list(expected)
