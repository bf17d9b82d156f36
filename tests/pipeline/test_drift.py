"""Claims about drift: what moves, by how much the pull-in voltage moves with it, and where v_u has doubled."""

from __future__ import annotations

import math

import numpy as np
import pytest

from softclose import Pulse, Waveform, simulate
from softclose.evaluate import draw, respond
from softclose.settings import load_config
from softclose.switch.plate import pull_in_voltage
from softclose.uncertainty.drift import DriftError, drift, drifted

DRIVE = Waveform([Pulse(0.0, 4.0, 4.78, 84.95), Pulse(32.46, 4.33, 6.2, 149.76), Pulse(45.94, 13.24, math.inf, 75.39)])
CONFIG = load_config("current")


@pytest.fixture(scope="module")
def switches() -> np.ndarray:
    return draw(CONFIG, 4000, seed=1, stream=0)


def test_stiffness_moves_pull_in_voltages_by_the_part_that_is_asked_for(switches: np.ndarray) -> None:
    config, moved = drifted(CONFIG, switches, "stiffness", 0.03)
    assert config == CONFIG
    area = CONFIG.model.plate_area_um2
    np.testing.assert_allclose(pull_in_voltage(moved, area), 1.03 * pull_in_voltage(switches, area), rtol=1e-12)
    np.testing.assert_array_equal(np.delete(moved, 2, axis=1), np.delete(switches, 2, axis=1))


def test_charge_is_a_voltage_between_the_plates(switches: np.ndarray) -> None:
    """A held step is one that is lower by the charge, on a switch that starts under it."""
    config, lot = drifted(CONFIG, switches[:200], "charge", 3.0)
    np.testing.assert_array_equal(lot, switches[:200])
    step = Waveform([Pulse(0.0, 4.0, math.inf, 100.0)])
    charged = respond(config, lot, step)
    lower = simulate(lot, Waveform([Pulse(0.0, 4.0, math.inf, 97.0)]), max_volts=math.inf)
    np.testing.assert_allclose(charged.max_contact_speed, lower.max_contact_speed, rtol=0.02)
    stiffer = drifted(load_config("current", ["amplifier.offset_volts=1"]), lot, "charge", 3.0)[0]
    assert stiffer.amplifier.offset_volts == -2.0


def test_rows_are_the_lot_after_each_drift_and_differences_are_paired(switches: np.ndarray) -> None:
    found = drift(CONFIG, switches, DRIVE, "stiffness", [0.04, -0.02])
    assert [r.drift for r in found.rows] == [-0.02, 0.0, 0.04]
    still = found.rows[1]
    assert still.comparison.v_u_cm_s == 0.0
    for row in found.rows:
        _, lot = drifted(CONFIG, switches, "stiffness", row.drift)
        v = respond(CONFIG, lot, DRIVE).max_contact_speed * 100.0
        ordered = np.sort(v[~np.isnan(v)])
        assert row.assessment.v_u_cm_s == ordered[math.ceil(0.9 * ordered.size) - 1]
        assert row.comparison.v_u_cm_s == pytest.approx(row.assessment.v_u_cm_s - still.assessment.v_u_cm_s)
    unpaired = still.assessment.v_u_interval[1] - still.assessment.v_u_interval[0]
    low, high = found.rows[0].comparison.v_u_interval
    assert high - low < unpaired


@pytest.mark.parametrize("kind", ["stiffness", "charge"])
def test_v_u_is_twice_what_it_was_where_it_is_said_to_be(kind: str, switches: np.ndarray) -> None:
    far = 0.2 if kind == "stiffness" else 25.0
    lot = switches[:1500]
    found = drift(CONFIG, lot, DRIVE, kind, [-far, 0.5 * far, far])  # type: ignore[arg-type]
    still = next(r.assessment.v_u_cm_s for r in found.rows if r.drift == 0.0)
    finite = [v for v in found.doubled if math.isfinite(v)]
    assert finite
    for value in finite:
        config, moved = drifted(CONFIG, lot, kind, value)  # type: ignore[arg-type]
        v = respond(config, moved, DRIVE).max_contact_speed * 100.0
        assert np.nanquantile(v, 0.9) == pytest.approx(2.0 * still, rel=0.02)
        assert np.sign(value) == (-1.0 if value == found.doubled[0] else 1.0)


def test_where_nothing_doubles_it_is_said(switches: np.ndarray) -> None:
    found = drift(CONFIG, switches[:300], DRIVE, "stiffness", [0.001])
    assert found.doubled == (-math.inf, math.inf)


def test_what_cannot_drift_is_named(switches: np.ndarray) -> None:
    with pytest.raises(DriftError, match="must be one of stiffness, charge"):
        drift(CONFIG, switches, DRIVE, "heat", [0.1])  # type: ignore[arg-type]
    with pytest.raises(DriftError, match="leaves no stiffness"):
        drift(CONFIG, switches[:10], DRIVE, "stiffness", [-1.0])
    with pytest.raises(DriftError, match="no finite number"):
        drift(CONFIG, switches[:10], DRIVE, "stiffness", [math.nan])
    trim = load_config("current-trim")
    with pytest.raises(DriftError, match="use stiffness"):
        drifted(trim, switches, "charge", 1.0)


def test_trimmed_switches_keep_the_drives_that_they_were_given(switches: np.ndarray) -> None:
    trim = load_config("current-trim")
    lot = draw(trim, 50, seed=2, stream=0)
    _, moved = drifted(trim, lot, "stiffness", 0.05)
    np.testing.assert_array_equal(moved[:, 4:], lot[:, 4:])
