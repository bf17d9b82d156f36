"""Claims that hold for any values: what is stored comes back, whatever it is."""

import tempfile
from pathlib import Path

import hypothesis.extra.numpy as hnp
import numpy as np
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from examples import examples
from small_store import create, layout
from softclose_store import (
    DriverStore,
    StageLayout,
    fingerprint_of,
    open_campaign,
    proposals_digest,
    verify,
    write_block,
)
from softclose_store.write.create import differences

SETTINGS = settings(
    max_examples=examples(12),
    deadline=None,
    suppress_health_check=list(HealthCheck),
    derandomize=True,
    phases=[Phase.explicit, Phase.generate],  # no shrinking: every example is a store on the disk
)
TEXT = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=80)
JSON = st.recursive(
    st.none() | st.booleans() | st.integers(-(10**9), 10**9) | st.floats(allow_nan=False, allow_infinity=False) | TEXT,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(TEXT, inner, max_size=3),
    max_leaves=8,
)


@SETTINGS
@given(
    n_candidates=st.integers(1, 5),
    n_switches=st.integers(1, 9),
    block_candidates=st.integers(1, 5),
    block_switches=st.integers(1, 9),
    data=st.data(),
    x=hnp.arrays(np.float32, (5, 9, 11), elements=st.floats(width=32)),
    response=hnp.arrays(np.float64, (5, 9, 8), elements=st.floats()),
    origin=TEXT,
    failure=TEXT,
    surrogate=st.dictionaries(TEXT.filter(bool), st.floats(allow_nan=False), max_size=4),
    g=st.floats(),
)
def test_any_values_come_back_bit_for_bit(
    n_candidates, n_switches, block_candidates, block_switches, data, x, response, origin, failure, surrogate, g
):
    used = data.draw(st.integers(1, n_switches))
    response[..., 3], response[..., 7] = 2, 0  # counts and states are whole numbers
    stage = StageLayout(
        name="search",
        n_candidates=n_candidates,
        n_switches=n_switches,
        block_candidates=block_candidates,
        block_switches=block_switches,
    )
    row = {"waveform": [[0.0, 4.0, 10.0, 150.0]], "n_switches": used, "origin": origin, "surrogate": surrogate}
    row |= {"failed": bool(failure), "failure": failure, "g_cm_s": g}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.zarr"
        sizes = create(path, layout([stage], max_impacts=0))
        markers = {}
        with DriverStore(path) as store:
            for i, j in sizes.wave_blocks(0, n_candidates, used):
                rows, columns = stage.candidates(i), stage.switches(j)
                at = (rows, slice(columns.start, min(columns.stop, used)))
                digest = proposals_digest([row["waveform"]] * (rows.stop - rows.start), used, rows.start)
                arrays = {"x": x[at], "v": -x[at], "response": response[at]}
                markers[i, j] = write_block(path, "search", i, j, arrays, digest)
            store.commit([row] * n_candidates, markers)
        DriverStore(path).close()  # all digests are as they were
        campaign = open_campaign(path)
        records = campaign.records()
        for i in range(n_candidates):
            assert campaign.trajectories(i).x[...].tobytes() == x[i, :used].tobytes()
            assert campaign.trajectories(i).v[...].tobytes() == (-x[i, :used]).tobytes()
            assert campaign.responses(i).final_x.tobytes() == response[i, :used, 4].tobytes()
            assert str(records["failure"][i]) == failure
            assert str(records["origin"][i]) == origin
            assert_array_equal([records[f"surrogate.{name}"][i] for name in surrogate], list(surrogate.values()))
        assert_array_equal(records["g_cm_s"], [g] * n_candidates)
        assert verify(path).ok


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
