"""Claims about proposals, chunks, records and commits."""

import errno

import numpy as np
import pytest
import xarray
import zarr
from numpy.testing import assert_array_equal

import small_store
from small_store import chunk, create, layout, proposal, record, run, run_candidate
from softclose_store import (
    DamageError,
    DriverStore,
    LayoutError,
    RecordError,
    open_campaign,
    read_switches,
    write_chunk,
)


@pytest.fixture
def path(tmp_path):
    create(tmp_path / "a.zarr")
    return tmp_path / "a.zarr"


def test_what_was_written_is_read_back_bit_for_bit(path):
    run(path)
    campaign, sizes = open_campaign(path), layout()
    for i in range(4):
        n = 7 if i == 2 else 10
        responses, trajectories = campaign.responses(i), campaign.trajectories(i)
        for i_chunk in range(sizes.chunks_of(n)):
            rows, expected = sizes.rows(i_chunk, n), chunk(sizes, i, i_chunk, n)
            assert_array_equal(trajectories.x[rows], expected["x"])
            assert_array_equal(trajectories.v[rows], expected["v"])
            assert_array_equal(responses.max_contact_speed[rows], expected["max_contact_speed"])
            assert_array_equal(responses.closed[rows], expected["closed"])
            assert_array_equal(responses.impact_time_us[rows], expected["impact_time"])
            assert responses.status.dtype == np.int8
        assert trajectories.x.shape == (n, 11)
        assert_array_equal(campaign.waveform(i), proposal(i)["waveform"])


def test_a_proposal_survives_its_driver_and_keeps_everything_it_said(path):
    with DriverStore(path) as store:
        assert store.proposal(1) is None
        store.propose(1, proposal(1))
        digest = store.proposal_digest(1)
    with DriverStore(path) as store:
        stored = store.proposal(1)
        assert store.proposal_digest(1) == digest
        assert_array_equal(stored.pop("waveform"), proposal(1)["waveform"])
        rest = {name: proposal(1)[name] for name in ("n_switches", "origin", "note", "surrogate")}
        assert stored == rest


def test_candidates_commit_in_order_and_once(path):
    with DriverStore(path) as store:
        store.propose(1, proposal(1))
        with pytest.raises(RecordError, match="the next one is 0"):
            store.commit(1, record(1))
        run_candidate(store, 0)
        with pytest.raises(RecordError, match="the next one is 1"):
            store.commit(0, record(0))
        with pytest.raises(RecordError, match="is committed"):
            store.propose(0, proposal(0))


def test_a_candidate_with_missing_chunks_commits_only_as_failed(path):
    with DriverStore(path) as store:
        with pytest.raises(RecordError, match="no proposal"):
            store.commit(0, record(0))
        store.propose(0, proposal(0))
        write_chunk(path, 0, 0, chunk(store.layout, 0, 0, 10), store.proposal_digest(0))
        assert store.chunks_done(0) == (True, False, False)
        with pytest.raises(RecordError, match="not stored"):
            store.commit(0, record(0))
        store.commit(0, {"failed": True, "failure": "a chunk killed every worker it met"})
    campaign = open_campaign(path)
    assert campaign.best() is None
    assert str(campaign.records()["failure"][0]) == "a chunk killed every worker it met"
    assert np.isnan(campaign.records()["g_cm_s"][0])
    assert (campaign.responses(0).status[4:] == -1).all()


def test_chunks_of_another_proposal_do_not_count(path):
    with DriverStore(path) as store:
        store.propose(0, proposal(0))
        write_chunk(path, 0, 0, chunk(store.layout, 0, 0, 10), store.proposal_digest(0) ^ 1)
        assert not any(store.chunks_done(0))


def test_a_marked_chunk_whose_data_is_lost_does_not_count(path):
    with DriverStore(path) as store:
        store.propose(0, proposal(0))
        for i_chunk in (0, 1):
            write_chunk(path, 0, i_chunk, chunk(store.layout, 0, i_chunk, 10), store.proposal_digest(0))
        (path / "v" / "c.0.1.0").write_bytes(b"")  # as after a loss of power
        assert store.chunks_done(0) == (True, False, False)
        assert store.chunks_done(0, check=False) == (True, True, False)
        run_candidate(store, 0)
    assert open_campaign(path).committed == 1


def test_every_opening_checks_the_last_committed_candidates(path):
    run(path, 2)
    file = path / "x" / "c.1.2.0"
    intact = file.read_bytes()
    file.write_bytes(intact[:-1] + bytes([intact[-1] ^ 1]))
    with pytest.raises(DamageError, match="candidate 1, chunk 2"):
        DriverStore(path)
    file.write_bytes(intact)
    run(path)


@pytest.mark.parametrize("name", ["g_cm_s", "waveform", "origin", "record_digest"])
def test_a_driver_refuses_damaged_records(path, name):
    run(path, 2)
    file = next((path / name).glob("c.*"))
    intact = file.read_bytes()
    for broken in (intact[:-1], b"", intact[:1] + bytes([intact[1] ^ 4]) + intact[2:]):
        file.write_bytes(broken)
        with pytest.raises(DamageError, match="verify --repair"):
            DriverStore(path)
    file.unlink()
    with pytest.raises(DamageError, match="verify --repair"):
        DriverStore(path)
    file.write_bytes(intact)
    run(path)


def test_a_damaged_read_fails_and_never_yields_data(path):
    run(path, 1)
    file = path / "x" / "c.0.0.0"
    raw = bytearray(file.read_bytes())
    raw[len(raw) // 3] ^= 16
    file.write_bytes(raw)
    with pytest.raises(DamageError, match="softclose verify"):
        open_campaign(path).trajectories(0).x[0]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"x": None}, "missing: \\['x'\\]"),
        ({"y": np.zeros(4)}, "unknown: \\['y'\\]"),
        ({"x": np.zeros((4, 12), np.float32)}, "must be \\(4, 11\\)"),
        ({"x": np.zeros((5, 11), np.float32)}, "must be \\(4, 11\\)"),
        ({"n_impacts": np.zeros(4)}, "must be int32"),
    ],
)
def test_arrays_that_do_not_fit_are_refused_before_anything_is_written(path, change, message):
    arrays = {**chunk(layout(), 0, 0, 10), **change}
    arrays = {name: values for name, values in arrays.items() if values is not None}
    with pytest.raises(LayoutError, match=message):
        write_chunk(path, 0, 0, arrays, 1)
    assert not list((path / "max_contact_speed").glob("c.*"))


def test_a_chunk_outside_the_store_is_refused(path):
    for i, i_chunk in ((4, 0), (-1, 0), (0, 3)):
        with pytest.raises(LayoutError, match="outside"):
            write_chunk(path, i, i_chunk, chunk(layout(), 0, 0, 10), 1)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"waveform": np.ones((3, 4))}, "1 to 2 pulses"),
        ({"n_switches": 11}, "1 to 10 switches"),
        ({"n_switches": 0}, "1 to 10 switches"),
        ({"surrogate": {str(k): 1.0 for k in range(33)}}, "up to 32"),
        ({"orign": "x"}, "did you mean origin"),
        ({"origin": 3}, "must be text"),
    ],
)
def test_ill_formed_proposals_are_refused(path, change, message):
    with DriverStore(path) as store:
        with pytest.raises(RecordError, match=message):
            store.propose(0, proposal(0) | change)
        assert store.proposal(0) is None


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"g_cms": 1.0}, "did you mean g_cm_s"),
        ({"g_cm_s": "high"}, "must be of type f8"),
        ({"p_exceed": [0.1, 0.2]}, "shape"),
        ({"waveform": np.ones((2, 4))}, "no field 'waveform'"),
    ],
)
def test_ill_formed_records_are_refused_and_nothing_is_committed(path, change, message):
    with DriverStore(path) as store:
        store.propose(0, proposal(0))
        for i_chunk in range(3):
            write_chunk(path, 0, i_chunk, chunk(store.layout, 0, i_chunk, 10), store.proposal_digest(0))
        with pytest.raises(RecordError, match=message):
            store.commit(0, record(0) | change)
        assert store.n_committed == 0
        store.commit(0, record(0))


def test_a_full_disk_commits_nothing_and_leaves_no_temporary_file(path, monkeypatch):
    with DriverStore(path) as store:
        run_candidate(store, 0)
        store.propose(1, proposal(1))
        monkeypatch.setenv("SOFTCLOSE_FAULT", "inside-chunk-write:4:raise-enospc")
        monkeypatch.setattr("softclose_store.faults._passages", __import__("collections").Counter())
        with pytest.raises(OSError, match="No space left") as error:
            write_chunk(path, 1, 0, chunk(store.layout, 1, 0, 10), store.proposal_digest(1))
        assert error.value.errno == errno.ENOSPC
        assert not any(store.chunks_done(1))
        monkeypatch.delenv("SOFTCLOSE_FAULT")
        run_candidate(store, 1)
    assert not list(path.rglob("*.partial"))
    assert open_campaign(path).committed == 2


def test_a_writer_notices_that_another_store_took_the_path(path, tmp_path):
    run(path, 1)
    path.rename(tmp_path / "old")
    create(path, n_switches=6, chunk_switches=6)
    with DriverStore(path) as store:
        run_candidate(store, 0, 6)
    assert open_campaign(path).trajectories(0).x.shape == (6, 11)


def test_a_chunk_can_be_written_inside_a_running_event_loop(path):
    import asyncio

    async def notebook():
        return write_chunk(path, 0, 0, chunk(layout(), 0, 0, 10), 1)

    assert asyncio.run(notebook())[0] == 1


def test_large_chunks_are_sharded_and_their_rows_read_alone(tmp_path):
    path = tmp_path / "large.zarr"
    sizes = create(path, n_switches=12_000, chunk_switches=10_240, max_impacts=1)
    assert (sizes.inner_switches, sizes.n_chunks) == (5120, 2)
    with DriverStore(path) as store:
        run_candidate(store, 0, 12_000)
        run_candidate(store, 1, 11_000)
    x = zarr.open_group(path, mode="r")["x"]
    assert (x.shards, x.chunks) == ((1, 10_240, 11), (1, 5120, 11))
    campaign = open_campaign(path)
    assert_array_equal(campaign.trajectories(0).x[10_240:], chunk(sizes, 0, 1, 12_000)["x"])
    assert_array_equal(campaign.trajectories(1).x[10_999, 3:5], chunk(sizes, 1, 1, 11_000)["x"][-1, 3:5])
    assert_array_equal(campaign.trajectories(1).x[[0, -1]][:, 0], campaign.trajectories(1).x[...][[0, -1], 0])
    with pytest.raises(IndexError):
        campaign.trajectories(1).x[11_000]


def test_a_store_without_trajectories_and_impacts_keeps_the_rest(tmp_path):
    path = tmp_path / "thin.zarr"
    sizes = create(path, times_us=np.empty(0), max_impacts=0)
    with DriverStore(path) as store:
        run_candidate(store, 0)
    campaign = open_campaign(path)
    assert "x" not in xarray.open_zarr(path)
    assert campaign.responses(0).impact_time_us is None
    assert_array_equal(campaign.responses(0).final_x[:4], chunk(sizes, 0, 0, 10)["final_x"])
    with pytest.raises(ValueError, match="keeps no trajectories"):
        campaign.trajectories(0)


def test_records_of_more_candidates_than_one_chunk_holds(tmp_path):
    path = tmp_path / "many.zarr"
    sizes = {"n_candidates": 300, "n_switches": 2, "chunk_switches": 2, "times_us": np.empty(0), "max_impacts": 0}
    create(path, **sizes)
    with DriverStore(path) as store:
        for i in range(131):
            store.propose(i, proposal(i, 2))
            store.commit(i, {"failed": True, "failure": f"reason {i}"})
    with DriverStore(path) as store:
        assert store.n_committed == 131
        assert [str(r) for r in store.records()["failure"][126:130]] == [f"reason {i}" for i in range(126, 130)]
        store.propose(131, proposal(131, 2))
    assert len(open_campaign(path).history()) == 131


def test_the_ensemble_is_read_back_in_the_simulators_order(path):
    p = small_store.population()
    expected = np.column_stack([p["D"], p["G"], p["K"], p["M"]])
    assert_array_equal(read_switches(path), expected)
    with DriverStore(path) as store:
        assert_array_equal(store.population, expected)
    assert_array_equal(open_campaign(path).switches(), expected)


def test_a_durable_store_holds_the_same_bits(path, tmp_path):
    create(tmp_path / "durable.zarr", durable=True)
    run(tmp_path / "durable.zarr")
    run(path)
    a, b = xarray.open_zarr(path).load(), xarray.open_zarr(tmp_path / "durable.zarr").load()
    for name in a.variables:
        if not name.startswith("wall_"):
            assert a[name].equals(b[name]), name


def test_a_run_adds_itself_to_the_runtime_group(path):
    with DriverStore(path) as store:
        store.note_run({"host": "one"})
        run_candidate(store, 0)
        store.note_run({"host": "two"})
    assert [r["host"] for r in open_campaign(path).runtime["runs"]] == ["one", "two"]
    assert zarr.open_group(path, mode="r", path="runtime").attrs["runs"] == [{"host": "one"}, {"host": "two"}]
