"""Claims about drives that are told by their pieces: what is later, what is cut off, and the largest voltage."""

from __future__ import annotations

import math

import numpy as np
import pytest

from softclose import Pulse, Waveform
from softclose.waveform import Pieced, WaveformError
from softclose.waveform.flat import flatten_pulses

COMMAND = Waveform([Pulse(3.0, 10.0, 4.0, 100.0), Pulse(40.0, 0.0, 20.0, 60.0), Pulse(70.0, 8.0, math.inf, 80.0)])
DRIVE = Pieced(*flatten_pulses(COMMAND, 250.0))
KNOTS = [0.0, 3.0, 13.0, 17.0, 27.0, 40.0, 60.0, 70.0, 78.0]
T = np.linspace(0.0, 200.0, 1601)


def test_it_is_the_voltage_of_its_pieces_and_a_piece_begins_at_its_first_instant() -> None:
    np.testing.assert_allclose(DRIVE.voltage(T), COMMAND.voltage(T), atol=1e-9)
    assert DRIVE.voltage([39.999, 40.0, 59.999, 60.0]).tolist() == [0.0, 60.0, 60.0, 0.0]
    assert DRIVE.voltage(20.0).shape == ()
    assert DRIVE.voltage(T[:12].reshape(4, 3)).shape == (4, 3)
    np.testing.assert_array_equal(DRIVE.voltage([-1.0, 300.0]), [0.0, 80.0])


@pytest.mark.parametrize("delay", [0.0, 0.4, 25.0])
def test_later_is_the_same_shifted_and_lifted_and_before_it_the_offset_alone(delay: float) -> None:
    late = DRIVE.later(delay, -2.5, 150.0)
    t = T[T + delay < 150.0]
    np.testing.assert_allclose(late.voltage(t + delay), COMMAND.voltage(t) - 2.5, atol=1e-9)
    np.testing.assert_array_equal(late.voltage(np.linspace(0.0, delay, 7)), -2.5)  # 3 µs of rest begin the command
    expected = [0.0, *(knot + delay for knot in (KNOTS if delay else KNOTS[1:]))]
    np.testing.assert_allclose(late.pieces[:, 0], expected, atol=1e-12)
    np.testing.assert_array_equal(late.pieces[1:, 0], late.pieces[:-1, 1])
    assert late.pieces[-1, 1] == 150.0
    assert late.n_ramps[0] == 0, "rest has no terms"
    assert DRIVE.pieces[0, 1] == 3.0, "what is delayed is itself as it was"
    assert DRIVE.pieces[0, 2] == 0.0


def test_on_a_horizon_there_are_the_pieces_that_begin_before_it() -> None:
    for horizon, n in ((100.0, 9), (65.0, 7), (60.0, 6), (40.0 + 1e-10, 5), (2.0, 1)):
        pieces, n_ramps, ramps = DRIVE.flat(horizon)
        assert [len(pieces), len(n_ramps), len(ramps)] == [n, n, n], horizon
        assert pieces[-1, 1] == horizon
    pieces[:] = math.nan
    assert np.isfinite(DRIVE.pieces).all(), "what a caller does with them is its own"


def test_breakpoints_are_where_pieces_begin_up_to_the_horizon() -> None:
    np.testing.assert_allclose(DRIVE.breakpoints(), KNOTS)
    np.testing.assert_allclose(DRIVE.breakpoints(60.0), KNOTS[:7])


def test_its_largest_voltage_is_the_largest_magnitude_before_the_horizon() -> None:
    assert DRIVE.max_voltage() == pytest.approx(100.0)
    assert DRIVE.max_voltage(2.0) == 0.0
    assert DRIVE.max_voltage(8.0) == pytest.approx(50.0, abs=1e-6), "half of a rise is half of its volts"
    assert DRIVE.later(0.0, -90.0, 250.0).max_voltage() == pytest.approx(90.0)  # of -90 to 10 V
    bump = Waveform([Pulse(0.0, 10.0, 0.0, 100.0), Pulse(6.0, 10.0, 0.0, 100.0)])
    found = Pieced(*flatten_pulses(bump, 250.0)).max_voltage()
    assert found == pytest.approx(float(bump.voltage(np.linspace(0.0, 30.0, 30001)).max()), rel=1e-3)
    jump = Pieced(*flatten_pulses(Waveform([Pulse(5.0, 0.0, math.inf, 90.0)]), 250.0))
    assert jump.max_voltage(5.0) == 0.0, "a jump at the end of a piece belongs to the next"


def test_a_drive_that_passes_its_limit_is_refused_with_its_voltage() -> None:
    DRIVE.check(100.0)
    DRIVE.check()
    DRIVE.check(60.0, 8.0)
    with pytest.raises(WaveformError, match=r"reaches 100 V; 99 V are allowed \(waveform.max_volts\)"):
        DRIVE.check(99.0)
    late = Pieced(*flatten_pulses(Waveform([Pulse(200.0, 4.0, math.inf, 90.0)]), 400.0))
    with pytest.raises(WaveformError, match="reaches 90 V"):
        late.check(80.0)
    late.check(80.0, 199.0)


def test_unless_said_otherwise_250_us_count() -> None:
    for start, peak in ((249.5, 90.0), (250.5, 0.0)):
        drive = Pieced(*flatten_pulses(Waveform([Pulse(start, 0.0, math.inf, 90.0)]), 400.0))
        assert drive.max_voltage() == peak
        if peak:
            with pytest.raises(WaveformError, match="reaches 90 V"):
                drive.check(80.0)
        else:
            drive.check(80.0)
