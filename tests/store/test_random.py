"""Claims that hold for any values: what is stored comes back, whatever it is."""

import tempfile
from pathlib import Path

import hypothesis.extra.numpy as hnp
import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from small_store import chunk, create, proposal
from softclose_store import DriverStore, fingerprint_of, open_campaign, write_chunk
from softclose_store.create import differences

SETTINGS = settings(max_examples=12, deadline=None, suppress_health_check=list(HealthCheck), derandomize=True)
TEXT = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=80)
JSON = st.recursive(
    st.none() | st.booleans() | st.integers(-(10**9), 10**9) | st.floats(allow_nan=False, allow_infinity=False) | TEXT,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(TEXT, inner, max_size=3),
    max_leaves=8,
)


@SETTINGS
@given(
    n_switches=st.integers(1, 9),
    chunk_switches=st.integers(1, 9),
    data=st.data(),
    x=hnp.arrays(np.float32, (9, 11), elements=st.floats(width=32)),
    origin=TEXT,
    failure=TEXT,
    surrogate=st.dictionaries(TEXT.filter(bool), st.floats(), max_size=4),
    g=st.floats(),
)
def test_any_values_come_back_bit_for_bit(n_switches, chunk_switches, data, x, origin, failure, surrogate, g):
    used = data.draw(st.integers(1, n_switches))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.zarr"
        sizes = create(path, n_switches=n_switches, chunk_switches=chunk_switches)
        with DriverStore(path) as store:
            store.propose(0, proposal(0, used) | {"origin": origin, "surrogate": surrogate})
            for i_chunk in range(sizes.chunks_of(used)):
                arrays = chunk(sizes, 0, i_chunk, used) | {"x": x[sizes.rows(i_chunk, used)]}
                write_chunk(path, 0, i_chunk, arrays, store.proposal_digest(0))
            assert all(store.chunks_done(0))
            store.commit(0, {"failed": bool(failure), "failure": failure, "g_cm_s": g})
        with DriverStore(path) as store:
            stored = store.proposal(0)
        assert stored["origin"] == origin
        assert list(stored["surrogate"]) == list(surrogate)
        assert_array_equal(list(stored["surrogate"].values()), list(surrogate.values()))
        campaign = open_campaign(path)
        assert campaign.trajectories(0).x[...].tobytes() == x[:used].tobytes()
        assert str(campaign.records()["failure"][0]) == failure
        assert_array_equal(campaign.records()["g_cm_s"], [g])


@SETTINGS
@given(config=st.dictionaries(TEXT, JSON, max_size=4))
def test_any_configuration_is_kept_and_equal_ones_have_one_fingerprint(config):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.zarr"
        create(path, config=config)
        campaign = open_campaign(path)
        assert campaign.config == config
        assert campaign.fingerprint == fingerprint_of(dict(reversed(config.items())))
        assert differences(campaign.config, config) == []
