"""Claims about a wave between its proposals and its commit: what of its blocks becomes a candidate's record."""

from __future__ import annotations

import numpy as np
import pytest

from softclose import Pulse, Waveform
from softclose.propose.protocol import Proposal, Wave
from softclose.settings import load_config
from softclose_store import Layout, StageLayout
from softclose_workflows.run.flight import Flight, plan_tasks, recovered
from softclose_workflows.run.tasks import BlockResult

WAVE = Wave(index=0, stage="search", start=0, size=2, n_switches=6, sees=0)
DRIVES = [Waveform([Pulse(0.0, 4.0, 5.0, volts), Pulse(30.0, 5.0, float("inf"), 80.0)]) for volts in (100.0, 120.0)]


def flight(failures: dict[int, str] | None = None) -> Flight:
    """Two candidates in two blocks of three switches."""
    stage = StageLayout(name="search", n_candidates=2, n_switches=6, block_candidates=2, block_switches=3)
    layout = Layout(stages=(stage,), times_us=np.linspace(0.0, 250.0, 3), max_impacts=1, n_pulses=2)
    proposals = tuple(Proposal(waveform=w, origin="sobol", n_switches=6) for w in DRIVES)
    tasks = plan_tasks(WAVE, proposals, layout, store="a.zarr", fingerprint="f")
    assert sorted(tasks) == [(0, 0), (0, 1)]
    found = Flight(wave=WAVE, proposals=proposals, tasks=tasks, propose_s=3.0)
    for column in (0, 1):
        speeds = np.array([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]]) + column
        found.results[0, column] = BlockResult(
            max_contact_speed=speeds,
            closed=np.ones((2, 3), dtype=bool),
            status=np.zeros((2, 3), dtype=np.int8),
            settling_us=10.0 * speeds,
            marker=np.array([1], dtype=np.uint64),
            failures=failures or {},
            simulate_s=4.0 + column,
            store_s=0.0,
        )
    return found


def test_times_are_shared_among_the_candidates_of_a_wave_and_of_a_block() -> None:
    for row in flight().rows(load_config("current")):
        assert row["wall_propose_s"] == pytest.approx(1.5)
        assert row["wall_simulate_s"] == pytest.approx((4.0 + 5.0) / 2)


def test_a_record_is_of_the_candidates_own_switches_in_all_blocks() -> None:
    first, second = flight().rows(load_config("current"))
    assert first["mean_cm_s"] == pytest.approx(100.0 * np.mean([0.1, 0.2, 0.3, 1.1, 1.2, 1.3]))
    assert second["max_cm_s"] == pytest.approx(160.0)
    assert (first["closing_us"], second["closing_us"]) == (13.0, 16.0)
    assert not first["failed"]
    np.testing.assert_array_equal(second["waveform"], DRIVES[1].rows())


def test_a_candidate_that_failed_in_any_block_has_its_reason_and_its_times_and_no_numbers() -> None:
    first, second = flight({1: "the mesh folds"}).rows(load_config("current"))
    assert not first["failed"]
    assert (second["failed"], second["failure"]) == (True, "the mesh folds")
    assert "g_cm_s" not in second
    assert second["origin"] == "sobol"
    assert second["wall_simulate_s"] == pytest.approx(4.5)


def test_a_stored_block_is_taken_over_unless_a_candidate_of_it_failed() -> None:
    stored = {
        "max_contact_speed": np.ones((2, 3)),
        "closed": np.ones((2, 3)),
        "status": np.zeros((2, 3)),
        "settling": np.full((2, 3), 40.0),
    }
    marker = np.array([7], dtype=np.uint64)
    taken = recovered(stored, marker)
    assert taken is not None
    assert (taken.simulate_s, taken.store_s, taken.failures) == (0.0, 0.0, {})  # nobody spent time on it now
    assert taken.closed.dtype == bool
    np.testing.assert_array_equal(taken.settling_us, 40.0)
    stored["status"][1] = -1  # the reason is not stored
    assert recovered(stored, marker) is None
