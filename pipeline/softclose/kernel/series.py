"""Owns the fast kernel's power series as straight-line code. Written by generate_series.py.

`flight_constant`, `flight_driven`: Taylor coefficients of x(t) under Eq. 1. With s = u/(G - x), so s (G - x) = u, and
x'' = c s² - k x, every coefficient follows from the ones before with one division. `constant` and `drive`: those of
u(t). `evaluate`, `descent`, `bend`, `sample` read the polynomial. `flight_time`, `bounce_duration`: after a rebound at
speed w under constant u, energy conservation gives the depth y as a series in the energy w²/2 (dy/dE = 1/force(y)),
and Abel's integral turns its coefficients e_m into those of the time, m B(m, 1/2) 2^(1-m) e_m.

Tuples, not arrays: an array that is passed on costs two atomic operations on its reference count.
"""

from __future__ import annotations

import numpy as np
from numba import njit

ORDER = 16
TERMS = 12
LANES = 16
"""Samples that are computed together in single precision."""
# Sums may be reordered by the compiler, once for all: each switch runs this same scalar code wherever it stands.
# Reordered sums need one copy of the code: everything is inlined into the entry point (`forceinline`). Where a function
# was compiled by itself too, the process that compiled ran another copy than those that loaded the cache: other bits.
_FAST = {"contract", "reassoc", "nsz"}


@njit(error_model="numpy", fastmath=_FAST, forceinline=True)
def flight_constant(x0, x1, u, gap, c, k):  # type: ignore[no-untyped-def]
    """Coefficients 0..ORDER of x at constant u."""
    r = 1.0 / (gap - x0)
    s0 = u * r
    z1 = x1 * r
    x2 = 0.5 * (c * (s0 * s0) - k * x0)
    z2 = x2 * r
    s1 = z1 * s0
    q = s0 * s1
    x3 = c * q * 0.3333333333333333 - k * x1 * 0.16666666666666666
    z3 = x3 * r
    s2 = z1 * s1 + z2 * s0
    q = s0 * s2 + 0.5 * s1 * s1
    x4 = c * q * 0.16666666666666666 - k * x2 * 0.08333333333333333
    z4 = x4 * r
    s3 = z1 * s2 + z2 * s1 + z3 * s0
    q = s0 * s3 + s1 * s2
    x5 = c * q * 0.1 - k * x3 * 0.05
    z5 = x5 * r
    s4 = z1 * s3 + z2 * s2 + z3 * s1 + z4 * s0
    q = s0 * s4 + s1 * s3 + 0.5 * s2 * s2
    x6 = c * q * 0.06666666666666667 - k * x4 * 0.03333333333333333
    z6 = x6 * r
    s5 = z1 * s4 + z2 * s3 + z3 * s2 + z4 * s1 + z5 * s0
    q = s0 * s5 + s1 * s4 + s2 * s3
    x7 = c * q * 0.047619047619047616 - k * x5 * 0.023809523809523808
    z7 = x7 * r
    s6 = z1 * s5 + z2 * s4 + z3 * s3 + z4 * s2 + z5 * s1 + z6 * s0
    q = s0 * s6 + s1 * s5 + s2 * s4 + 0.5 * s3 * s3
    x8 = c * q * 0.03571428571428571 - k * x6 * 0.017857142857142856
    z8 = x8 * r
    s7 = z1 * s6 + z2 * s5 + z3 * s4 + z4 * s3 + z5 * s2 + z6 * s1 + z7 * s0
    q = s0 * s7 + s1 * s6 + s2 * s5 + s3 * s4
    x9 = c * q * 0.027777777777777776 - k * x7 * 0.013888888888888888
    z9 = x9 * r
    s8 = z1 * s7 + z2 * s6 + z3 * s5 + z4 * s4 + z5 * s3 + z6 * s2 + z7 * s1 + z8 * s0
    q = s0 * s8 + s1 * s7 + s2 * s6 + s3 * s5 + 0.5 * s4 * s4
    x10 = c * q * 0.022222222222222223 - k * x8 * 0.011111111111111112
    z10 = x10 * r
    s9 = z1 * s8 + z2 * s7 + z3 * s6 + z4 * s5 + z5 * s4 + z6 * s3 + z7 * s2 + z8 * s1 + z9 * s0
    q = s0 * s9 + s1 * s8 + s2 * s7 + s3 * s6 + s4 * s5
    x11 = c * q * 0.01818181818181818 - k * x9 * 0.00909090909090909
    z11 = x11 * r
    s10 = z1 * s9 + z2 * s8 + z3 * s7 + z4 * s6 + z5 * s5 + z6 * s4 + z7 * s3 + z8 * s2 + z9 * s1 + z10 * s0
    q = s0 * s10 + s1 * s9 + s2 * s8 + s3 * s7 + s4 * s6 + 0.5 * s5 * s5
    x12 = c * q * 0.015151515151515152 - k * x10 * 0.007575757575757576
    z12 = x12 * r
    s11 = z1 * s10 + z2 * s9 + z3 * s8 + z4 * s7 + z5 * s6 + z6 * s5 + z7 * s4 + z8 * s3 + z9 * s2 + z10 * s1 + z11 * s0
    q = s0 * s11 + s1 * s10 + s2 * s9 + s3 * s8 + s4 * s7 + s5 * s6
    x13 = c * q * 0.01282051282051282 - k * x11 * 0.00641025641025641
    z13 = x13 * r
    s12 = (
        z1 * s11
        + z2 * s10
        + z3 * s9
        + z4 * s8
        + z5 * s7
        + z6 * s6
        + z7 * s5
        + z8 * s4
        + z9 * s3
        + z10 * s2
        + z11 * s1
        + z12 * s0
    )
    q = s0 * s12 + s1 * s11 + s2 * s10 + s3 * s9 + s4 * s8 + s5 * s7 + 0.5 * s6 * s6
    x14 = c * q * 0.01098901098901099 - k * x12 * 0.005494505494505495
    z14 = x14 * r
    s13 = (
        z1 * s12
        + z2 * s11
        + z3 * s10
        + z4 * s9
        + z5 * s8
        + z6 * s7
        + z7 * s6
        + z8 * s5
        + z9 * s4
        + z10 * s3
        + z11 * s2
        + z12 * s1
        + z13 * s0
    )
    q = s0 * s13 + s1 * s12 + s2 * s11 + s3 * s10 + s4 * s9 + s5 * s8 + s6 * s7
    x15 = c * q * 0.009523809523809525 - k * x13 * 0.004761904761904762
    s14 = (
        z1 * s13
        + z2 * s12
        + z3 * s11
        + z4 * s10
        + z5 * s9
        + z6 * s8
        + z7 * s7
        + z8 * s6
        + z9 * s5
        + z10 * s4
        + z11 * s3
        + z12 * s2
        + z13 * s1
        + z14 * s0
    )
    q = s0 * s14 + s1 * s13 + s2 * s12 + s3 * s11 + s4 * s10 + s5 * s9 + s6 * s8 + 0.5 * s7 * s7
    x16 = c * q * 0.008333333333333333 - k * x14 * 0.004166666666666667
    return x0, x1, x2, x3, x4, x5, x6, x7, x8, x9, x10, x11, x12, x13, x14, x15, x16


@njit(error_model="numpy", fastmath=_FAST, forceinline=True)
def flight_driven(x0, x1, u, gap, c, k):  # type: ignore[no-untyped-def]
    """Coefficients 0..ORDER of x where u has the coefficients u[0..ORDER-2]."""
    u0, u1, u2, u3, u4, u5, u6, u7, u8, u9, u10, u11, u12, u13, u14 = u
    r = 1.0 / (gap - x0)
    s0 = u0 * r
    z1 = x1 * r
    x2 = 0.5 * (c * (s0 * s0) - k * x0)
    z2 = x2 * r
    s1 = r * u1 + z1 * s0
    q = s0 * s1
    x3 = c * q * 0.3333333333333333 - k * x1 * 0.16666666666666666
    z3 = x3 * r
    s2 = r * u2 + z1 * s1 + z2 * s0
    q = s0 * s2 + 0.5 * s1 * s1
    x4 = c * q * 0.16666666666666666 - k * x2 * 0.08333333333333333
    z4 = x4 * r
    s3 = r * u3 + z1 * s2 + z2 * s1 + z3 * s0
    q = s0 * s3 + s1 * s2
    x5 = c * q * 0.1 - k * x3 * 0.05
    z5 = x5 * r
    s4 = r * u4 + z1 * s3 + z2 * s2 + z3 * s1 + z4 * s0
    q = s0 * s4 + s1 * s3 + 0.5 * s2 * s2
    x6 = c * q * 0.06666666666666667 - k * x4 * 0.03333333333333333
    z6 = x6 * r
    s5 = r * u5 + z1 * s4 + z2 * s3 + z3 * s2 + z4 * s1 + z5 * s0
    q = s0 * s5 + s1 * s4 + s2 * s3
    x7 = c * q * 0.047619047619047616 - k * x5 * 0.023809523809523808
    z7 = x7 * r
    s6 = r * u6 + z1 * s5 + z2 * s4 + z3 * s3 + z4 * s2 + z5 * s1 + z6 * s0
    q = s0 * s6 + s1 * s5 + s2 * s4 + 0.5 * s3 * s3
    x8 = c * q * 0.03571428571428571 - k * x6 * 0.017857142857142856
    z8 = x8 * r
    s7 = r * u7 + z1 * s6 + z2 * s5 + z3 * s4 + z4 * s3 + z5 * s2 + z6 * s1 + z7 * s0
    q = s0 * s7 + s1 * s6 + s2 * s5 + s3 * s4
    x9 = c * q * 0.027777777777777776 - k * x7 * 0.013888888888888888
    z9 = x9 * r
    s8 = r * u8 + z1 * s7 + z2 * s6 + z3 * s5 + z4 * s4 + z5 * s3 + z6 * s2 + z7 * s1 + z8 * s0
    q = s0 * s8 + s1 * s7 + s2 * s6 + s3 * s5 + 0.5 * s4 * s4
    x10 = c * q * 0.022222222222222223 - k * x8 * 0.011111111111111112
    z10 = x10 * r
    s9 = r * u9 + z1 * s8 + z2 * s7 + z3 * s6 + z4 * s5 + z5 * s4 + z6 * s3 + z7 * s2 + z8 * s1 + z9 * s0
    q = s0 * s9 + s1 * s8 + s2 * s7 + s3 * s6 + s4 * s5
    x11 = c * q * 0.01818181818181818 - k * x9 * 0.00909090909090909
    z11 = x11 * r
    s10 = r * u10 + z1 * s9 + z2 * s8 + z3 * s7 + z4 * s6 + z5 * s5 + z6 * s4 + z7 * s3 + z8 * s2 + z9 * s1 + z10 * s0
    q = s0 * s10 + s1 * s9 + s2 * s8 + s3 * s7 + s4 * s6 + 0.5 * s5 * s5
    x12 = c * q * 0.015151515151515152 - k * x10 * 0.007575757575757576
    z12 = x12 * r
    s11 = (
        r * u11
        + z1 * s10
        + z2 * s9
        + z3 * s8
        + z4 * s7
        + z5 * s6
        + z6 * s5
        + z7 * s4
        + z8 * s3
        + z9 * s2
        + z10 * s1
        + z11 * s0
    )
    q = s0 * s11 + s1 * s10 + s2 * s9 + s3 * s8 + s4 * s7 + s5 * s6
    x13 = c * q * 0.01282051282051282 - k * x11 * 0.00641025641025641
    z13 = x13 * r
    s12 = (
        r * u12
        + z1 * s11
        + z2 * s10
        + z3 * s9
        + z4 * s8
        + z5 * s7
        + z6 * s6
        + z7 * s5
        + z8 * s4
        + z9 * s3
        + z10 * s2
        + z11 * s1
        + z12 * s0
    )
    q = s0 * s12 + s1 * s11 + s2 * s10 + s3 * s9 + s4 * s8 + s5 * s7 + 0.5 * s6 * s6
    x14 = c * q * 0.01098901098901099 - k * x12 * 0.005494505494505495
    z14 = x14 * r
    s13 = (
        r * u13
        + z1 * s12
        + z2 * s11
        + z3 * s10
        + z4 * s9
        + z5 * s8
        + z6 * s7
        + z7 * s6
        + z8 * s5
        + z9 * s4
        + z10 * s3
        + z11 * s2
        + z12 * s1
        + z13 * s0
    )
    q = s0 * s13 + s1 * s12 + s2 * s11 + s3 * s10 + s4 * s9 + s5 * s8 + s6 * s7
    x15 = c * q * 0.009523809523809525 - k * x13 * 0.004761904761904762
    s14 = (
        r * u14
        + z1 * s13
        + z2 * s12
        + z3 * s11
        + z4 * s10
        + z5 * s9
        + z6 * s8
        + z7 * s7
        + z8 * s6
        + z9 * s5
        + z10 * s4
        + z11 * s3
        + z12 * s2
        + z13 * s1
        + z14 * s0
    )
    q = s0 * s14 + s1 * s13 + s2 * s12 + s3 * s11 + s4 * s10 + s5 * s9 + s6 * s8 + 0.5 * s7 * s7
    x16 = c * q * 0.008333333333333333 - k * x14 * 0.004166666666666667
    return x0, x1, x2, x3, x4, x5, x6, x7, x8, x9, x10, x11, x12, x13, x14, x15, x16


@njit(error_model="numpy", fastmath=_FAST, forceinline=True)
def constant(u):  # type: ignore[no-untyped-def]
    """Coefficients of a constant voltage."""
    return u, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0


@njit(error_model="numpy", fastmath=_FAST, forceinline=True)
def drive(u, cosine, sine, omega):  # type: ignore[no-untyped-def]
    """Coefficients u plus those of a ramp a cos(omega t + angle); a cos(angle) = cosine, a sin(angle) = sine."""
    u0, u1, u2, u3, u4, u5, u6, u7, u8, u9, u10, u11, u12, u13, u14 = u
    u0 += cosine
    p = omega
    u1 -= sine * p
    p = p * omega
    u2 -= cosine * (p * 0.5)
    p = p * omega
    u3 += sine * (p * 0.16666666666666666)
    p = p * omega
    u4 += cosine * (p * 0.041666666666666664)
    p = p * omega
    u5 -= sine * (p * 0.008333333333333333)
    p = p * omega
    u6 -= cosine * (p * 0.001388888888888889)
    p = p * omega
    u7 += sine * (p * 0.0001984126984126984)
    p = p * omega
    u8 += cosine * (p * 2.48015873015873e-05)
    p = p * omega
    u9 -= sine * (p * 2.7557319223985893e-06)
    p = p * omega
    u10 -= cosine * (p * 2.755731922398589e-07)
    p = p * omega
    u11 += sine * (p * 2.505210838544172e-08)
    p = p * omega
    u12 += cosine * (p * 2.08767569878681e-09)
    p = p * omega
    u13 -= sine * (p * 1.6059043836821613e-10)
    p = p * omega
    u14 -= cosine * (p * 1.1470745597729725e-11)
    return u0, u1, u2, u3, u4, u5, u6, u7, u8, u9, u10, u11, u12, u13, u14


@njit(error_model="numpy", fastmath=_FAST, forceinline=True)
def evaluate(x, h):  # type: ignore[no-untyped-def]
    """Position and velocity of the polynomial x at h."""
    x0, x1, x2, x3, x4, x5, x6, x7, x8, x9, x10, x11, x12, x13, x14, x15, x16 = x
    h2 = h * h
    x_even = x16
    x_even = x14 + h2 * x_even
    x_even = x12 + h2 * x_even
    x_even = x10 + h2 * x_even
    x_even = x8 + h2 * x_even
    x_even = x6 + h2 * x_even
    x_even = x4 + h2 * x_even
    x_even = x2 + h2 * x_even
    x_even = x0 + h2 * x_even
    x_odd = x15
    x_odd = x13 + h2 * x_odd
    x_odd = x11 + h2 * x_odd
    x_odd = x9 + h2 * x_odd
    x_odd = x7 + h2 * x_odd
    x_odd = x5 + h2 * x_odd
    x_odd = x3 + h2 * x_odd
    x_odd = x1 + h2 * x_odd
    v_even = 15.0 * x15
    v_even = 13.0 * x13 + h2 * v_even
    v_even = 11.0 * x11 + h2 * v_even
    v_even = 9.0 * x9 + h2 * v_even
    v_even = 7.0 * x7 + h2 * v_even
    v_even = 5.0 * x5 + h2 * v_even
    v_even = 3.0 * x3 + h2 * v_even
    v_even = x1 + h2 * v_even
    v_odd = 16.0 * x16
    v_odd = 14.0 * x14 + h2 * v_odd
    v_odd = 12.0 * x12 + h2 * v_odd
    v_odd = 10.0 * x10 + h2 * v_odd
    v_odd = 8.0 * x8 + h2 * v_odd
    v_odd = 6.0 * x6 + h2 * v_odd
    v_odd = 4.0 * x4 + h2 * v_odd
    v_odd = 2.0 * x2 + h2 * v_odd
    return x_even + h * x_odd, v_even + h * v_odd


@njit(error_model="numpy", fastmath=_FAST, forceinline=True)
def bend(x, h):  # type: ignore[no-untyped-def]
    """Bound on |x''| over [0, h]."""
    _x0, _x1, x2, x3, x4, x5, x6, x7, x8, x9, x10, x11, x12, x13, x14, x15, x16 = x
    h2 = h * h
    even = 240.0 * abs(x16)
    even = 182.0 * abs(x14) + h2 * even
    even = 132.0 * abs(x12) + h2 * even
    even = 90.0 * abs(x10) + h2 * even
    even = 56.0 * abs(x8) + h2 * even
    even = 30.0 * abs(x6) + h2 * even
    even = 12.0 * abs(x4) + h2 * even
    even = 2.0 * abs(x2) + h2 * even
    odd = 210.0 * abs(x15)
    odd = 156.0 * abs(x13) + h2 * odd
    odd = 110.0 * abs(x11) + h2 * odd
    odd = 72.0 * abs(x9) + h2 * odd
    odd = 42.0 * abs(x7) + h2 * odd
    odd = 20.0 * abs(x5) + h2 * odd
    odd = 6.0 * abs(x3) + h2 * odd
    return even + h * odd


@njit(error_model="numpy", fastmath=_FAST, forceinline=True)
def descent(x, h):  # type: ignore[no-untyped-def]
    """(x(0) - x(h)) / h, free of cancellation however small h is, and the velocity at h."""
    _x0, x1, x2, x3, x4, x5, x6, x7, x8, x9, x10, x11, x12, x13, x14, x15, x16 = x
    h2 = h * h
    y_even = x15
    y_even = x13 + h2 * y_even
    y_even = x11 + h2 * y_even
    y_even = x9 + h2 * y_even
    y_even = x7 + h2 * y_even
    y_even = x5 + h2 * y_even
    y_even = x3 + h2 * y_even
    y_even = x1 + h2 * y_even
    y_odd = x16
    y_odd = x14 + h2 * y_odd
    y_odd = x12 + h2 * y_odd
    y_odd = x10 + h2 * y_odd
    y_odd = x8 + h2 * y_odd
    y_odd = x6 + h2 * y_odd
    y_odd = x4 + h2 * y_odd
    y_odd = x2 + h2 * y_odd
    v_even = 15.0 * x15
    v_even = 13.0 * x13 + h2 * v_even
    v_even = 11.0 * x11 + h2 * v_even
    v_even = 9.0 * x9 + h2 * v_even
    v_even = 7.0 * x7 + h2 * v_even
    v_even = 5.0 * x5 + h2 * v_even
    v_even = 3.0 * x3 + h2 * v_even
    v_even = x1 + h2 * v_even
    v_odd = 16.0 * x16
    v_odd = 14.0 * x14 + h2 * v_odd
    v_odd = 12.0 * x12 + h2 * v_odd
    v_odd = 10.0 * x10 + h2 * v_odd
    v_odd = 8.0 * x8 + h2 * v_odd
    v_odd = 6.0 * x6 + h2 * v_odd
    v_odd = 4.0 * x4 + h2 * v_odd
    v_odd = 2.0 * x2 + h2 * v_odd
    return -(y_even + h * y_odd), v_even + h * v_odd


@njit(error_model="numpy", fastmath=_FAST, forceinline=True)
def sample(x, t, times, first, stop, i, x_out, v_out):  # type: ignore[no-untyped-def]
    """x and v of the polynomial that starts at t, at times[first:stop], into row i."""
    x0, x1, x2, x3, x4, x5, x6, x7, x8, x9, x10, x11, x12, x13, x14, x15, x16 = x
    d2 = 2.0 * x2
    d3 = 3.0 * x3
    d4 = 4.0 * x4
    d5 = 5.0 * x5
    d6 = 6.0 * x6
    d7 = 7.0 * x7
    d8 = 8.0 * x8
    d9 = 9.0 * x9
    d10 = 10.0 * x10
    d11 = 11.0 * x11
    d12 = 12.0 * x12
    d13 = 13.0 * x13
    d14 = 14.0 * x14
    d15 = 15.0 * x15
    d16 = 16.0 * x16
    for m in range(stop - first):
        j = np.uintp(first + m)
        s = times[j] - t
        y = x16
        y = x15 + s * y
        y = x14 + s * y
        y = x13 + s * y
        y = x12 + s * y
        y = x11 + s * y
        y = x10 + s * y
        y = x9 + s * y
        y = x8 + s * y
        y = x7 + s * y
        y = x6 + s * y
        y = x5 + s * y
        y = x4 + s * y
        y = x3 + s * y
        y = x2 + s * y
        y = x1 + s * y
        y = x0 + s * y
        x_out[i, j] = y
        y = d16
        y = d15 + s * y
        y = d14 + s * y
        y = d13 + s * y
        y = d12 + s * y
        y = d11 + s * y
        y = d10 + s * y
        y = d9 + s * y
        y = d8 + s * y
        y = d7 + s * y
        y = d6 + s * y
        y = d5 + s * y
        y = d4 + s * y
        y = d3 + s * y
        y = d2 + s * y
        y = x1 + s * y
        v_out[i, j] = y


@njit(error_model="numpy", fastmath=_FAST, forceinline=True)
def sample_single(x, t, times, first, stop, i, x_out, v_out):  # type: ignore[no-untyped-def]
    """`sample` in single precision, in whole blocks of LANES: what is written beyond `stop` is overwritten later."""
    x0, x1, x2, x3, x4, x5, x6, x7, x8, x9, x10, x11, x12, x13, x14, x15, x16 = x
    f0 = np.float32(x0)
    f1 = np.float32(x1)
    f2 = np.float32(x2)
    f3 = np.float32(x3)
    f4 = np.float32(x4)
    f5 = np.float32(x5)
    f6 = np.float32(x6)
    f7 = np.float32(x7)
    f8 = np.float32(x8)
    f9 = np.float32(x9)
    f10 = np.float32(x10)
    f11 = np.float32(x11)
    f12 = np.float32(x12)
    f13 = np.float32(x13)
    f14 = np.float32(x14)
    f15 = np.float32(x15)
    f16 = np.float32(x16)
    d2 = np.float32(2.0 * x2)
    d3 = np.float32(3.0 * x3)
    d4 = np.float32(4.0 * x4)
    d5 = np.float32(5.0 * x5)
    d6 = np.float32(6.0 * x6)
    d7 = np.float32(7.0 * x7)
    d8 = np.float32(8.0 * x8)
    d9 = np.float32(9.0 * x9)
    d10 = np.float32(10.0 * x10)
    d11 = np.float32(11.0 * x11)
    d12 = np.float32(12.0 * x12)
    d13 = np.float32(13.0 * x13)
    d14 = np.float32(14.0 * x14)
    d15 = np.float32(15.0 * x15)
    d16 = np.float32(16.0 * x16)
    whole = first
    while whole < stop and whole + LANES <= x_out.shape[1]:
        for m in range(LANES):
            j = np.uintp(whole + m)
            s = np.float32(times[j] - t)
            y = f16
            y = f15 + s * y
            y = f14 + s * y
            y = f13 + s * y
            y = f12 + s * y
            y = f11 + s * y
            y = f10 + s * y
            y = f9 + s * y
            y = f8 + s * y
            y = f7 + s * y
            y = f6 + s * y
            y = f5 + s * y
            y = f4 + s * y
            y = f3 + s * y
            y = f2 + s * y
            y = f1 + s * y
            y = f0 + s * y
            x_out[i, j] = y
            y = d16
            y = d15 + s * y
            y = d14 + s * y
            y = d13 + s * y
            y = d12 + s * y
            y = d11 + s * y
            y = d10 + s * y
            y = d9 + s * y
            y = d8 + s * y
            y = d7 + s * y
            y = d6 + s * y
            y = d5 + s * y
            y = d4 + s * y
            y = d3 + s * y
            y = d2 + s * y
            y = f1 + s * y
            v_out[i, j] = y
        whole += LANES
    while whole < stop:
        j = np.uintp(whole)
        s = np.float32(times[j] - t)
        y = f16
        y = f15 + s * y
        y = f14 + s * y
        y = f13 + s * y
        y = f12 + s * y
        y = f11 + s * y
        y = f10 + s * y
        y = f9 + s * y
        y = f8 + s * y
        y = f7 + s * y
        y = f6 + s * y
        y = f5 + s * y
        y = f4 + s * y
        y = f3 + s * y
        y = f2 + s * y
        y = f1 + s * y
        y = f0 + s * y
        x_out[i, j] = y
        y = d16
        y = d15 + s * y
        y = d14 + s * y
        y = d13 + s * y
        y = d12 + s * y
        y = d11 + s * y
        y = d10 + s * y
        y = d9 + s * y
        y = d8 + s * y
        y = d7 + s * y
        y = d6 + s * y
        y = d5 + s * y
        y = d4 + s * y
        y = d3 + s * y
        y = d2 + s * y
        y = f1 + s * y
        v_out[i, j] = y
        whole += 1


@njit(error_model="numpy", fastmath=_FAST, forceinline=True)
def flight_time(travel, gap, pull, k):  # type: ignore[no-untyped-def]
    """Coefficients m = 0.. of w^(2m+1) in the flight time after a rebound at speed w; constant pull = c u² closes."""
    p0 = 1.0 / (gap - travel)
    a0 = pull * (p0 * p0) - k * travel
    b0 = 1.0 / a0
    e1 = b0
    f0 = 2.0 * e1
    p1 = -p0 * e1 * p0
    q = p0 * p1
    a1 = 2.0 * pull * q + k * e1
    b1 = -b0 * a1 * b0
    e2 = b1 * 0.5
    f1 = 1.333333333333333 * e2
    p2 = -p0 * (e1 * p1 + e2 * p0)
    q = p0 * p2 + 0.5 * p1 * p1
    a2 = 2.0 * pull * q + k * e2
    b2 = -b0 * (a1 * b1 + a2 * b0)
    e3 = b2 * 0.3333333333333333
    f2 = 0.8000000000000002 * e3
    p3 = -p0 * (e1 * p2 + e2 * p1 + e3 * p0)
    q = p0 * p3 + p1 * p2
    a3 = 2.0 * pull * q + k * e3
    b3 = -b0 * (a1 * b2 + a2 * b1 + a3 * b0)
    e4 = b3 * 0.25
    f3 = 0.45714285714285724 * e4
    p4 = -p0 * (e1 * p3 + e2 * p2 + e3 * p1 + e4 * p0)
    q = p0 * p4 + p1 * p3 + 0.5 * p2 * p2
    a4 = 2.0 * pull * q + k * e4
    b4 = -b0 * (a1 * b3 + a2 * b2 + a3 * b1 + a4 * b0)
    e5 = b4 * 0.2
    f4 = 0.25396825396825395 * e5
    p5 = -p0 * (e1 * p4 + e2 * p3 + e3 * p2 + e4 * p1 + e5 * p0)
    q = p0 * p5 + p1 * p4 + p2 * p3
    a5 = 2.0 * pull * q + k * e5
    b5 = -b0 * (a1 * b4 + a2 * b3 + a3 * b2 + a4 * b1 + a5 * b0)
    e6 = b5 * 0.16666666666666666
    f5 = 0.13852813852813853 * e6
    p6 = -p0 * (e1 * p5 + e2 * p4 + e3 * p3 + e4 * p2 + e5 * p1 + e6 * p0)
    q = p0 * p6 + p1 * p5 + p2 * p4 + 0.5 * p3 * p3
    a6 = 2.0 * pull * q + k * e6
    b6 = -b0 * (a1 * b5 + a2 * b4 + a3 * b3 + a4 * b2 + a5 * b1 + a6 * b0)
    e7 = b6 * 0.14285714285714285
    f6 = 0.07459207459207459 * e7
    p7 = -p0 * (e1 * p6 + e2 * p5 + e3 * p4 + e4 * p3 + e5 * p2 + e6 * p1 + e7 * p0)
    q = p0 * p7 + p1 * p6 + p2 * p5 + p3 * p4
    a7 = 2.0 * pull * q + k * e7
    b7 = -b0 * (a1 * b6 + a2 * b5 + a3 * b4 + a4 * b3 + a5 * b2 + a6 * b1 + a7 * b0)
    e8 = b7 * 0.125
    f7 = 0.03978243978243978 * e8
    p8 = -p0 * (e1 * p7 + e2 * p6 + e3 * p5 + e4 * p4 + e5 * p3 + e6 * p2 + e7 * p1 + e8 * p0)
    q = p0 * p8 + p1 * p7 + p2 * p6 + p3 * p5 + 0.5 * p4 * p4
    a8 = 2.0 * pull * q + k * e8
    b8 = -b0 * (a1 * b7 + a2 * b6 + a3 * b5 + a4 * b4 + a5 * b3 + a6 * b2 + a7 * b1 + a8 * b0)
    e9 = b8 * 0.1111111111111111
    f8 = 0.02106129164952694 * e9
    p9 = -p0 * (e1 * p8 + e2 * p7 + e3 * p6 + e4 * p5 + e5 * p4 + e6 * p3 + e7 * p2 + e8 * p1 + e9 * p0)
    q = p0 * p9 + p1 * p8 + p2 * p7 + p3 * p6 + p4 * p5
    a9 = 2.0 * pull * q + k * e9
    b9 = -b0 * (a1 * b8 + a2 * b7 + a3 * b6 + a4 * b5 + a5 * b4 + a6 * b3 + a7 * b2 + a8 * b1 + a9 * b0)
    e10 = b9 * 0.1
    f9 = 0.011084890341856286 * e10
    p10 = -p0 * (e1 * p9 + e2 * p8 + e3 * p7 + e4 * p6 + e5 * p5 + e6 * p4 + e7 * p3 + e8 * p2 + e9 * p1 + e10 * p0)
    q = p0 * p10 + p1 * p9 + p2 * p8 + p3 * p7 + p4 * p6 + 0.5 * p5 * p5
    a10 = 2.0 * pull * q + k * e10
    b10 = -b0 * (a1 * b9 + a2 * b8 + a3 * b7 + a4 * b6 + a5 * b5 + a6 * b4 + a7 * b3 + a8 * b2 + a9 * b1 + a10 * b0)
    e11 = b10 * 0.09090909090909091
    f10 = 0.005806371131448531 * e11
    p11 = -p0 * (
        e1 * p10 + e2 * p9 + e3 * p8 + e4 * p7 + e5 * p6 + e6 * p5 + e7 * p4 + e8 * p3 + e9 * p2 + e10 * p1 + e11 * p0
    )
    q = p0 * p11 + p1 * p10 + p2 * p9 + p3 * p8 + p4 * p7 + p5 * p6
    a11 = 2.0 * pull * q + k * e11
    b11 = -b0 * (
        a1 * b10 + a2 * b9 + a3 * b8 + a4 * b7 + a5 * b6 + a6 * b5 + a7 * b4 + a8 * b3 + a9 * b2 + a10 * b1 + a11 * b0
    )
    e12 = b11 * 0.08333333333333333
    f11 = 0.0030294110251035816 * e12
    return f0, f1, f2, f3, f4, f5, f6, f7, f8, f9, f10, f11


@njit(error_model="numpy", fastmath=_FAST, forceinline=True)
def bounce_duration(f, w):  # type: ignore[no-untyped-def]
    """Flight time [µs] after a rebound at speed w."""
    f0, f1, f2, f3, f4, f5, f6, f7, f8, f9, f10, f11 = f
    w2 = w * w
    w4 = w2 * w2
    even = f10
    even = f8 + w4 * even
    even = f6 + w4 * even
    even = f4 + w4 * even
    even = f2 + w4 * even
    even = f0 + w4 * even
    odd = f11
    odd = f9 + w4 * odd
    odd = f7 + w4 * odd
    odd = f5 + w4 * odd
    odd = f3 + w4 * odd
    odd = f1 + w4 * odd
    return w * (even + w2 * odd)
