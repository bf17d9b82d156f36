"""Owns digests: what ties stored bytes to the place where they belong.

Chunk and record digests are 64-bit xxh3 (damage, not malice, is looked for; 20 GB/s), identities are sha256.
A digest of 0 means "not written", so a digest that comes out as 0 is stored as 1.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import xxhash


def canonical_json(data: Any) -> str:
    """One text per value: sorted keys, no spaces, shortest floats."""
    return json.dumps(data, sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)


def fingerprint_of(config: Mapping[str, Any]) -> str:
    """sha256 of the canonical JSON of a configuration: the identity of a campaign."""
    return sha256(canonical_json(config).encode())


def sha256(data: bytes) -> str:
    """Hexadecimal sha256."""
    return hashlib.sha256(data).hexdigest()


def chunk_digest(name: str, i_candidate: int, i_chunk: int, proposal_digest: int, rows: np.ndarray[Any, Any]) -> int:
    """Digest of the rows that one chunk holds of one array, keyed with where they belong. rows: C-contiguous."""
    key = f"{name}|{i_candidate}|{i_chunk}|{proposal_digest}|{rows.dtype.str}|{rows.shape}"
    state = xxhash.xxh3_64(key.encode())
    state.update(rows.view(np.uint8).data if rows.size else b"")
    return state.intdigest() or 1


def fields_digest(key: str, fields: Iterable[tuple[str, Any]]) -> int:
    """Digest of named values (arrays, numbers, text) keyed with `key`."""
    state = xxhash.xxh3_64(key.encode())
    for name, value in fields:
        if isinstance(value, str):
            content, kind = value.encode(), "text"
        else:
            array = np.ascontiguousarray(value)
            if array.dtype.kind in "OTU":
                content, kind = "\0".join(str(item) for item in array.ravel()).encode(), f"text{array.shape}"
            else:
                content, kind = array.tobytes(), f"{array.dtype.str}{array.shape}"
        state.update(f"|{name}|{kind}|{len(content)}|".encode())
        state.update(content)
    return state.intdigest() or 1


def array_sha256(array: np.ndarray[Any, Any]) -> str:
    """sha256 of an array's type, shape and values."""
    kind = array.dtype.kind in "OTU"
    content = "\0".join(str(item) for item in array.ravel()).encode() if kind else np.ascontiguousarray(array).tobytes()
    return sha256(f"{'text' if kind else array.dtype.str}|{array.shape}|".encode() + content)
