"""Claims about rescoring: equal to a fresh assessment bit for bit, and refused where the events do not suffice."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from small_campaigns import COARSE, make_campaign
from softclose import Waveform, assess, load_population, simulate
from softclose_store import open_campaign
from softclose_workflows.analyses.rescore import RescoreError, Score, rescore
from softclose_workflows.cli import main

N = 80
PRESET: dict[str, Any] = {"max_open": 1.0, "sampling": "replicated"}
"""What the preset has and `assess` has not by itself."""


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> str:
    return make_campaign(tmp_path_factory.mktemp("rescore") / "a.zarr", *COARSE)


def _fresh(store: str, candidate: int):  # type: ignore[no-untyped-def]
    waveform = Waveform.from_rows(open_campaign(store).waveform(candidate))
    return simulate(load_population("current").sample(N, seed=1, sampling="replicated"), waveform, max_impacts=64)


@pytest.mark.parametrize(
    ("objective", "arguments"),
    [
        (("level=0.99", "c1_cm_s=5.0"), {"level": 0.99, "c1_cm_s": 5.0}),
        (("limits_cm_s=[10.0, 30.0]",), {"limits_cm_s": (10.0, 30.0)}),
        (('form="chance"', "p_max=0.02"), {"form": "chance", "p_max": 0.02}),
        (("confidence=0.8", "min_contact=0.5"), {"confidence": 0.8, "min_contact": 0.5}),
    ],
)
def test_another_objective_equals_a_fresh_assessment(store: str, objective: tuple[str, ...], arguments: dict) -> None:  # type: ignore[type-arg]
    for r in rescore(store, Score(objective=objective)):
        assert repr(r.assessment) == repr(assess(_fresh(store, r.candidate), **PRESET, **arguments))


def test_other_definitions_equal_a_naive_look_at_a_fresh_simulation(store: str) -> None:
    for r in rescore(store, Score(closed_by_us=90.0, impacts_until_us=60.0)):
        fresh = _fresh(store, r.candidate)
        speeds = np.full(N, math.nan)
        for i in range(N):
            counted = [v for t, v in zip(fresh.impact_time_us[i], fresh.impact_speed[i], strict=True) if t <= 60.0]
            if counted:
                speeds[i] = max(counted)

        class Naive:
            max_contact_speed = speeds
            closed = np.array([s <= 90.0 for s in fresh.settling_us])
            settling_us = fresh.settling_us

        assert repr(r.assessment) == repr(replace(assess(Naive(), **PRESET), closed_by_us=90.0))


def test_first_impact_only(store: str) -> None:
    for r in rescore(store, Score(impacts="first")):
        fresh = _fresh(store, r.candidate)

        class Naive:
            max_contact_speed = fresh.impact_speed[:, 0]
            closed = fresh.closed
            settling_us = fresh.settling_us

        assert repr(r.assessment) == repr(assess(Naive(), **PRESET))


def test_the_campaigns_own_score_gives_its_own_records_and_ranking(store: str) -> None:
    table = open_campaign(store).records()
    ranking = rescore(store, Score())
    assert [r.rank for r in ranking] == [r.rank_before for r in ranking] == list(range(1, 9))
    for r in ranking:
        assert r.assessment.g_cm_s == table["g_cm_s"][r.candidate] == r.g_before_cm_s
    assert rescore(store, Score(impacts_until_us=250.0)) == pytest.approx(ranking) or [
        r.assessment.v_u_cm_s for r in rescore(store, Score(impacts_until_us=250.0))
    ] == [r.assessment.v_u_cm_s for r in ranking]


def test_lost_impacts_are_refused_unless_they_came_later(tmp_path_factory: pytest.TempPathFactory) -> None:
    few = make_campaign(tmp_path_factory.mktemp("few") / "b.zarr", *COARSE, "store.max_impacts=2", "campaign.budget=3")
    with pytest.raises(RescoreError, match=r"candidate \d: .*store.max_impacts"):
        rescore(few, Score(impacts_until_us=250.0))
    assert len(rescore(few, Score(impacts="first"))) == 3
    assert len(rescore(few, Score(impacts_until_us=0.01))) == 3


def test_command_gives_the_new_ranking(store: str) -> None:
    asked = ["rescore", store, "--level", "0.5", "--c1", "1000", "--closed-by", "100", "--limit", "12.5"]
    done = CliRunner().invoke(main, [*asked, "--json"])
    assert done.exit_code == 0, done.output
    said = json.loads(done.stdout)["candidates"]
    assert [c["g_cm_s"] for c in said] == sorted(c["g_cm_s"] for c in said)
    assert said[0]["p_exceed"][0]["limit_cm_s"] == 12.5
    table = CliRunner().invoke(main, asked)
    assert "before" in table.stdout


@pytest.mark.parametrize("bad", [["--level", "1.5"], ["--form", "chance", "--p-max", "-1"], ["--c1", "-3"]])
def test_bad_settings_are_refused(store: str, bad: list[str]) -> None:
    done = CliRunner().invoke(main, ["rescore", store, *bad])
    assert done.exit_code == 2
    assert "objective." in done.stderr


@pytest.mark.parametrize(
    ("bad", "says"),
    [
        (["--rows", "-3"], "-3 is not in the range x>=1"),
        (["--closed-by", "1e9"], "--closed-by is 1e+09 µs; the campaign simulated from 0 to 250 µs"),
        (["--closed-by", "-1"], "--closed-by is -1 µs"),
        (["--impacts-until", "251"], "--impacts-until is 251 µs"),
    ],
)
def test_rows_and_instants_that_do_not_exist_are_refused(store: str, bad: list[str], says: str) -> None:
    done = CliRunner().invoke(main, ["rescore", store, *bad])
    assert done.exit_code == 2
    assert says in done.stderr
