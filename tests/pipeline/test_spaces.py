"""Claims about the search spaces: everything in the cube is admissible, and the two maps are inverse."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from examples import examples
from softclose.waveform import Pulse, Waveform
from softclose.waveform.spaces import SPACES, NaturalScales, SpaceError, build_space

CURRENT = (2.43, 3.68, 65.3, 3.41)
MODIFIED = (1.93, 4.18, 80.0, 3.7)


def space_of(name, switch=CURRENT, **limits):
    return build_space(name, NaturalScales.from_switch(switch, plate_area_um2=16700.0, **limits))


def test_scales_are_those_of_the_printed_mean_switch():
    s = NaturalScales.from_switch(CURRENT, plate_area_um2=16700.0)
    assert s.period_us == pytest.approx(2 * math.pi / math.sqrt(65.3 / 3410.0), rel=1e-12)
    assert s.pull_in_volts == pytest.approx(80.75, abs=0.05)  # Eq. 3
    force = 8.8541878128e-12 * 16700e-12 / 2 * (s.hold_volts / ((3.68 - 2.43) * 1e-6)) ** 2
    assert force == pytest.approx(65.3 * 2.43e-6, rel=1e-9)


@pytest.mark.parametrize(
    ("name", "dim"),
    [
        ("two-pulse-paper", 4),
        ("two-pulse-full", 6),
        ("two-pulse-release", 7),
        ("three-pulse-full", 10),
        ("three-pulse-release", 11),
    ],
)
def test_every_parameter_of_every_pulse_is_free(name, dim):
    space = space_of(name)
    assert space.dim == dim
    rng = np.random.default_rng(1)
    rows = np.array([space.waveform(rng.random(dim)).rows() for _ in range(40)])
    free = np.ptp(np.where(np.isinf(rows), 0.0, rows), axis=0) > 0.0
    assert free.sum() == dim


@settings(max_examples=examples(60), deadline=None)
@given(
    data=st.data(),
    name=st.sampled_from(sorted(SPACES)),
    volts=st.sampled_from([90.0, 120.0, 150.0]),
    switch=st.sampled_from([CURRENT, MODIFIED]),
)
def test_every_point_of_the_cube_is_admissible_and_round_trips(data, name, volts, switch):
    space = space_of(name, switch, max_volts=volts)
    point = data.draw(st.lists(st.floats(0.0, 1.0), min_size=space.dim, max_size=space.dim))
    waveform = space.waveform(point)
    waveform.check(volts, 250.0)
    assert all(p.rise_us >= 4.0 for p in waveform.pulses)
    again = space.waveform(space.unit(waveform, clip=True))
    np.testing.assert_allclose(again.rows(), waveform.rows(), rtol=1e-7, atol=2e-6)


def test_overlapping_pulses_are_reached():
    space = space_of("three-pulse-full")
    rng = np.random.default_rng(2)
    overlapping = 0
    for _ in range(200):
        a, b, _hold = space.waveform(rng.random(10)).pulses
        overlapping += b.start_us < a.end_us
    assert overlapping > 20


def test_an_overlap_above_the_limit_is_delayed_until_it_just_fits():
    space = space_of("two-pulse-full")
    point = np.full(6, 0.5)
    point[list(space.names).index("delay2")] = 0.0
    point[list(space.names).index("volts1")] = 1.0
    waveform = space.waveform(point)
    assert waveform.max_voltage() == pytest.approx(150.0, rel=1e-6)
    assert waveform.pulses[1].start_us > 0.0


@settings(max_examples=examples(40), deadline=None)
@given(data=st.data(), name=st.sampled_from(sorted(SPACES)), volts=st.sampled_from([90.0, 150.0]))
def test_many_points_are_mapped_as_each_alone_and_what_was_repaired_stays(data, name, volts):
    space = space_of(name, max_volts=volts)
    seed = data.draw(st.integers(0, 2**32 - 1))
    points = np.random.default_rng(seed).random((17, space.dim)).round(data.draw(st.sampled_from([0, 1, 17])))
    waveforms = space.waveforms(points)
    assert waveforms == [space.waveform(p) for p in points]
    canonical = space.canonical(points)
    assert canonical.tobytes() == np.array([space.unit(w, clip=True) for w in waveforms]).tobytes()
    np.testing.assert_allclose(space.canonical(canonical), canonical, atol=1e-6)
    found, places = space.coordinates_of_all([Waveform([Pulse(0, 4, 10, 100)]), *waveforms])
    assert places.tolist() == list(range(1, 18))
    assert found.tobytes() == np.array([space.coordinates_of(w) for w in waveforms]).tobytes()


def test_a_pulse_is_delayed_no_further_than_the_limit_asks():
    """Against a scan: a hundredth of a microsecond earlier the sum is too high somewhere."""
    space = space_of("three-pulse-release", max_volts=90.0)
    points = np.random.default_rng(4).random((60, space.dim))
    before, after = space.rows(points), space.admissible_rows(points)
    fine = np.linspace(0.0, 400.0, 40_001)
    n_moved = 0
    for asked, rows in zip(before, after, strict=True):
        assert Waveform.from_rows(rows).voltage(fine).max() <= 90.0 * (1 + 1e-9)
        if rows[1, 0] > asked[1, 0] + 0.02:
            n_moved += 1
            earlier = rows[:2].copy()
            earlier[1, 0] -= 0.01
            assert Waveform.from_rows(earlier).voltage(fine).max() > 90.0
    assert n_moved > 10


def test_another_form_is_refused_with_what_was_expected():
    space = space_of("two-pulse-full")
    with pytest.raises(SpaceError, match="has 1 pulses"):
        space.unit(Waveform([Pulse(0, 4, 10, 100)]))
    with pytest.raises(SpaceError, match="last pulse must hold"):
        space.unit(Waveform([Pulse(0, 4, 3, 100), Pulse(20, 4, 10, 80)]))
    with pytest.raises(SpaceError, match="fixes it at"):
        space_of("two-pulse-paper").unit(Waveform([Pulse(0, 5, 3, 150), Pulse(20, 4, math.inf, 80)]))


@settings(max_examples=examples(200), deadline=None)
@given(
    data=st.data(),
    n_pulses=st.sampled_from([2, 3]),
    holds=st.booleans(),
    switch=st.sampled_from([CURRENT, MODIFIED]),
    volts=st.sampled_from([90.0, 150.0]),
)
def test_every_admissible_waveform_is_a_point_of_the_full_space(data, n_pulses, holds, switch, volts):
    horizon = 250.0
    kind = "full" if holds else "release"
    space = space_of(f"{'two' if n_pulses == 2 else 'three'}-pulse-{kind}", switch, max_volts=volts)
    starts = sorted([0.0, *data.draw(st.lists(st.floats(0.0, horizon), min_size=n_pulses - 1, max_size=n_pulses - 1))])
    pulses = [
        Pulse(
            start,
            data.draw(st.floats(4.0, horizon)),
            math.inf if holds and j == n_pulses - 1 else data.draw(st.floats(0.0, horizon)),
            # Their sum stays below the limit, wherever they overlap.
            data.draw(st.floats(1e-3 * volts, volts / n_pulses)),
        )
        for j, start in enumerate(starts)
    ]
    waveform = Waveform(pulses)
    again = space.waveform(space.unit(waveform))
    np.testing.assert_allclose(again.rows(), waveform.rows(), rtol=1e-6, atol=1e-5)


def test_a_waveform_outside_the_ranges_is_refused_or_clipped():
    space = space_of("two-pulse-full")
    far = Waveform([Pulse(0, 4, 3, 150), Pulse(20, 400.0, math.inf, 80)])
    with pytest.raises(SpaceError, match="rise2"):
        space.unit(far)
    assert space.unit(far, clip=True)[list(space.names).index("rise2")] == 1.0


def test_an_unknown_space_names_the_nearest():
    with pytest.raises(SpaceError, match="did you mean 'three-pulse-full'"):
        space_of("three-pulse-ful")
