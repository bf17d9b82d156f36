"""Claims about repair: what was damaged is there again bit for bit, proved by digests, and nothing good is lost."""

import json
import random
import shutil
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import zarr
from numpy.testing import assert_array_equal

import small_store
from examples import in_turn
from small_store import create, population, proposal, record, run, write_wave
from softclose_store import (
    DamageError,
    DriverStore,
    GroupArray,
    LockedError,
    StoreError,
    list_groups,
    open_campaign,
    read_group,
    repair,
    verify,
    write_group,
)
from softclose_store.schema import digests
from softclose_store.schema.hierarchy import HYPERPARAMETER, HYPERPARAMETER_UNIT, TABLES
from stores import damage, differences, files_of

GROUP = "certification/one"


def certify(path):
    arrays = {
        "speed": GroupArray(dims=("switch",), values=np.arange(9.0), unit="cm/s"),
        "name": GroupArray(dims=("k",), values=["a", "µ"]),
    }
    write_group(path, GROUP, arrays, {"n": 9}, replace=True)


def recompute(**changes):
    """How small_store's numbers, and the result group, are computed again."""

    def group(path, name, attributes):
        if name == GROUP:
            certify(path)
        return "" if name == GROUP else "unknown"

    return replace(small_store.recompute(), **({"group": group} | changes))


@pytest.fixture(scope="module")
def original(tmp_path_factory):
    """A finished campaign with a result group."""
    path = tmp_path_factory.mktemp("repaired") / "a.zarr"
    create(path)
    run(path)
    certify(path)
    return path


@pytest.fixture
def finished(original, tmp_path):
    """A copy of it, to be damaged."""
    return Path(shutil.copytree(original, tmp_path / "copy.zarr"))


def contents(path):
    return {file.relative_to(path).as_posix(): file.read_bytes() for file in files_of(path)}


SINGLE = (
    "zarr.json",
    "candidates/digests/root.json",
    "runtime/zarr.json",
    "search/zarr.json",
    "search/x/zarr.json",
    "candidates/records/zarr.json",
    "population/D/c.0",
    "finish/time/c.0",
    "candidates/field/c.0",
    "candidates/hyperparameter/c.0",
    "candidates/records/c.0.0",
    "candidates/words/c.0.0",
    "candidates/surrogate/c.0.0",
    "search/block_digest/c.1.0.0",
    "search/x/c.2.1.0",
    "finish/response/c.1.1.0",
    "certification/zarr.json",
    "certification/one/zarr.json",
    "certification/one/speed/c/0",
)


@pytest.mark.parametrize("key", in_turn(SINGLE, 12))
def test_any_kind_of_file_is_written_again_as_it_was_and_proved(finished, original, key):
    rng = random.Random(key)
    for kind in rng.sample(["flip", "truncate", "delete", "append"], 2):
        damage(finished / key, kind, rng)
        assert not verify(finished).ok
        done = repair(finished, recompute())
        assert done.ok, done.after.problems
        assert contents(finished) == contents(original)
        if not key.startswith("certification"):
            assert done.proved
            assert not done.unproved


def test_lost_digests_are_computed_again_and_said_to_be_unproved(finished, original):
    (finished / "candidates" / "digests" / "c.0.0").unlink()
    done = repair(finished, recompute())
    assert done.ok
    assert len(done.unproved) == 16  # proposal and record of each candidate
    assert contents(finished) == contents(original)


def test_one_pass_repairs_everything(finished, original):
    rng = random.Random(3)
    keys = [*SINGLE, "v", "finish/impact/c.0.0.0.0", "search/block_digest/c.0.1.0", "candidates/digests/c.0.0"]
    for key in keys:
        if key != "v":
            damage(finished / key, rng.choice(["flip", "truncate", "delete"]), rng)
    shutil.copy(
        original / "candidates" / "digests" / "root.json", finished / "candidates" / "digests" / "root.json"
    )  # or nothing says what it is
    shutil.rmtree(finished / "search" / "v")
    (finished / "zarr.json (copy)").write_bytes(b"?")
    done = repair(finished, recompute())
    assert done.ok, done.after.problems
    assert contents(finished) == contents(original)


def test_repairs_at_random_give_the_same_store(finished, original):
    rng = random.Random(12)
    for _ in range(4):
        keys = [
            k
            for k in contents(original)
            if not k.startswith("candidates/wall_times/c.") and k != "candidates/digests/root.json"
        ]
        for key in rng.sample(keys, 12):
            damage(finished / key, rng.choice(["flip", "truncate", "delete", "append"]), rng)
        done = repair(finished, recompute())
        assert done.ok, done.after.problems
        assert contents(finished) == contents(original)


def test_names_of_surrogate_quantities_that_are_lost_with_the_root_come_back(finished, original):
    for key in ("zarr.json", "candidates/hyperparameter/c.0"):
        (finished / key).write_bytes(b"")
    done = repair(finished, recompute())
    assert done.ok, done.after.problems
    assert {"surrogate.noise", "surrogate.scale"} <= set(open_campaign(finished).records())
    assert contents(finished) == contents(original)


def test_a_folder_in_the_place_of_a_file_is_somebodys_and_kept(finished, original):
    key = "search/x/c.0.0.0"
    (finished / key).unlink()
    (finished / key).mkdir()
    (finished / key / "thesis.tex").write_text("precious")
    done = repair(finished, recompute())
    assert done.ok, done.after.problems
    assert contents(finished) == contents(original)
    assert (finished.with_name("copy.zarr.strays") / key / "thesis.tex").read_text() == "precious"


def test_lost_timings_are_said_to_be_lost(finished, original):
    (finished / "candidates" / "wall_times" / "c.0.0").unlink()
    done = repair(finished, recompute())
    assert done.ok
    assert done.unproved == tuple(f"timings of candidate {i} are lost" for i in range(8))
    assert differences(finished, original) == []


@pytest.mark.parametrize(
    "lost", in_turn([["records"], ["digests"], ["digests", "records"], ["digests", "words", "wall_times"]], 2)
)
@pytest.mark.parametrize("fate", ["emptied", pytest.param("deleted", marks=pytest.mark.long)])
def test_without_its_root_a_store_still_knows_how_much_was_committed(finished, original, lost, fate):
    for key in ["zarr.json", *(f"candidates/{name}/c.0.0" for name in lost)]:
        (finished / key).write_bytes(b"") if fate == "emptied" else (finished / key).unlink()
    assert verify(finished).n_committed == 8
    done = repair(finished, recompute())
    assert done.ok, done.after.problems
    certain = "digests" not in lost
    said = [what for what in (done.proved if certain else done.unproved) if "8 committed candidates" in what]
    assert len(said) == 1
    assert differences(finished, original) == []
    assert open_campaign(finished).n_waves == 4


@pytest.mark.parametrize("fate", in_turn(["emptied", "deleted"], 2, 1))
def test_without_its_root_and_all_tables_a_store_says_that_it_does_not_know_and_a_resume_finds_the_blocks(
    finished, original, fate
):
    for key in [
        "zarr.json",
        *(f"candidates/{name}/c.0.0" for name in ("records", "digests", "words", "wall_times", "surrogate")),
    ]:
        (finished / key).write_bytes(b"") if fate == "emptied" else (finished / key).unlink()
    assert not verify(finished).ok
    done = repair(finished, recompute())
    assert "0 committed candidates: the most that any table says" in done.unproved[0]
    blocks = {file: file.stat().st_mtime_ns for file in finished.glob("*/x/c.*")}
    run(finished)
    assert differences(finished, original) == []
    assert {file: file.stat().st_mtime_ns for file in blocks} == blocks


def test_the_root_of_an_unfinished_store_comes_back_at_its_last_commit(tmp_path):
    path = tmp_path / "a.zarr"
    create(path)
    for until in (0, 4, 5):
        run(path, until)
        with DriverStore(path) as store:
            write_wave(store, store.n_committed)  # in flight
        content = (path / "zarr.json").read_bytes()
        (path / "zarr.json").unlink()
        done = repair(path, recompute())
        assert done.ok
        assert [what for what in done.unproved if "rebuilt" not in what] == []
        assert bool(done.unproved) == (until == 0)  # blocks and no table: never written, or lost
        assert (path / "zarr.json").read_bytes() == content


@pytest.mark.parametrize("point", in_turn(["inside-record:4", "inside-record:5", "after-record:1"], 3, 1))
def test_a_root_that_is_lost_after_a_kill_within_a_commit_comes_back_with_whole_waves(tmp_path, monkeypatch, point):
    path = tmp_path / "a.zarr"
    create(path)
    run(path, 4)
    monkeypatch.setenv("SOFTCLOSE_FAULT", f"{point}:raise-enospc")
    monkeypatch.setattr("softclose_store.faults._passages", Counter())
    with pytest.raises(OSError, match="No space"):
        run(path, 5)
    monkeypatch.delenv("SOFTCLOSE_FAULT")
    (path / "zarr.json").write_bytes(b"")
    assert repair(path, recompute()).ok
    assert open_campaign(path).committed in (4, 5)
    run(path)
    assert verify(path).ok


def test_a_stray_is_moved_aside_and_never_costs_a_good_file(finished, original, tmp_path):
    strays = ("zarr.json (copy)", "search/x/zarr.json.bak", "search/x/c.9.0.0", "zarr.json is not what was written")
    for key in strays:
        (finished / key).write_bytes(key.encode())
    (tmp_path / "victim").mkdir()
    (tmp_path / "victim" / "thesis.tex").write_text("precious")
    (finished / "linked").symlink_to(tmp_path / "victim")
    done = repair(finished, recompute())
    assert done.ok
    assert contents(finished) == contents(original)
    aside = finished.with_name("copy.zarr.strays")
    assert {key: (aside / key).read_bytes() for key in strays} == {key: key.encode() for key in strays}
    assert (aside / "linked").is_symlink()
    assert (tmp_path / "victim" / "thesis.tex").read_text() == "precious"
    assert [what for what in done.proved if "it is now" in what and str(aside) in what]
    (finished / "zarr.json (copy)").write_bytes(b"another")
    repair(finished, recompute())
    assert (aside / "zarr.json (copy)").read_bytes() == b"zarr.json (copy)"
    assert (aside / "zarr.json (copy).1").read_bytes() == b"another"


def test_a_stray_behind_a_url_is_moved_aside_too():
    from softclose_store.disk.files import open_files, read_key, write_key

    url = "memory://test-strays/a.zarr"
    create(url)
    run(url)
    write_key(open_files(url, read_only=False), "notes.txt", b"mine")
    assert repair(url, recompute()).ok
    assert read_key(open_files(f"{url}.strays", read_only=True), "notes.txt") == b"mine"


@pytest.mark.parametrize("what", in_turn(["block", "proposals", "record", "population"], 2))
def test_a_repair_that_computes_something_else_is_refused_and_changes_nothing(finished, what):
    right = recompute()

    def other_block(store, stage, i, j):
        arrays = right.block(store, stage, i, j)
        return arrays | {"v": arrays["v"] + np.float32(1e-6)}

    key, wrong = {
        "block": ("search/v/c.0.0.0", other_block),
        "proposals": (
            "candidates/words/c.0.0",
            lambda store, start, size: [proposal(i + 1) for i in range(start, start + size)],
        ),
        "record": ("candidates/records/c.0.0", lambda store, i: record(i) | {"p_nc": 0.2}),
        "population": ("population/D/c.0", lambda config: population() | {"D": np.ones(12)}),
    }[what]
    (finished / key).write_bytes(b"")
    before = contents(finished)
    with pytest.raises(DamageError, match="is not what was stored"):
        repair(finished, replace(right, **{what: wrong}))
    after = contents(finished)
    assert {k: v for k, v in after.items() if v != before.get(k)} == {}
    assert repair(finished, right).ok


@pytest.mark.parametrize("lost", in_turn([["block_digest"], ["block_digest", "v"]], 2))
def test_where_a_marker_is_lost_the_records_tell_whether_the_block_is_the_same(finished, original, lost):
    right = recompute()

    def other(store, stage, i, j):
        arrays = right.block(store, stage, i, j)
        return arrays | {"v": arrays["v"] + np.float32(1e-6)}

    for name in lost:
        (finished / "search" / name / "c.0.0.0").unlink()
    before = contents(finished)
    with pytest.raises(DamageError, match="is not what was stored"):
        repair(finished, replace(right, block=other))
    assert contents(finished) == before
    done = repair(finished, right)
    assert done.ok
    assert done.unproved == ()
    assert contents(finished) == contents(original)


def test_a_marker_of_another_time_is_corrected_by_the_records(finished, original):
    array = zarr.open_array(finished / "finish" / "block_digest", mode="r+")
    marker = array[2, 0]
    marker[-1] ^= np.uint64(1)
    array[2, 0] = marker
    assert repair(finished, recompute()).ok
    assert contents(finished) == contents(original)


def test_damaged_blocks_of_a_wave_in_flight_go_and_a_resume_computes_them(tmp_path, original):
    path = tmp_path / "a.zarr"
    create(path)
    run(path, 4)
    with DriverStore(path) as store:
        write_wave(store, 4)
        write_wave(store, 5)
    (path / "finish" / "x" / "c.0.1.0").write_bytes(b"")
    kept = (path / "finish" / "x" / "c.0.0.0").stat().st_mtime_ns
    done = repair(path, recompute())
    assert done.ok
    assert not list(path.glob("finish/*/c.0.1.0*"))
    run(path)
    certify(path)
    assert differences(path, original) == []
    assert (path / "finish" / "x" / "c.0.0.0").stat().st_mtime_ns == kept


def test_what_a_kill_left_behind_goes(finished):
    (finished / "search" / "x" / f"c.0.0.0.{'0a' * 16}.partial").write_bytes(b"?")
    assert repair(finished, recompute()).ok
    assert not list(finished.rglob("*.partial"))


def test_a_store_that_is_being_driven_is_not_repaired(finished):
    with DriverStore(finished), pytest.raises(LockedError):
        repair(finished, recompute())


def test_a_group_that_nobody_can_compute_again_stays_as_it_is(finished):
    (finished / "certification" / "one" / "speed" / "c" / "0").write_bytes(b"")
    before = contents(finished)
    done = repair(finished, recompute(group=None))
    assert not done.ok
    assert done.failed == (f"group {GROUP}: nobody knows how to compute it again",)
    assert done.after.damaged_groups == [GROUP]
    assert contents(finished) == before


def test_metadata_of_a_group_and_their_copy_give_each_other_back_and_without_both_the_repair_says_what_to_do(
    finished, original
):
    own, copy = finished / GROUP / "zarr.json", finished / GROUP / "name" / "group.json"
    for file in (own, copy):
        file.unlink()
        done = repair(finished, recompute(group=None))
        assert done.ok
        assert done.unproved == ()
        assert contents(finished) == contents(original)
    own.write_bytes(b"")
    copy.write_bytes(b"")
    done = repair(finished, recompute(group=lambda path, name, attributes: "its name does not say enough"))
    assert not done.ok
    assert done.failed[0].endswith(f"delete {finished}/{GROUP} and make it again")
    shutil.copytree(finished, finished.with_name("other.zarr"))
    shutil.rmtree(finished / GROUP)  # as it says
    assert verify(finished).ok
    done = repair(finished.with_name("other.zarr"), recompute())  # one whose name says all of it
    assert done.ok
    assert "of whose metadata nothing was left, computed again" in done.unproved[0]
    assert contents(finished.with_name("other.zarr")) == contents(original)


def test_metadata_of_another_group_are_none_of_a_groups_own(finished, original):
    write_group(finished, "certification/two", {"speed": GroupArray(dims=("switch",), values=np.arange(3.0))}, {})
    before = contents(finished)
    (finished / GROUP / "zarr.json").write_bytes(before["certification/two/zarr.json"])
    with pytest.raises(DamageError, match=r"certification/one/zarr\.json is lost or not what was written"):
        read_group(finished, GROUP)
    assert repair(finished, recompute(group=None)).ok
    assert contents(finished) == before


def test_a_root_of_an_earlier_time_is_brought_forward(finished, original):
    content = (finished / "zarr.json").read_bytes()
    (finished / "zarr.json").write_bytes((finished / "candidates" / "digests" / "root.json").read_bytes())
    (problem,) = verify(finished).problems
    assert "it says 0 waves, the records say 4" in problem.what
    assert repair(finished, recompute()).ok
    assert (finished / "zarr.json").read_bytes() == content


def test_the_roots_copy_is_written_again_as_it_was_and_a_kill_as_a_run_begins_is_no_damage(finished):
    from softclose_store.schema.opening import decode_root
    from softclose_store.schema.root import runtime_text

    copy = (finished / "candidates" / "digests" / "root.json").read_bytes()
    with DriverStore(finished) as store:
        store.note_run({"host": "there"})
    (finished / "candidates" / "digests" / "root.json").unlink()
    assert repair(finished, recompute()).ok
    assert (finished / "candidates" / "digests" / "root.json").read_bytes() == copy
    ahead = decode_root((finished / "zarr.json").read_bytes(), "").noted({"host": "elsewhere"})
    (finished / "runtime" / "zarr.json").write_bytes(runtime_text(ahead))
    assert verify(finished).ok


@pytest.mark.parametrize(
    "name",
    in_turn(
        [
            "../../../victim.txt",
            "/etc/hostname",
            "speed/../../../victim.txt",
            "..",
            "speed",
            "zarr.json",
            "a/b/zarr.json",
        ],
        3,
    ),
)
def test_a_group_that_lists_files_of_others_is_damaged_and_they_are_not_touched(finished, name):
    victim = finished.parent / "victim.txt"
    victim.write_text("precious")
    own = finished / "certification" / "one" / "zarr.json"
    document = json.loads(own.read_bytes())
    document["attributes"]["softclose_files"][name] = digests.sha256(b"precious")
    document["attributes"].pop("softclose_digest")
    document["attributes"]["softclose_digest"] = digests.sha256(digests.canonical_json(document).encode())
    own.write_bytes(json.dumps(document, indent=1, sort_keys=True).encode())
    assert [p.kind for p in verify(finished).problems if p.group] == ["group"]
    before = contents(finished)
    for use in (lambda: certify(finished), lambda: read_group(finished, GROUP)):
        with pytest.raises(DamageError, match="no file of an array of it"):
            use()
    assert contents(finished) == before
    assert victim.read_text() == "precious"


def test_a_group_is_not_written_through_a_link(finished, tmp_path):
    (tmp_path / "victim").mkdir()
    (finished / "other").symlink_to(tmp_path / "victim")
    with pytest.raises(StoreError, match="is a link"):
        write_group(finished, "other/one", {"a": GroupArray(dims=("k",), values=[1.0])}, {})
    assert not list((tmp_path / "victim").iterdir())


@pytest.mark.parametrize("name", ["../a", "a/../b", "/a", "A", "a//b", "search/a", "a/..b"])
def test_a_groups_name_stays_in_the_store_and_out_of_the_campaign(finished, name):
    with pytest.raises(StoreError, match="group"):
        write_group(finished, name, {}, {})
    assert list_groups(finished) == [GROUP]


def test_arrays_that_are_described_alike_keep_their_own_values_and_others_their_own_words(finished):
    """Their metadata are made once for all of them."""
    values = {"a": np.arange(3.0), "b": np.ones(3), "c": np.arange(3.0), "d": np.arange(3)}
    arrays = {k: GroupArray(dims=("s",), values=v, unit="V" if k == "c" else "cm/s") for k, v in values.items()}
    for name in ("alike/one", "alike/two"):
        write_group(finished, name, arrays, {})
        for key, expected in values.items():
            stored = zarr.open_array(finished / name / key, mode="r")
            assert stored.dtype == expected.dtype
            assert stored.attrs["units"] == arrays[key].unit
            assert_array_equal(read_group(finished, name).arrays[key], expected)
    assert verify(finished).ok


def test_a_group_replaces_another_whole(finished):
    write_group(finished, GROUP, {"other": GroupArray(dims=("k",), values=[1, 2])}, {}, replace=True)
    assert_array_equal(read_group(finished, GROUP).arrays["other"], [1, 2])
    assert not (finished / "certification" / "one" / "speed" / "zarr.json").exists()
    assert verify(finished).ok
    with pytest.raises(StoreError, match="has a group certification/one already"):
        write_group(finished, GROUP, {}, {})


def test_damage_of_every_kind_in_one_store_is_repaired_in_one_go(finished, original):
    """A group that cannot be made again does not keep the ones after it from being repaired, in whatever order."""
    for name in ("certification/aaa", "certification/mmm", "certification/zzz"):
        write_group(finished, name, {"speed": GroupArray(dims=("s",), values=np.arange(3.0), unit="cm/s")}, {})
    shutil.copytree(finished / "certification/mmm", finished.parent / "intact")
    for name in ("aaa", "one", "zzz"):
        (finished / f"certification/{name}/speed/c/0").write_bytes(b"\x00")
    (finished / "certification/mmm/zarr.json").unlink()
    for key in ("search/x/c.2.1.0", "candidates/records/c.0.0"):
        (finished / key).write_bytes(b"\x00")
    done = repair(finished, recompute())
    assert [line.partition(":")[0] for line in done.failed] == ["group certification/aaa", "group certification/zzz"]
    assert contents(finished / "certification/mmm") == contents(finished.parent / "intact")
    for name in ("aaa", "zzz"):
        shutil.rmtree(finished / f"certification/{name}")
    shutil.rmtree(finished / "certification/mmm")
    assert {problem.kind for problem in verify(finished).problems} == {"listing"}
    assert repair(finished, recompute()).ok
    assert contents(finished) == contents(original)


def test_a_group_made_again_is_proved_only_where_it_is_the_same(finished):
    def other(path, name, attributes):
        write_group(path, name, {"speed": GroupArray(dims=("s",), values=np.ones(9), unit="cm/s")}, {}, replace=True)
        return ""

    (finished / "certification/one/speed/c/0").write_bytes(b"\x00")
    done = repair(finished, recompute(group=other))
    assert done.ok
    assert (done.proved, done.unproved) == ((), ("group certification/one computed again",))


def test_of_a_group_that_is_lost_whole_the_root_says_what_it_was_made_for_and_proves_it(finished, original, tmp_path):
    told = []

    def group(path, name, attributes):
        told.append((name, attributes))
        certify(path)
        return ""

    (finished / "certification").rename(tmp_path / "elsewhere")
    (finished / "certification").symlink_to(tmp_path / "elsewhere")
    done = repair(finished, recompute(group=group))
    assert done.ok
    assert told == [(GROUP, {"n": 9})]
    assert f"group {GROUP}, of whose metadata nothing was left, computed again" in done.proved
    assert contents(finished) == contents(original)


def test_digests_of_other_candidates_are_written_again_where_the_values_prove_themselves(finished):
    """Both are whole files: what is computed again says which of the two is foreign."""
    before = contents(finished)
    file = finished / "candidates" / "digests" / "c.0.0"
    stored = zarr.open_array(finished / "candidates" / "digests", mode="r+")
    stored[...] = np.roll(stored[...], 1, axis=0)
    assert file.read_bytes() != before["candidates/digests/c.0.0"]
    with pytest.raises(DamageError, match="the record of candidate 0 is damaged"):
        open_campaign(finished).records()
    mended = repair(finished, recompute())
    assert mended.ok
    assert not mended.unproved
    assert contents(finished) == before


@pytest.mark.parametrize("name", in_turn([*TABLES, HYPERPARAMETER, HYPERPARAMETER_UNIT], 3))
def test_an_empty_folder_in_the_place_of_a_table_s_file_makes_way(original, tmp_path, name):
    path = Path(shutil.copytree(original, tmp_path / "a.zarr"))
    (file,) = (path / name).glob("c.*")
    file.unlink()
    file.mkdir()
    assert repair(path, recompute()).ok
    assert differences(original, path) == []


@pytest.mark.parametrize("folder", in_turn(["digests", "records", "hyperparameter"], 3))
def test_a_link_in_the_place_of_a_folder_of_a_table_makes_way(original, tmp_path, folder):
    path = Path(shutil.copytree(original, tmp_path / "a.zarr"))
    outside = Path(shutil.move(path / "candidates" / folder, tmp_path / "outside"))
    before = {file.name: file.read_bytes() for file in outside.iterdir()}
    (path / "candidates" / folder).symlink_to(outside)
    assert repair(path, recompute()).ok
    assert differences(original, path) == []
    assert {file.name: file.read_bytes() for file in outside.iterdir()} == before
