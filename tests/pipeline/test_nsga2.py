"""Claims about the NSGA-II engine: a growing front, no state beside the records, an optional library."""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from softclose.evaluate import draw, respond
from softclose.metrics.pareto import hypervolume, pareto_front
from softclose.plugins import EngineError
from softclose.propose.objectives import front_values, worst_values
from softclose.propose.plan import plan
from softclose.propose.protocol import Observation, Problem, load_engine
from softclose.propose.side_by_side import evaluate, run_engine
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
