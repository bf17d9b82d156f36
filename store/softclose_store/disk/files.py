"""Owns how bytes reach a store: paths and URLs, and the keys behind them.

Local files go through the door of `disk/below.py`; a write is a temporary file that is synced (if durable) and renamed
over the old one. zarr's `LocalStore` follows links, and does the same without syncing and through a thread per file,
which costs three times as much.
"""

from __future__ import annotations

import os
import struct
import uuid
import zipfile
import zlib
from collections.abc import AsyncIterator, Callable, Iterable
from pathlib import Path
from urllib.parse import unquote, urlparse

from zarr.abc.buffer import Buffer, BufferPrototype
from zarr.abc.store import ByteRequest, OffsetByteRequest, RangeByteRequest, Store, SuffixByteRequest
from zarr.buffer import cpu, default_buffer_prototype
from zarr.storage import FsspecStore, ZipStore

from softclose_store.disk.below import MOST_BYTES, Below, parts_of
from softclose_store.disk.loop import Here, run_here
from softclose_store.disk.names import OWN_FOLDER, PARTIAL, is_chunk_key
from softclose_store.disk.objects import ServiceFiles, Version, is_object_url, open_objects
from softclose_store.errors import NotPlainError, StoreError

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
        return Path(text).expanduser() if text.startswith("~") else Path(text)
    if text.startswith("file://"):
        return Path(unquote(urlparse(text).path))
    return None


def normalised(path: StorePath) -> str:
    """One text per store: an absolute path, or the URL without its last slash."""
    local = local_path(path)
    return os.fspath(path).rstrip("/") if local is None else os.path.abspath(local)


class LocalFiles(Here, Store):
    """The files of a local store, through the door of `Below`; writes are whole files, synced where `durable`.

    With `blind=True` chunk keys read as absent: a writer replaces whole shards and never merges with what is there, so
    that a damaged or half-written file cannot stand in its way.
    """

    supports_writes = True
    supports_deletes = True
    supports_listing = True

    def __init__(
        self, root: Path | str, *, read_only: bool = False, durable: bool = False, blind: bool = False
    ) -> None:
        super().__init__(read_only=read_only)
        self.root = Path(root)
        self.below = Below(os.fspath(root))
        self.durable = durable
        self.blind = blind

    def with_read_only(self, read_only: bool = False) -> LocalFiles:
        """The same store with another `read_only`."""
        return LocalFiles(self.root, read_only=read_only, durable=self.durable, blind=self.blind)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, LocalFiles) and self.root == other.root

    def __repr__(self) -> str:
        return f"LocalFiles({os.fspath(self.root)!r})"

    async def get(
        self, key: str, prototype: BufferPrototype | None = None, byte_range: ByteRequest | None = None
    ) -> Buffer | None:
        """Read a key; chunks are invisible to a blind writer."""
        if self.blind and is_chunk_key(key):
            return None
        start, stop = 0, None
        if isinstance(byte_range, RangeByteRequest):
            start, stop = byte_range.start, byte_range.end
        elif isinstance(byte_range, OffsetByteRequest):
            start = byte_range.offset
        elif isinstance(byte_range, SuffixByteRequest):
            start = -byte_range.suffix
        content = self.below.read(key, start=start, stop=stop, most=most_bytes(key))
        return None if content is None else (prototype or default_buffer_prototype()).buffer.from_bytes(content)

    async def get_partial_values(
        self, prototype: BufferPrototype, key_ranges: Iterable[tuple[str, ByteRequest | None]]
    ) -> list[Buffer | None]:
        """Read parts of keys."""
        return [await self.get(key, prototype, byte_range) for key, byte_range in key_ranges]

    async def exists(self, key: str) -> bool:
        """Whether there is a key."""
        return self.below.size(key) is not None

    async def getsize(self, key: str) -> int:
        """Bytes of a key."""
        size = self.below.size(key)
        if size is None:
            raise FileNotFoundError(key)
        return size

    async def set(self, key: str, value: Buffer) -> None:
        """Replace a key by a whole new file."""
        self._check_writable()
        fault = "inside-chunk-write" if self.blind and is_chunk_key(key) else ""
        self.below.write(key, value.as_buffer_like(), durable=self.durable, fault=fault)

    async def delete(self, key: str) -> None:
        """Remove a file, or a link itself; never a folder, nor what is in one."""
        self._check_writable()
        self.below.delete(key)

    async def list(self) -> AsyncIterator[str]:
        """Every key; links are keys like files, and not followed."""
        for key in self.below.every_key():
            yield key

    async def list_prefix(self, prefix: str) -> AsyncIterator[str]:
        """Every key that begins so."""
        for key in self.below.every_key():
            if key.startswith(prefix):
                yield key

    async def list_dir(self, prefix: str) -> AsyncIterator[str]:
        """What lies right below a folder."""
        for name, _ in self.below.names(prefix):
            yield name


MOST_TEXT = 8_000_000
"""Most bytes of a file of JSON. The root of a campaign of five hundred stages has five million."""


def most_bytes(key: str) -> int:
    """Most bytes of what lies at a key."""
    return MOST_TEXT if key.endswith((".json", ".lock")) else MOST_BYTES


class ZippedFiles(ZipStore):
    """A store that travels as one zip: what an entry says of its size is asked before it is unpacked.

    Archivers put the folder itself into the file, and some lay notes of their own beside it: the store is the one
    folder that has a root, and nothing else in the file is looked at.
    """

    def _sync_open(self) -> None:
        try:
            super()._sync_open()
        except (zipfile.BadZipFile, NotImplementedError, OverflowError, UnicodeDecodeError, struct.error) as e:
            raise StoreError(f"{self.path} is no zip file, or was cut short on its way ({e}): copy it again") from e
        folder = self._folder()
        kept = [info for info in self._zf.infolist() if info.filename.startswith(folder) and not _is_note(info)]
        for info in kept:
            info.filename = info.filename.removeprefix(folder)  # what it is called in the file stays `orig_filename`
        self._zf.filelist[:] = [info for info in kept if info.filename]
        self._zf.NameToInfo.clear()
        self._zf.NameToInfo.update({info.filename: info for info in self._zf.filelist})

    def _folder(self) -> str:
        """The folder of the store within the file, with its slash; "" where it is not in one."""
        names = [info.filename for info in self._zf.infolist() if not _is_note(info)]
        roots = [name.removesuffix(ROOT) for name in names if name == ROOT or name.endswith(f"/{ROOT}")]
        depth = min((root.count("/") for root in roots), default=0)
        found = sorted({root for root in roots if root.count("/") == depth})
        if len(found) > 1:
            told = ", ".join(root.rstrip("/") for root in found[:5])
            raise StoreError(f"{self.path} holds {len(found)} stores ({told} …): unzip it, and give one of them")
        return found[0] if found else ""

    async def get(self, key: str, prototype: BufferPrototype, byte_range: ByteRequest | None = None) -> Buffer | None:
        """Read a key."""
        try:
            size = self._zf.getinfo(key).file_size
        except KeyError:
            return None
        if size > most_bytes(key):
            raise NotPlainError(
                f"{key} of {self.path} is of {size:,} bytes, and no file of a store is: nothing was read"
            )
        try:
            return await super().get(key, prototype, byte_range)
        except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError, OSError) as e:
            raise StoreError(f"{key} of {self.path} cannot be unpacked ({e}): copy the file again") from e


def _is_note(info: zipfile.ZipInfo) -> bool:
    """Whether an entry is an archiver's own, such as macOS's `__MACOSX/` and `.DS_Store`."""
    *folders, name = info.filename.split("/")
    return "__MACOSX" in folders or name in (".DS_Store", "Thumbs.db", "desktop.ini") or name.startswith("._")


ROOT = "zarr.json"
"""What every store has."""


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
    """Whether a local store is one file, as it travels: also as archivers of other systems spell its ending."""
    return local.suffix.lower() == ".zip" and local.is_file()


def open_files(path: StorePath, *, read_only: bool, durable: bool = False, blind: bool = False) -> Store:
    """The zarr store behind a path or a URL. Durability is the service's own business behind a URL."""
    local = local_path(path)
    if local is not None and is_zip(local):
        if not read_only:
            raise StoreError(f"{path} {ZIPPED}")
        zipped = ZippedFiles(local, mode="r", read_only=True)
        zipped._sync_open()  # its own methods expect that of whoever does not open it by a coroutine
        return zipped
    if local is not None:
        return LocalFiles(local, read_only=read_only, durable=durable, blind=blind)
    if normalised(path).startswith(("zip:", "tar:", "libarchive:")):
        raise StoreError(f"{path} is a URL of an archive; give the path of the file, such as runs/a.zip")
    if is_object_url(normalised(path)):
        return open_objects(normalised(path), read_only=read_only)
    try:
        # An instance of our own: asynchronous file systems are bound to the loop that first uses them.
        return FsspecStore.from_url(
            normalised(path), storage_options={"skip_instance_cache": True}, read_only=read_only
        )
    except (ImportError, ValueError) as e:
        raise StoreError(f"cannot open {path}: {e}; give a local path or a URL that fsspec knows (s3://…)") from e


def read_key(files: Store, key: str) -> bytes | None:
    """The bytes under a key, or None. Raises NotPlainError where something else than a plain file lies there."""
    if isinstance(files, LocalFiles):
        return files.below.read(key, most=most_bytes(key))
    content = run_here(files.get(key, default_buffer_prototype()), files)
    return None if content is None else content.to_bytes()


def look_at(files: Store, key: str) -> bytes | None:
    """The bytes under a key; None where there is none, or something else than a plain file, or an unsafe name."""
    try:
        return read_key(files, key)
    except StoreError:
        return None


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
    """Remove a key; one that is not there is no error. Raises NotPlainError where it lies behind a link."""
    parts_of(key)
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
    key = f"{OWN_FOLDER}/probe.{uuid.uuid4().hex}{PARTIAL}"
    write_key(files, key, b"")
    delete_key(files, key)


def list_keys(files: Store, skip: Callable[[str], bool] | None = None) -> list[str]:
    """Every key of a store, sorted; links are keys like files, and not followed.

    skip: names at the store's root that are not looked into.
    """
    if isinstance(files, LocalFiles):
        return files.below.every_key(skip)

    async def gather() -> list[str]:
        if skip is None:
            return sorted([key async for key in files.list() if not key.endswith("/")])  # folders, in a zip
        folders = {name.strip("/") async for name in files.list_dir("")}
        found = [key for name in folders if not skip(name) async for key in files.list_prefix(f"{name}/")]
        return sorted(key for key in found if not key.endswith("/"))

    return run_here(gather(), files)
