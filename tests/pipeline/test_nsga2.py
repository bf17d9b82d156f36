"""Claims about the NSGA-II engine: a growing front, no state beside the records, an optional library."""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from softclose.config import load_config
from softclose.metrics.pareto import hypervolume, pareto_front
from softclose.plugins import EngineError
from softclose.propose.plan import plan
from softclose.propose.protocol import Observation, Problem, load_engine
from softclose.propose.side_by_side import evaluate, run_engine

pytest.importorskip("pymoo")
N = 256


def _problem(budget: int, **settings: Any) -> Problem:
    return Problem(
        load_config(
            {
                "campaign": {"budget": budget, "seed": 3},
                "population": {"n_switches": N},
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


def _volume(history: list[Observation]) -> float:
    return hypervolume([o.v_u_cm_s for o in history], [o.p_nc for o in history], worst_v_u_cm_s=60.0)


@pytest.mark.slow
def test_the_front_grows_beyond_that_of_as_many_random_points() -> None:
    history = _run(_problem(640))
    assert {o.origin for o in history} == {"sobol", "nsga2"}
    parts = [_volume(history[:k]) for k in (64, 192, 384, 640)]
    assert parts == sorted(parts)
    assert parts[-1] > parts[0] + 1.0
    random = _run(_problem(640, optimiser={"engine": "sobol"}), "sobol")
    assert parts[-1] > _volume(random) + 0.5
    front = pareto_front([o.v_u_cm_s for o in history], [o.p_nc for o in history])
    assert len(front) >= 5, "a front, not one point"


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


def test_without_pymoo_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pymoo", None)
    with pytest.raises(EngineError, match=r"softclose\[pareto\]"):
        load_engine("nsga2")
