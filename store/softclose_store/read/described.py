"""Owns the files of a store as its schema describes them: what zarr opens arrays by, for reading and for writing.

The metadata of arrays are the schema's own, never those of the files: no file decides about types, sizes or codecs.
Chunks come from the files, as large as they may be, and where one has to be there its absence is damage: zarr would
take it for one full of fill values.
"""

from __future__ import annotations

import time
from collections.abc import AsyncIterator, Callable, Iterable, Mapping

from zarr.abc.buffer import Buffer, BufferPrototype
from zarr.abc.store import ByteRequest, Store, SuffixByteRequest
from zarr.buffer import default_buffer_prototype

from softclose_store.disk.files import LocalFiles
from softclose_store.errors import DamageError
from softclose_store.read.bounds import Bound, bound_of
from softclose_store.schema.texts import read_json

Needed = Callable[[str, str], bool]
"""(array, chunk such as `c.0.0`) -> whether it has to be there."""


class DescribedFiles(Store):
    """The files of one store behind the schema's metadata: key -> bytes of every `zarr.json` that there is."""

    supports_writes = True
    supports_deletes = True
    supports_listing = True

    def __init__(self, inner: Store, documents: Mapping[str, bytes], where: str, needed: Needed) -> None:
        super().__init__(read_only=inner.read_only)
        self.inner = inner
        self.documents = documents
        self.where = where
        self.needed = needed
        self._bounds: dict[str, Bound] = {}
        self.writing_s = 0.0
        """Time that writes of chunks have taken [s]."""

    def with_read_only(self, read_only: bool = False) -> DescribedFiles:
        """The same store with another `read_only`."""
        return DescribedFiles(self.inner.with_read_only(read_only), self.documents, self.where, self.needed)

    def __eq__(self, other: object) -> bool:
        return self is other

    def place(self, key: str) -> tuple[str, str]:
        """(array, chunk) that a key belongs to; empty texts for what is no chunk of an array of the schema."""
        name = key
        while name:
            name, _, _ = name.rpartition("/")
            if f"{name}/zarr.json" in self.documents:
                chunk = key[len(name) + 1 :]
                return (name, chunk) if chunk == "c" or chunk[:2] in ("c.", "c/") else ("", "")
        return "", ""

    def bound(self, name: str) -> Bound:
        """What a chunk's file of an array may hold."""
        if name not in self._bounds:
            self._bounds[name] = bound_of(read_json(self.documents[f"{name}/zarr.json"]))
        return self._bounds[name]

    async def get(
        self, key: str, prototype: BufferPrototype | None = None, byte_range: ByteRequest | None = None
    ) -> Buffer | None:
        """Read a key: metadata from the schema, a chunk from its file. Raises DamageError."""
        prototype = prototype or default_buffer_prototype()
        if key in self.documents:
            return prototype.buffer.from_bytes(self.documents[key])
        name, chunk = self.place(key)
        if not name:
            return None
        bound = self.bound(name)
        if isinstance(self.inner, LocalFiles) and byte_range is None and not self.inner.blind:
            content = self.inner.below.read(key, most=bound.most_bytes)
            found = None if content is None else prototype.buffer.from_bytes(content)
        else:
            found = await self.inner.get(key, prototype, byte_range)
        if found is None:
            if self.needed(name, chunk):
                raise self.damage(key, "is missing")
            return None
        if not isinstance(byte_range, SuffixByteRequest):  # which is the list of a shard's chunks, of known length
            try:
                bound.check(memoryview(found.as_buffer_like()).cast("B"), part=byte_range is not None)
            except ValueError as e:
                raise self.damage(key, f"cannot be read ({e})") from e
        return found

    def damage(self, key: str, what: str) -> DamageError:
        """The error of one file, with what to do."""
        return DamageError(f"{key} of {self.where} {what}: run `softclose verify {self.where} --repair`")

    async def get_partial_values(
        self, prototype: BufferPrototype, key_ranges: Iterable[tuple[str, ByteRequest | None]]
    ) -> list[Buffer | None]:
        """Read parts of keys."""
        return [await self.get(key, prototype, byte_range) for key, byte_range in key_ranges]

    async def exists(self, key: str) -> bool:
        """Whether there is a key."""
        return key in self.documents or await self.inner.exists(key)

    async def set(self, key: str, value: Buffer) -> None:
        """Replace a chunk."""
        assert key not in self.documents
        began = time.perf_counter()
        await self.inner.set(key, value)
        self.writing_s += time.perf_counter() - began

    async def delete(self, key: str) -> None:
        """Remove a chunk."""
        await self.inner.delete(key)

    async def list(self) -> AsyncIterator[str]:
        """Every key."""
        async for key in self.inner.list():
            yield key

    async def list_prefix(self, prefix: str) -> AsyncIterator[str]:
        """Every key that begins so."""
        async for key in self.inner.list_prefix(prefix):
            yield key

    async def list_dir(self, prefix: str) -> AsyncIterator[str]:
        """What lies right below a folder."""
        async for name in self.inner.list_dir(prefix):
            yield name


def never(name: str, chunk: str) -> bool:
    """No chunk has to be there: what writers, who read none, and checks, who look themselves, ask by."""
    return False
