"""Claims about the presets that ship: who proposes what their own ensembles evaluate."""

from __future__ import annotations

import pytest

from softclose.presets import preset_names
from softclose.propose.plan import SEARCH, plan
from softclose.propose.protocol import Problem
from softclose.settings import load_config

PROCESS = ("skopt", "parego")
"""Engines that are a Gaussian process."""

SEARCHES = [name for name in preset_names() if not name.endswith(("-paper", "-direct"))]


def share_of_the_process(name: str) -> float:
    """Of the candidates that a preset's own ensemble evaluates, those that the process proposes from what it learnt."""
    problem = Problem(load_config(name))
    waves = plan(problem)
    if problem.config.optimiser.engine not in PROCESS:
        return 0.0
    learnt = [w for w in waves if w.stage == SEARCH and w.sees]
    return sum(w.size for w in learnt) / sum(w.size for w in waves)


@pytest.mark.parametrize("name", SEARCHES)
def test_the_process_proposes_at_least_half_of_the_candidates(name: str) -> None:
    assert share_of_the_process(name) >= 0.5


def test_the_published_procedures_are_what_was_published() -> None:
    assert {share_of_the_process(name) for name in preset_names() if name not in SEARCHES} == {0.0}
    assert len(SEARCHES) == len(preset_names()) - 4
