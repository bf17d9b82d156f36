"""Claims about a store that travels as one zip: it reads as it did, and whoever would write is told to unzip it."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from numpy.testing import assert_array_equal

from small_store import create, run
from softclose_store import DriverStore, StoreError, open_campaign, verify
from softclose_store.disk.lock import lock_holder
from stores import differences


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("zip") / "a.zarr"
    create(path)
    run(path, 7)
    shutil.make_archive(str(path.with_suffix("")), "zip", path)
    return path


def test_a_zipped_store_reads_as_the_folder_does(store: Path) -> None:
    zipped, folder = open_campaign(store.with_suffix(".zip")), open_campaign(store)
    assert zipped.committed == folder.committed
    for name, values in folder.records().items():
        assert_array_equal(zipped.records()[name], values)
    assert_array_equal(zipped.trajectories(0).x[...], folder.trajectories(0).x[...])
    assert zipped.dataset().sizes == folder.dataset().sizes
    assert list(zipped.datatree().children) == list(folder.datatree().children)
    assert verify(store.with_suffix(".zip")).ok
    assert lock_holder(store.with_suffix(".zip")) is None


def test_a_zipped_store_is_not_driven_and_unzipped_goes_on(store: Path, tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="zipped store, which can be read only; unzip it"):
        DriverStore(store.with_suffix(".zip"))
    shutil.unpack_archive(store.with_suffix(".zip"), tmp_path / "b.zarr")
    run(tmp_path / "b.zarr", 8)
    whole = tmp_path / "c.zarr"
    create(whole)
    run(whole, 8)
    assert differences(tmp_path / "b.zarr", whole) == []
