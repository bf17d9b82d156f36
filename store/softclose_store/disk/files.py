"""Owns how bytes reach a store: paths and URLs, whole-file atomic writes, syncing, and keys.

Local writes go to a temporary file that is synced (if durable) and renamed over the old one; `LocalStore` does the same
without syncing and through a thread per file, which costs three times as much.
"""

from __future__ import annotations

import contextlib
import os
import uuid
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlparse

from zarr.abc.buffer import Buffer, BufferPrototype
from zarr.abc.store import ByteRequest, Store
from zarr.buffer import cpu, default_buffer_prototype
from zarr.storage import FsspecStore, LocalStore, ZipStore

from softclose_store import faults
from softclose_store.disk.loop import run_here
from softclose_store.disk.names import PARTIAL, is_chunk_key
from softclose_store.disk.objects import ServiceFiles, Version, is_object_url, open_objects
from softclose_store.errors import StoreError

StorePath = str | os.PathLike[str]


def path_text(path: StorePath) -> str:
    """A path or URL as text. Raises StoreError for anything else."""
    if not isinstance(path, str | os.PathLike):
        raise StoreError(f"{path!r} is no store; give the path of a directory, or a URL such as s3://bucket/name")
    return os.fspath(path)


def local_path(path: StorePath) -> Path | None:
    """The local directory of a store, or None where `path` is a URL of something else."""
    text = path_text(path)
    if not text.strip():
        raise StoreError("the store's path is empty; give a directory to create, or a URL such as s3://bucket/name")
    if "://" not in text:
        return Path(text)
    if text.startswith("file://"):
        return Path(unquote(urlparse(text).path))
    return None


def normalised(path: StorePath) -> str:
    """One text per store: an absolute path, or the URL without its last slash."""
    local = local_path(path)
    return os.fspath(path).rstrip("/") if local is None else os.path.abspath(local)


class LocalFiles(LocalStore):
    """A local store whose writes are whole files, renamed into place, and synced where `durable`.

    With `blind=True` chunk keys read as absent: a writer replaces whole shards and never merges with what is there, so
    that a damaged or half-written file cannot stand in its way.
    """

    def __init__(
        self, root: Path | str, *, read_only: bool = False, durable: bool = False, blind: bool = False
    ) -> None:
        super().__init__(root, read_only=read_only)
        self.durable = durable
        self.blind = blind

    def with_read_only(self, read_only: bool = False) -> LocalFiles:
        """The same store with another `read_only`."""
        return LocalFiles(self.root, read_only=read_only, durable=self.durable, blind=self.blind)

    async def get(
        self, key: str, prototype: BufferPrototype | None = None, byte_range: ByteRequest | None = None
    ) -> Buffer | None:
        """Read a key; chunks are invisible to a blind writer."""
        if self.blind and is_chunk_key(key):
            return None
        try:
            return await super().get(key, prototype, byte_range)
        except FileNotFoundError:  # the store's folder itself is not there
            return None

    async def set(self, key: str, value: Buffer) -> None:
        """Replace a key by a whole new file."""
        self._check_writable()
        write_file(
            os.path.join(self.root, key),
            value.as_buffer_like(),
            durable=self.durable,
            fault="inside-chunk-write" if self.blind and is_chunk_key(key) else "",
        )

    async def delete(self, key: str) -> None:
        """Remove a file, or a link itself; never a folder, nor what is in one."""
        self._check_writable()
        with contextlib.suppress(FileNotFoundError):
            os.unlink(os.path.join(self.root, key))


def write_file(path: str, content: Any, *, durable: bool, fault: str = "") -> None:
    """Write a file atomically: a temporary one beside it, renamed over it.

    Parameters
    ----------
    path : str
        Where.
    content : bytes-like
        What.
    durable : bool
        Sync it, with its folder.
    fault : str
        Name of the place, for tests that break it.
    """
    temporary = f"{path}.{uuid.uuid4().hex}{PARTIAL}"
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL
    try:
        file = os.open(temporary, flags, 0o644)
    except FileNotFoundError:
        _make_directories(os.path.dirname(path), durable=durable)
        file = os.open(temporary, flags, 0o644)
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
        os.replace(temporary, path)
    except BaseException:
        with contextlib.suppress(OSError):
            os.unlink(temporary)
        raise
    if durable:
        sync_directory(os.path.dirname(path))


def _write_all(file: int, view: memoryview) -> None:
    while view:
        view = view[os.write(file, view) :]


def _make_directories(path: str, *, durable: bool) -> None:
    """Create folders; each new entry is synced in its parent if durable."""
    missing = []
    while not os.path.isdir(path):
        missing.append(path)
        path = os.path.dirname(path)
    for folder in reversed(missing):
        with contextlib.suppress(FileExistsError):
            os.mkdir(folder)
        if durable:
            sync_directory(os.path.dirname(folder))


def sync_directory(path: StorePath) -> None:
    """Flush a folder's entries to the disk."""
    folder = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


ZIPPED = "is a zipped store, which can be read only; unzip it to go on with it"
"""Why nothing is written there."""


def is_zip(local: Path) -> bool:
    """Whether a local store is one file, as it travels."""
    return local.suffix == ".zip" and local.is_file()


def open_files(path: StorePath, *, read_only: bool, durable: bool = False, blind: bool = False) -> Store:
    """The zarr store behind a path or a URL. Durability is the service's own business behind a URL."""
    local = local_path(path)
    if local is not None and is_zip(local):
        if not read_only:
            raise StoreError(f"{path} {ZIPPED}")
        zipped = ZipStore(local, mode="r", read_only=True)
        zipped._sync_open()  # its own methods expect that of whoever does not open it by a coroutine
        return zipped
    if local is not None:
        return LocalFiles(local, read_only=read_only, durable=durable, blind=blind)
    if is_object_url(normalised(path)):
        return open_objects(normalised(path), read_only=read_only)
    try:
        # An instance of our own: asynchronous file systems are bound to the loop that first uses them.
        return FsspecStore.from_url(
            normalised(path), storage_options={"skip_instance_cache": True}, read_only=read_only
        )
    except (ImportError, ValueError) as e:
        raise StoreError(f"cannot open {path}: {e}; give a local path or a URL that fsspec knows (s3://…)") from e


def zarr_target(files: Store, path: StorePath) -> Any:
    """What Zarr and xarray open a store by: they need not have a library of their own for object stores."""
    return files if isinstance(files, ServiceFiles | ZipStore) else (local_path(path) or normalised(path))


def read_key(files: Store, key: str) -> bytes | None:
    """The bytes under a key, or None."""
    content = run_here(files.get(key, default_buffer_prototype()), files)
    return None if content is None else content.to_bytes()


def write_key(files: Store, key: str, content: bytes) -> None:
    """Replace the bytes under a key atomically."""
    run_here(files.set(key, cpu.Buffer.from_bytes(content)), files)


def create_key(files: Store, key: str, content: bytes) -> bool:
    """Write a key behind a URL where there is none; False where there is one. One request, which the service decides.

    Where a service knows no such request (an old fsspec) it is a look and a write, between which another may write.
    """
    if isinstance(files, ServiceFiles):
        return run_here(files.create(key, content), files)
    assert isinstance(files, FsspecStore)

    async def create() -> bool:
        try:
            await files.fs._pipe_file(f"{files.path}/{key}", content, mode="create")
        except FileExistsError:
            return False
        return True

    try:
        return run_here(create(), files)
    except (TypeError, NotImplementedError):
        if read_key(files, key) is not None:
            return False
        write_key(files, key, content)
        return True


def key_version(files: ServiceFiles, key: str) -> Version | None:
    """A key of an object store and the name of its state; None where there is none."""
    return run_here(files.version(key), files)


def replace_key(files: ServiceFiles, key: str, content: bytes, tag: str) -> bool:
    """Write a key of an object store where it is still in the state `tag`; False where it is not."""
    return run_here(files.replace(key, content, tag), files)


def delete_key(files: Store, key: str) -> None:
    """Remove a key; one that is not there is no error. Raises StoreError where it lies behind a link."""
    check_inside(files, key)
    run_here(files.delete(key), files)


def check_writable(path: StorePath) -> None:
    """Write a small file into a store and remove it.

    Its name is that of a file that a kill leaves behind: nobody takes it for data.

    Parameters
    ----------
    path : str or Path
        Folder or URL of the store.

    Raises
    ------
    OSError
        Or the service's own error, where that fails.
    """
    files = open_files(path, read_only=False)
    key = f"digests/probe.{uuid.uuid4().hex}{PARTIAL}"
    write_key(files, key, b"")
    delete_key(files, key)


def check_inside(files: Store, key: str) -> None:
    """Raise StoreError where a key would leave the store: an unsafe name, or a link on the way."""
    if os.path.isabs(key) or ".." in key.split("/") or "\\" in key:
        raise StoreError(f"{key!r} is no key of a store: it leads out of it; nothing was touched")
    if isinstance(files, LocalStore):
        folder = files.root
        for part in key.split("/")[:-1]:
            folder = folder / part
            if folder.is_symlink():
                raise StoreError(f"{folder} is a link, which may lead out of the store; nothing was touched")


def list_keys(files: Store) -> list[str]:
    """Every key of a store, sorted; links are keys like files, and not followed."""
    if isinstance(files, LocalStore):
        return sorted(_walk(os.fspath(files.root), ""))

    async def gather() -> list[str]:
        return sorted([key async for key in files.list() if not key.endswith("/")])  # folders, in a zip

    return run_here(gather(), files)


def _walk(folder: str, prefix: str) -> list[str]:
    keys: list[str] = []
    try:
        with os.scandir(folder) as entries:
            for entry in entries:
                if entry.is_dir(follow_symlinks=False):
                    keys += _walk(entry.path, f"{prefix}{entry.name}/")
                else:
                    keys.append(prefix + entry.name)
    except FileNotFoundError:  # removed meanwhile, or no store at all
        return keys
    return keys
