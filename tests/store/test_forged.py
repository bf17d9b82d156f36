"""Claims about a store that somebody made up: its root is consistent in itself, and says what no store says.

Each is refused in one line, by name, before anything is allocated by what it says; `verify` and its repair say so too.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numcodecs.blosc
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from examples import examples, in_turn
from small_store import recompute
from softclose_store import DamageError, DriverStore, StoreError, open_campaign, repair, store_state, verify
from softclose_store.read.bounds import MOST_WORDS_BYTES, Bound
from softclose_store.schema.documents import GroupArrayDocument, checked
from softclose_store.schema.root import Root
from softclose_store.schema.texts import MOST_DEEP, read_json

Change = Callable[[dict[str, Any]], Any]


def forge(store: Path, change: Change, key: str = "zarr.json") -> None:
    document = json.loads((store / key).read_bytes())
    change(document)
    (store / key).write_bytes(Root(document).encode())


def attribute(name: str, value: Any) -> Change:
    return lambda document: document["attributes"].__setitem__(name, value)


def without(name: str) -> Change:
    return lambda document: document["attributes"].pop(name)


def size(name: str, value: Any) -> Change:
    return lambda document: document["attributes"]["layout"].__setitem__(name, value)


def of_stage(name: str, value: Any) -> Change:
    return lambda document: document["attributes"]["layout"]["stages"][0].__setitem__(name, value)


def entry(array: str, name: str, value: Any) -> Change:
    return lambda document: document["consolidated_metadata"]["metadata"][array].__setitem__(name, value)


def many_stages(document: dict[str, Any]) -> None:
    stages = document["attributes"]["layout"]["stages"]
    stages += [{**stages[0], "name": f"s{i}"} for i in range(200_000)]


def gzip(document: dict[str, Any]) -> None:
    codecs = document["consolidated_metadata"]["metadata"]["candidates/records"]["codecs"]
    codecs[1] = {"name": "gzip", "configuration": {"level": 9}}


FORGED: dict[str, Change] = {
    **{f"no {name}": without(name) for name in ("layout", "config", "n_committed", "n_waves", "algorithm", "durable")},
    **{f"no {name}": without(name) for name in ("fingerprint", "static_digests", "metadata_digest", "hyperparameters")},
    "committed text": attribute("n_committed", "x"),
    "committed below nothing": attribute("n_committed", -3),
    "committed truth": attribute("n_committed", True),
    "committed fraction": attribute("n_committed", 8.5),
    "a milliard committed": attribute("n_committed", 10**9),
    "more waves than candidates": attribute("n_waves", 9),
    "no wave": attribute("n_waves", 0),
    "configuration of a list": attribute("config", [1]),
    "layout of text": attribute("layout", "x"),
    "forty names": attribute("hyperparameters", [f"h{i}" for i in range(40)]),
    "a name that is a number": attribute("hyperparameters", [1]),
    "a milliard pulses": size("n_pulses", 10**9),
    "a milliard instants": size("n_times", 10**9),
    "a milliard impacts": size("max_impacts", 10**9),
    "limits of text": size("limits_cm_s", ["x"]),
    "a milliard candidates a chunk": size("table_chunk", 10**9),
    "no stages": size("stages", []),
    "many stages": many_stages,
    "a milliard candidates": of_stage("n_candidates", 10**9),
    "many candidates": of_stage("n_candidates", 9_000_000),
    "a milliard switches": of_stage("n_switches", 10**9),
    "many switches": of_stage("n_switches", 90_000_000),
    "a stage outside": of_stage("name", "../../x"),
    "another codec": gzip,
    "another type": entry("candidates/records", "data_type", "float32"),
    "another size": entry("candidates/records", "shape", [10**9, 50]),
    "another fill value": entry("population/D", "fill_value", 7.0),
    "attributes that scale": entry("population/D", "attributes", {"scale_factor": 2.0}),
    "a foreign array": lambda d: d["consolidated_metadata"]["metadata"].__setitem__("search/E9", {}),
    "no metadata": lambda d: d.pop("consolidated_metadata"),
    "metadata of a list": lambda d: d.__setitem__("consolidated_metadata", []),
    "runs of text": lambda d: d["consolidated_metadata"]["metadata"]["runtime"]["attributes"].__setitem__("runs", "x"),
    "versions of numbers": lambda d: d["consolidated_metadata"]["metadata"]["runtime"]["attributes"].__setitem__(
        "versions", {"zarr": 3}
    ),
}


@pytest.mark.parametrize("forged", in_turn(FORGED, 30))
def test_a_root_of_wrong_types_or_sizes_is_refused_in_one_line_and_rebuilt(
    forged: str, whole: Path, store: Path
) -> None:
    forge(store, FORGED[forged])
    before, began = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.monotonic()
    for opening in (open_campaign, DriverStore):
        with pytest.raises(
            DamageError, match=r"zarr.json is (no root of a store: |of [\d,]+ bytes).*softclose verify .* --repair"
        ) as told:
            opening(store)
        assert "\n" not in str(told.value)
        assert len(str(told.value)) < 700
    assert store_state(store).kind == "damaged"
    assert "root" in {problem.kind for problem in verify(store).problems}
    assert repair(store, recompute()).ok
    for name, values in open_campaign(whole).records().items():
        np.testing.assert_array_equal(open_campaign(store).records()[name], values)
    assert time.monotonic() - began < 20.0
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 500_000


def test_more_candidates_than_the_tables_have_files_for_are_believed_by_nobody(store: Path) -> None:
    """Such a root is one of the schema: what it says is that so many candidates are there."""
    from softclose_store.schema.hierarchy import schema_of
    from softclose_store.schema.opening import layout_without_times

    document = json.loads((store / "zarr.json").read_bytes())
    document["attributes"]["layout"]["stages"][0]["n_candidates"] = 9_000_000
    document["attributes"]["layout"]["table_chunk"] = 128
    layout = layout_without_times(document["attributes"]["layout"])
    schema = json.loads(schema_of(layout)["zarr.json"])
    runtime = document["consolidated_metadata"]["metadata"]["runtime"]["attributes"]
    forged = Root({**schema, "attributes": document["attributes"]}).committed(9_000_000, 100_000, ())
    for key in ("zarr.json", "candidates/digests/root.json"):
        (store / key).write_bytes(forged.with_runtime(runtime).encode())
    before, began = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.monotonic()
    with pytest.raises(DamageError, match=r"candidates/digests/c.1.0 of .* is missing"):
        open_campaign(store).records()
    with pytest.raises(DamageError):
        DriverStore(store)
    report = verify(store)
    assert any("9000000 candidates, and the tables have files for 128" in str(p) for p in report.problems)
    assert time.monotonic() - began < 20.0
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 500_000


def test_a_header_that_claims_more_than_the_array_has_is_refused_before_it_is_unpacked(store: Path) -> None:
    """A Blosc file of 70 bytes can say that it holds two gigabytes; so can one of text."""
    reads: dict[str, Callable[[], Any]] = {
        "candidates/records/c.0.0": lambda: open_campaign(store).records(),
        "population/K/c.0": lambda: open_campaign(store).population(),
        "search/x/c.0.0.0": lambda: open_campaign(store).trajectories(0).x[...],
    }
    for key, read in reads.items():
        file = store / key
        intact = file.read_bytes()
        file.write_bytes(intact[:4] + (2**31 - 17).to_bytes(4, "little") + intact[8:])
        with pytest.raises(DamageError, match="it says that it holds 2,147,483,631 bytes"):
            read()
        assert not verify(store).ok
        file.write_bytes(intact)
    assert verify(store).ok


def test_text_is_bounded_in_bytes_and_in_number() -> None:
    bound = Bound(items=3, chunk_bytes=48, n_inner=1, codecs=("vlen-utf8", "zstd", "crc32c"))

    def text(words: list[str]) -> bytes:
        parts = b"".join(len(w.encode()).to_bytes(4, "little") + w.encode() for w in words)
        return len(words).to_bytes(4, "little") + parts

    def packed(content: bytes) -> memoryview:
        return memoryview(numcodecs.zstd.compress(content, 1) + b"sums")

    bound.check(packed(text(["a", "bc", ""])))
    for content in (text(["a"]), b"\xff" * 4, bytes(MOST_WORDS_BYTES + 1), b"ab"):
        with pytest.raises(ValueError, match="it says that it holds"):
            bound.check(packed(content))
    with pytest.raises(ValueError, match="-1 bytes of text"):
        bound.check(memoryview(b"no zstd frame at all"))


@pytest.mark.parametrize("open_at", in_turn([b"[", b'{"a":'], 2))
def test_text_nested_deep_anywhere_is_refused(open_at: bytes, store: Path) -> None:
    deep = open_at * 100_000
    for key in (
        "zarr.json",
        "candidates/digests/root.json",
        "runtime/zarr.json",
        "candidates/records/zarr.json",
        "candidates/digests/extension.json",
    ):
        intact = (store / key).read_bytes() if (store / key).exists() else None
        (store / key).write_bytes(deep)
        assert not verify(store).ok
        assert repair(store, recompute()).ok
        if intact is None:
            assert not (store / key).exists()
        else:
            assert (store / key).read_bytes() == intact
    with pytest.raises(ValueError, match="nested"):
        read_json(deep)


@given(st.integers(1, MOST_DEEP), st.text(max_size=20), st.booleans())
@settings(max_examples=examples(50))
def test_brackets_within_words_are_no_depth(depth: int, word: str, lists: bool) -> None:
    value: Any = word + "[{" * 100
    for _ in range(depth):
        value = [value] if lists else {word: value}
    assert read_json(json.dumps(value).encode()) == value
    for _ in range(MOST_DEEP):
        value = [value]
    with pytest.raises(ValueError, match="nested more than"):
        read_json(json.dumps(value).encode())


@pytest.fixture
def removed_whole(store: Path) -> Iterator[Path]:
    """The store; what is left of it is removed by a program: Python's own removal is recursive, pytest's too."""
    yield store
    subprocess.run(["rm", "-rf", str(store), f"{store}.strays"], check=True)


def test_a_thousand_folders_within_each_other_are_one_stray(removed_whole: Path) -> None:
    store = removed_whole
    folder = os.open(store, os.O_RDONLY)
    for _ in range(1_000):
        os.mkdir("a", dir_fd=folder)
        inner = os.open("a", os.O_RDONLY, dir_fd=folder)
        os.close(folder)
        folder = inner
    os.close(folder)
    strays = [p for p in verify(store).problems if p.kind == "unknown"]
    assert len(strays) == 1
    assert open_campaign(store).finished
    assert repair(store, recompute()).ok
    assert not (store / "a").exists()


def test_what_was_written_by_no_codec_of_ours_is_no_array_of_a_group() -> None:
    document = {
        "zarr_format": 3,
        "node_type": "array",
        "shape": [10],
        "data_type": "float64",
        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": [10]}},
        "codecs": [{"name": "bytes"}, {"name": "crc32c"}],
    }
    assert checked(GroupArrayDocument, document).n_chunks == 1
    for name, value in {
        "codecs": [{"name": "bytes"}, {"name": "gzip"}, {"name": "crc32c"}],
        "data_type": "object",
        "shape": [10, 10],
        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": [10**9]}},
        "storage_transformers": [{}],
    }.items():
        with pytest.raises(ValueError, match=f"{name}|the document"):
            checked(GroupArrayDocument, {**document, name: value})


def test_a_store_error_is_one_that_says_what_to_do(store: Path) -> None:
    (store / "zarr.json").unlink()
    (store / "zarr.json").symlink_to("/dev/zero")
    with pytest.raises(StoreError, match=r"zarr.json is a link, and no file of a store is.*--repair"):
        open_campaign(store)
