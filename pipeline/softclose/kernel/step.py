"""Owns the length of a step: how far a Taylor polynomial is as good as asked."""

from __future__ import annotations

import numpy as np
from numba import njit

from softclose.kernel.series import ORDER

_ONE_BITS = int(np.float64(1.0).view(np.int64))


@njit(error_model="numpy", forceinline=True)
def bits(a):  # type: ignore[no-untyped-def]
    """The bits of a >= 0 as an integer: log2(a) in fixed point, to 0.09."""
    return np.float64(a).view(np.int64)


@njit(error_model="numpy", forceinline=True)
def radius(tolerance, a, n, b, m):  # type: ignore[no-untyped-def]
    """The h at which a h^n and b h^m are at most the tolerance, to a few per cent.

    Two terms of a series, since one may vanish by symmetry. The roots are taken in the floating-point bits: a step need
    not be exact, and logarithms and exponentials would cost as much as half the series.
    """
    budget = bits(tolerance)
    exponent = min((budget - bits(abs(a))) // n, (budget - bits(abs(b))) // m)
    return 0.94 * np.int64(exponent + _ONE_BITS).view(np.float64)


@njit(error_model="numpy", forceinline=True)
def step_of(earlier, last_but_one, last, tolerance):  # type: ignore[no-untyped-def]
    """Step at which the last two terms of v are at most the tolerance [µs], from three coefficients of x.

    Where a pair of complex singularities leads, coefficients swing like cos(n phi): both may be small at once. A third,
    four before them, then bounds the step as the radius of convergence that it suggests.
    """
    budget = bits(tolerance) - _ONE_BITS
    early = (budget // (ORDER - 1)) - (bits(abs((ORDER - 4) * earlier)) - _ONE_BITS) // (ORDER - 5)
    h = 0.94 * np.int64(early + _ONE_BITS).view(np.float64)
    return min(h, radius(tolerance, ORDER * last, ORDER - 1, (ORDER - 1) * last_but_one, ORDER - 2))


@njit(error_model="numpy", forceinline=True)
def step_size(x, tolerance):  # type: ignore[no-untyped-def]
    """`step_of` the polynomial x."""
    return step_of(x[ORDER - 4], x[ORDER - 1], x[ORDER], tolerance)
