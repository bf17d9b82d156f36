"""Claims about the release of a closed lot: closed forms of its swing, contacts, and a brake that calms it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import by_hand
from examples import in_turn
from softclose import Pulse, Waveform, opening
from softclose.conditions.temperature import heated
from softclose.evaluate import draw
from softclose.opening import (
    LOOKS,
    OpeningError,
    Released,
    Trial,
    Tried,
    design_brake,
    joined,
    judge_opening,
    let_go,
    opened,
)
from softclose.settings import load_config

SOFT = Waveform([Pulse(0, 4.4, 7.25, 111.6), Pulse(56.5, 19, math.inf, 75)])
STEP = Waveform([Pulse(0, 0.0, math.inf, 110)])
HOT = {"celsius": [-40, 20, 85], "stiffness": [1.06, 1.0, 0.93], "low_C": -40, "high_C": 85}


def test_an_instant_release_without_damping_swings_as_far_as_it_was_pulled() -> None:
    config = load_config({})
    switches = draw(config, 300, seed=1)
    found = judge_opening(config, switches, opened(STEP, 250.0), at_us=250.0)
    assert found.n == 300
    assert found.overshoot == pytest.approx(1.0, abs=1e-3)
    assert math.isinf(found.rest_us), "nothing takes its energy out"
    assert found.p_stuck.estimate == 0.0
    # x = D cos(omega t): the median is a quarter of a period later at rest.
    omega = np.median(np.sqrt(1e-3 * switches["K"] / switches["M"]))
    first = found.released.times_us[np.flatnonzero(found.released.quantiles[1] < 0.0)[0]]
    assert first == pytest.approx(0.5 * math.pi / omega, abs=0.5)


def test_damping_settles_a_release_as_its_quality_factor_says() -> None:
    q = 4.0
    config = load_config({}, [f"model.quality_factor={q}", "opening.watch_us=300"])
    switches = np.repeat([[2.43, 3.68, 65.3, 3.41]], 20, axis=0)
    found = judge_opening(config, switches, opened(STEP, 250.0), at_us=250.0)
    root = math.sqrt(1.0 - 0.25 / q**2)
    assert found.overshoot == pytest.approx(math.exp(-0.5 * math.pi / q / root), abs=2e-3)
    assert found.rest_us == pytest.approx(rest_of_the_mean_switch(q), abs=0.4)
    assert found.p_rebound.estimate == 0.0, "its impacts on closing are none of its opening"


def rest_of_the_mean_switch(q: float) -> float:
    """When its swing of quality factor Q, in closed form, has left 5 % of its travel for the last time [µs]."""
    root, omega = math.sqrt(1.0 - 0.25 / q**2), math.sqrt(1e-3 * 65.3 / 3.41)
    t = np.linspace(0, 300, 300_001)
    x = np.exp(-0.5 * omega / q * t) * (np.cos(omega * root * t) + 0.5 / q / root * np.sin(omega * root * t))
    return float(t[np.flatnonzero(np.abs(x) > 0.05)[-1]])


@pytest.mark.parametrize(("part", "told"), [(0.1, False), (0.9, False), (1.1, True)])
def test_rest_is_told_of_a_switch_that_was_seen_inside_the_band_for_half_a_period_of_its_own(
    part: float, told: bool
) -> None:
    watch_us = rest_of_the_mean_switch(4.0) + part * math.pi * math.sqrt(3.41 / (1e-3 * 65.3))
    config = load_config({}, ["model.quality_factor=4.0", f"opening.watch_us={watch_us}"])
    found = let_go(config, np.array([[2.43, 3.68, 65.3, 3.41]]), opened(STEP, 250.0), at_us=250.0)
    assert found.held.all()
    assert np.isfinite(found.rest_us[0]) == told


def test_a_release_is_watched_in_even_steps_from_its_begin_to_the_end_of_the_watch() -> None:
    times = opening.looks_us(load_config({}, ["opening.watch_us=320"]))
    np.testing.assert_allclose(times, 320.0 * np.arange(LOOKS + 1) / LOOKS)


def test_adhesion_keeps_switches() -> None:
    config = load_config({}, ["model.adhesion_uN=1e6"])
    found = judge_opening(config, draw(config, 30, seed=1), opened(STEP, 250.0), at_us=250.0)
    assert found.p_stuck.estimate == 1.0
    assert found.overshoot == 0.0


def test_a_second_pulse_that_closes_again_is_counted() -> None:
    config = load_config({})
    twice = Waveform([*opened(STEP, 250.0).pulses, Pulse(280.0, 0.0, math.inf, 110.0)])
    found = judge_opening(config, draw(config, 100, seed=1), twice, at_us=250.0)
    assert found.p_rebound.estimate == 1.0


@pytest.mark.long
@pytest.mark.slow
def test_a_brake_calms_switches_that_it_was_not_designed_on() -> None:
    config = load_config({})
    drive = opened(SOFT, 250.0)
    brake = design_brake(config, draw(config, 200, seed=2), drive, at_us=250.0, budget=200)
    assert brake.pulses[:-1] == drive.pulses
    assert brake.pulses[-1].start_us >= 250.0
    assert brake.max_voltage(1e4) <= config.waveform.max_volts
    fresh = draw(config, 2000, seed=9)
    plain, braked = (judge_opening(config, fresh, w, at_us=250.0) for w in (drive, brake))
    assert braked.overshoot_interval[1] < 0.85 * plain.overshoot_interval[0]
    assert braked.p_rebound.estimate < 0.05
    again = design_brake(config, draw(config, 200, seed=2), drive, at_us=250.0, budget=200)
    assert again == brake, "the same seed, the same brake"


def test_what_cannot_be_judged_is_said() -> None:
    with pytest.raises(OpeningError, match="does not hold"):
        opened(Waveform([Pulse(0, 4, 5, 100)]), 250.0)
    with pytest.raises(OpeningError, match=r"up at 75\.5 µs: later"):
        opened(SOFT, 60.0)
    assert [opened(SOFT, at).pulses[-1].peak_us for at in (75.5, 80.0)] == [0.0, 4.5]
    low = Waveform([Pulse(0, 4, math.inf, 30)])
    config = load_config({})
    with pytest.raises(OpeningError, match="0 of 50 switches are held"):
        judge_opening(config, draw(config, 50, seed=1), opened(low, 250.0), at_us=250.0)
    lot = draw(config, 10, seed=1)
    assert judge_opening(config, lot, opened(STEP, 250.0), at_us=250.0).n == 10
    with pytest.raises(OpeningError, match="9 of 9 switches are held"):
        judge_opening(config, lot.rows(slice(9)), opened(STEP, 250.0), at_us=250.0)


def test_a_switch_at_rest_between_its_contacts_is_not_held() -> None:
    """A damped lot below pull-in: nothing is told of it, in the shape in which it is told of others."""
    config = load_config({}, ["model.quality_factor=0.7"])
    low = opened(Waveform([Pulse(0, 4, math.inf, 30)]), 400.0)
    found = let_go(config, draw(config, 5, seed=1), low, at_us=400.0)
    assert not (found.held | found.stuck | found.rebound).any()
    assert found.quantiles.shape == (3, LOOKS + 1)
    assert np.isnan(found.quantiles).all()


def test_of_two_cases_a_switch_is_judged_by_its_worse_one() -> None:
    """Eight switches: every pair of yes and no in both cases; the motion is that of the first."""
    yes, no = np.ones(8, dtype=np.bool_), np.zeros(8, dtype=np.bool_)
    first, second = np.array([0, 1, 0, 1] * 2, dtype=np.bool_), np.array([0, 0, 1, 1] * 2, dtype=np.bool_)
    rows = np.arange(8.0)
    common = {"waveform": STEP, "times_us": np.arange(2.0)}
    a = Released(
        held=yes, stuck=first, rebound=no, overshoot=rows, rest_us=9 - rows, quantiles=np.zeros((3, 2)), **common
    )
    b = Released(
        held=rows < 6, stuck=no, rebound=second, overshoot=7 - rows, rest_us=rows, quantiles=np.ones((3, 2)), **common
    )
    for worse in (opening._worse(a, b), opening._worse(b, a)):
        assert worse.held.tolist() == [True] * 6 + [False] * 2
        assert worse.stuck.tolist() == [False, True, False, True, False, True, False, False]
        assert worse.rebound.tolist() == [False, False, True, True, False, False, False, False]
        np.testing.assert_array_equal(worse.overshoot, [7, 6, 5, 4, 4, 5, math.nan, math.nan])
        np.testing.assert_array_equal(worse.rest_us, [9, 8, 7, 6, 5, 5, math.nan, math.nan])
    assert opening._worse(a, b).quantiles is a.quantiles


def test_what_was_not_held_is_not_judged() -> None:
    """Let go while half of the lot still bounces."""
    config = load_config({})
    drive = Waveform([*opened(SOFT, 80.0).pulses, Pulse(110.0, 0.0, math.inf, 120.0)])  # closes all of them again
    found = let_go(config, draw(config, 400, seed=3), drive, at_us=80.0)
    assert 0.05 < found.held.mean() < 0.95
    assert not (found.stuck | found.rebound)[~found.held].any()
    assert found.rebound[found.held].all()
    assert np.isnan(found.overshoot[~found.held]).all()
    assert np.isnan(found.rest_us[~found.held]).all()
    assert np.isfinite(found.overshoot[found.held]).all()


def test_parts_of_a_lot_are_the_lot() -> None:
    config = load_config({})
    switches, drive = draw(config, 60, seed=3), opened(SOFT, 250.0)
    whole = let_go(config, switches, drive, at_us=250.0)
    parts = joined([let_go(config, switches.rows(slice(a, a + 20)), drive, at_us=250.0) for a in (0, 20, 40)])
    for name in ("held", "stuck", "rebound", "overshoot", "rest_us"):
        np.testing.assert_array_equal(getattr(parts, name), getattr(whole, name), name)


@pytest.mark.parametrize("watch_us", [150.0, 163.0, 190.0, 201.0])
def test_what_swings_for_ever_never_settles(watch_us: float) -> None:
    """Without losses every switch crosses the band twice a period, also at the last look."""
    config = load_config({}, [f"opening.watch_us={watch_us}"])
    found = let_go(config, draw(config, 300, seed=5), opened(STEP, 250.0), at_us=250.0)
    assert found.held.sum() > 280
    assert np.isinf(found.rest_us[found.held]).all()


@pytest.mark.parametrize(
    ("stiffness", "exponent"), in_turn((pytest.param(k, e) for e in (1.5, 1.0) for k in (1e4, 5e4, 5e5)), 6)
)
def test_a_compliant_contact_lets_go_whatever_its_indentation(
    tmp_path: Path, stiffness: float, exponent: float
) -> None:
    """It holds beyond the travel, by nanometres or by a tenth of it, and opens like a rigid one."""
    modes = tmp_path / "soft.toml"
    modes.write_text(
        "[[mode]]\nfrequency_kHz = 22.0\nquality_factor = 5.0\n[contact]\n"
        f"force_at_1_um_uN = {stiffness}\nexponent = {exponent}\nloss_us_per_um = 8.0\n"
    )
    config = load_config(
        {}, ["model.name=reduced-order", f"model.modes={modes}", "opening.watch_us=300", "waveform.max_volts=150"]
    )
    switches = draw(config, 40, seed=1)
    found = judge_opening(config, switches, opened(STEP, 250.0), at_us=250.0)
    assert found.n == 40
    assert found.p_stuck.estimate == 0.0
    assert found.released.quantiles[1, 0] > 1.0, "held beyond the travel"
    rigid = load_config({}, ["model.quality_factor=5.0", "opening.watch_us=300"])
    expected = judge_opening(rigid, switches, opened(STEP, 250.0), at_us=250.0)
    assert found.rest_us == pytest.approx(expected.rest_us, abs=3.0)
    assert found.overshoot == pytest.approx(expected.overshoot, rel=0.15)


CONDITIONS = {
    "trim": {"trim": {"measured": "pull-in and resonance"}},
    "learned trim": {"trim": {"measured": "contact times", "actuations": 6}},
    "scatter": {"amplifier": {"gain_error": 0.02, "time_error": 0.02}},
    "amplifier": {"amplifier": {"bandwidth_kHz": 60, "delay_us": 3, "gain_error": 0.02, "time_error": 0.02}},
    "own temperature": {"temperature": HOT},
    "worst of three": {"temperature": HOT | {"worst_of": 3}},
    "all": {
        "trim": {"measured": "pull-in and resonance"},
        "amplifier": {"bandwidth_kHz": 100, "gain_error": 0.02, "time_error": 0.02},
        "temperature": HOT | {"worst_of": 2},
    },
}


@pytest.mark.parametrize("name", CONDITIONS)
def test_under_every_condition_each_switch_opens_as_it_does_alone(name: str) -> None:
    """Each switch under its own drive, which falls at its own instant, from which it is watched at its own pace."""
    config = load_config({"model": {"quality_factor": 3.0}, "opening": {"watch_us": 250.0}} | CONDITIONS[name])
    drive, at = opened(Waveform([Pulse(0, 5.0, math.inf, 110)]), 250.0), 250.0
    found = let_go(config, draw(config, 5, seed=3), drive, at_us=at)
    for i, row in enumerate(by_hand.rows(config, 5, seed=3)):
        own, b = by_hand.own_drive(config, row, drive, horizon_us=500.0)
        t = np.linspace(at * b, (at + 250.0) * b, LOOKS + 1)
        worst_of = config.temperature.worst_of
        tried = np.linspace(config.temperature.low_C, config.temperature.high_C, worst_of) if worst_of else [None]
        overshoot, rest = [], []
        for celsius in tried:
            switch = row if celsius is None else by_hand.heated(config, row, float(celsius))
            r = by_hand.model(config, switch, own, 500.0 * b, times_us=t)
            x = r.x[0].astype(float) / switch["D"]
            assert x[0] == pytest.approx(1.0, abs=1e-6)
            overshoot.append(max(-x.min(), 0.0))
            rest.append(t[np.flatnonzero(np.abs(x) > 0.05)[-1]] - at * b)
        assert found.held[i]
        assert not found.stuck[i]
        assert found.overshoot[i] == pytest.approx(max(overshoot), abs=2e-3)
        assert found.rest_us[i] == pytest.approx(max(rest), abs=0.7)  # two looks


@pytest.mark.parametrize("adhesion_uN", [0.0, 150.0])
def test_at_its_worst_temperature_a_switch_is_judged_where_it_is_held_at_all_of_them(adhesion_uN: float) -> None:
    """Against one release for each temperature; hot, the spring is too weak for what a contact of 150 µN keeps."""
    model = {"model": {"adhesion_uN": adhesion_uN}}
    config = load_config(model | {"temperature": HOT | {"worst_of": 3}})
    plain, lot, drive = load_config(model), draw(config, 300, seed=3), opened(SOFT, 90.0)
    found = let_go(config, lot, drive, at_us=90.0)
    alone = [let_go(plain, heated(config.temperature, lot, c), drive, at_us=90.0) for c in (-40.0, 22.5, 85.0)]
    held = np.all([r.held for r in alone], axis=0)
    assert 0.02 < held.mean() < 0.98
    np.testing.assert_array_equal(found.held, held)
    np.testing.assert_array_equal(found.rebound, held & np.any([r.rebound for r in alone], axis=0))
    np.testing.assert_array_equal(found.stuck, held & np.any([r.stuck for r in alone], axis=0))
    assert (found.stuck & ~np.all([r.stuck for r in alone], axis=0)).any() == (adhesion_uN > 0.0)
    for name in ("overshoot", "rest_us"):
        worst = np.max([getattr(r, name)[held] for r in alone], axis=0)
        np.testing.assert_array_equal(getattr(found, name)[held], worst, name)
        assert np.isnan(getattr(found, name)[~held]).all()


def test_a_brake_is_designed_on_a_lot_with_conditions_too() -> None:
    config = load_config({"trim": {"measured": "pull-in"}, "amplifier": {"gain_error": 0.01}})
    lot, drive = draw(config, 60, seed=2), opened(SOFT, 250.0)
    brake = design_brake(config, lot, drive, at_us=250.0, budget=40)
    plain, braked = (judge_opening(config, lot, w, at_us=250.0) for w in (drive, brake))
    assert braked.overshoot < plain.overshoot


def told(**values: Any) -> Any:
    """What stands for the opening of a lot."""
    nothing = SimpleNamespace(estimate=0.0)
    return SimpleNamespace(**({"overshoot": 0.8, "p_rebound": nothing, "p_stuck": nothing} | values))


def test_no_brake_takes_the_drive_above_its_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where ever more volts would calm the lot, as the drive's falling edge and the brake add up."""
    config = load_config({}, ["waveform.max_volts=115"])
    drive = opened(SOFT, 250.0)
    tried: list[float] = []

    def judged(_config: Any, _lot: Any, waveform: Waveform, **_: Any) -> Any:
        tried.append(waveform.max_voltage(1e4))
        return told(overshoot=2.0 - waveform.voltage(np.linspace(250.0, 300.0, 501)).max() / 150.0)

    monkeypatch.setattr(opening, "judge_opening", judged)
    brake = design_brake(config, draw(config, 20, seed=1), drive, at_us=250.0, budget=600)
    found = brake.voltage(np.linspace(250.0, 300.0, 501)).max()
    assert 105.0 < found <= 115.0
    assert max(tried) <= 115.0, "none above it is even simulated"


def test_a_brake_begins_soon_after_the_drive_is_down() -> None:
    """By a thirty-second of a period at most, and it rises, and stays up, for half as long at most (ADR 130)."""
    config, drive = load_config({}), opened(SOFT, 250.0)
    lot = draw(config, 200, seed=1)
    brakes: list[Pulse] = []

    def flat(trial: Trial) -> Tried:
        brakes.append(trial.waveform.pulses[-1])
        return Tried(0.8)

    design_brake(config, lot, drive, at_us=250.0, budget=200, attempt=flat)
    period = 2.0 * math.pi * math.sqrt(np.median(lot["M"] / (1e-3 * lot["K"])))  # µg and µN/µm: µs
    unit = period / math.sqrt(1000.0)
    begun, rises, peaks = (
        np.array([getattr(b, name) for b in brakes[1:]]) for name in ("start_us", "rise_us", "peak_us")
    )
    least_rise = config.waveform.min_rise_us
    assert begun.min() >= 250.0
    assert 0.3 * unit < begun.max() - 250.0 <= drive.pulses[-1].rise_us + unit * (1.0 + 1e-12)
    assert least_rise <= rises.min() < rises.max() <= least_rise + 0.5 * unit
    assert 0.0 <= peaks.min() < peaks.max() <= 0.5 * unit


def searched(budget: int, attempt: Callable[[Trial], Tried], **more: Any) -> Waveform:
    """SOFT let go at 250 µs, with the brake that is found where trials cost what is said."""
    config = load_config({})
    switches, drive = draw(config, 20, seed=1), opened(SOFT, 250.0)
    return design_brake(config, switches, drive, at_us=250.0, budget=budget, attempt=attempt, **more)


@pytest.mark.parametrize(("budget", "n"), [(36, 25), (37, 37), (48, 37)])
def test_the_search_tries_the_drive_itself_and_then_whole_generations_within_its_budget(budget: int, n: int) -> None:
    drive = opened(SOFT, 250.0)
    trials: list[tuple[Trial, Tried]] = []
    heard: list[tuple[int, int]] = []
    brake = searched(
        budget,
        lambda trial: Tried(abs(trial.waveform.pulses[-1].volts - 60.0)),
        told=lambda *words: trials.append(words),
        listener=lambda *words: heard.append(words),
    )
    assert [trial.number for trial, _ in trials] == list(range(n))
    assert heard == [(done, budget) for done in range(2, n + 1)]
    assert trials[0][0].waveform == drive
    assert all(trial.waveform.pulses[:-1] == drive.pulses for trial, _ in trials[1:])
    assert brake == min(trials, key=lambda pair: pair[1].cost)[0].waveform


def test_the_search_finds_a_brake_that_is_best_in_all_of_its_four_numbers() -> None:
    best = np.array([262.0, load_config({}).waveform.min_rise_us + 0.3, 0.4, 112.0])

    def far(trial: Trial) -> Tried:
        pulse = trial.waveform.pulses[-1]
        found = np.array([pulse.start_us, pulse.rise_us, pulse.peak_us, pulse.volts])
        return Tried(float(np.square(found - best).sum()) if trial.number else math.inf)

    brake = searched(1200, far).pulses[-1]
    np.testing.assert_allclose([brake.start_us, brake.rise_us, brake.peak_us, brake.volts], best, atol=0.01)


def test_a_search_ends_before_its_budget_where_no_brake_is_better_than_another() -> None:
    drive = opened(SOFT, 250.0)
    heard: list[tuple[int, int]] = []
    brake = searched(100_000, lambda trial: Tried(0.8), listener=lambda *words: heard.append(words))
    assert 12 <= len(heard) < 1000
    assert brake == drive


@pytest.mark.parametrize(("share", "pays"), [(0.25, True), (0.35, False)])
@pytest.mark.parametrize("fate", ["p_stuck", "p_rebound"])
def test_a_brake_pays_a_travel_of_overshoot_for_each_switch_that_it_keeps_or_throws_back(
    fate: str, share: float, pays: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It takes 0.3 of overshoot away: worth it where fewer than 0.3 of the switches stay or touch again."""
    config, drive = load_config({}), opened(SOFT, 250.0)

    def judged(_config: Any, _lot: Any, waveform: Waveform, **_: Any) -> Any:
        if waveform == drive:
            return told(overshoot=0.8)
        return told(overshoot=0.5, **{fate: SimpleNamespace(estimate=share)})

    monkeypatch.setattr(opening, "judge_opening", judged)
    brake = design_brake(config, draw(config, 20, seed=1), drive, at_us=250.0, budget=40)
    assert (brake != drive) == pays


def test_a_switch_whose_integration_failed_was_not_held(monkeypatch: pytest.MonkeyPatch) -> None:
    config = load_config({})
    lot, drive = draw(config, 12, seed=1), opened(STEP, 250.0)
    whole = let_go(config, lot, drive, at_us=250.0)
    assert whole.held.all()
    real = opening.respond_each

    def failing(*arguments: Any, **named: Any) -> Any:
        status = np.zeros(12, dtype=np.int8)
        status[[2, 7]] = 1, 2
        return [replace(found, status=status) for found in real(*arguments, **named)]

    monkeypatch.setattr(opening, "respond_each", failing)
    found = let_go(config, lot, drive, at_us=250.0)
    assert np.flatnonzero(~found.held).tolist() == [2, 7]
    assert np.isnan(found.overshoot[[2, 7]]).all()
