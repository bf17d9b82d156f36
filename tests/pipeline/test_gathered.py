"""Claims about what is gathered from pieces: it is the pieces in their places, in memory or in a file, which leaves
memory when it is put aside."""

from __future__ import annotations

import gc
import os
import sys
import tempfile
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from softclose.evaluate import gathered
from softclose.evaluate.gathered import Gathering, put_aside, put_judged_aside
from softclose.evaluate.pieces import joined_judged
from softclose.metrics.objective import Judged


def judged(n: int, seed: int, n_asked: int = 0) -> Judged:
    draw = np.random.default_rng(seed)
    v = draw.random(n)
    return Judged(
        max_contact_speed=np.where(v < 0.1, np.nan, v),
        closed=v > 0.3,
        status=draw.integers(0, 3, n).astype(np.int8),
        settling_us=np.where(v < 0.2, np.inf, 90.0 * v),
        asked=draw.random((n, n_asked)) if n_asked else None,
        first_contact_us=30.0 * v,
        n_impacts=draw.integers(0, 9, n).astype(np.int32),
    )


def gather(drives: list[list[Judged]]) -> list[Judged]:
    """The pieces of every drive, in an order that is not theirs."""
    whole = Gathering(len(drives), sum(len(part.closed) for part in drives[0]))
    starts = np.cumsum([0, *(len(part.closed) for part in drives[0])])
    for k in np.random.default_rng(0).permutation(len(drives[0])):
        for i, parts in enumerate(drives):
            whole.put(i, int(starts[k]), parts[k])
    return whole.judged()


@pytest.mark.parametrize("most_bytes", [0, gathered.MOST_BYTES])
@pytest.mark.parametrize("n_asked", [0, 1, 3])
def test_the_whole_is_its_pieces_in_their_places(
    most_bytes: int, n_asked: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gathered, "MOST_BYTES", most_bytes)
    drives = [[judged(n, 10 * i + n, n_asked) for n in (700, 1, 5000, 33)] for i in range(3)]
    for found, parts in zip(gather(drives), drives, strict=True):
        expected = joined_judged(parts)
        put_judged_aside(found)
        for field in fields(Judged):
            own, other = getattr(found, field.name), getattr(expected, field.name)
            assert (own is None) == (other is None)
            if other is not None:
                assert own.dtype == other.dtype
                assert_array_equal(own, other)


@pytest.mark.parametrize("most_bytes", [0, gathered.MOST_BYTES])
def test_what_one_piece_did_not_tell_is_told_of_none(most_bytes: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gathered, "MOST_BYTES", most_bytes)
    silent = [judged(40, 1), replace(judged(9, 2), n_impacts=None), judged(5, 3)]
    first, second = gather([silent, [judged(n, n) for n in (40, 9, 5)]])
    assert first.n_impacts is None
    assert second.n_impacts is not None
    assert_array_equal(first.max_contact_speed, joined_judged(silent).max_contact_speed)


def test_what_is_large_lies_in_a_file_without_a_name_and_what_is_small_in_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    opened: list[object] = []
    made = tempfile.TemporaryFile
    monkeypatch.setattr(tempfile, "TemporaryFile", lambda: opened.append(0) or made())
    row = 8 + 1 + 1 + 8 + 8 + 4
    monkeypatch.setattr(gathered, "MOST_BYTES", 2 * 100 * row)
    gather([[judged(60, 1), judged(40, 2)]] * 2)
    assert not opened
    found = gather([[judged(60, 1), judged(41, 2)]] * 2)
    assert opened
    assert not any(tmp_path.iterdir())
    assert found[1].closed.any()


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_what_is_put_aside_leaves_memory_until_it_is_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gathered, "MOST_BYTES", 0)

    def of_files() -> float:
        return int(Path("/proc/self/statm").read_text().split()[2]) * os.sysconf("SC_PAGE_SIZE") / 1e6

    part = judged(1_000_000, 1)
    (found,) = gather([[part]])
    gc.collect()
    before = of_files()
    assert_array_equal(found.max_contact_speed, part.max_contact_speed)
    assert of_files() > before + 7.0
    put_aside(found.max_contact_speed, None, part.closed)
    assert of_files() < before + 1.0
    assert_array_equal(found.max_contact_speed[-3:], part.max_contact_speed[-3:])
    put_judged_aside(found)
    assert of_files() < before + 1.0
