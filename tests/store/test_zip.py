"""Claims about a store that travels as one zip: it reads as it did, and whoever would write is told to unzip it."""

from __future__ import annotations

import shutil
import zipfile
from pathlib import Path
from typing import Any

import pytest
from numpy.testing import assert_array_equal

from examples import in_turn
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


def packed(folder: Path, target: Path, *, top: str = "", kind: int = zipfile.ZIP_STORED, notes: bool = False) -> Path:
    """A folder as an archiver packs it: with the folder itself, with its own notes beside."""
    with zipfile.ZipFile(target, "w", kind) as archive:
        if top:
            archive.writestr(zipfile.ZipInfo(top), b"")
        for path in sorted(folder.rglob("*")):
            name = top + path.relative_to(folder).as_posix()
            archive.write(path, name)
            if notes and path.is_file():
                place, _, last = name.rpartition("/")
                archive.writestr(f"__MACOSX/{place}/._{last}", b"Mac OS X")
        if notes:
            archive.writestr(f"{top}.DS_Store", b"x")
            archive.writestr("__MACOSX/zarr.json", b"{}")
            archive.writestr(f"{top}Thumbs.db", b"x")
    return target


LAYOUTS: dict[str, tuple[str, dict[str, Any]]] = {
    "the folder itself": ("b.zip", {"top": "a.zarr/"}),
    "capitals": ("B.ZIP", {"top": "a.zarr/"}),
    "compressed": ("b.zip", {"top": "a.zarr/", "kind": zipfile.ZIP_DEFLATED}),
    "folders above": ("b.Zip", {"top": "home/lab 7/runs/a.zarr/"}),
    "macOS": ("b.zip", {"top": "a.zarr/", "notes": True}),
    "notes beside the root": ("b.zip", {"notes": True}),
    "a name of its own": ("b.zip", {"top": "Lösung-ü.zarr/"}),
}


@pytest.mark.parametrize("layout", in_turn(LAYOUTS, 2))
def test_what_archivers_make_of_a_store_reads_as_it_did(store: Path, tmp_path: Path, layout: str) -> None:
    name, options = LAYOUTS[layout]
    path = packed(store, tmp_path / name, **options)
    zipped, folder = open_campaign(path), open_campaign(store)
    for key, values in folder.records().items():
        assert_array_equal(zipped.records()[key], values)
    assert_array_equal(zipped.trajectories(0).x[...], folder.trajectories(0).x[...])
    assert zipped.dataset().sizes == folder.dataset().sizes
    report = verify(path)
    assert report.ok, report
    with pytest.raises(StoreError, match="zipped store, which can be read only; unzip it"):
        DriverStore(path)


@pytest.mark.parametrize("part", [0.0, 0.01, 0.5, 0.9, 0.999])
@pytest.mark.parametrize("top", ["", "a.zarr/"])
def test_a_zip_that_was_cut_short_is_said_to_be(store: Path, tmp_path: Path, part: float, top: str) -> None:
    path = packed(store, tmp_path / "b.zip", top=top)
    content = path.read_bytes()
    path.write_bytes(content[: int(part * len(content))])
    with pytest.raises(StoreError, match=r"is no zip file, or was cut short .* copy it again") as found:
        open_campaign(path)
    assert "\n" not in str(found.value)


def test_bytes_that_were_changed_on_the_way_are_named(store: Path, tmp_path: Path) -> None:
    path = packed(store, tmp_path / "b.zip", top="a.zarr/", kind=zipfile.ZIP_DEFLATED)
    with zipfile.ZipFile(path) as archive:
        root = next(i for i in archive.infolist() if i.filename == "a.zarr/zarr.json")
    content = bytearray(path.read_bytes())
    middle = root.header_offset + 30 + len(root.filename) + root.compress_size // 2
    content[middle : middle + 8] = bytes(8)
    path.write_bytes(content)
    with pytest.raises(StoreError, match=r"zarr\.json of .* cannot be unpacked"):
        open_campaign(path)


def test_a_zip_of_several_stores_asks_for_one(store: Path, tmp_path: Path) -> None:
    path = tmp_path / "both.zip"
    with zipfile.ZipFile(path, "w") as archive:
        for name in ("a.zarr", "b.zarr"):
            archive.write(store / "zarr.json", f"runs/{name}/zarr.json")
    with pytest.raises(StoreError, match=r"holds 2 stores \(runs/a\.zarr, runs/b\.zarr …\): unzip it"):
        open_campaign(path)
