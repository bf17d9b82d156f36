"""Claims about what is remembered of records: it is what would be worked out, and equal records cost nothing."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bowl import proposed
from softclose import Pulse, Waveform
from softclose.propose import ahead
from softclose.propose.known import column, remembered
from softclose.propose.protocol import Proposal
from softclose.settings import load_config

WAVE = Waveform([Pulse(0.0, 4.0, 4.0, 100.0)])


def records(*g: float) -> list[Any]:
    proposal = Proposal(waveform=WAVE, origin="explore", n_switches=9)
    return [proposed(i, 0, proposal, value) for i, value in enumerate(g)]


@pytest.fixture
def problem() -> Any:
    return SimpleNamespace(known={})


def test_a_column_looks_at_new_records_alone_and_at_all_where_one_is_another(problem: Any) -> None:
    looked: list[float] = []

    def value(o: Any) -> float:
        looked.append(o.g_cm_s)
        return float(o.g_cm_s)

    def asked(told: list[Any]) -> list[float]:
        looked.clear()
        return column(problem, "g", told, value).tolist()

    told = records(3.0, 1.0, 2.0)
    assert asked(told[:2]) == [3.0, 1.0]
    assert asked(told) == [3.0, 1.0, 2.0]
    assert looked == [2.0]
    assert asked(told[:1]) == [3.0]
    assert asked(told) == [3.0, 1.0, 2.0]
    assert not looked
    assert asked([told[0], replace(told[1], g_cm_s=5.0), told[2]]) == [3.0, 5.0, 2.0]
    assert looked == [3.0, 5.0, 2.0]
    column(problem, "g", told, value)[0] = 99.0
    assert asked(told) == [3.0, 1.0, 2.0], "what is handed out is the asker's own"


def test_an_answer_is_worked_out_again_where_records_differ(problem: Any) -> None:
    told, counts = records(3.0, 1.0), []

    def least(o: list[Any]) -> float:
        counts.append(len(o))
        return min(r.g_cm_s for r in o)

    assert [remembered(problem, "least", told, least) for _ in range(3)] == [1.0] * 3
    assert counts == [2]
    assert remembered(problem, "least", told[:1], least) == 3.0
    assert remembered(problem, "other", told, least) == 1.0
    assert remembered(problem, "least", told, least) == 1.0
    assert counts == [2, 1, 2, 2]


def test_what_a_campaign_s_engines_need_is_loaded_and_nothing_else() -> None:
    """In a fresh process, for a campaign of descents and then for one of a Gaussian process; plots are still to be
    had."""
    code = (
        "import sys; from softclose.propose.ahead import load_ahead; from softclose.settings import load_config\n"
        "for settings in (['campaign.budget=0', 'explore.budget=60'], []):\n"
        "    load_ahead(load_config('current-three', settings))\n"
        "    print(*[name in sys.modules for name in ('cma', 'skopt', 'matplotlib')])\n"
        "import matplotlib.pyplot"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not done.stderr
    assert done.stdout.splitlines() == ["True False False", "True True False"], "what draws is not loaded by searches"


def test_loading_ahead_is_of_no_consequence_to_a_campaign_without_descents(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ahead, "library", lambda: pytest.fail("nobody needs it"))
    ahead.load_ahead(load_config("current", ["optimiser.engine=sobol", "finish.budget=0", "explore.budget=0"]))
    assert np.isfinite(records(1.0)[0].g_cm_s)
