"""Claims about fronts of several objectives, and the hypervolume that they dominate."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from softclose.metrics.pareto import hypervolume, pareto_front


@given(
    st.tuples(st.integers(1, 30), st.integers(1, 4)).flatmap(
        lambda shape: arrays(
            np.float64, shape, elements=st.one_of(st.sampled_from([np.nan, np.inf]), st.integers(0, 4).map(float))
        )
    )
)
def test_the_front_is_exactly_what_nothing_else_beats(values):
    front = pareto_front(values).tolist()
    assert len(set(front)) == len(front)
    for i, own in enumerate(values):
        if not np.isfinite(own).all():
            assert i not in front
            continue
        beaten = any(
            (other <= own).all() and ((other < own).any() or j < i)
            for j, other in enumerate(values)
            if j != i and np.isfinite(other).all()
        )
        assert (i in front) == (not beaten)
    last = values[front, -1].tolist()
    assert last == sorted(last)


@pytest.mark.parametrize("values", [[1.0, 2.0], [[[1.0]]], np.zeros((3, 0))])
def test_what_is_no_table_is_refused(values):
    with pytest.raises(ValueError, match=r"\(n, k\) table"):
        pareto_front(values)


@pytest.mark.parametrize("worst", [[1.0], [1.0, 0.0], [1.0, np.nan]])
def test_a_corner_that_does_not_fit_is_refused(worst):
    with pytest.raises(ValueError, match="2 positive numbers"):
        hypervolume([[0.5, 0.5]], worst)


@given(arrays(np.float64, (12, 3), elements=st.floats(0.0, 1.4)), st.integers(2, 3))
def test_the_hypervolume_is_the_share_that_is_dominated(values, k):
    """By counting the cells of a grid."""
    values, corner, n = values[:, :k], np.array([60.0, 1.0, 250.0])[:k], 60
    cell = (np.arange(n) + 0.5) / n
    dominated = np.zeros((n,) * k, dtype=bool)
    for point in values:
        dominated |= np.logical_and.reduce(np.meshgrid(*(cell >= p for p in point), indexing="ij"))
    found = hypervolume(values * corner, corner)
    assert found == pytest.approx(dominated.mean(), abs=2.0 * k / n)
    assert hypervolume(values[:6] * corner, corner) <= found + 1e-12


def test_what_is_undefined_or_beyond_the_corner_dominates_nothing():
    assert hypervolume([[np.nan, 0.1], [np.inf, 0.1], [0.1, 2.0]], [1.0, 1.0]) == 0.0
    assert hypervolume([[0.25, 0.5]], [1.0, 1.0]) == pytest.approx(0.375)
