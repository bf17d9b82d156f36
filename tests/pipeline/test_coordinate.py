"""Claims about an axis of a search space: one-to-one, and nearly all of it is core."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from softclose.waveform.coordinates import FAR, Axis

CORE = {"low": 2.0, "high": 8.0}
AXES = [
    Axis(name="volts1", least=least, most=most, log=log, dense=dense, **CORE)
    for least in (0.1, 2.0)
    for most in (8.0, 300.0)
    for log in (False, True)
    for dense in ("evenly", "low", "high")
]


@pytest.mark.parametrize("axis", AXES)
def test_the_ends_of_an_axis_are_its_least_and_most_value_and_it_rises_between(axis):
    values = axis.value(np.linspace(0.0, 1.0, 1001))
    assert values[[0, -1]] == pytest.approx([axis.least, axis.most])
    assert (np.diff(values) > 0.0).all()


@given(st.sampled_from(AXES), st.floats(0.0, 1.0))
def test_value_and_unit_are_inverse(axis, u):
    assert float(axis.unit(axis.value(u))) == pytest.approx(u, abs=1e-7)


@given(st.sampled_from(AXES), st.floats(-50.0, 1000.0))
@example(AXES[0], 0.1)
@example(AXES[-1], 300.0)
def test_only_what_is_outside_the_axis_has_a_coordinate_outside_the_unit_interval(axis, value):
    # One rounding beyond an end, a coordinate rounds to the end itself.
    assume(all(value == end or abs(value - end) > 1e-12 for end in (axis.least, axis.most)))
    u = float(axis.unit(value))
    assert (u < 0.0) == (value < axis.least)
    assert (u > 1.0) == (value > axis.most)


@pytest.mark.parametrize("axis", AXES)
def test_a_tail_takes_two_hundredths_of_the_axis_and_only_where_there_is_one(axis):
    begin, end = axis.core
    assert begin == (FAR if axis.least < axis.low else 0.0)
    assert end == (1.0 - FAR if axis.most > axis.high else 1.0)
    assert axis.value([begin, end]) == pytest.approx([axis.low, axis.high])
