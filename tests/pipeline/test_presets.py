"""Claims about the presets that ship: who proposes what their own ensembles evaluate."""

from __future__ import annotations

import numpy as np
import pytest

from softclose.presets import preset_names
from softclose.propose.design import design_point
from softclose.propose.plan import SEARCH, plan
from softclose.propose.protocol import Problem
from softclose.settings import load_config

PROCESS = ("skopt", "parego")
"""Engines that are a Gaussian process."""

NO_CHEAP_MODEL = {"actuator"}
"""A device whose force is a table of capacitances: no kernel is fast with it, and a prior would cost as the search."""

NO_PRIOR = {"current-front"}

SEARCHES = [n for n in preset_names() if not n.endswith(("-paper", "-direct")) and n not in NO_CHEAP_MODEL]


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


@pytest.mark.parametrize("name", [name for name in SEARCHES if name not in NO_PRIOR])
def test_the_prior_of_every_preset_has_an_answer(name: str) -> None:
    problem = Problem(load_config(name, ["prior.n_switches=16", "prior.n_exploring=8"]))
    waveform = problem.space.waveform(design_point(problem, 0))
    few, all_of_them = problem.prior_values([waveform], 8), problem.prior_values([waveform])
    assert np.isfinite([few.g_cm_s[0], all_of_them.g_cm_s[0]]).all()
    assert few.failure == all_of_them.failure == ""


def test_every_other_search_has_a_prior() -> None:
    assert {name for name in SEARCHES if not load_config(name).has_prior} == NO_PRIOR


def test_the_published_procedures_are_what_was_published() -> None:
    assert {share_of_the_process(name) for name in preset_names() if name not in SEARCHES} == {0.0}
    assert len(SEARCHES) == len(preset_names()) - 4 - len(NO_CHEAP_MODEL)
