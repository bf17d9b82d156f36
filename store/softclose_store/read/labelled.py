"""Owns what labelled readers such as xarray open a campaign by: files that are compared with what was written first."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from zarr.abc.buffer import Buffer, BufferPrototype
from zarr.abc.store import ByteRequest
from zarr.buffer import default_buffer_prototype

from softclose_store.disk.files import look_at
from softclose_store.read.described import DescribedFiles
from softclose_store.schema.digests import sha256


class CheckedFiles(DescribedFiles):
    """Described files of which each chunk is checked before it is handed out."""

    def __init__(
        self, files: DescribedFiles, check: Callable[[str, str], bool], expected: Mapping[str, str] | None = None
    ) -> None:
        """check: (array, chunk) -> whether it is in use; raises DamageError where it is not what was written.

        expected: sha256 of each file of a result group, by its key.
        """
        super().__init__(files.inner, files.documents, files.where, files.needed)
        self._check = check
        self._expected = expected or {}

    async def get(
        self, key: str, prototype: BufferPrototype | None = None, byte_range: ByteRequest | None = None
    ) -> Buffer | None:
        """Read a key; a chunk that is not in use is not there."""
        if key in self._expected:
            content = look_at(self.inner, key)
            if content is None or sha256(content) != self._expected[key]:
                raise self.damage(key, "is missing" if content is None else "is not what was written")
            return (prototype or default_buffer_prototype()).buffer.from_bytes(content)
        name, chunk = self.place(key)
        if name and not self._check(name, chunk):
            return None
        return await super().get(key, prototype, byte_range)
