"""Claims about finding damage, and repairing it."""

import random
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import small_store
from small_store import chunk, create, layout, population, proposal, record, run, run_candidate
from softclose_store import (
    DamageError,
    DriverStore,
    GroupArray,
    Recompute,
    open_campaign,
    read_group,
    repair,
    verify,
    write_group,
)
from stores import differences


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A finished campaign of two candidates with a result group."""
    path = tmp_path_factory.mktemp("finished") / "a.zarr"
    create(path, n_candidates=2, n_switches=5, chunk_switches=4)
    run_all(path)
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


def run_all(path):
    with DriverStore(path) as store:
        for i in range(2):
            run_candidate(store, i, 5 - i)


def files_of(path: Path) -> list[Path]:
    return sorted(p for p in path.rglob("*") if p.is_file())


def restore(saved):
    for file, content in saved.items():
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(content)


def recompute():
    def known(store, i):
        return 5 - i

    return Recompute(
        population=lambda config: population(5),
        times_us=lambda config: layout().times_us,
        proposal=lambda store, i: proposal(i, known(store, i)),
        chunk=lambda store, i, i_chunk: chunk(store.layout, i, i_chunk, known(store, i)),
        record=lambda store, i: {k: v for k, v in record(i).items() if not k.startswith("wall_")},
    )


def damage(file: Path, kind: str, rng: random.Random) -> None:
    content = file.read_bytes()
    if kind == "flip":
        at = rng.randrange(len(content))
        file.write_bytes(content[:at] + bytes([content[at] ^ (1 << rng.randrange(8))]) + content[at + 1 :])
    elif kind == "truncate":
        file.write_bytes(content[: rng.randrange(len(content))])
    elif kind == "append":
        file.write_bytes(content + rng.randbytes(1 + rng.randrange(8)))
    else:
        file.unlink()


def test_an_intact_store_has_no_problem(finished):
    report = verify(finished)
    assert report.problems == ()
    assert report.orphans == ()
    assert (report.n_committed, report.n_chunks) == (2, 3)


@pytest.mark.parametrize("kind", ["flip", "truncate", "delete", "append"])
def test_damage_to_any_file_is_found(finished, kind):
    rng = random.Random(f"{kind} 1")
    missed = []
    files = files_of(finished)
    # Every file of data and one in three of the sixty small per-candidate arrays' files, another third for each kind.
    chosen = [f for k, f in enumerate(files) if f.stat().st_size > 1500 or (k + len(kind)) % 3 == 0]
    for file in chosen:
        content = file.read_bytes()
        damage(file, kind, rng)
        if verify(finished).ok:
            missed.append(str(file.relative_to(finished)))
        file.write_bytes(content)
    assert missed == []
    assert verify(finished).ok


def test_swapped_files_are_found(finished):
    rng = random.Random(5)
    files = files_of(finished)
    missed = []
    for _ in range(40):
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


def test_a_file_that_belongs_to_nothing_is_found_and_leftovers_are_only_listed(finished):
    (finished / "x" / "c.7.0.0").write_bytes(b"?")
    assert [p.kind for p in verify(finished).problems] == ["unknown"]
    (finished / "x" / "c.7.0.0").unlink()
    (finished / "x" / "c.0.0.0.abc.partial").write_bytes(b"?")
    report = verify(finished)
    assert report.ok
    assert report.orphans == ("x/c.0.0.0.abc.partial",)
    (finished / "x" / "c.0.0.0.abc.partial").unlink()


def test_an_unfinished_campaign_with_chunks_in_flight_is_whole(tmp_path):
    path = tmp_path / "a.zarr"
    create(path)
    run(path, 1)
    with DriverStore(path) as store:
        store.propose(1, proposal(1))
        small_store.write_chunk(path, 1, 2, chunk(store.layout, 1, 2, 10), store.proposal_digest(1))
    report = verify(path)
    assert report.ok
    assert report.n_chunks == 4
    (path / "x" / "c.1.2.0").unlink()
    assert [p.kind for p in verify(path).problems] == ["pending"]


def test_repair_writes_every_kind_of_damage_again_and_proves_it(finished, tmp_path):
    saved = {file: file.read_bytes() for file in files_of(finished)}
    rng = random.Random(11)
    data = [f for f in saved if "certification" not in str(f) and not f.parent.name.startswith("wall_")]
    special = [
        finished / name
        for name in (
            "zarr.json",
            "x/zarr.json",
            "chunk_digest/root.json",
            "runtime/zarr.json",
            "D/c.0",
            "time/c.0",
            "waveform/c.0.0.0",
            "n_switches/c.0",
            "failed/c.0",
            "chunk_digest/c.1.0.0",
            "x/c.0.1.0",
            "record_digest/c.0",
        )
    ]
    for file in [*special, *rng.sample(data, 8)]:
        damage(file, rng.choice(["flip", "truncate", "delete", "append"]), rng)
        assert not verify(finished).ok
        done = repair(finished, recompute())
        assert done.ok, (file, done.after.problems)
        assert done.proved or "digest" in file.parent.name
        assert file.read_bytes() == saved[file], file
    assert not list(finished.rglob("*.partial"))
    restore(saved)


def test_repair_of_many_files_at_once_gives_the_same_store(finished, tmp_path):
    path = tmp_path / "other.zarr"
    create(path, n_candidates=2, n_switches=5, chunk_switches=4)
    run_all(path)
    rng = random.Random(3)
    for name in ("x/c.0.0.0", "chunk_digest/c.0.1.0", "v/c.1.0.0", "waveform/c.0.0.0", "g_cm_s/c.0", "K/c.0"):
        damage(path / name, rng.choice(["flip", "delete", "truncate"]), rng)
    done = repair(path, recompute())
    assert done.ok
    assert done.unproved == ()
    missing = [d for d in differences(path, finished) if "certification" not in d]
    assert missing == []


def test_lost_timings_are_said_to_be_lost(finished):
    saved = {file: file.read_bytes() for file in files_of(finished)}
    (finished / "wall_propose_s" / "c.0").unlink()
    done = repair(finished, recompute())
    assert done.ok
    assert done.unproved == ("timings of candidate 0 are lost", "timings of candidate 1 are lost")
    restore(saved)


def test_a_repair_that_computes_something_else_is_refused_and_changes_nothing(finished):
    saved = {file: file.read_bytes() for file in files_of(finished)}
    file = finished / "v" / "c.0.0.0"
    file.write_bytes(b"")
    wrong = recompute()

    def other(store, i, i_chunk):
        arrays = wrong.chunk(store, i, i_chunk)
        return arrays | {"v": arrays["v"] + np.float32(1e-6)}

    with pytest.raises(DamageError, match="is not what was stored"):
        repair(
            finished,
            Recompute(
                population=wrong.population,
                times_us=wrong.times_us,
                proposal=wrong.proposal,
                chunk=other,
                record=wrong.record,
            ),
        )
    assert file.read_bytes() == b""
    restore(saved)
    assert verify(finished).ok


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
