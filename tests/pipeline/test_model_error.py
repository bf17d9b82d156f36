"""Claims about the error of the device model: what it does to a switch, who sees it, and what counts."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from conditions_of_campaigns import DRIVE, config
from softclose import Pulse, Waveform
from softclose.conditions.model_error import UncertainModel, mistaken
from softclose.evaluate import draw, evaluate, respond
from softclose.evaluate.chain import chain_of, combinations
from softclose.evaluate.respond import respond_each
from softclose.settings import ConfigError, load_config

PLAIN = config()


@settings(max_examples=15, deadline=None)
@given(st.floats(-0.2, 0.2), st.integers(0, 2**16))
def test_a_force_that_is_stronger_is_a_drive_that_is_higher_by_its_root(force: float, seed: int) -> None:
    lot = draw(PLAIN, 16, seed=seed)
    found = respond(PLAIN, mistaken(lot, force, 0.0), DRIVE)
    higher = Waveform([replace(p, volts=p.volts * math.sqrt(1.0 + force)) for p in DRIVE.pulses])
    wanted = respond(PLAIN, lot, higher)
    apart = np.abs(np.nan_to_num(found.max_contact_speed) - np.nan_to_num(wanted.max_contact_speed)) > 1e-6
    assert apart.sum() <= 1, "but for one that grazes"


@settings(max_examples=15, deadline=None)
@given(st.floats(-0.1, 0.1), st.integers(0, 2**16))
def test_times_that_are_longer_are_a_motion_that_is_slower(time: float, seed: int) -> None:
    lot = draw(PLAIN, 16, seed=seed)
    b = 1.0 + time
    stretched = Waveform([Pulse(p.start_us * b, p.rise_us * b, p.peak_us * b, p.volts) for p in DRIVE.pulses])
    found = respond(PLAIN, mistaken(lot, 0.0, time), stretched, horizon_us=250.0 * b)
    wanted = respond(PLAIN, lot, DRIVE)
    apart = np.abs(np.nan_to_num(found.max_contact_speed) * b - np.nan_to_num(wanted.max_contact_speed)) > 1e-6
    assert apart.sum() <= 1


def test_the_worst_is_that_of_either_end_of_either_error() -> None:
    c = load_config({"model_error": {"force": 0.03, "time": 0.02, "counts": "worst", "reach": 1.5}})
    lot = draw(c, 40, seed=1)
    assert "force_error" not in lot
    ends = [(0.0, 0.0), (-0.045, 0.0), (0.045, 0.0), (0.0, -0.03), (0.0, 0.03)]
    speeds = np.array([respond(PLAIN, mistaken(lot, f, t), DRIVE).max_contact_speed for f, t in ends])
    found = respond(c, lot, DRIVE)
    touched = ~np.isnan(speeds).all(axis=0)
    np.testing.assert_allclose(found.max_contact_speed[touched], np.nanmax(speeds[:, touched], axis=0))
    assert np.isnan(found.max_contact_speed[~touched]).all()
    assert len(respond_each(c, lot, DRIVE)) == 5
    one = load_config({"model_error": {"force": 0.03, "counts": "worst"}})
    assert len(respond_each(one, lot, DRIVE)) == 3, "an error of nothing has no ends"


def test_a_trim_reads_the_switch_as_it_is_and_takes_the_error_of_the_force_out() -> None:
    error = {"force": 0.06}
    trim = {"measured": "pull-in and resonance", "pull_in_error": 0.0, "resonance_error": 0.0}
    at = {"objective": {"closed_by_us": 0.0}}
    spread, trimmed, no_error = (
        evaluate(load_config(x | at), draw(load_config(x | at), 600, seed=2), DRIVE, fresh=True)
        for x in ({"model_error": error}, {"model_error": error, "trim": trim}, {"trim": trim})
    )
    assert trimmed.p_nc == pytest.approx(no_error.p_nc, abs=0.02)
    assert trimmed.mean_cm_s == pytest.approx(no_error.mean_cm_s, rel=0.03)
    assert spread.p_nc > trimmed.p_nc + 0.02


def test_errors_are_normal_independent_and_the_same_for_every_candidate() -> None:
    c = load_config({"model_error": {"force": 0.04, "time": 0.01}})
    lot = draw(c, 4000, seed=3)
    assert np.std(lot["force_error"]) == pytest.approx(0.04, rel=0.05)
    assert np.std(lot["time_error"]) == pytest.approx(0.01, rel=0.05)
    assert abs(np.corrcoef(lot["force_error"], lot["time_error"])[0, 1]) < 0.05
    np.testing.assert_array_equal(lot["force_error"][:50], draw(c, 50, seed=3)["force_error"])
    plain = draw(PLAIN, 4000, seed=3)
    np.testing.assert_allclose(lot["K"] * (1.0 + lot["force_error"]), plain["K"])
    ratio = lot["M"] / plain["M"]
    np.testing.assert_allclose(ratio, (1.0 + lot["time_error"]) ** 2 / (1.0 + lot["force_error"]))
    extreme = mistaken(plain, -3.0, 0.0)
    np.testing.assert_allclose(extreme["K"], plain["K"] / 0.05)


@pytest.mark.parametrize(
    ("key", "value"), [("force", -0.1), ("force", 0.31), ("time", 1.0), ("counts", "best"), ("reach", 0.0)]
)
def test_senseless_errors_are_refused(key: str, value: object) -> None:
    with pytest.raises(ConfigError, match=f"model_error.{key}"):
        load_config({"model_error": {key: value}})


def test_however_wrong_the_model_is_a_switch_has_a_force_and_a_time() -> None:
    """Normal errors have no end: -200 % is one of them."""
    wrong = mistaken(draw(PLAIN, 4, seed=1), -2.0, -2.0)
    for name in ("K", "M"):
        assert (wrong[name] > 0.0).all()
        assert np.isfinite(wrong[name]).all()


@pytest.mark.parametrize(
    ("errors", "said"),
    [
        ({"force": 0.04}, "its force by 4 % (standard deviation): the figures are those of the lots that it may be"),
        ({"time": 0.02}, "its times by 2 % (standard deviation)"),
        (
            {"force": 0.04, "time": 0.02, "counts": "worst", "reach": 1.5},
            "its force by 4 % and its times by 2 % (standard deviation): each switch counts at its worst of either "
            "error up to 1.5 standard deviations",
        ),
    ],
)
def test_how_wrong_the_model_is_taken_to_be_is_said(errors: dict[str, Any], said: str) -> None:
    (line,) = UncertainModel.assumed(load_config({"model_error": errors}).model_error)
    assert said in line
    assert UncertainModel.assumed(PLAIN.model_error) == []


@pytest.mark.parametrize(
    "errors",
    [{}, {"force": 0.03}, {"time": 0.02}, {"force": 0.03, "time": 0.02}],
    ids=lambda errors: "-".join(errors) or "none",
)
@pytest.mark.parametrize("counts", ["mean", "worst"])
def test_a_switch_costs_as_many_simulations_as_it_has_cases(errors: dict[str, Any], counts: str) -> None:
    c = load_config({"model_error": errors | {"counts": counts}})
    assert c.n_cases == len(respond_each(c, draw(c, 2, seed=1), DRIVE))


def test_every_case_of_the_worst_says_what_is_wrong_in_it() -> None:
    c = load_config({"model_error": {"force": 0.03, "time": 0.2, "counts": "worst", "reach": 1.5}})
    names = [case.name for chosen in combinations(chain_of(c)) for case in chosen]
    assert names == [
        "force +0.0 %, times +0.0 %",
        "force -4.5 %, times +0.0 %",
        "force +4.5 %, times +0.0 %",
        "force +0.0 %, times -30.0 %",
        "force +0.0 %, times +30.0 %",
    ]


def test_a_model_that_is_right_has_no_condition() -> None:
    assert load_config({"model_error": {"counts": "worst"}}).model_error.none
    assert len(respond_each(load_config({"model_error": {"counts": "worst"}}), draw(PLAIN, 4, seed=1), DRIVE)) == 1
