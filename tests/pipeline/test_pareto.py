"""Claims about the Pareto front of v_u and p_nc."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from softclose.metrics.pareto import pareto_front


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
