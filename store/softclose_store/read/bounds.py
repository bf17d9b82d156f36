"""Owns what a chunk may decode to: asked of its first bytes, before a codec allocates what they claim.

Blosc and Zstandard say in a header how large their content is, and both allocate that much before they look further; so
does the codec of text, which believes a number of words. A chunk whose header says anything but what its array's
metadata say is damage, or a bomb.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numcodecs.zstd import decompress

MOST_WORDS_BYTES = 16_000_000
"""Most bytes of a chunk of text, decoded: 128 candidates have 40 kB each."""

_BLOSC_HEADER = 16
_ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
_CHECKSUM = 4
"""Bytes of the crc32c behind a chunk."""
_ITEMSIZES = {"bool": 1, "string": 16}
_SLACK = 4_096
"""Bytes that a codec may add to what it cannot compress."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Bound:
    """What one file of an array may hold."""

    items: int
    """Elements of an inner chunk."""
    chunk_bytes: int
    """Bytes of an inner chunk, decoded; of text those of its places."""
    n_inner: int
    """Inner chunks in the file: 1 where it is no shard."""
    codecs: tuple[str, ...]
    """Names of the codecs of an inner chunk."""

    @property
    def most_bytes(self) -> int:
        """Most bytes of the file."""
        decoded = MOST_WORDS_BYTES if "vlen-utf8" in self.codecs else self.chunk_bytes
        return self.n_inner * (decoded + decoded // 64 + _SLACK)

    def check(self, content: memoryview, *, part: bool = False) -> None:
        """Raise ValueError where a file, or one inner chunk of it (part), claims to decode to anything else."""
        if self.n_inner == 1 or part:
            self._check_chunk(content)
            return
        index = np.frombuffer(content[-(16 * self.n_inner + _CHECKSUM) : -_CHECKSUM], dtype="<u8").reshape(-1, 2)
        if len(index) != self.n_inner:
            raise ValueError("its list of chunks is cut")
        for offset, n_bytes in index.tolist():
            if n_bytes < 2**64 - 1:  # there is such a chunk
                if offset + n_bytes > len(content):
                    raise ValueError("its list of chunks leads out of it")
                self._check_chunk(content[offset : offset + n_bytes])

    def _check_chunk(self, content: memoryview) -> None:
        if "blosc" in self.codecs:
            said = int.from_bytes(content[4:8], "little")
            if len(content) < _BLOSC_HEADER or said != self.chunk_bytes:
                raise ValueError(f"it says that it holds {said:,} bytes; {self.chunk_bytes:,} are the array's")
        if "vlen-utf8" in self.codecs:
            words = content[:-_CHECKSUM]
            if "zstd" in self.codecs:
                said = _zstd_size(words)
                if not 4 <= said <= MOST_WORDS_BYTES:
                    raise ValueError(f"it says that it holds {said:,} bytes of text; {MOST_WORDS_BYTES:,} are the most")
                words = memoryview(decompress(words))
            n = int.from_bytes(words[:4], "little")
            if n != self.items:
                raise ValueError(f"it says that it holds {n:,} texts; {self.items:,} are the array's")


def _zstd_size(frame: memoryview) -> int:
    """Decoded bytes of a Zstandard frame, as its header says (RFC 8878, 3.1.1.1); -1 where it does not."""
    if bytes(frame[:4]) != _ZSTD_MAGIC or len(frame) < 6:
        return -1
    descriptor = frame[4]
    single, flag = bool(descriptor & 0x20), descriptor >> 6
    at = 5 + (not single) + (0, 1, 2, 4)[descriptor & 3]
    width = (int(single), 2, 4, 8)[flag]
    if not width:
        return -1
    return int.from_bytes(frame[at : at + width], "little") + (256 if width == 2 else 0)


def bound_of(document: Mapping[str, Any]) -> Bound:
    """What a file of an array may hold, by the array's metadata, which were checked before.

    Parameters
    ----------
    document : mapping
        The array's `zarr.json`.

    Returns
    -------
    Bound
    """
    outer = document["chunk_grid"]["configuration"]["chunk_shape"]
    codecs, inner = document["codecs"], outer
    if codecs[0]["name"] == "sharding_indexed":
        inner, codecs = codecs[0]["configuration"]["chunk_shape"], codecs[0]["configuration"]["codecs"]
    kind = document["data_type"]
    itemsize = _ITEMSIZES.get(kind) or int("".join(c for c in kind if c.isdigit())) // 8
    return Bound(
        items=math.prod(inner),
        chunk_bytes=math.prod(inner) * itemsize,
        n_inner=math.prod(outer) // math.prod(inner),
        codecs=tuple(codec["name"] for codec in codecs),
    )
