"""A disk that loses power: records what a store does to its files, and makes what a loss after any step may leave.

The file system is the worst that POSIX allows. What was written to a file since it was last synced may be there, torn,
zeros or gone; names created, replaced or removed in a folder since that was last synced may be there or not, each for
itself, whatever their order.
"""

from __future__ import annotations

import os
import random
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from softclose_store.disk import below as below_module
from softclose_store.disk import files as files_module
from softclose_store.write import create as create_module

LOSSES = ("forgets", "names first", "torn")
"""Everything unsynced is gone; all names are there and no unsynced content; each name and content by itself."""

Step = tuple[str, Any, Any]


@dataclass
class Recorder:
    """Stands for `os` in the store's modules: does what is asked, and notes what changes the disk."""

    base: Path
    steps: list[Step] = field(default_factory=list)
    _open: dict[int, int | str] = field(default_factory=dict)
    _n_files: int = 0

    def __getattr__(self, name: str) -> Any:
        return getattr(os, name)

    def _name(self, path: Any, folder: int | None = None) -> str:
        at = Path(path) if folder is None else Path(f"/proc/self/fd/{folder}").readlink() / path
        return at.relative_to(self.base).as_posix()

    def open(self, path: Any, flags: int, mode: int = 0o777, *, dir_fd: int | None = None) -> int:
        is_new = flags & os.O_CREAT and flags & os.O_EXCL
        descriptor = os.open(path, flags, mode, dir_fd=dir_fd)
        if is_new:
            self._n_files += 1
            self._open[descriptor] = self._n_files
            self.steps.append(("create", self._name(path, dir_fd), self._n_files))
        else:
            self._open[descriptor] = self._name(path, dir_fd)
        return descriptor

    def write(self, descriptor: int, content: Any) -> int:
        n = os.write(descriptor, content)
        self.steps.append(("write", self._open[descriptor], bytes(content[:n])))
        return n

    def fsync(self, descriptor: int) -> None:
        """Nothing here relies on this machine's disk."""
        self.steps.append(("sync", self._open[descriptor], None))

    def replace(self, old: Any, new: Any, *, src_dir_fd: int, dst_dir_fd: int) -> None:
        os.replace(old, new, src_dir_fd=src_dir_fd, dst_dir_fd=dst_dir_fd)
        self.steps.append(("rename", self._name(old, src_dir_fd), self._name(new, dst_dir_fd)))

    def rename(self, old: Any, new: Any) -> None:
        os.rename(old, new)
        self.steps.append(("rename", self._name(old), self._name(new)))

    def mkdir(self, path: Any, *, dir_fd: int | None = None) -> None:
        os.mkdir(path, dir_fd=dir_fd)
        self.steps.append(("mkdir", self._name(path, dir_fd), None))

    def unlink(self, path: Any, *, dir_fd: int | None = None) -> None:
        os.unlink(path, dir_fd=dir_fd)
        self.steps.append(("unlink", self._name(path, dir_fd), None))

    def mark(self, promise: int) -> None:
        """From here on so many candidates are promised to be there."""
        self.steps.append(("mark", promise, None))


@contextmanager
def recording(base: Path) -> Iterator[Recorder]:
    """Record what the store's modules do below a folder that exists."""
    recorder = Recorder(base)
    with pytest.MonkeyPatch.context() as patch:
        for module in (below_module, files_module, create_module):
            patch.setattr(module, "os", recorder)
        yield recorder


@dataclass
class _File:
    content: bytes = b""
    synced: bytes = b""


@dataclass
class _Folder:
    names: dict[str, _Folder | _File] = field(default_factory=dict)
    synced: dict[str, _Folder | _File] = field(default_factory=dict)
    pending: list[dict[str, _Folder | _File | None]] = field(default_factory=list)
    """Changes of names since the last sync; None: removed."""

    def apply(self, change: dict[str, _Folder | _File | None]) -> None:
        _apply(self.names, change)
        self.pending.append(change)


def _apply(names: dict[str, Any], change: dict[str, Any]) -> None:
    for name, node in change.items():
        if node is None:
            names.pop(name, None)
        else:
            names[name] = node


class Disk:
    """What was done to a disk, in memory and on the platter."""

    def __init__(self) -> None:
        self.top = _Folder()
        self.promised = -1
        self._files: dict[int, _File] = {}

    def _folder(self, path: str) -> _Folder:
        node: Any = self.top
        for part in path.split("/") if path not in ("", ".") else ():
            node = node.names[part]
        assert isinstance(node, _Folder)
        return node

    def do(self, step: Step) -> None:
        """One step further."""
        what, a, b = step
        if what == "mark":
            self.promised = a
        elif what == "write":
            self._files[a].content += b
        elif what == "sync" and isinstance(a, int):
            self._files[a].synced = self._files[a].content
        elif what == "sync":
            folder = self._folder(a)
            folder.synced, folder.pending = dict(folder.names), []
        else:
            parent, _, name = a.rpartition("/")
            folder = self._folder(parent)
            if what == "create":
                self._files[b] = _File()
                folder.apply({name: self._files[b]})
            elif what == "mkdir":
                folder.apply({name: _Folder()})
            elif what == "unlink":
                folder.apply({name: None})
            elif what == "rename":
                assert b.rpartition("/")[0] == parent
                folder.apply({name: None, b.rpartition("/")[2]: folder.names[name]})

    def sync_all(self, folder: _Folder | None = None) -> None:
        """Everything reaches the platter."""
        folder = folder or self.top
        folder.synced, folder.pending = dict(folder.names), []
        for node in folder.names.values():
            if isinstance(node, _Folder):
                self.sync_all(node)
            else:
                node.synced = node.content

    def lose_power(self, target: Path, loss: str, rng: random.Random) -> None:
        """Make below `target` what may be found when the power is back."""
        self._make(self.top, target, loss, rng)

    def _make(self, folder: _Folder, target: Path, loss: str, rng: random.Random) -> None:
        target.mkdir(parents=True, exist_ok=True)
        names = dict(folder.synced)
        for change in folder.pending:
            if loss == "names first" or (loss == "torn" and rng.random() < 0.5):
                _apply(names, change)
        for name, node in names.items():
            if isinstance(node, _Folder):
                self._make(node, target / name, loss, rng)
            else:
                (target / name).write_bytes(_left_of(node, loss, rng))


def _left_of(file: _File, loss: str, rng: random.Random) -> bytes:
    if loss != "torn" or file.synced == file.content:
        return file.synced
    whole = file.content
    half = whole[: rng.randrange(len(whole) + 1)]
    return rng.choice([whole, half, bytes(len(whole)), half + bytes(len(whole) - len(half)), file.synced])
