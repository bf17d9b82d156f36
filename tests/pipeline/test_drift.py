"""Claims about drift: what moves, by how much the pull-in voltage moves with it, and where v_u has doubled."""

from __future__ import annotations

import math

import numpy as np
import pytest

import by_hand
from softclose import Pulse, Waveform, simulate
from softclose.evaluate import draw, respond
from softclose.population.lot import Lot
from softclose.settings import load_config
from softclose.switch.plate import pull_in_voltage
from softclose.uncertainty.drift import DriftError, drift, drifted

DRIVE = Waveform([Pulse(0.0, 4.0, 4.78, 84.95), Pulse(32.46, 4.33, 6.2, 149.76), Pulse(45.94, 13.24, math.inf, 75.39)])
CONFIG = load_config("current")


@pytest.fixture(scope="module")
def switches() -> Lot:
    return draw(CONFIG, 4000, seed=1)


def test_stiffness_moves_pull_in_voltages_by_the_part_that_is_asked_for(switches: Lot) -> None:
    config, moved = drifted(CONFIG, switches, "stiffness", 0.03)
    assert config == CONFIG
    area = CONFIG.model.plate_area_um2
    np.testing.assert_allclose(
        pull_in_voltage(moved.switches, area), 1.03 * pull_in_voltage(switches.switches, area), rtol=1e-12
    )
    assert [*moved] == [*switches]
    for name in {*moved} - {"K"}:
        np.testing.assert_array_equal(moved[name], switches[name], name)


def test_charge_is_a_voltage_between_the_plates(switches: Lot) -> None:
    """A held step is one that is lower by the charge, on a switch that starts under it."""
    config, lot = drifted(CONFIG, switches.rows(slice(200)), "charge", 3.0)
    np.testing.assert_array_equal(lot.switches, switches.switches[:200])
    step = Waveform([Pulse(0.0, 4.0, math.inf, 100.0)])
    charged = respond(config, lot, step)
    lower = simulate(lot.switches, Waveform([Pulse(0.0, 4.0, math.inf, 97.0)]), max_volts=math.inf)
    np.testing.assert_allclose(charged.max_contact_speed, lower.max_contact_speed, rtol=0.02)
    stiffer = drifted(load_config("current", ["amplifier.offset_volts=1"]), lot, "charge", 3.0)[0]
    assert stiffer.amplifier.offset_volts == -2.0


def test_rows_are_the_lot_after_each_drift_and_differences_are_paired(switches: Lot) -> None:
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
def test_v_u_is_twice_what_it_was_where_it_is_said_to_be(kind: str, switches: Lot) -> None:
    far = 0.2 if kind == "stiffness" else 25.0
    lot = switches.rows(slice(1500))
    found = drift(CONFIG, lot, DRIVE, kind, [-far, 0.5 * far, far])  # type: ignore[arg-type]
    still = next(r.assessment.v_u_cm_s for r in found.rows if r.drift == 0.0)
    finite = [v for v in found.doubled if math.isfinite(v)]
    assert finite
    for value in finite:
        config, moved = drifted(CONFIG, lot, kind, value)  # type: ignore[arg-type]
        v = respond(config, moved, DRIVE).max_contact_speed * 100.0
        assert np.nanquantile(v, 0.9) == pytest.approx(2.0 * still, rel=0.02)
        assert np.sign(value) == (-1.0 if value == found.doubled[0] else 1.0)


def test_where_nothing_doubles_it_is_said(switches: Lot) -> None:
    found = drift(CONFIG, switches.rows(slice(300)), DRIVE, "stiffness", [0.001])
    assert found.doubled == (-math.inf, math.inf)


def test_what_cannot_drift_is_named(switches: Lot) -> None:
    with pytest.raises(DriftError, match="must be one of stiffness, charge"):
        drift(CONFIG, switches, DRIVE, "heat", [0.1])  # type: ignore[arg-type]
    with pytest.raises(DriftError, match="leaves no stiffness"):
        drift(CONFIG, switches.rows(slice(10)), DRIVE, "stiffness", [-1.0])
    with pytest.raises(DriftError, match="no finite number"):
        drift(CONFIG, switches.rows(slice(10)), DRIVE, "stiffness", [math.nan])


def test_trimmed_switches_keep_the_drives_that_they_were_given() -> None:
    trim = load_config("current-trim")
    lot = draw(trim, 50, seed=2)
    _, moved = drifted(trim, lot, "stiffness", 0.05)
    assert [*moved] == [*lot]
    for name in {*moved} - {"K"}:
        np.testing.assert_array_equal(moved[name], lot[name], name)


@pytest.mark.parametrize("measured", ["pull-in and resonance", "contact times"])
def test_charge_is_so_many_volts_less_of_every_switch_s_own_drive(measured: str) -> None:
    """Trimmed: each switch was measured before, and its own scaled command is lower by the charge."""
    config = load_config("current-trim", [f"trim.measured={measured}", "amplifier.bandwidth_kHz=200"])
    rows, lot = by_hand.rows(config, 6, seed=2), draw(config, 6, seed=2)
    found = drift(config, lot, DRIVE, "charge", [4.0])
    charged = load_config("current-trim", [f"trim.measured={measured}", "amplifier.bandwidth_kHz=200",
                                           "amplifier.offset_volts=-4"])  # fmt: skip
    for row, c in zip(found.rows, (config, charged), strict=True):
        alone = by_hand.respond(c, rows, DRIVE).max_contact_speed * 100.0
        assert row.assessment.mean_cm_s == pytest.approx(np.nanmean(alone), abs=0.003)  # samples within 10 mV
    assert [r.drift for r in found.rows] == [0.0, 4.0]
    assert abs(found.rows[1].assessment.mean_cm_s - found.rows[0].assessment.mean_cm_s) > 0.3
