"""Claims about the door to files: below one folder, through no link, plain files of bounded size only."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from softclose_store.disk.below import MOST_DEEP, Below, parts_of
from softclose_store.errors import NotPlainError, StoreError


@pytest.fixture
def below(tmp_path: Path) -> Below:
    (tmp_path / "store").mkdir()
    (tmp_path / "outside").mkdir()
    (tmp_path / "outside" / "file").write_bytes(b"theirs")
    return Below(str(tmp_path / "store"))


def test_what_is_written_is_read_in_whole_and_in_part(below: Below) -> None:
    assert below.read("a/b/c") is None
    assert below.size("a/b/c") is below.identity("a/b/c") is None
    below.write("a/b/c", b"0123456789", durable=True)
    assert below.read("a/b/c") == b"0123456789"
    assert below.read("a/b/c", start=2, stop=5) == b"234"
    assert below.read("a/b/c", start=-3) == b"789"
    assert below.read("a/b/c", start=-30) == b"0123456789"
    assert below.read("a/b/c", start=7, stop=99) == b"789"
    assert below.read("a/b/c", start=99) == b""
    assert below.read("a/b/c", most=10) is not None
    with pytest.raises(NotPlainError, match="a/b/c is of 10 bytes, where 9 are the most"):
        below.read("a/b/c", most=9)
    assert (below.size("a/b/c"), below.kind("a/b/c"), below.kind("a"), below.kind("x")) == (
        10,
        "a file",
        "a folder",
        "",
    )
    before = below.identity("a/b/c")
    below.write("a/b/c", b"new", durable=False)
    assert below.identity("a/b/c") != before
    assert below.every_key() == ["a/b/c"]
    below.delete("a/b/c")
    below.delete("a/b/c")
    below.delete("x/y")
    assert below.every_key() == []


def _link(place: Path, outside: Path) -> None:
    place.symlink_to(outside / "file")


def _loop(place: Path, outside: Path) -> None:
    place.symlink_to(place.name)


def _nothing(place: Path, outside: Path) -> None:
    place.symlink_to(outside / "not there")


def _folder(place: Path, outside: Path) -> None:
    place.mkdir()


def _pipe(place: Path, outside: Path) -> None:
    os.mkfifo(place)


def _socket(place: Path, outside: Path) -> None:
    here = os.getcwd()
    os.chdir(place.parent)  # the path of a socket is short
    try:
        with socket.socket(socket.AF_UNIX) as s:
            s.bind(place.name)
    finally:
        os.chdir(here)


WAYS = {"a link": (_link, _loop, _nothing), "a folder": (_folder,), "a pipe": (_pipe,), "a socket": (_socket,)}


@pytest.mark.parametrize(("what", "make"), [(what, make) for what, makes in WAYS.items() for make in makes])
def test_what_is_no_file_is_refused_by_name_and_never_followed(what: str, make: object, below: Below) -> None:
    root = Path(below.root)
    outside = root.parent / "outside"
    (root / "a").mkdir()
    make(root / "a" / "b", outside)  # type: ignore[operator]
    for act in (below.read, below.size, below.identity, below.open_lock):
        with pytest.raises(
            (NotPlainError, IsADirectoryError), match=f"a/b is {what}, and no file of a store is.*--repair|"
        ):
            act("a/b")
    assert below.kind("a/b") == what
    if what == "a folder":
        for act in (below.delete, lambda key: below.write(key, b"x", durable=False)):
            with pytest.raises(NotPlainError, match="a/b is a folder"):
                act("a/b")
    else:
        assert below.every_key() == ["a/b"]
        below.write("a/b", b"mine", durable=False)  # takes its place
        assert below.read("a/b") == b"mine"
        below.delete("a/b")
        make(root / "a" / "b", outside)  # type: ignore[operator]
        below.delete("a/b")
        assert below.kind("a/b") == ""
    assert [p.name for p in outside.iterdir()] == ["file"]
    assert (outside / "file").read_bytes() == b"theirs"


def test_a_folder_that_is_a_link_leads_nowhere(below: Below) -> None:
    root = Path(below.root)
    (root / "a").symlink_to(root.parent / "outside")
    (root / "b").mkdir()
    (root / "b" / "c").symlink_to(root.parent / "outside")
    (root / "f").write_bytes(b"")
    acts = {
        "read": below.read,
        "size": below.size,
        "kind": below.kind,
        "delete": below.delete,
        "lock": below.open_lock,
        "write": lambda key: below.write(key, b"x", durable=False),
        "move": lambda key: below.move(key, Below(below.root), "elsewhere"),
        "move into": lambda key: below.move("f", Below(below.root), key),
    }
    for name, act in acts.items():
        for key in ("a/file", "b/c/file"):
            with pytest.raises(NotPlainError, match=r"(a|b/c) is a link instead of a folder"):
                act(key)
        with pytest.raises(NotPlainError, match="f is a file instead of a folder"):
            act("f/g") if name != "move into" else below.move("f", Below(below.root), "f/g")
    assert (root.parent / "outside" / "file").read_bytes() == b"theirs"
    assert below.every_key() == ["a", "b/c", "f"]
    assert below.names("a") == []


@given(st.sampled_from(["", ".", "..", "a//b", "../x", "a/../b", "/etc/passwd", "a/.", "a\\b", "a\0b", "a/"]))
def test_a_key_that_leads_out_is_none(key: str) -> None:
    with pytest.raises(StoreError, match="leads out of it"):
        parts_of(key)


def test_what_is_moved_overwrites_nothing_and_leaves_no_empty_folders(below: Below) -> None:
    other = Below(str(Path(below.root).parent / "outside"))
    below.write("a/b/c", b"mine", durable=False)
    assert not below.move("a/b/c", other, "file")
    assert below.move("a/b/c", other, "x/y")
    assert other.read("x/y") == b"mine"
    assert other.read("file") == b"theirs"
    assert list(Path(below.root).iterdir()) == []


def test_folders_that_are_too_deep_are_one_key(below: Below) -> None:
    place = Path(below.root, *"a" * 20)
    place.mkdir(parents=True)
    (place / "file").write_bytes(b"")
    (deep,) = below.every_key()
    assert deep.count("/") == MOST_DEEP
    assert below.move(deep, Below(str(Path(below.root).parent / "outside")), "deep")
    assert below.every_key() == []


def test_a_lock_is_a_file_of_its_own(below: Below) -> None:
    first, second = below.open_lock("lock"), below.open_lock("lock")
    assert below.is_same(first, "lock")
    assert below.is_same(second, "lock")
    below.delete("lock")
    third = below.open_lock("lock")
    assert not below.is_same(first, "lock")
    assert below.is_same(third, "lock")
    assert not below.is_same(third, "other")
    for descriptor in (first, second, third):
        os.close(descriptor)


def test_a_write_that_fails_leaves_nothing(below: Below, monkeypatch: pytest.MonkeyPatch) -> None:
    below.write("a", b"old", durable=False)

    def full(descriptor: int, content: bytes) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "write", full)
    with pytest.raises(OSError, match="No space left"):
        below.write("a", b"new", durable=False)
    assert below.every_key() == ["a"]
    assert below.read("a") == b"old"
