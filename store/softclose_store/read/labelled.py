"""Owns what labelled readers such as xarray open a campaign by: files that are compared with what was written first."""

from __future__ import annotations

from collections.abc import Callable

from zarr.abc.buffer import Buffer, BufferPrototype
from zarr.abc.store import ByteRequest

from softclose_store.read.described import DescribedFiles


class CheckedFiles(DescribedFiles):
    """Described files of which each chunk is checked before it is handed out."""

    def __init__(self, files: DescribedFiles, check: Callable[[str, str], bool]) -> None:
        """check: (array, chunk) -> whether it is in use; raises DamageError where it is not what was written."""
        super().__init__(files.inner, files.documents, files.where, files.needed)
        self._check = check

    async def get(
        self, key: str, prototype: BufferPrototype | None = None, byte_range: ByteRequest | None = None
    ) -> Buffer | None:
        """Read a key; a chunk that is not in use is not there."""
        name, chunk = self.place(key)
        if name and not self._check(name, chunk):
            return None
        return await super().get(key, prototype, byte_range)
