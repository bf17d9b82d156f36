"""Claims about the Pareto front of v_u and p_nc."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from softclose.metrics.pareto import hypervolume, pareto_front


@given(
    st.integers(1, 30).flatmap(
        lambda n: st.tuples(
            *[
                arrays(np.float64, n, elements=st.one_of(st.just(np.nan), st.integers(0, 6).map(float)))
                for _ in range(2)
            ]
        )
    )
)
def test_the_front_is_exactly_what_nothing_else_beats(pair):
    v, p = pair
    front = set(pareto_front(v, p).tolist())
    for i in range(len(v)):
        if np.isnan(v[i] + p[i]):
            assert i not in front
            continue
        beaten = any(
            v[j] <= v[i] and p[j] <= p[i] and (v[j] < v[i] or p[j] < p[i] or j < i) for j in range(len(v)) if j != i
        )
        assert (i in front) == (not beaten)


def test_arrays_of_different_length_are_refused():
    with pytest.raises(ValueError, match="two \\(n,\\) arrays"):
        pareto_front([1.0, 2.0], [1.0])


@given(arrays(np.float64, (12, 2), elements=st.floats(0.0, 1.0)))
def test_the_hypervolume_is_the_area_that_is_dominated(points):
    v, p = 80.0 * points[:, 0], points[:, 1]
    grid_v, grid_p = (np.arange(400) + 0.5) / 400 * 60.0, (np.arange(400) + 0.5) / 400
    dominated = np.zeros((400, 400), dtype=bool)
    for a, b in zip(v, p, strict=True):
        dominated |= (grid_v[:, None] >= a) & (grid_p[None, :] >= b)
    assert hypervolume(v, p, worst_v_u_cm_s=60.0) == pytest.approx(60.0 * dominated.mean(), abs=60.0 * 2 / 400 * 2)
    assert hypervolume(v[:6], p[:6], worst_v_u_cm_s=60.0) <= hypervolume(v, p, worst_v_u_cm_s=60.0) + 1e-12
