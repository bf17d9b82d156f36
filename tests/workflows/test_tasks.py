"""A block of candidates and switches: what is stored of each, and of those that the device model refuses."""

from __future__ import annotations

import math

import numpy as np

from small_campaigns import block_task
from softclose import load_config, simulate
from softclose.waveform import Waveform
from softclose_store import RESPONSE_QUANTITIES
from softclose_workflows.run.tasks import compute_block, rows_of, times_us

GOOD = Waveform.from_rows([(0.0, 4.0, 20.0, 90.0), (40.0, 6.0, math.inf, 60.0)])
OTHER = Waveform.from_rows([(0.0, 4.0, math.inf, 120.0)])
TOO_HIGH = Waveform.from_rows([(0.0, 4.0, math.inf, 170.0)])
CONFIG = load_config({"population": {"n_switches": 12}, "store": {"n_times": 26, "max_impacts": 3}})
SWITCHES = CONFIG.build_population().sample(12, seed=5)
NAMES = [q.name for q in RESPONSE_QUANTITIES]
NAME_IN_RESPONSES = {"first_contact": "first_contact_us", "settling": "settling_us"}


def test_each_candidate_of_a_block_is_what_simulate_says():
    arrays, failures = compute_block(CONFIG, SWITCHES, (rows_of(GOOD), rows_of(OTHER)))
    assert failures == {}
    assert arrays["response"].shape == (2, 12, len(NAMES))
    assert arrays["response"].dtype == np.float64
    assert arrays["x"].shape == arrays["v"].shape == (2, 12, 26)
    assert arrays["x"].dtype == arrays["v"].dtype == np.float32
    assert arrays["impact"].shape == (2, 12, 3, 2)
    assert arrays["impact"].dtype == np.float64
    for i, waveform in enumerate((GOOD, OTHER)):
        r = simulate(SWITCHES, waveform, times_us=np.linspace(0.0, 250.0, 26), max_impacts=3, dtype=np.float32)
        response = dict(zip(NAMES, arrays["response"][i].T, strict=True))
        for name in NAMES:
            np.testing.assert_array_equal(response[name], getattr(r, NAME_IN_RESPONSES.get(name, name)))
        np.testing.assert_array_equal(arrays["x"][i], r.x)
        np.testing.assert_array_equal(arrays["v"][i], r.v)
        np.testing.assert_array_equal(arrays["impact"][i, :, :, 0], r.impact_time_us)
        np.testing.assert_array_equal(arrays["impact"][i, :, :, 1], r.impact_speed)


def test_a_candidate_that_the_model_refuses_leaves_the_next_ones_alone():
    arrays, failures = compute_block(CONFIG, SWITCHES, (rows_of(TOO_HIGH), rows_of(GOOD)))
    assert list(failures) == [0]
    assert "WaveformError" in failures[0]
    assert "150" in failures[0]
    refused = dict(zip(NAMES, arrays["response"][0].T, strict=True))
    assert (refused.pop("closed") == 0.0).all()
    assert (refused.pop("status") == -1.0).all()
    assert all(np.isnan(values).all() for values in refused.values())
    assert np.isnan(arrays["x"][0]).all()
    assert np.isnan(arrays["impact"][0]).all()
    assert arrays["x"].dtype == np.float32
    alone, _ = compute_block(CONFIG, SWITCHES, (rows_of(GOOD),))
    for name in arrays:
        np.testing.assert_array_equal(arrays[name][1:], alone[name])


def test_a_refused_candidate_alone_stays_in_the_schemas_types():
    arrays, _ = compute_block(CONFIG, SWITCHES, (rows_of(TOO_HIGH),))
    assert arrays["x"].dtype == arrays["v"].dtype == np.float32
    assert arrays["response"].shape == (1, 12, len(NAMES))


def test_what_a_model_of_ones_own_answers_in_is_stored_in_the_schemas_types(monkeypatch):
    monkeypatch.setattr(
        "softclose.device.device.load_model",
        lambda _: lambda *given, dtype, **settings: simulate(*given, **settings),
    )
    arrays, _ = compute_block(CONFIG, SWITCHES, (rows_of(GOOD),))
    assert arrays["x"].dtype == arrays["v"].dtype == np.float32


def test_the_grid_runs_from_zero_to_the_horizon():
    grid = times_us(CONFIG)
    assert (grid[0], grid[-1], len(grid)) == (0.0, 250.0, 26)


def test_a_task_names_its_first_and_last_candidate_and_switch():
    task = block_task(first=20, start=256, stop=512, waveforms=(rows_of(GOOD),) * 3)
    assert task.name == "candidates 20 to 22, switches 256 to 511"
