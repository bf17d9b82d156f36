"""Owns scrambled Sobol sequences: bit for bit those of `scipy.stats.qmc.Sobol`, whose package takes a second to import.

Direction numbers of Joe and Kuo (SIAM J. Sci. Comput. 30, 2635, 2008), `new-joe-kuo-6.21201`; scrambled by lower
triangular matrices and a shift (Matoušek 1998).
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softclose.arrays import FloatArray

Bits = NDArray[Any]
"""Unsigned integers of 32 bits, or of 64."""

N_BITS = 30
"""Of each number, where nobody asks for more."""
MOST_POINTS = 2**N_BITS
"""Points of a sequence."""

_DIGITS = 10
"""Digits of an index that are looked up at once."""

_POLYNOMIALS = (
    (1, (1,)),
    (3, (1,)),
    (7, (1, 3)),
    (11, (1, 3, 1)),
    (13, (1, 1, 1)),
    (19, (1, 1, 3, 3)),
    (25, (1, 3, 5, 13)),
    (37, (1, 1, 5, 5, 17)),
    (41, (1, 1, 5, 5, 5)),
    (47, (1, 1, 7, 11, 19)),
    (55, (1, 1, 5, 1, 1)),
    (59, (1, 1, 1, 3, 11)),
    (61, (1, 3, 5, 5, 31)),
    (67, (1, 3, 3, 9, 7, 49)),
    (91, (1, 1, 1, 15, 21, 21)),
    (97, (1, 3, 1, 13, 27, 49)),
    (103, (1, 1, 1, 15, 7, 5)),
    (109, (1, 3, 1, 15, 13, 25)),
    (115, (1, 1, 5, 5, 19, 61)),
    (131, (1, 3, 7, 11, 23, 15, 103)),
    (137, (1, 3, 7, 13, 13, 15, 69)),
    (143, (1, 1, 3, 13, 7, 35, 63)),
    (145, (1, 3, 5, 9, 1, 25, 53)),
    (157, (1, 3, 1, 13, 9, 35, 107)),
)
"""Primitive polynomial of each dimension, and its first direction numbers."""

MOST_DIMENSIONS = len(_POLYNOMIALS)


def scrambled_sobol(dim: int, n: int, rng: np.random.Generator, *, start: int = 0, bits: int = N_BITS) -> FloatArray:
    """Points `start` to `start + n` of the sequence that a child of a generator scrambles, (n, dim) in [0, 1).

    A point depends on that child, its own index and the bits of its numbers, 64 at most. Raises ValueError for too many
    points or dimensions.
    """
    if not 1 <= dim <= MOST_DIMENSIONS:
        raise ValueError(f"a sequence of {dim} dimensions; from 1 to {MOST_DIMENSIONS} are known")
    if not 0 <= start <= start + n <= MOST_POINTS:
        raise ValueError(f"points {start} to {start + n} of a sequence that has {MOST_POINTS}")
    kind: Any = np.uint32 if bits <= 32 else np.uint64
    (own,) = rng.spawn(1)
    powers = kind(1) << np.arange(bits, dtype=kind)
    shift = own.integers(2, size=(dim, bits), dtype=kind) @ powers
    lower = np.tril(own.integers(2, size=(dim, bits, bits), dtype=kind)).astype(np.float32)
    lower[:, np.arange(bits), np.arange(bits)] = 1.0
    # Bit 0 is the least significant; row and column 0 of a matrix belong to the most significant one. Products are
    # counts of up to `bits` ones, exact in any order: floats, which BLAS multiplies, take a tenth of the time.
    scrambled = (lower @ _digits(dim, bits)).astype(kind) & kind(1)
    numbers = (scrambled * powers[::-1][None, :, None]).sum(axis=1, dtype=kind)  # (dim, bits)
    index = np.arange(start, start + n, dtype=kind)
    gray = index ^ (index >> kind(1))
    points = np.broadcast_to(shift, (n, dim))
    for first in range(0, int(start + n).bit_length(), _DIGITS):
        sums = _all_sums(numbers[:, first : min(first + _DIGITS, int(start + n).bit_length())])
        points = points ^ sums[(gray >> kind(first)) & kind(len(sums) - 1)]
    scaled: FloatArray = points * 2.0**-bits
    return scaled


def _all_sums(numbers: Bits) -> Bits:
    """(2ᵐ, dim) row i: what those of (dim, m) numbers are modulo 2 together that the bits of i name."""
    sums = np.zeros((1, len(numbers)), dtype=numbers.dtype)
    for column in numbers.T:
        sums = np.concatenate([sums, sums ^ column])
    return sums


@functools.cache
def _digits(dim: int, bits: int) -> NDArray[np.float32]:
    """(dim, bits, bits) the digits of each direction number, the most significant first."""
    numbers = _directions(dim, bits)
    places = np.arange(bits - 1, -1, -1, dtype=numbers.dtype)
    digits: NDArray[np.float32] = ((numbers[:, None, :] >> places[None, :, None]) & numbers.dtype.type(1)).astype(
        np.float32
    )
    digits.setflags(write=False)
    return digits


@functools.cache
def _directions(dim: int, bits: int) -> Bits:
    """(dim, bits) direction numbers by Sobol's recurrence, scaled to so many bits."""
    found = np.zeros((dim, bits), dtype=np.uint32 if bits <= 32 else np.uint64)
    for row, (polynomial, first) in zip(found, _POLYNOMIALS[:dim], strict=True):
        degree = polynomial.bit_length() - 1
        if degree == 0:
            row[:] = 1
        else:
            numbers = list(first)
            for j in range(degree, bits):
                new = numbers[j - degree] ^ (numbers[j - degree] << degree)
                for k in range(1, degree):
                    if polynomial >> (degree - k) & 1:
                        new ^= numbers[j - k] << k
                numbers.append(new)
            row[:] = numbers
        row <<= np.arange(bits - 1, -1, -1, dtype=row.dtype)
    return found
