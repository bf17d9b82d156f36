"""Claims about the comparison of engines: what they are shown, and what counts as their best."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

import bowl
from softclose.propose.protocol import Observation, Problem, Proposal
from softclose.propose.side_by_side import best_so_far, compare_engines, run_engine
from softclose.propose.sobol import initial_point
from softclose.settings import load_config
from softclose.waveform import Waveform


class Recorder:
    """The Sobol engine, a candidate at a time, with a record of what it was shown."""

    def __init__(self) -> None:
        self.shown: list[tuple[int, int, int]] = []

    def propose(
        self, problem: Problem, index: int, history: Sequence[Observation], pending: Sequence[Waveform]
    ) -> Proposal:
        self.shown.append((index, len(history), len(pending)))
        point = initial_point(problem, index)
        return Proposal(waveform=problem.space.waveform(point), origin="sobol", n_switches=20)


def observation(index: int, g: float, n_switches: int, *, failed: bool = False) -> Observation:
    waveform = Waveform.from_rows([(0.0, 4.0, float("inf"), 100.0)])
    return bowl.observation(index, waveform, g, n_switches=n_switches, failed=failed)


@pytest.mark.parametrize("lag", [1, 3])
def test_an_engine_sees_what_it_would_see_with_that_many_candidates_in_flight(lag: int) -> None:
    config = load_config(
        {"campaign": {"budget": 6, "lag": lag}, "prior": {"model": "none"}, "population": {"n_switches": 20}}
    )
    recorder = Recorder()
    history, wall, spent = run_engine(config, recorder)
    assert recorder.shown == [(i, max(i - lag + 1, 0), min(i, lag - 1)) for i in range(6)]
    assert [o.index for o in history] == list(range(6))
    assert len(wall) == len(spent) == 6


def test_a_wave_of_an_engine_that_proposes_singly_shows_it_the_others_of_the_wave() -> None:
    config = load_config(
        {"campaign": {"budget": 7, "wave": 3, "lag": 2}, "prior": {"model": "none"}, "population": {"n_switches": 20}}
    )
    recorder = Recorder()
    history, _, _ = run_engine(config, recorder)
    assert [o.wave for o in history] == [0, 0, 0, 1, 1, 1, 2]
    assert recorder.shown == [(0, 0, 0), (1, 0, 1), (2, 0, 2), (3, 0, 3), (4, 0, 4), (5, 0, 5), (6, 3, 3)]


def test_the_best_is_one_on_the_largest_ensemble() -> None:
    records = [
        observation(0, 9.0, 100, failed=True),
        observation(1, 20.0, 100),
        observation(2, 14.0, 100),
        observation(3, 16.0, 4096),
        observation(4, 13.0, 100),
        observation(5, 15.0, 4096),
        observation(6, 17.0, 4096),
    ]
    assert [o.index if o else None for o in best_so_far(records)] == [None, 1, 2, 3, 3, 5, 5]


def test_a_comparison_reports_the_finishing_stage_on_its_own_ensemble() -> None:
    config = load_config(
        {
            "campaign": {"budget": 10},
            "prior": {"model": "none"},
            "population": {"n_switches": 40, "sampling": "sobol"},
            "optimiser": {"n_initial": 8},
            "finish": {"budget": 6, "n_switches": 160, "n_basins": 2},
        }
    )
    (run,) = compare_engines(config, ["sobol"], [4])
    assert run.best.n_switches == 160
    assert run.best_g_cm_s[-1] == run.best.g_cm_s
