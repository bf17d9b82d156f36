"""Claims about finding damage: in any file, of any kind, and files that belong to nothing."""

import json
import random
import shutil
from pathlib import Path

import numpy as np
import pytest
import zarr
from numpy.testing import assert_array_equal

from examples import examples, in_turn, is_whole
from small_store import create, run, write_wave
from softclose_store import DamageError, DriverStore, GroupArray, open_campaign, read_group, verify, write_group
from softclose_store.schema.root import Root
from stores import damage, files_of


@pytest.fixture(scope="module")
def original(tmp_path_factory):
    """A finished campaign with a result group."""
    path = tmp_path_factory.mktemp("finished") / "a.zarr"
    create(path)
    run(path)
    write_group(
        path,
        "certification/one",
        {
            "speed": GroupArray(dims=("switch",), values=np.arange(9.0), unit="cm/s"),
            "name": GroupArray(dims=("k",), values=["a", "µ"]),
        },
        {"n": 9},
    )
    return path


@pytest.fixture
def finished(original, tmp_path):
    """A copy of it, to be damaged."""
    return Path(shutil.copytree(original, tmp_path / "copy.zarr"))


def test_an_intact_store_has_no_problem_and_every_block_was_read(finished):
    told = []
    report = verify(finished, on_block=lambda *block: told.append(block))
    assert report.problems == ()
    assert report.orphans == ()
    assert (report.n_committed, report.n_blocks) == (8, 14)
    search = [("search", i, j) for i in range(3) for j in range(3) if (i, j) != (2, 2)]  # seven switches: two blocks
    assert told == search + [("finish", i, j) for i in range(3) for j in range(2)]


@pytest.mark.sampled
@pytest.mark.parametrize("kind", in_turn(["flip", "truncate", "delete", "append"], 4))
def test_damage_to_any_file_is_found(finished, kind):
    rng = random.Random(f"{kind} 1")
    missed = []
    # One in four of the files (of twelve in `make test`), others for each kind, and always the small ones that hold
    # the rest together.
    special = ("zarr.json", "root.json")
    share = 4 if is_whole() else 12
    chosen = [
        file
        for k, file in enumerate(files_of(finished))
        if (k + len(kind)) % share == 0 or (file.name in special and file.parent in (finished, finished / "digests"))
    ]
    for file in chosen:
        content = file.read_bytes()
        damage(file, kind, rng)
        if verify(finished).ok:
            missed.append(str(file.relative_to(finished)))
        file.write_bytes(content)
    assert missed == []
    assert verify(finished).ok


@pytest.mark.sampled
def test_swapped_files_are_found(finished):
    rng = random.Random(5)
    files = files_of(finished)
    missed = []
    for _ in range(examples(40)):
        a = rng.choice(files)
        alike = [f for f in files if f.name == a.name and f != a] or files
        b = rng.choice(alike if rng.random() < 0.7 else files)
        first, second = a.read_bytes(), b.read_bytes()
        if first == second:
            continue
        a.write_bytes(second)
        b.write_bytes(first)
        if verify(finished).ok:
            missed.append((str(a), str(b)))
        a.write_bytes(first)
        b.write_bytes(second)
    assert missed == []


@pytest.mark.parametrize(
    "key",
    in_turn(
        [
            "search/x/c.3.0.0",  # beyond the last block
            "search/x/c.2.2.0",  # beyond the seven switches of the last wave
            "search/x/c.00.0.0",
            "candidates/records/c.1.0",
            "zarr.json (copy)",
            "notes.txt",
            "mine.partial",
            "search/x/notes.txt",
            "..a/b",
        ],
        3,
    ),
)
def test_a_file_that_belongs_to_nothing_is_named(finished, key):
    stray = finished / key
    stray.parent.mkdir(exist_ok=True)
    stray.write_bytes(b"?")
    (problem,) = verify(finished).problems
    assert (problem.kind, problem.key) == ("unknown", key)
    stray.unlink()
    if not any(stray.parent.iterdir()):
        stray.parent.rmdir()


def test_a_link_is_a_file_like_any_other_and_not_followed(finished, tmp_path):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "zarr.json").write_text("{}")
    (finished / "linked").symlink_to(tmp_path / "elsewhere")
    (problem,) = verify(finished).problems
    assert (problem.kind, problem.key) == ("unknown", "linked")
    (finished / "linked").unlink()


def test_what_a_kill_left_behind_is_only_listed(finished):
    left = finished / "search" / "x" / f"c.0.0.0.{'0a' * 16}.partial"
    left.write_bytes(b"?")
    report = verify(finished)
    assert report.ok
    assert report.orphans == (f"search/x/{left.name}",)
    left.unlink()


def test_an_unfinished_campaign_with_blocks_in_flight_is_whole(tmp_path):
    path = tmp_path / "a.zarr"
    create(path)
    run(path, 4)
    with DriverStore(path) as store:
        write_wave(store, 4)
        write_wave(store, 5)
    for key in ("search/block_digest/c.2.1.0", "finish/block_digest/c.1.0.0", "finish/block_digest/c.1.1.0"):
        (path / key).unlink()  # not stored to the end: not looked at
    report = verify(path)
    assert report.ok, report.problems
    assert report.n_blocks == 6 + 1 + 2
    (path / "finish" / "x" / "c.0.1.0").unlink()
    (path / "search" / "block_digest" / "c.2.0.0").write_bytes(b"")
    report = verify(path)
    assert [(p.kind, p.block) for p in report.problems] == [
        ("pending", ("search", 2, 0)),
        ("pending", ("finish", 0, 1)),
    ]


def test_a_store_that_was_killed_within_its_commit_is_whole(tmp_path, monkeypatch):
    path = tmp_path / "a.zarr"
    create(path)
    monkeypatch.setenv("SOFTCLOSE_FAULT", "before-commit:1:raise-enospc")
    monkeypatch.setattr("softclose_store.faults._passages", __import__("collections").Counter())
    with pytest.raises(OSError, match="No space"):
        run(path, 4)  # new names of surrogate quantities are written, and are not yet the root's
    assert verify(path).problems == ()
    assert open_campaign(path).committed == 0


def test_what_is_damaged_is_said_in_numbers(finished):
    for key, found in (
        ("candidates/records/c.0.0", {"proposal": list(range(8)), "record": list(range(8))}),
        ("candidates/words/c.0.0", {"proposal": list(range(8)), "record": list(range(8))}),
        ("candidates/wall_times/c.0.0", {"timings": list(range(8))}),
        ("candidates/surrogate/c.0.0", {"proposal": list(range(8))}),
    ):
        file = finished / key
        content = file.read_bytes()
        file.write_bytes(content[:-2])
        report = verify(finished)
        assert {p.kind for p in report.problems} == set(found), key
        for kind, candidates in found.items():
            assert sorted({p.candidate for p in report.problems if p.kind == kind}) == candidates
        assert report.damaged_records == list(range(8))
        assert report.damaged_blocks == []
        file.write_bytes(content)
    file = finished / "finish" / "impact" / "c.1.1.0.0"
    content = file.read_bytes()
    file.write_bytes(content[:-2])
    assert verify(finished).damaged_blocks == [("finish", 1, 1)]
    file.write_bytes(content)


def test_a_marker_that_is_intact_and_of_another_time_is_found(finished):
    """A block and its marker replaced together by others of the same proposals are not those of the record."""
    file = finished / "finish" / "block_digest" / "c.2.0.0"
    content = file.read_bytes()
    array = zarr.open_array(finished / "finish" / "block_digest", mode="r+")
    marker = array[2, 0]
    marker[-1] ^= np.uint64(1)
    array[2, 0] = marker
    report = verify(finished)
    assert report.damaged_blocks == [("finish", 2, 0), ("finish", 2, 1)]
    assert all("is not that of candidate 7's record" in p.what for p in report.problems)
    file.write_bytes(content)


def test_a_damaged_root_is_said_and_the_rest_is_checked_by_what_remains(finished):
    content = (finished / "zarr.json").read_bytes()
    block = finished / "search" / "v" / "c.0.0.0"
    intact = block.read_bytes()
    for broken in (b"", content.replace(b'"n_committed":8', b'"n_committed":4')):
        (finished / "zarr.json").write_bytes(broken)
        report = verify(finished)
        assert ({p.kind for p in report.problems}, report.n_committed, report.n_blocks) == ({"root"}, 8, 14)
        block.write_bytes(intact[:-3])
        assert verify(finished).damaged_blocks == [("search", 0, 0)]
        block.write_bytes(intact)
    (finished / "zarr.json").write_bytes(content)


def test_a_group_whose_own_metadata_is_lost_is_damaged_and_no_stray(finished):
    own = finished / "certification" / "one" / "zarr.json"
    content = own.read_bytes()
    for broken in (None, b"", content[:50]):
        own.unlink() if broken is None else own.write_bytes(broken)
        report = verify(finished)
        assert [p.kind for p in report.problems] == ["group"]
        assert report.damaged_groups == ["certification/one"]
    own.write_bytes(content)


def test_result_groups_appear_whole_and_are_checked_when_read(finished):
    group = read_group(finished, "certification/one")
    assert group.attributes == {"n": 9}
    assert_array_equal(group.arrays["speed"], np.arange(9.0))
    assert [str(n) for n in group.arrays["name"]] == ["a", "µ"]
    assert open_campaign(finished).finished
    file = finished / "certification" / "one" / "speed" / "c" / "0"
    content = file.read_bytes()
    file.write_bytes(content[:-1])
    with pytest.raises(DamageError, match="certification/one/speed"):
        read_group(finished, "certification/one")
    file.write_bytes(content)


def test_a_root_whose_configuration_was_edited_with_its_digest_is_not_the_campaigns(finished):
    content = (finished / "zarr.json").read_bytes()
    document = json.loads(content)
    document["attributes"]["config"]["campaign"]["seed"] = 8
    (finished / "zarr.json").write_bytes(Root(document).encode())
    assert any("fingerprint" in p.what for p in verify(finished).problems)
    (finished / "zarr.json").write_bytes(content)


@pytest.mark.parametrize(
    "key", ["candidates/digests/c.0.0", "search/x/c.0.0.0", "search/block_digest/c.0.0.0", "population/D/c.0"]
)
def test_other_bytes_in_the_place_of_text_are_refused_before_they_are_taken_for_a_number_of_words(finished, key):
    for text in ("candidates/words/c.0.0", "candidates/field/c.0"):
        (finished / text).write_bytes((finished / key).read_bytes())
        with pytest.raises(RuntimeError, match="Zstd"):
            zarr.open_array(finished / text.rpartition("/")[0], mode="r")[...]
    assert {p.kind for p in verify(finished).problems} == {"static", "proposal", "record"}


@pytest.mark.parametrize("name", ["population/D", "finish/time", "candidates/records", "candidates/hyperparameter"])
def test_an_array_with_the_metadata_of_a_larger_one_is_not_read_by_it(finished, name):
    before = open_campaign(finished).records()["g_cm_s"]
    document = json.loads((finished / "search" / "x" / "zarr.json").read_bytes())
    document["shape"] = [10**6, 10**6, 1001]  # four petabytes
    (finished / name / "zarr.json").write_text(json.dumps(document))
    assert "schema" in {p.kind for p in verify(finished).problems}
    assert_array_equal(open_campaign(finished).records()["g_cm_s"], before)  # readers go by the schema
    with pytest.raises(DamageError, match=f"{name}/zarr.json of .* is not what was written: run `softclose verify"):
        DriverStore(finished)


@pytest.mark.parametrize("key", ["population/D/c.0", "finish/time/c.0", "search/x/zarr.json", "zarr.json"])
def test_damage_is_told_by_the_key_of_the_file_that_is_damaged(finished, key):
    """What repair goes by."""
    (finished / key).write_bytes(b"\x00")
    assert key in {p.key for p in verify(finished).problems}


def test_a_store_of_whose_root_nothing_is_left_has_nothing_committed(finished):
    for key in ("zarr.json", "candidates/digests/root.json"):
        (finished / key).write_bytes(b"\x00")
    report = verify(finished)
    assert report.n_committed == 0
    assert "its copy is damaged too" in report.problems[0].what
