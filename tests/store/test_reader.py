"""Claims about reading: typed access, any Zarr tool, old stores, nothing executed."""

import json
import pickle
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pandas
import pytest
import xarray
import zarr
from numpy.testing import assert_array_equal

import small_store
from small_store import chunk, create, proposal, record, run, run_candidate, write_chunk
from softclose_store import DriverStore, StoreError, open_campaign, verify

GOLDEN = Path(__file__).parent / "golden"


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    path = tmp_path_factory.mktemp("reader") / "a.zarr"
    create(path)
    run(path, 3)
    return path


def test_xarray_alone_gives_labelled_arrays_with_dimensions_coordinates_and_units(path):
    data = xarray.open_zarr(path)
    assert data.x.dims == ("candidate", "switch", "time")
    assert data.impact_time.dims == ("candidate", "switch", "impact")
    assert data.waveform.dims == ("candidate", "pulse", "parameter")
    assert dict(data.sizes) | {"candidate": 3, "switch": 10, "time": 11, "impact": 3} == dict(data.sizes)
    assert_array_equal(data.time, np.linspace(0.0, 250.0, 11))
    assert list(data.parameter.values) == ["start_us", "rise_us", "peak_us", "volts"]
    assert data.waveform.sel(parameter="volts").isel(candidate=0, pulse=0).values == 150.0
    assert data.p_exceed.sel(limit=19.7).shape == (3,)
    named = ("x", "v", "time", "g_cm_s", "max_contact_speed", "D", "K", "M")
    units = {name: data[name].attrs["units"] for name in named}
    assert units == {
        "x": "µm",
        "v": "µm/µs",
        "time": "µs",
        "g_cm_s": "cm/s",
        "max_contact_speed": "µm/µs",
        "D": "µm",
        "K": "N/m",
        "M": "µg",
    }
    assert all(variable.attrs["long_name"] for variable in data.variables.values())
    dtypes = {name: str(data[name].dtype) for name in ("closed", "status", "n_impacts", "x", "final_x")}
    assert dtypes == {"closed": "bool", "status": "int8", "n_impacts": "int32", "x": "float32", "final_x": "float64"}


def test_no_array_needs_pickles_or_objects(path):
    group = zarr.open_group(path, mode="r")
    for name, array in group.arrays():
        text = json.dumps(array.metadata.to_dict(), default=str)
        assert "pickle" not in text, name
        assert array.dtype != object, name
    for file in path.rglob("*"):
        if file.is_file():
            with pytest.raises(
                (
                    pickle.UnpicklingError,
                    ValueError,
                    KeyError,
                    EOFError,
                    IndexError,
                    AttributeError,
                    ImportError,
                    OverflowError,
                    UnicodeDecodeError,
                    TypeError,
                    MemoryError,
                )
            ):
                pickle.loads(file.read_bytes())


def test_opening_a_store_imports_neither_numba_nor_dask_nor_skopt(path):
    code = (
        "import sys, softclose_store; c = softclose_store.open_campaign(sys.argv[1]); c.best(); c.records();"
        "assert not {'numba', 'dask', 'skopt', 'softclose', 'pandas'} & set(sys.modules), sys.modules.keys()"
    )
    subprocess.run([sys.executable, "-c", f"import sys; sys.path[:0] = {sys.path!r}; {code}", str(path)], check=True)


def test_best_is_the_smallest_g_among_the_largest_ensembles(path):
    campaign = open_campaign(path)  # g is 30, 29 and 28, the last on 7 switches
    best = campaign.best()
    assert (best.candidate, best.g_cm_s, best.n_switches) == (1, 29.0, 10)
    assert_array_equal(best.waveform, proposal(1)["waveform"])
    assert campaign.best(n_switches=7).candidate == 2
    assert campaign.best(n_switches=3) is None
    with pytest.raises(AttributeError):
        best.g_cm_s = 0.0


def test_history_is_a_table_and_a_dictionary_without_pandas(path, monkeypatch):
    campaign = open_campaign(path)
    table = campaign.history()
    assert isinstance(table, pandas.DataFrame)
    assert list(table.g_cm_s) == [30.0, 29.0, 28.0]
    assert list(table.pulse2_peak_us) == [np.inf] * 3
    assert list(table["p_exceed_19.7"]) == [0.2] * 3
    assert_array_equal(table["surrogate.noise"], [np.nan, 0.1, np.nan])
    assert list(table.origin) == ["sobol"] * 3
    monkeypatch.setitem(sys.modules, "pandas", None)
    columns = campaign.history()
    assert set(columns) == set(table.columns)
    assert_array_equal(columns["g_cm_s"], table.g_cm_s)


def test_trajectories_are_read_by_the_slice(path):
    x = open_campaign(path).trajectories(2).x
    whole = np.concatenate([chunk(small_store.layout(), 2, k, 7)["x"] for k in range(2)])
    assert_array_equal(x, whole)
    assert_array_equal(x[5], whole[5])
    assert_array_equal(x[-1, 2:4], whole[-1, 2:4])
    assert_array_equal(x[1:6:2], whole[1:6:2])
    assert_array_equal(x[::-1], whole[::-1])
    assert_array_equal(x[[6, 0]], whole[[6, 0]])
    assert_array_equal(x[whole[:, 0] > 0.5], whole[whole[:, 0] > 0.5])
    assert_array_equal(x[..., 3], whole[..., 3])
    for outside in (7, [0, 9]):
        with pytest.raises(IndexError):
            x[outside]


@pytest.mark.parametrize("i", [3, -1, True, 1.5])
def test_a_candidate_that_is_not_committed_is_refused(path, i):
    with pytest.raises(StoreError, match="has 3"):
        open_campaign(path).trajectories(i)


def test_a_campaign_shows_an_instant_and_refresh_looks_again(tmp_path):
    path = tmp_path / "a.zarr"
    create(path)
    run(path, 1)
    campaign = open_campaign(path)
    run(path, 2)
    assert (campaign.committed, len(campaign.history()), len(campaign.records()["g_cm_s"])) == (1, 1, 1)
    campaign.refresh()
    assert (campaign.committed, len(campaign.history())) == (2, 2)
    assert campaign.dataset().sizes["candidate"] == 2
    assert "2 of 4" in repr(campaign)


def test_uncommitted_candidates_are_invisible_however_much_of_them_is_written(tmp_path):
    path = tmp_path / "a.zarr"
    create(path)
    run(path, 1)
    with DriverStore(path) as store:
        store.propose(1, proposal(1))
        for i_chunk in range(3):
            write_chunk(path, 1, i_chunk, chunk(store.layout, 1, i_chunk, 10), store.proposal_digest(1))
    assert xarray.open_zarr(path).sizes["candidate"] == 1
    assert zarr.open_group(path, mode="r")["x"].shape[0] == 1
    assert open_campaign(path).committed == 1


@pytest.mark.parametrize("version", [1])
def test_golden_stores_of_every_schema_version_keep_reading(version, tmp_path):
    path = tmp_path / "golden.zarr"
    with zipfile.ZipFile(GOLDEN / f"version-{version}.zip") as archive:
        archive.extractall(path)
    campaign = open_campaign(path)
    assert (campaign.schema_version, campaign.committed, campaign.budget) == (version, 2, 3)
    assert campaign.config == small_store.CONFIG
    assert campaign.best().candidate == 0
    sizes = small_store.layout(n_candidates=3, n_switches=5, chunk_switches=3, times_us=np.linspace(0.0, 250.0, 5))
    assert_array_equal(campaign.trajectories(0).x[3:], chunk(sizes, 0, 1, 5)["x"])
    assert_array_equal(campaign.responses(1).max_contact_speed[:3], chunk(sizes, 1, 0, 4)["max_contact_speed"])
    assert campaign.history().note[1] == "größer"
    assert xarray.open_zarr(path).sizes["candidate"] == 2
    report = verify(path)
    assert report.ok, report.problems
    with DriverStore(path) as store:  # it can be continued, too
        assert store.proposal(2)["origin"] == "sobol"
        run_candidate(store, 2, 5)
    assert open_campaign(path).finished
    assert record(2)["g_cm_s"] == open_campaign(path).records()["g_cm_s"][2]
