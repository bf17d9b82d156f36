"""Owns digests: what ties stored bytes to the place where they belong.

Digests of blocks and records are 64-bit xxh3 (damage, not malice, is looked for; 20 GB/s), identities are sha256.
A digest of 0 means "not written", so a digest that comes out as 0 is stored as 1.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import xxhash
from numpy.typing import ArrayLike, NDArray


def canonical_json(data: Any) -> str:
    """One text per value: sorted keys, no spaces, shortest floats."""
    return json.dumps(data, sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)


def fingerprint_of(config: Mapping[str, Any]) -> str:
    """sha256 of the canonical JSON of a configuration: the identity of a campaign."""
    return sha256(canonical_json(config).encode())


def sha256(data: bytes) -> str:
    """Hexadecimal sha256."""
    return hashlib.sha256(data).hexdigest()


def keyed_digest(key: str, parts: Iterable[bytes | memoryview]) -> int:
    """xxh3 of a key and of parts, whose lengths belong to it."""
    state = xxhash.xxh3_64(key.encode())
    for part in parts:
        state.update(f"|{len(part)}|".encode())
        state.update(part)
    return state.intdigest() or 1


class BlockDigest:
    """Digest of one array of a block, keyed with where it belongs; its values may come in parts that follow."""

    def __init__(
        self, place: tuple[str, str, int, int], proposals: int, dtype: np.dtype[Any], shape: tuple[int, ...]
    ) -> None:
        """place: stage, array, row and column of the block; proposals: digest of those that it was computed for."""
        stage, name, i, j = place
        self._state = xxhash.xxh3_64(f"{stage}|{name}|{i}|{j}|{proposals}|{dtype.str}|{shape}".encode())

    def add(self, values: NDArray[Any]) -> None:
        """The next values: C-contiguous, little-endian."""
        self._state.update(values.reshape(-1).view(np.uint8).data if values.size else b"")

    @property
    def value(self) -> int:
        """The digest of what was added."""
        return int(self._state.intdigest()) or 1


def block_digest(stage: str, name: str, i_block: int, j_block: int, proposals: int, values: NDArray[Any]) -> int:
    """Digest of one array of a block, keyed with where it belongs. values: C-contiguous, little-endian."""
    digest = BlockDigest((stage, name, i_block, j_block), proposals, values.dtype, values.shape)
    digest.add(values)
    return digest.value


def proposals_digest(
    waveforms: Iterable[ArrayLike], n_switches: int, start: int, designs: Iterable[ArrayLike] | None = None
) -> int:
    """Digest of what the candidates of one row of blocks are simulated with.

    Parameters
    ----------
    waveforms : iterable of (n_pulse, 4) array-like
        Rows of NaN are none.
    n_switches : int
        Size of their ensemble.
    start : int
        Campaign-wide index of the first of them.
    designs : iterable of (n_design,) array-like, optional
        Nominal values of each, NaN for the population's own, where candidates have such.
    """
    parts = []
    for waveform in waveforms:
        rows = np.atleast_2d(np.asarray(waveform, dtype="<f8"))
        parts.append(np.ascontiguousarray(rows[~np.isnan(rows).all(axis=1)]).tobytes())
    n = len(parts)
    if designs is not None:
        parts += [np.asarray(design, dtype="<f8").tobytes() for design in designs]
    return keyed_digest(f"proposals|{start}|{n}|{n_switches}", parts)


def assessed_digest(
    stage: str,
    i_block: int,
    j_block: int,
    proposals: int,
    max_contact_speed: ArrayLike,
    closed: ArrayLike,
    status: ArrayLike,
    settling: ArrayLike,
    asked: ArrayLike | None = None,
) -> int:
    """Digest of what an assessment takes of a block.

    A task's answer carries these arrays; the driver compares their digest with the last of the block's marker.

    Parameters
    ----------
    stage : str
        Stage of the block.
    i_block, j_block : int
        Its row and column.
    proposals : int
        Digest of its proposals.
    max_contact_speed, closed, status, settling : (candidates, switches) array-like
        Of the switches that were simulated.
    asked : (candidates, switches, n_asked) array-like, optional
        Further quantities of each, where the campaign asks for any.
    """

    def of_floats(values: ArrayLike) -> bytes:
        numbers = np.asarray(values, dtype="<f8")
        return np.where(np.isnan(numbers), np.nan, numbers).tobytes()  # one NaN: its bits mean nothing

    parts = [
        of_floats(max_contact_speed),
        np.asarray(closed, dtype=bool).tobytes(),
        np.asarray(status, dtype="i1").tobytes(),
        of_floats(settling),
    ]
    if asked is not None and np.shape(asked)[-1]:
        parts.append(of_floats(asked))
    return keyed_digest(f"assessed|{stage}|{i_block}|{j_block}|{proposals}|{np.shape(closed)}", parts)


def array_sha256(array: np.ndarray[Any, Any]) -> str:
    """sha256 of an array's type, shape and values."""
    kind = array.dtype.kind in "OTU"
    content = "\0".join(str(item) for item in array.ravel()).encode() if kind else np.ascontiguousarray(array).tobytes()
    return sha256(f"{'text' if kind else array.dtype.str}|{array.shape}|".encode() + content)
