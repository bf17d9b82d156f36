"""Claims about reading: typed access, any Zarr tool, nothing executed."""

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
from small_store import block, create, layout, proposal, run, write_wave
from softclose_store import SCHEMA_VERSION, DriverStore, StoreError, open_campaign, verify
from stores import differences

GOLDEN = Path(__file__).parent / "golden"


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """Six of eight candidates: the search, and the first wave of the finish."""
    path = tmp_path_factory.mktemp("reader") / "a.zarr"
    create(path)
    run(path, 7)
    return path


def test_xarray_alone_labels_the_table_of_records_with_names_units_and_meanings(path):
    data = xarray.open_zarr(path, group="candidates")
    assert data.records.dims == ("candidate", "field")
    assert data.sizes["candidate"] == 7
    assert_array_equal(data.records.sel(field="g_cm_s"), [30, 29, 28, np.nan, 29.5, 25, 24])
    assert_array_equal(data.records.sel(field="wave"), [0, 0, 0, 0, 1, 2, 2])
    assert_array_equal(data.records.sel(field="pulse2_volts"), [80, 80, np.nan, 80, 80, 80, 80])
    wanted = ["g_cm_s", "p_nc", "pulse1_start_us", "pulse1_volts", "p_exceed_19.7"]
    fields = data.sel(field=wanted)
    assert list(fields.field_unit.values) == ["cm/s", "1", "µs", "V", "1"]
    assert fields.field_long_name.values[0] == "objective g, Eq. 10"
    assert all(data.field_long_name.values)
    assert list(data.words.sel(word="origin").values) == ["sobol"] * 7
    assert data.words.sel(word="note").values[1] == "größer"
    assert_array_equal(data.surrogate.sel(hyperparameter="noise"), [np.nan, 0.1, np.nan, 0.1 * 3, np.nan, 0.5, np.nan])
    assert (data.wall_times.sel(wall_time="wall_propose_s") == 0.5).all()
    lot = xarray.open_zarr(path, group="population")
    assert {name: lot[name].attrs["units"] for name in "DGETKM"} == {
        "D": "µm",
        "G": "µm",
        "E": "GPa",
        "T": "µm",
        "K": "N/m",
        "M": "µg",
    }
    for variable in (*data.variables.values(), *lot.variables.values()):
        assert variable.attrs["long_name"]


def test_xarray_alone_shows_the_stages_as_a_tree_and_one_by_one(path):
    tree = xarray.open_datatree(path, engine="zarr")
    assert set(tree.children) == {"candidates", "population", "search", "finish", "runtime"}
    for name, n_candidates, n_switches in (("search", 5, 10), ("finish", 2, 12)):
        for data in (tree[name], xarray.open_zarr(path, group=name)):
            assert data.x.dims == ("candidate", "switch", "time")
            assert data.impact.dims == ("candidate", "switch", "event", "impact_quantity")
            assert data.x.shape == (n_candidates, n_switches, 11)
            assert_array_equal(data.time, np.linspace(0.0, 250.0, 11))
            assert data.response.sel(quantity="settling").shape == (n_candidates, n_switches)
            assert dict(zip(data.quantity.values, data.quantity_unit.values, strict=True))["final_v"] == "µm/µs"
            assert list(data.impact_quantity.values) == ["time", "speed"]
            assert {k: data[k].attrs["units"] for k in ("x", "v", "time")} == {"x": "µm", "v": "µm/µs", "time": "µs"}
            assert str(data.x.dtype) == str(data.v.dtype) == "float32"
            assert all(variable.attrs["long_name"] for variable in data.variables.values())
    assert tree["finish"].attrs["first_candidate"] == 5
    expected = block(layout(), "finish", 1, 1)["x"][0]
    assert_array_equal(tree["finish"].x.isel(candidate=1, switch=slice(6, 12)), expected)
    assert_array_equal(tree["search"].response.isel(candidate=3).sel(quantity="status"), [-1] * 10)


def test_no_array_needs_pickles_or_objects(path):
    group = zarr.open_group(path, mode="r")
    for name, array in group.members(max_depth=None):
        if isinstance(array, zarr.Group):
            continue
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
    campaign = open_campaign(path)  # g is 30, 29, 28 and none on 10 switches, 29.5 on 7, then 25 and 24 on 12
    best = campaign.best()
    assert (best.candidate, best.g_cm_s, best.n_switches) == (6, 24.0, 12)
    assert_array_equal(best.waveform, proposal(6)["waveform"])
    assert best.record["wave"] == 2
    assert campaign.best(n_switches=10).candidate == 2
    assert_array_equal(campaign.best(n_switches=10).waveform, proposal(2)["waveform"])
    assert campaign.best(stage="search").candidate == 2
    assert campaign.best(n_switches=7).candidate == 4
    assert campaign.best(n_switches=3) is None
    assert campaign.best(n_switches=12, stage="search") is None
    with pytest.raises(AttributeError):
        best.g_cm_s = 0.0
    with pytest.raises(ValueError, match="no stage 'polish'"):
        campaign.best(stage="polish")


def test_history_is_a_table_and_a_dictionary_without_pandas(path, monkeypatch):
    campaign = open_campaign(path)
    table = campaign.history()
    assert isinstance(table, pandas.DataFrame)
    assert_array_equal(table.g_cm_s, [30.0, 29.0, 28.0, np.nan, 29.5, 25.0, 24.0])
    assert_array_equal(table.pulse2_peak_us, [np.inf, np.inf, np.nan, np.inf, np.inf, np.inf, np.inf])
    assert_array_equal(table["p_exceed_19.7"], [0.2, 0.2, 0.2, np.nan, 0.2, 0.2, 0.2])
    assert_array_equal(table["surrogate.scale"], [np.nan, 2.0, np.nan, 2.0, np.nan, 2.0, np.nan])
    assert list(table.origin) == ["sobol"] * 7
    assert list(table.failed) == [i == 3 for i in range(7)]
    assert table.failed.dtype == bool
    assert set(table.columns) >= {field.name for field in campaign.layout.fields}
    monkeypatch.setitem(sys.modules, "pandas", None)
    columns = campaign.history()
    assert list(columns) == list(table.columns)
    assert_array_equal(columns["g_cm_s"], table.g_cm_s)


def test_trajectories_and_impacts_are_read_by_the_slice(path):
    campaign = open_campaign(path)
    parts = [block(layout(), "search", 2, k, 7) for k in range(2)]
    for rows, whole in (
        (campaign.trajectories(4).x, np.concatenate([part["x"][0] for part in parts])),
        (campaign.responses(4).impact_speed, np.concatenate([part["impact"][0, ..., 1] for part in parts])),
    ):
        assert rows.shape == whole.shape
        assert_array_equal(rows, whole)
        assert_array_equal(rows[5], whole[5])
        assert_array_equal(rows[-1, 1:3], whole[-1, 1:3])
        assert_array_equal(rows[1:6:2], whole[1:6:2])
        assert_array_equal(rows[::-1], whole[::-1])
        assert_array_equal(rows[[6, 0]], whole[[6, 0]])
        assert_array_equal(rows[whole[:, 0] > 0.5], whole[whole[:, 0] > 0.5])
        assert_array_equal(rows[..., 2], whole[..., 2])
        for outside in (7, [0, 9]):
            with pytest.raises(IndexError):
                rows[outside]


@pytest.mark.parametrize("i", [7, -1, True, 1.5])
def test_a_candidate_that_is_not_committed_is_refused(path, i):
    with pytest.raises(StoreError, match="has 7"):
        open_campaign(path).trajectories(i)


def test_a_campaign_shows_an_instant_and_refresh_looks_again(tmp_path):
    path = tmp_path / "a.zarr"
    create(path)
    run(path, 4)
    campaign = open_campaign(path)
    run(path, 7)
    assert (campaign.committed, len(campaign.history()), len(campaign.records()["g_cm_s"])) == (4, 4, 4)
    assert campaign.stages == {"search": 4, "finish": 0}
    with pytest.raises(StoreError, match="has 4"):
        campaign.responses(5)
    campaign.refresh()
    assert (campaign.committed, len(campaign.history()), campaign.n_waves) == (7, 7, 3)
    assert campaign.stages == {"search": 5, "finish": 2}
    assert [campaign.stage_of(i) for i in (4, 5)] == ["search", "finish"]
    assert campaign.dataset().sizes["candidate"] == 7
    assert campaign.dataset("finish").sizes["candidate"] == 2
    assert campaign.datatree()["search"].sizes["candidate"] == 5
    assert "7 of 8" in repr(campaign)


def test_uncommitted_candidates_are_invisible_however_much_of_them_is_written(tmp_path):
    path = tmp_path / "a.zarr"
    create(path)
    run(path, 4)
    with DriverStore(path) as store:
        write_wave(store, 4)
        write_wave(store, 5)
    assert xarray.open_zarr(path, group="candidates").sizes["candidate"] == 4
    assert xarray.open_zarr(path, group="search").sizes["candidate"] == 4
    assert xarray.open_zarr(path, group="search").sizes["block_candidate"] == 2
    assert xarray.open_datatree(path, engine="zarr")["finish"].sizes["candidate"] == 0
    assert zarr.open_group(path, mode="r")["search/x"].shape[0] == 4
    assert open_campaign(path).committed == 4


def test_opening_a_store_reads_no_block(tmp_path):
    path = tmp_path / "a.zarr"
    create(path)
    run(path)
    for file in [*path.glob("search/*/c.*"), *path.glob("finish/*/c.*")]:
        if file.parent.name in ("response", "impact", "x", "v", "block_digest"):
            file.write_bytes(b"not read")
    campaign = open_campaign(path)
    assert campaign.best().candidate == 7
    assert len(campaign.history()) == 8
    lazy = campaign.trajectories(0)
    assert lazy.x.shape == (10, 11)
    assert lazy.x.dtype == np.float32


def test_the_golden_store_of_this_schema_reads_verifies_and_continues(tmp_path):
    path = tmp_path / "golden.zarr"
    with zipfile.ZipFile(GOLDEN / f"version-{SCHEMA_VERSION}.zip") as archive:
        archive.extractall(path)
    campaign = open_campaign(path)
    assert (campaign.schema_version, campaign.committed, campaign.n_waves, campaign.budget) == (SCHEMA_VERSION, 5, 2, 8)
    assert (campaign.config, campaign.algorithm) == (small_store.CONFIG, small_store.ALGORITHM)
    assert campaign.best().candidate == 2
    assert campaign.history().note[1] == "größer"
    assert_array_equal(campaign.trajectories(0).x[4:8], block(layout(), "search", 0, 1)["x"][0])
    assert xarray.open_datatree(path, engine="zarr")["search"].sizes["candidate"] == 5
    report = verify(path)
    assert report.ok, report.problems
    assert report.n_blocks == 12  # those of the wave in flight, too
    in_flight = (path / "finish" / "x" / "c.1.1.0").stat().st_mtime_ns
    run(path)
    assert (path / "finish" / "x" / "c.1.1.0").stat().st_mtime_ns == in_flight
    create(tmp_path / "new.zarr")
    run(tmp_path / "new.zarr")
    assert differences(path, tmp_path / "new.zarr") == []
