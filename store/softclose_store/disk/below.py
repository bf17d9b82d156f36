"""Owns the door to local files: each is opened below one folder, no link on the way is followed, and each is plain.

A store may come from a stranger. What lies where a file should be can be a link that leads elsewhere or in circles, a
device that never ends, a pipe on which a reader waits for ever, a folder, or a file of any size: all of them are
refused by name before a byte is read, written or deleted (docs/adr/084).
"""

from __future__ import annotations

import contextlib
import errno
import os
import stat
import uuid
from collections.abc import Callable, Iterator
from typing import Any

from softclose_store import faults
from softclose_store.disk.names import PARTIAL
from softclose_store.errors import NotPlainError, StoreError

MOST_BYTES = 2**31
"""Most bytes of one file of a store: what Blosc can hold."""

MOST_DEEP = 8
"""Most folders on the way to a file; a deeper one is a thing of its own, and no file of a store is so deep."""

_FOLDER = os.O_RDONLY | os.O_DIRECTORY
_WRITE = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW
# O_NONBLOCK: opening a pipe does not wait for its other end.
_READ = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_NOCTTY

_KINDS = {
    stat.S_IFLNK: "a link",
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFREG: "a file",
}


def parts_of(key: str) -> list[str]:
    """The names on the way to a key. Raises StoreError for one that leads out of its store."""
    parts = key.split("/")
    if "\\" in key or "\0" in key or any(part in ("", ".", "..") for part in parts):
        raise StoreError(f"{key!r} is no key of a store: it leads out of it; nothing was touched")
    return parts


class Below:
    """The files below one folder, which itself may be given by any path: that one is the user's own."""

    __slots__ = ("root",)

    def __init__(self, root: str) -> None:
        self.root = root

    def refusal(self, key: str, what: str) -> NotPlainError:
        """Why a key is not touched, and what to do."""
        return NotPlainError(
            f"{self.root}/{key} is {what}, and no file of a store is: nothing was read or written there; run "
            f"`softclose verify {self.root} --repair`"
        )

    @contextlib.contextmanager
    def _folder(self, key: str, *, make: bool = False, durable: bool = False) -> Iterator[tuple[int, str]]:
        """Descriptor of the folder that a key lies in, and the key's last name.

        Raises FileNotFoundError, and NotPlainError where something else stands in the place of a folder.
        """
        *folders, name = parts_of(key)
        try:
            folder = os.open(self.root, _FOLDER)
        except NotADirectoryError as e:
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), self.root) from e
        try:
            for k, part in enumerate(folders):
                try:
                    inner = os.open(part, _FOLDER | os.O_NOFOLLOW, dir_fd=folder)
                except FileNotFoundError:
                    if not make:
                        raise
                    with contextlib.suppress(FileExistsError):
                        os.mkdir(part, dir_fd=folder)
                    if durable:
                        os.fsync(folder)
                    inner = os.open(part, _FOLDER | os.O_NOFOLLOW, dir_fd=folder)
                except OSError as e:
                    if e.errno in (errno.ENOTDIR, errno.ELOOP):
                        raise self.refusal(
                            "/".join(folders[: k + 1]), f"{_kind(folder, part)} instead of a folder"
                        ) from e
                    raise
                os.close(folder)
                folder = inner
            yield folder, name
        finally:
            os.close(folder)

    def kind(self, key: str) -> str:
        """What lies at a key: "a file", "a folder", "a link" …; "" where nothing does. Raises NotPlainError."""
        try:
            with self._folder(key) as (folder, name):
                return _kind(folder, name)
        except FileNotFoundError:
            return ""

    def size(self, key: str) -> int | None:
        """Bytes of a file; None where there is none. Raises NotPlainError."""
        try:
            with self._folder(key) as (folder, name):
                return self._plain(os.stat(name, dir_fd=folder, follow_symlinks=False), key).st_size
        except FileNotFoundError:
            return None

    def identity(self, key: str) -> tuple[int, int] | None:
        """Changes when a file is replaced; None where there is none. Raises NotPlainError."""
        try:
            with self._folder(key) as (folder, name):
                found = self._plain(os.stat(name, dir_fd=folder, follow_symlinks=False), key)
                return found.st_ino, found.st_mtime_ns
        except FileNotFoundError:
            return None

    def _plain(self, found: os.stat_result, key: str) -> os.stat_result:
        if not stat.S_ISREG(found.st_mode):
            raise self.refusal(key, _KINDS.get(stat.S_IFMT(found.st_mode), "something else"))
        return found

    @contextlib.contextmanager
    def _opened(self, key: str, flags: int) -> Iterator[tuple[int, os.stat_result]]:
        with self._folder(key) as (folder, name):
            with contextlib.suppress(FileNotFoundError):  # opening a device can do something already
                self._plain(os.stat(name, dir_fd=folder, follow_symlinks=False), key)
            file = os.open(name, flags, 0o644, dir_fd=folder)
        try:
            yield file, self._plain(os.fstat(file), key)
        finally:
            os.close(file)

    def read(self, key: str, *, start: int = 0, stop: int | None = None, most: int = MOST_BYTES) -> bytes | None:
        """The bytes of a file, or those from `start` to `stop` (negative: counted from its end); None where none is.

        Raises NotPlainError for what is no plain file, or larger than `most`.
        """
        try:
            with self._opened(key, _READ) as (file, found):
                size = found.st_size
                if size > most:
                    raise self.refusal(key, f"of {size:,} bytes, where {most:,} are the most")
                first = max(0, size + start) if start < 0 else min(start, size)
                last = size if stop is None else min(stop, size)
                pieces = []
                while first < last:
                    piece = os.pread(file, last - first, first)
                    if not piece:
                        break
                    pieces.append(piece)
                    first += len(piece)
        except FileNotFoundError:
            return None
        return pieces[0] if len(pieces) == 1 else b"".join(pieces)

    def write(self, key: str, content: Any, *, durable: bool, fault: str = "") -> None:
        """Replace a file by a whole new one. Raises NotPlainError where a folder is in its place."""
        with self._folder(key, make=True, durable=durable) as (folder, name):
            try:
                replace_in(folder, name, content, durable=durable, fault=fault)
            except (IsADirectoryError, NotADirectoryError) as e:
                raise self.refusal(key, "a folder") from e

    def delete(self, key: str) -> None:
        """Remove a file, or a link itself; never a folder, nor what is in one. None there is no error."""
        with contextlib.suppress(FileNotFoundError), self._folder(key) as (folder, name):
            try:
                os.unlink(name, dir_fd=folder)
            except IsADirectoryError as e:
                raise self.refusal(key, "a folder") from e

    def move(self, key: str, other: Below, place: str) -> bool:
        """Rename whatever lies at a key to a place below another folder where nothing is; False where something is."""
        with self._folder(key) as (folder, name), other._folder(place, make=True) as (to, new):
            if _kind(to, new):
                return False
            os.rename(name, new, src_dir_fd=folder, dst_dir_fd=to)
        while "/" in key:  # folders that are empty now go too
            key = key.rpartition("/")[0]
            try:
                with self._folder(key) as (folder, name):
                    os.rmdir(name, dir_fd=folder)
            except OSError:  # not empty: it is somebody's
                break
        return True

    def open_lock(self, key: str) -> int:
        """Descriptor of a file to be locked, made where there is none; never that of what a link leads to."""
        with self._folder(key, make=True) as (folder, name):
            with contextlib.suppress(FileNotFoundError):
                self._plain(os.stat(name, dir_fd=folder, follow_symlinks=False), key)
            file = os.open(name, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK, 0o644, dir_fd=folder)
        try:
            self._plain(os.fstat(file), key)
        except BaseException:
            os.close(file)
            raise
        return file

    def is_same(self, file: int, key: str) -> bool:
        """Whether an open file is the one that lies at a key now."""
        try:
            with self._folder(key) as (folder, name):
                there, here = os.stat(name, dir_fd=folder, follow_symlinks=False), os.fstat(file)
        except (OSError, NotPlainError):
            return False
        return (there.st_dev, there.st_ino) == (here.st_dev, here.st_ino)

    def every_key(self, skip: Callable[[str], bool] | None = None) -> list[str]:
        """Every key, sorted: files, links and whatever else; a folder that is too deep is one key.

        skip: names right below the store that are left out, with everything in them.
        """
        found: list[str] = []
        pending = [""]
        while pending:
            at = pending.pop()
            for name, is_folder in self.names(at):
                if skip is not None and not at and skip(name):
                    continue
                if is_folder and at.count("/") < MOST_DEEP:
                    pending.append(f"{at}{name}/")
                else:
                    found.append(f"{at}{name}")
        return sorted(found)

    def names(self, prefix: str = "") -> list[tuple[str, bool]]:
        """(name, whether it is a folder) of what lies right below a folder; nothing where it is none."""
        try:
            with self._folder(f"{prefix.strip('/')}/_".lstrip("/")) as (folder, _), os.scandir(folder) as entries:
                return [(entry.name, entry.is_dir(follow_symlinks=False)) for entry in entries]
        except (FileNotFoundError, NotPlainError):  # removed meanwhile, or no store at all
            return []


def replace_in(folder: int, name: str, content: Any, *, durable: bool, fault: str = "") -> None:
    """Write a file of an open folder atomically: a temporary one beside it, renamed over it.

    Parameters
    ----------
    folder : int
        Descriptor of the folder.
    name : str
        What the file is called in it.
    content : bytes-like
        What.
    durable : bool
        Sync it, with its folder.
    fault : str
        Name of the place, for tests that break it.
    """
    temporary = f"{name}.{uuid.uuid4().hex}{PARTIAL}"
    file = os.open(temporary, _WRITE, 0o644, dir_fd=folder)
    try:
        try:
            view = memoryview(content).cast("B")
            if fault and os.environ.get(faults.VARIABLE):
                half = len(view) // 2
                _write_all(file, view[:half])
                faults.point(fault)
                view = view[half:]
            _write_all(file, view)
            if durable:
                os.fsync(file)
        finally:
            os.close(file)
        os.replace(temporary, name, src_dir_fd=folder, dst_dir_fd=folder)
    except BaseException:
        with contextlib.suppress(OSError):
            os.unlink(temporary, dir_fd=folder)
        raise
    if durable:
        os.fsync(folder)


def _write_all(file: int, view: memoryview) -> None:
    while view:
        view = view[os.write(file, view) :]


def _kind(folder: int, name: str) -> str:
    try:
        found = os.stat(name, dir_fd=folder, follow_symlinks=False)
    except FileNotFoundError:
        return ""
    return _KINDS.get(stat.S_IFMT(found.st_mode), "something else")
