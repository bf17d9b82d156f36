"""Claims about blocks, records and the commits of waves."""

import asyncio
import errno
import os
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
import xarray
import zarr
from numpy.testing import assert_array_equal

import small_store
from small_store import (
    FAILED,
    SEARCH,
    USED,
    block,
    block_digests,
    create,
    layout,
    proposal,
    rows,
    run,
    run_wave,
    write_wave,
)
from softclose_store import (
    RESPONSE_QUANTITIES,
    DamageError,
    DriverStore,
    LayoutError,
    PopulationColumn,
    RecordError,
    StageLayout,
    assessed_digest,
    create_campaign,
    open_campaign,
    proposals_digest,
    read_population,
    write_block,
)
from softclose_store.write.block import assessed_of, check_block


@pytest.fixture
def path(tmp_path):
    create(tmp_path / "a.zarr")
    return tmp_path / "a.zarr"


def stored(sizes, i):
    """What small_store writes of candidate i, per switch: name -> (n_switches, …)."""
    stage, local = sizes.stage_of(i)
    n = USED.get(i, stage.n_switches)
    row, k = divmod(local, stage.block_candidates)
    parts = [block(sizes, stage.name, row, j, n) for j in range(stage.blocks_of(n))]
    return {name: np.concatenate([part[name][k] for part in parts]) for name in parts[0]}


def test_what_was_written_is_read_back_bit_for_bit(path):
    run(path)
    campaign, sizes = open_campaign(path), layout()
    names = [quantity.name for quantity in RESPONSE_QUANTITIES]
    for i in range(8):
        expected = stored(sizes, i)
        responses, trajectories = campaign.responses(i), campaign.trajectories(i)
        assert_array_equal(trajectories.x, expected["x"])
        assert_array_equal(trajectories.v, expected["v"])
        response = expected["response"]
        for name in ("max_contact_speed", "n_impacts", "final_x", "final_v", "closed", "status"):
            if i not in FAILED or name in ("max_contact_speed", "final_x", "closed", "status"):
                assert_array_equal(getattr(responses, name), response[:, names.index(name)], err_msg=name)
        assert_array_equal(responses.first_contact_us, response[:, names.index("first_contact")])
        assert_array_equal(responses.settling_us, response[:, names.index("settling")])
        assert_array_equal(responses.impact_time_us, expected["impact"][..., 0])
        assert_array_equal(responses.impact_speed, expected["impact"][..., 1])
        assert (responses.status.dtype, responses.n_impacts.dtype, responses.closed.dtype) == (np.int8, np.int32, bool)
        assert_array_equal(campaign.waveform(i), proposal(i)["waveform"])
    assert len(campaign.responses(4).closed) == 7
    assert (campaign.responses(3).status == -1).all()
    assert (campaign.responses(3).n_impacts == -1).all()


def test_the_driver_knows_every_value_that_the_reader_knows(path):
    run(path)
    with DriverStore(path) as store:
        records = store.records()
        assert (store.n_committed, store.n_waves) == (8, 4)
    seen = open_campaign(path).records()
    assert records.keys() == seen.keys()
    for name, values in records.items():
        assert_array_equal(values, seen[name], err_msg=name)
    assert list(records["wave"]) == [0, 0, 0, 0, 1, 2, 2, 3]
    assert list(records["n_switches"]) == [10, 10, 10, 10, 7, 12, 12, 12]
    assert list(records["failed"]) == [i in FAILED for i in range(8)]
    assert str(records["failure"][3]) == "the device model says no"
    assert np.isnan(records["g_cm_s"][3])
    assert records["n_failed_switches"][3] == -1
    assert_array_equal(records["surrogate.noise"], [np.nan if i % 2 == 0 else 0.1 * i for i in range(8)])


def test_a_wave_commits_as_a_whole_and_only_with_all_its_blocks(path):
    with DriverStore(path) as store:
        wave, markers = rows(store.layout, 0), write_wave(store, 0)
        with pytest.raises(RecordError, match="cuts a block"):
            store.commit(wave[:3], markers)
        lost = {at: marker for at, marker in markers.items() if at != (1, 2)}
        with pytest.raises(RecordError, match=r"markers of \[\(1, 2\)\] are missing"):
            store.commit(wave, lost)
        with pytest.raises(RecordError, match=r"those of \[\(2, 0\)\] belong to no block of it"):
            store.commit(wave, {**markers, (2, 0): markers[0, 0]})
        with pytest.raises(RecordError, match="at least one candidate"):
            store.commit([], {})
        assert store.n_committed == 0
        store.commit(wave, markers)
        assert (store.n_committed, store.n_waves) == (4, 1)
    assert open_campaign(path).stages == {"search": 4, "finish": 0}


def test_blocks_of_other_proposals_do_not_count(path):
    with DriverStore(path) as store:
        wave, markers = rows(store.layout, 0), write_wave(store, 0)
        blocks = list(markers)
        right = small_store.block_digests(store.layout, 0, blocks)
        assert store.blocks_done("search", blocks, right) == [True] * 6
        assert store.blocks_done("search", blocks, [right[0] ^ 1, *right[1:]]) == [False, *[True] * 5]
        wave[2] = wave[2] | {"waveform": proposal(7)["waveform"]}
        with pytest.raises(RecordError, match="candidates 2 to 3 are not stored, or of other proposals"):
            store.commit(wave, markers)
        wave[2] = proposal(2) | small_store.record(2)
        marker = markers[0, 1].copy()
        marker[2] = 0
        with pytest.raises(RecordError, match="candidates 0 to 1 are not stored"):
            store.commit(wave, {**markers, (0, 1): marker})
        store.commit(wave, markers)


def test_the_proposals_digest_depends_on_all_that_is_simulated_and_on_the_place():
    a, b = proposal(0)["waveform"], proposal(1)["waveform"]
    padded = np.vstack([a, np.full((1, 4), np.nan)])
    assert proposals_digest([a, b], 10, 4) == proposals_digest([padded, b], 10, 4)
    others = [([b, a], 10, 4), ([a, b], 11, 4), ([a, b], 10, 6), ([a], 10, 4), ([np.vstack([a, b])], 10, 4)]
    assert len({proposals_digest(*other) for other in [([a, b], 10, 4), *others]}) == 6


def test_a_marker_ends_with_the_digest_of_what_the_task_gives_back(path):
    sizes = layout()
    arrays = block(sizes, "search", 1, 2, 9)  # one switch of the two that the block has
    marker = write_block(path, "search", 1, 2, arrays, 77)
    response = arrays["response"]
    back = {
        "max_contact_speed": response[..., 0],
        "closed": response[..., 6] > 0,
        "status": response[..., 7],
        "settling": response[..., 2],
    }
    assert marker[-1] == assessed_digest("search", 1, 2, 77, **back)
    with DriverStore(path) as store:
        stored = store.read_assessed("search", 1, 2, 9)
        assert_array_equal(store.markers("search", [(1, 2)])[1, 2], marker)
        assert not store.markers("search", [(1, 1)])[1, 1].any()
    for name, values in back.items():
        assert_array_equal(stored[name], values, err_msg=name)
    assert marker[-1] == assessed_digest("search", 1, 2, 77, **stored)
    for change in (
        {"closed": ~back["closed"]},
        {"status": back["status"] + 1},
        {"max_contact_speed": response[..., 1]},
        {"settling": response[..., 1]},
    ):
        assert marker[-1] != assessed_digest("search", 1, 2, 77, **(back | change))


def test_a_marked_block_whose_data_is_lost_does_not_count(path):
    with DriverStore(path) as store:
        write_wave(store, 0)
        (path / "search" / "v" / "c.0.1.0").write_bytes(b"")  # as after a loss of power
        blocks = store.layout.wave_blocks(0, 4, 10)
        right = small_store.block_digests(store.layout, 0, blocks)
        assert store.blocks_done("search", blocks, right) == [True, False, True, True, True, True]
        assert store.blocks_done("search", blocks, right, check=False) == [True] * 6
        run_wave(store)
    assert open_campaign(path).committed == 4


@pytest.mark.parametrize("key", ["x/c.0.1.0", "impact/c.1.2.0.0", "block_digest/c.0.0.0"])
def test_every_opening_checks_the_blocks_of_the_last_wave(path, key):
    run(path, 4)
    file = path / "search" / key
    intact = file.read_bytes()
    file.write_bytes(intact[:-1] + bytes([intact[-1] ^ 1]))
    with pytest.raises(DamageError, match=r"block \(., .\) of stage search"):
        DriverStore(path)
    file.write_bytes(intact)
    run(path)


@pytest.mark.parametrize("name", ["records", "words", "surrogate", "digests"])
def test_a_driver_and_a_reader_refuse_damaged_records(path, name):
    run(path, 4)
    file = path / "candidates" / name / "c.0.0"
    intact = file.read_bytes()
    for broken in (intact[:-1], b"", intact[:1] + bytes([intact[1] ^ 4]) + intact[2:]):
        file.write_bytes(broken)
        with pytest.raises(DamageError, match=r"softclose verify .* --repair"):
            DriverStore(path)
        with pytest.raises(DamageError, match=r"softclose verify .* --repair"):
            open_campaign(path).records()
    file.unlink()
    with pytest.raises(DamageError, match=r"softclose verify .* --repair"):
        DriverStore(path)
    file.write_bytes(intact)
    run(path)


def test_a_damaged_read_fails_and_never_yields_data(path):
    run(path, 4)
    file = path / "search" / "x" / "c.0.0.0"
    raw = bytearray(file.read_bytes())
    raw[len(raw) // 3] ^= 16
    file.write_bytes(raw)
    with pytest.raises(DamageError, match="softclose verify"):
        open_campaign(path).trajectories(0).x[0]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"x": None}, "missing: \\['x'\\]"),
        ({"y": np.zeros((2, 4))}, "unknown: \\['y'\\]"),
        ({"x": np.zeros((2, 4, 12), np.float32)}, "must be \\(2, 4, 11\\)"),
        ({"x": np.zeros((2, 5, 11), np.float32)}, "must be \\(2, 4, 11\\)"),
        ({"x": np.zeros((1, 4, 11), np.float32)}, "must be \\(2, 4, 11\\)"),
        ({"response": np.zeros((2, 4))}, "must be \\(2, 4, 8\\)"),
        ({"v": np.zeros((2, 4, 11), complex)}, "must be float32"),
    ],
)
def test_arrays_that_do_not_fit_are_refused_before_anything_is_written(path, change, message):
    arrays = {**block(layout(), "search", 0, 0), **change}
    arrays = {name: values for name, values in arrays.items() if values is not None}
    with pytest.raises(LayoutError, match=message):
        write_block(path, "search", 0, 0, arrays, 1)
    assert not list(path.glob("search/response/c.*"))


@pytest.mark.parametrize(("stage", "i", "j"), [("search", 3, 0), ("search", 0, 3), ("search", -1, 0), ("polish", 0, 0)])
def test_blocks_outside_the_store_are_refused(path, stage, i, j):
    with pytest.raises(LayoutError, match=r"outside the 3 by 3 blocks|no stage"):
        write_block(path, stage, i, j, block(layout(), "search", 0, 0), 1)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"waveform": np.ones((3, 4))}, "1 to 2 pulses"),
        ({"waveform": np.ones(4)}, "1 to 2 pulses"),
        ({"n_switches": 9}, "one wave has one number"),
        ({"n_switches": "ten"}, "must be one number of type int"),
        ({"surrogate": {str(k): 1.0 for k in range(33)}}, "up to 32"),
        ({"surrogate": {"": 1.0}}, "all named"),
        ({"orign": "x"}, "did you mean origin"),
        ({"origin": 3}, "must be text"),
        ({"g_cms": 1.0}, "did you mean g_cm_s"),
        ({"g_cm_s": "high"}, "must be one number of type float"),
        ({"g_cm_s": [1.0]}, "must be one number of type float"),
        ({"n_failed_switches": 1.5}, "must be one number of type int"),
        ({"failed": 2}, "must be one number of type bool"),
        ({"p_exceed": [0.1, 0.2]}, "shape"),
        ({"wave": 7}, "no field 'wave'"),
    ],
)
def test_ill_formed_rows_are_refused_and_nothing_of_their_wave_stays(path, change, message):
    with DriverStore(path) as store:
        markers = write_wave(store, 0)
        wave = rows(store.layout, 0)
        for row in (1, 3):
            spoilt = [r | change if k == row else r for k, r in enumerate(wave)]
            with pytest.raises(RecordError, match=message):
                store.commit(spoilt, markers)
        assert store.n_committed == 0
        assert not (path / "candidates" / "records" / "c.0.0").exists()
        store.commit(wave, markers)
        assert set(store.records()) >= {"surrogate.noise", "surrogate.scale"}
        assert sum(name.startswith("surrogate.") for name in store.records()) == 2


@pytest.mark.parametrize("name", ["waveform", "n_switches", "origin"])
def test_a_row_needs_a_proposal(path, name):
    with DriverStore(path) as store:
        wave = rows(store.layout, 0)
        wave[0] = {k: v for k, v in wave[0].items() if k != name}
        with pytest.raises(RecordError, match=f"{name} is missing"):
            store.commit(wave, write_wave(store, 0))


def test_a_full_disk_commits_nothing_and_leaves_no_temporary_file(path, monkeypatch):
    with DriverStore(path) as store:
        run_wave(store)
        monkeypatch.setenv("SOFTCLOSE_FAULT", "inside-chunk-write:3:raise-enospc")
        monkeypatch.setattr("softclose_store.faults._passages", Counter())
        with pytest.raises(OSError, match="No space left") as error:
            write_wave(store, 4)
        assert error.value.errno == errno.ENOSPC
        blocks = store.layout.wave_blocks(4, 1, 7)
        assert not any(store.blocks_done("search", blocks, small_store.block_digests(store.layout, 4, blocks)))
        monkeypatch.delenv("SOFTCLOSE_FAULT")
        run_wave(store)
    assert not list(path.rglob("*.partial"))
    assert open_campaign(path).committed == 5


def test_a_writer_notices_that_another_store_took_the_path(path, tmp_path):
    run(path, 4)
    path.rename(tmp_path / "old")
    sizes = create(path, layout([replace(SEARCH, n_switches=6, block_switches=6)]))
    with DriverStore(path) as store:
        run_wave(store)
    assert open_campaign(path).trajectories(0).x.shape == (6, 11)
    assert_array_equal(open_campaign(path).trajectories(0).x, block(sizes, "search", 0, 0)["x"][0])


def test_a_block_can_be_written_inside_a_running_event_loop(path):
    async def notebook():
        return write_block(path, "search", 0, 0, block(layout(), "search", 0, 0), 1)

    assert asyncio.run(notebook())[0] == 1


def test_large_blocks_are_sharded_and_their_rows_read_alone(tmp_path, monkeypatch):
    path = tmp_path / "large.zarr"
    stage = StageLayout(name="search", n_candidates=4, n_switches=12_000, block_candidates=2, block_switches=10_240)
    sizes = create(path, layout([stage], max_impacts=1))
    assert (stage.inner, stage.n_block_switches) == ((1, 5120), 2)
    monkeypatch.setattr(small_store, "WAVES", {0: 2, 2: 2})
    monkeypatch.setattr(small_store, "USED", {2: 11_000})
    with DriverStore(path) as store:
        run_wave(store)
        run_wave(store)
    x = zarr.open_group(path, mode="r")["search/x"]
    assert (x.shards, x.chunks) == ((2, 10_240, 11), (1, 5120, 11))
    campaign = open_campaign(path)
    assert_array_equal(campaign.trajectories(1).x[10_240:], block(sizes, "search", 0, 1)["x"][1])
    last = block(sizes, "search", 1, 1, 11_000)["x"][0, -1]
    assert_array_equal(campaign.trajectories(2).x[10_999, 3:5], last[3:5])
    assert_array_equal(campaign.trajectories(2).x[[0, -1]][:, 0], campaign.trajectories(2).x[...][[0, -1], 0])
    with pytest.raises(IndexError):
        campaign.trajectories(2).x[11_000]


def test_a_store_without_trajectories_and_impacts_keeps_the_rest(tmp_path):
    path = tmp_path / "thin.zarr"
    sizes = create(path, layout(times_us=np.empty(0), max_impacts=0))
    run(path, 4)
    campaign = open_campaign(path)
    assert set(xarray.open_zarr(path, group="search").data_vars) == {"response", "block_digest"}
    assert campaign.responses(0).impact_time_us is None
    assert_array_equal(campaign.responses(0).final_x[:4], block(sizes, "search", 0, 0)["response"][0, :, 4])
    with pytest.raises(ValueError, match="keeps no trajectories"):
        campaign.trajectories(0)


def test_records_of_more_candidates_than_one_chunk_holds(tmp_path, monkeypatch):
    path = tmp_path / "many.zarr"
    stage = StageLayout(name="search", n_candidates=300, n_switches=2, block_candidates=50, block_switches=2)
    sizes = create(path, layout([stage], times_us=np.empty(0), max_impacts=0))
    assert (sizes.table_chunk, sizes.n_table_chunks) == (100, 3)
    monkeypatch.setattr(small_store, "WAVES", {0: 50, 50: 200, 250: 50})
    run(path, 250)  # the second wave lies in three chunks
    for name in ("records", "words", "surrogate", "digests", "wall_times"):
        assert sorted(p.name for p in (path / "candidates" / name).glob("c.*")) == ["c.0.0", "c.1.0", "c.2.0"]
    run(path, 300)
    history = open_campaign(path).history()
    assert_array_equal(history.g_cm_s, [np.nan if i in FAILED else 29.5 if i == 4 else 30.0 - i for i in range(300)])
    assert_array_equal(history.wave, [0] * 50 + [1] * 200 + [2] * 50)


def test_of_two_chunks_of_records_the_first_is_written_last(tmp_path, monkeypatch):
    path = tmp_path / "many.zarr"
    stage = StageLayout(name="search", n_candidates=300, n_switches=2, block_candidates=50, block_switches=2)
    create(path, layout([stage], times_us=np.empty(0), max_impacts=0))
    monkeypatch.setattr(small_store, "WAVES", {0: 150})
    monkeypatch.setenv("SOFTCLOSE_FAULT", "inside-record:10:raise-enospc")  # ten chunks: five tables of two
    monkeypatch.setattr("softclose_store.faults._passages", Counter())
    with pytest.raises(OSError, match="No space left"):
        run(path, 150)
    assert (path / "candidates" / "digests" / "c.1.0").exists()
    assert not (path / "candidates" / "digests" / "c.0.0").exists()


def test_the_ensemble_is_read_back_column_by_column(path):
    expected = small_store.population()
    with DriverStore(path) as store:
        of_driver = store.population
    for found in (read_population(path), of_driver, open_campaign(path).population()):
        assert [*found] == [*"DGETKM"]
        for name, values in expected.items():
            assert_array_equal(found[name], values, name)
    assert_array_equal(open_campaign(path).switches(), np.column_stack([expected[name] for name in "DGKM"]))


GAINS = (
    *(PopulationColumn(name, "1", name) for name in "DGKM"),
    PopulationColumn("gain", "1", "gain of its drive"),
    PopulationColumn("celsius", "°C", "its temperature"),
)


def test_a_population_has_the_columns_that_its_layout_says_and_no_others(tmp_path):
    """Whatever a campaign's conditions add to its lot is stored, told in its unit, and kept by an extension."""
    path = tmp_path / "gains.zarr"
    sizes = layout(columns=GAINS)
    rng = np.random.default_rng(3)
    population = {c.name: rng.random(sizes.n_switches) for c in GAINS}
    made = {"config": small_store.CONFIG, "algorithm": "a", "runtime": {}}
    create_campaign(path, layout=sizes, population=population, **made)
    campaign = open_campaign(path)
    assert campaign.layout.columns == GAINS
    assert [*campaign.population()] == [c.name for c in GAINS]
    assert_array_equal(read_population(path)["celsius"], population["celsius"])
    assert campaign.datatree()["population"]["celsius"].attrs == {"units": "°C", "long_name": "its temperature"}
    assert not (path / "population" / "E").exists()
    for wrong in (population | {"E": population["D"]}, {n: v for n, v in population.items() if n != "gain"}):
        with pytest.raises(LayoutError, match="the population has columns"):
            create_campaign(tmp_path / "b.zarr", layout=sizes, population=wrong, **made)
    for bad in (np.nan, np.inf):
        unknown = population | {"gain": np.where(np.arange(sizes.n_switches) == 2, bad, 1.0)}
        with pytest.raises(LayoutError, match=r"population column gain .* all finite"):
            create_campaign(tmp_path / "b.zarr", layout=sizes, population=unknown, **made)


@pytest.mark.parametrize("names", [(), ("D", "D"), ("case",), ("candidate",), ("switch",), ("a b",), ("../x",), (3,)])
def test_columns_that_cannot_be_are_refused(names):
    with pytest.raises(LayoutError, match="the population has columns"):
        layout(columns=tuple(PopulationColumn(name, "1", "x") for name in names))


def test_a_durable_store_holds_the_same_bits(path, tmp_path):
    create(tmp_path / "durable.zarr", durable=True)
    run(tmp_path / "durable.zarr")
    run(path)
    for group in ("candidates", "population", "search", "finish"):
        a, b = (xarray.open_zarr(p, group=group).load() for p in (path, tmp_path / "durable.zarr"))
        for name in a.variables:
            if not name.startswith("wall_"):
                assert a[name].equals(b[name]), name


def test_a_durable_store_syncs_every_file_and_its_folder_before_the_commit_that_relies_on_it(tmp_path, monkeypatch):
    path = tmp_path / "durable.zarr"
    create(path, durable=True)
    steps = []
    opened = {}
    real_open, real_fsync, real_replace = os.open, os.fsync, os.replace

    def open_file(name, *rest, dir_fd=None, **options):
        descriptor = real_open(name, *rest, dir_fd=dir_fd, **options)
        opened[descriptor] = os.fspath(name) if dir_fd is None else f"{opened[dir_fd]}/{name}"
        return descriptor

    def replace(a, b, *, src_dir_fd, dst_dir_fd):
        real_replace(a, b, src_dir_fd=src_dir_fd, dst_dir_fd=dst_dir_fd)
        steps.append(("rename", f"{opened[src_dir_fd]}/{a}", f"{opened[dst_dir_fd]}/{b}"))

    monkeypatch.setattr(os, "open", open_file)
    monkeypatch.setattr(os, "fsync", lambda d: (real_fsync(d), steps.append(("sync", opened[d])))[0])
    monkeypatch.setattr(os, "replace", replace)
    run(path, 4)
    renames = [(k, step[1], step[2]) for k, step in enumerate(steps) if step[0] == "rename"]
    commit = max(k for k, _, target in renames if target == f"{path}/zarr.json")
    assert commit == renames[-1][0]  # the root is the last file of a wave
    assert len(renames) == 6 * 5 + 2 + 5 + 1  # six blocks, the surrogate's names and units, five tables, the root
    for k, temporary, target in renames:
        assert ("sync", temporary) in steps[:k], target
        assert ("sync", os.path.dirname(target)) in steps[k + 1 : max(commit, k + 2)], target


def test_a_run_adds_itself_to_the_runtime_group(path):
    with DriverStore(path) as store:
        store.note_run({"host": "one"})
        run_wave(store)
        store.note_run({"host": "two"})
    assert [r["host"] for r in open_campaign(path).runtime["runs"]] == ["one", "two"]
    assert zarr.open_group(path, mode="r", path="runtime").attrs["runs"] == [{"host": "one"}, {"host": "two"}]


def test_rows_of_a_refused_wave_are_not_written_with_the_next_one(path):
    with DriverStore(path) as store:
        wave, markers = rows(store.layout, 0), write_wave(store, 0)
        with pytest.raises(RecordError, match="must be one number"):
            store.commit([*wave[:3], wave[3] | {"g_cm_s": "high"}], markers)
        store.commit(wave[:2], {at: marker for at, marker in markers.items() if at[0] == 0})
    assert np.isnan(zarr.open_array(path / "candidates" / "records", mode="r")[2:]).all()
    assert not zarr.open_array(path / "candidates" / "digests", mode="r")[2:].any()


def test_of_a_block_whose_marker_is_half_there_nothing_is_done(path):
    with DriverStore(path) as store:
        markers = write_wave(store, 0)
        sizes = store.layout
        blocks = sizes.wave_blocks(0, 4, 10)
        expected = block_digests(sizes, 0, blocks)
        torn = {place: marker.copy() for place, marker in markers.items()}
        torn[blocks[1]][-1] = 0
        with pytest.raises(RecordError, match="are not stored, or of other proposals"):
            store.commit(rows(sizes, 0), torn)
        store._blocks.marker = lambda stage, i, j: torn[i, j]
        assert store.blocks_done("search", blocks[:2], expected[:2], check=False) == [True, False]


def test_the_opening_looks_at_the_blocks_of_the_very_last_wave(path):
    run(path)
    with DriverStore(path) as store:
        stage, local = store.layout.stage_of(7)
        assert (stage.name, local) == ("finish", 2)
    shard = path / "finish" / "x" / "c.2.0.0"
    shard.write_bytes(bytes(len(shard.read_bytes())))
    with pytest.raises(DamageError, match=r"block \(2, 0\) of stage finish"):
        DriverStore(path)


def test_one_wrong_digest_among_many_is_enough_to_refuse_a_wave(path):
    with DriverStore(path) as store:
        markers = write_wave(store, 0)
        last = max(markers)
        markers[last] = markers[last].copy()
        markers[last][0] += np.uint64(1)
        with pytest.raises(RecordError, match="of other proposals"):
            store.commit(rows(store.layout, 0), markers)


def test_a_response_says_who_is_closed_and_who_failed(path):
    with DriverStore(path) as store:
        write_wave(store, 0)
        found = store.read_assessed("search", 1, 0)  # candidates 2 and 3, of which the latter fails
        response = block(store.layout, "search", 1, 0)["response"]
    assert_array_equal(found["closed"], response[..., 6] > 0)
    assert not np.array_equal(found["closed"], response[..., 5] > 0)
    assert_array_equal(found["status"], [[0] * 4, [-1] * 4])
    lost = response.copy()
    lost[0, 0, 7] = np.nan
    assert assessed_of(lost)[2][0, 0] == -1


def test_a_block_of_no_switches_is_none(path):
    with DriverStore(path) as store:
        arrays = {name: values[:, :0] for name, values in block(store.layout, "search", 0, 0).items()}
        with pytest.raises(LayoutError, match="has shape"):
            write_block(path, "search", 0, 0, arrays, 1)


def test_a_block_is_stored_in_the_schemas_types(path):
    with DriverStore(path) as store:
        arrays = block(store.layout, "search", 0, 0)
        values, _ = check_block(store.layout, "search", 0, 0, arrays | {"x": arrays["x"].astype(np.float64)})
        assert {name: v.dtype for name, v in values.items()} == {
            name: np.dtype(dtype) for name, (_, dtype) in store.layout.block_arrays.items()
        }
