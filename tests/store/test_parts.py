"""Claims about groups that are written a part at a time: whole or not there, digests of every part, plain xarray."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from softclose_store import (
    DamageError,
    GroupArray,
    StoreError,
    list_groups,
    read_group,
    verify,
    write_group,
)
from softclose_store.check.repair import remove_orphans
from softclose_store.parts import PartedArray, Parts, unfinished_parts, write_part

GROUP = "trajectories/release-3"
ARRAY = PartedArray(dims=("trial", "switch", "time"), chunk=(1, 4, 3), unit="µm", long_name="travel x(t)")
X = np.random.default_rng(1).random((2, 6, 3)).astype(np.float32)


def parts(store: Path, x: np.ndarray = X) -> dict[str, str]:
    files: dict[str, str] = {}
    for i in range(2):
        for j in range(2):
            files |= write_part(store, GROUP, "x", ARRAY, (i, j, 0), x[i : i + 1, 4 * j : 4 * j + 4])
    return files


def finish(store: Path, files: dict[str, str]) -> None:
    write_group(
        store,
        GROUP,
        {"time": GroupArray(dims=("time",), values=np.arange(3.0), unit="µs", long_name="since the fall")},
        {"candidate": 3},
        parts={"x": Parts(array=ARRAY, shape=X.shape, files=files)},
        replace=True,
    )


def test_parts_are_nothing_until_the_group_is_finished_and_then_all_of_it(store: Path) -> None:
    files = parts(store)
    report = verify(store)
    assert report.ok
    assert sorted(report.orphans) == sorted(f"{GROUP}/{member}" for member in files)
    assert list_groups(store) == []
    with xr.open_datatree(store, engine="zarr") as tree:
        assert "trajectories" not in tree
    finish(store, files)
    report = verify(store)
    assert report.ok
    assert report.orphans == ()
    assert report.unlisted == ()
    np.testing.assert_array_equal(read_group(store, GROUP).arrays["x"], X)
    with xr.open_datatree(store, engine="zarr") as tree:
        x = tree[GROUP]["x"]
        np.testing.assert_array_equal(x.to_numpy(), X)
        assert x.dims == ("trial", "switch", "time")
        assert x.attrs == {"units": "µm", "long_name": "travel x(t)"}
        assert tree[GROUP].attrs["candidate"] == 3


def test_a_part_that_is_missing_reads_as_nan_and_not_as_nought(store: Path) -> None:
    files = parts(store)
    for member in [m for m in files if m.startswith("x/c/1/")]:
        del files[member]
        (store / GROUP / member).unlink()
    finish(store, files)
    assert verify(store).ok
    with xr.open_datatree(store, engine="zarr") as tree:
        x = tree[GROUP]["x"].to_numpy()
    np.testing.assert_array_equal(x[0], X[0])
    assert np.isnan(x[1]).all()


def test_a_damaged_part_is_found_and_its_group_refused(store: Path) -> None:
    finish(store, parts(store))
    file = store / GROUP / "x" / "c" / "1" / "0" / "0"
    content = file.read_bytes()
    for wrong in (content[:-1], content[:9] + bytes([content[9] ^ 1]) + content[10:]):
        file.write_bytes(wrong)
        assert verify(store).damaged_groups == [GROUP]
        with pytest.raises(DamageError, match="release-3"):
            read_group(store, GROUP)
    file.unlink()
    assert verify(store).damaged_groups == [GROUP]
    write_part(store, GROUP, "x", ARRAY, (1, 0, 0), X[1:2, :4])
    assert verify(store).ok
    assert file.read_bytes() == content


def test_a_finished_group_is_replaced_by_one_of_other_parts(store: Path) -> None:
    finish(store, parts(store))
    files = parts(store, X + 1.0)
    dropped = files.pop("x/c/1/1/0")
    assert dropped
    finish(store, files)
    assert not (store / GROUP / "x" / "c" / "1" / "1" / "0").exists(), "what the new group does not list is deleted"
    assert verify(store).ok


def test_only_what_can_be_a_part_is_written(store: Path) -> None:
    good = X[:1, :4]
    for group in ("opening/3", "trajectories", "trajectories/../search", "search", "trajectories/A"):
        with pytest.raises(StoreError, match="no part"):
            write_part(store, group, "x", ARRAY, (0, 0, 0), good)
    for values in (X[:1, :5], X[:2, :4], X[0, :4]):
        with pytest.raises(StoreError, match="shape"):
            write_part(store, GROUP, "x", ARRAY, (0, 0, 0), values)
    with pytest.raises(StoreError, match="no part"):
        write_part(store, GROUP, "../x", ARRAY, (0, 0, 0), good)
    assert list_groups(store) == []
    assert not (store / "trajectories").exists()


def test_what_a_killed_writer_leaves_is_removed_and_nothing_else(store: Path) -> None:
    finish(store, parts(store))
    left = write_part(store, "trajectories/release-4", "x", ARRAY, (0, 0, 0), X[:1, :4])
    before = verify(store)
    assert before.ok
    assert remove_orphans(store) == [f"trajectories/release-4/{member}" for member in left]
    assert verify(store).orphans == ()
    np.testing.assert_array_equal(read_group(store, GROUP).arrays["x"], X)


def test_what_only_looks_like_a_part_belongs_to_nobody(store: Path) -> None:
    finish(store, parts(store))
    for key in ("trajectories/release-9/x/c/0/0/readme", "trajectories/release-9/x/d/0", f"{GROUP}/x/c/9/9/9"):
        file = store / key
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(b"?")
        report = verify(store)
        assert [problem.key for problem in report.problems] == [key]
        file.unlink()
    keys = [f"{GROUP}/x/c/0/0/0", f"{GROUP}/zarr.json", "trajectories/a/x/c/0", "trajectories/b/x/c/0"]
    assert unfinished_parts([*keys, "trajectories/b/x/zarr.json"]) == ["trajectories/a/x/c/0"]


@pytest.mark.parametrize("passage", [1, 3])
def test_a_kill_between_parts_leaves_a_store_that_is_whole(store: Path, passage: int) -> None:
    child = os.fork()
    if child == 0:  # pragma: no cover - the child is killed
        os.environ["SOFTCLOSE_FAULT"] = f"inside-part:{passage}"
        parts(store)
        os._exit(0)
    assert os.waitpid(child, 0)[1] == signal.SIGKILL
    report = verify(store)
    assert report.ok
    assert len(report.orphans) == passage - 1
    finish(store, parts(store))
    assert verify(store).ok
    np.testing.assert_array_equal(read_group(store, GROUP).arrays["x"], X)
