"""Owns the power series of drives that are no cosines, as straight-line code. Written by generate_series.py.

`fading` and `decaying` add exponentials with real and with complex rates; `shifted` is a polynomial about another
point. Under such drives bounces are not told by those before them: `short_...` and `short_return` take one that is
short, and so needs few powers, in one low polynomial.
"""

from __future__ import annotations

from numba import njit

from softclose.kernel.series import _FAST

DEGREE = 7
SHORT = 8


@njit(error_model="numpy", fastmath=_FAST, forceinline=True)
def fading(u, a, decay):  # type: ignore[no-untyped-def]
    """Coefficients u plus those of a exp(-decay t)."""
    u0, u1, u2, u3, u4, u5, u6, u7, u8, u9, u10, u11, u12, u13, u14 = u
    u0 += a
    p = a * decay
    u1 -= p
    p = p * decay
    u2 += p * 0.5
    p = p * decay
    u3 -= p * 0.16666666666666666
    p = p * decay
    u4 += p * 0.041666666666666664
    p = p * decay
    u5 -= p * 0.008333333333333333
    p = p * decay
    u6 += p * 0.001388888888888889
    p = p * decay
    u7 -= p * 0.0001984126984126984
    p = p * decay
    u8 += p * 2.48015873015873e-05
    p = p * decay
    u9 -= p * 2.7557319223985893e-06
    p = p * decay
    u10 += p * 2.755731922398589e-07
    p = p * decay
    u11 -= p * 2.505210838544172e-08
    p = p * decay
    u12 += p * 2.08767569878681e-09
    p = p * decay
    u13 -= p * 1.6059043836821613e-10
    p = p * decay
    u14 += p * 1.1470745597729725e-11
    return u0, u1, u2, u3, u4, u5, u6, u7, u8, u9, u10, u11, u12, u13, u14


@njit(error_model="numpy", fastmath=_FAST, forceinline=True)
def decaying(u, cosine, sine, omega, decay):  # type: ignore[no-untyped-def]
    """Coefficients u plus those of the real part of (cosine + i sine) exp((i omega - decay) t)."""
    u0, u1, u2, u3, u4, u5, u6, u7, u8, u9, u10, u11, u12, u13, u14 = u
    u0 += cosine
    p = cosine
    q = sine
    h = omega * p - decay * q
    p = -decay * p - omega * q
    q = h
    u1 += p * 1.0
    h = omega * p - decay * q
    p = -decay * p - omega * q
    q = h
    u2 += p * 0.5
    h = omega * p - decay * q
    p = -decay * p - omega * q
    q = h
    u3 += p * 0.16666666666666666
    h = omega * p - decay * q
    p = -decay * p - omega * q
    q = h
    u4 += p * 0.041666666666666664
    h = omega * p - decay * q
    p = -decay * p - omega * q
    q = h
    u5 += p * 0.008333333333333333
    h = omega * p - decay * q
    p = -decay * p - omega * q
    q = h
    u6 += p * 0.001388888888888889
    h = omega * p - decay * q
    p = -decay * p - omega * q
    q = h
    u7 += p * 0.0001984126984126984
    h = omega * p - decay * q
    p = -decay * p - omega * q
    q = h
    u8 += p * 2.48015873015873e-05
    h = omega * p - decay * q
    p = -decay * p - omega * q
    q = h
    u9 += p * 2.7557319223985893e-06
    h = omega * p - decay * q
    p = -decay * p - omega * q
    q = h
    u10 += p * 2.755731922398589e-07
    h = omega * p - decay * q
    p = -decay * p - omega * q
    q = h
    u11 += p * 2.505210838544172e-08
    h = omega * p - decay * q
    p = -decay * p - omega * q
    q = h
    u12 += p * 2.08767569878681e-09
    h = omega * p - decay * q
    p = -decay * p - omega * q
    q = h
    u13 += p * 1.6059043836821613e-10
    h = omega * p - decay * q
    p = -decay * p - omega * q
    q = h
    u14 += p * 1.1470745597729725e-11
    return u0, u1, u2, u3, u4, u5, u6, u7, u8, u9, u10, u11, u12, u13, u14


@njit(error_model="numpy", fastmath=_FAST, forceinline=True)
def shifted(u0, p, i, s):  # type: ignore[no-untyped-def]
    """Coefficients about s of the polynomial u0 + p[i, 0, 0] s + p[i, 1, 0] s² + ... with DEGREE terms."""
    u1 = p[i, 0, 0]
    u2 = p[i, 1, 0]
    u3 = p[i, 2, 0]
    u4 = p[i, 3, 0]
    u5 = p[i, 4, 0]
    u6 = p[i, 5, 0]
    u7 = p[i, 6, 0]
    u6 += s * u7
    u5 += s * u6
    u4 += s * u5
    u3 += s * u4
    u2 += s * u3
    u1 += s * u2
    u0 += s * u1
    u6 += s * u7
    u5 += s * u6
    u4 += s * u5
    u3 += s * u4
    u2 += s * u3
    u1 += s * u2
    u6 += s * u7
    u5 += s * u6
    u4 += s * u5
    u3 += s * u4
    u2 += s * u3
    u6 += s * u7
    u5 += s * u6
    u4 += s * u5
    u3 += s * u4
    u6 += s * u7
    u5 += s * u6
    u4 += s * u5
    u6 += s * u7
    u5 += s * u6
    u6 += s * u7
    return u0, u1, u2, u3, u4, u5, u6, u7, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0


@njit(error_model="numpy", fastmath=_FAST, forceinline=True)
def short_flight_driven(x0, x1, u, gap, c, k):  # type: ignore[no-untyped-def]
    """Coefficients 0..SHORT of x where u has the coefficients u[0..SHORT-2]."""
    u0, u1, u2, u3, u4, u5, u6, _u7, _u8, _u9, _u10, _u11, _u12, _u13, _u14 = u
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
    s6 = r * u6 + z1 * s5 + z2 * s4 + z3 * s3 + z4 * s2 + z5 * s1 + z6 * s0
    q = s0 * s6 + s1 * s5 + s2 * s4 + 0.5 * s3 * s3
    x8 = c * q * 0.03571428571428571 - k * x6 * 0.017857142857142856
    return x0, x1, x2, x3, x4, x5, x6, x7, x8


@njit(error_model="numpy", fastmath=_FAST, forceinline=True)
def short_damped_driven(x0, x1, u, gap, c, k, d):  # type: ignore[no-untyped-def]
    """Coefficients 0..SHORT of x with damping, where u has the coefficients u[0..]."""
    u0, u1, u2, u3, u4, u5, u6, _u7, _u8, _u9, _u10, _u11, _u12, _u13, _u14 = u
    r0 = 1.0 / (gap - x0)
    z1 = x1 * r0
    s0 = u0 * r0
    q = 0.5 * s0 * s0
    x2 = c * q * 1.0 - k * x0 * 0.5 - (d * x1) * 0.5
    z2 = x2 * r0
    s1 = r0 * u1 + z1 * s0
    q = s0 * s1
    x3 = c * q * 0.3333333333333333 - k * x1 * 0.16666666666666666 - (d * x2) * 0.3333333333333333
    z3 = x3 * r0
    s2 = r0 * u2 + z1 * s1 + z2 * s0
    q = s0 * s2 + 0.5 * s1 * s1
    x4 = c * q * 0.16666666666666666 - k * x2 * 0.08333333333333333 - (d * x3) * 0.25
    z4 = x4 * r0
    s3 = r0 * u3 + z1 * s2 + z2 * s1 + z3 * s0
    q = s0 * s3 + s1 * s2
    x5 = c * q * 0.1 - k * x3 * 0.05 - (d * x4) * 0.2
    z5 = x5 * r0
    s4 = r0 * u4 + z1 * s3 + z2 * s2 + z3 * s1 + z4 * s0
    q = s0 * s4 + s1 * s3 + 0.5 * s2 * s2
    x6 = c * q * 0.06666666666666667 - k * x4 * 0.03333333333333333 - (d * x5) * 0.16666666666666666
    z6 = x6 * r0
    s5 = r0 * u5 + z1 * s4 + z2 * s3 + z3 * s2 + z4 * s1 + z5 * s0
    q = s0 * s5 + s1 * s4 + s2 * s3
    x7 = c * q * 0.047619047619047616 - k * x5 * 0.023809523809523808 - (d * x6) * 0.14285714285714285
    s6 = r0 * u6 + z1 * s5 + z2 * s4 + z3 * s3 + z4 * s2 + z5 * s1 + z6 * s0
    q = s0 * s6 + s1 * s5 + s2 * s4 + 0.5 * s3 * s3
    x8 = c * q * 0.03571428571428571 - k * x6 * 0.017857142857142856 - (d * x7) * 0.125
    return x0, x1, x2, x3, x4, x5, x6, x7, x8


@njit(error_model="numpy", fastmath=_FAST, forceinline=True)
def short_film_driven(x0, x1, u, gap, c, k, d, f):  # type: ignore[no-untyped-def]
    """Coefficients 0..SHORT of x with damping, behind a film, where u has the coefficients u[0..]."""
    u0, u1, u2, u3, u4, u5, u6, _u7, _u8, _u9, _u10, _u11, _u12, _u13, _u14 = u
    r0 = 1.0 / (gap - x0)
    z1 = x1 * r0
    r1 = z1 * r0
    p1 = r0 * r1
    s0 = u0 * r0
    q = 0.5 * s0 * s0
    x2 = c * q * 1.0 - k * x0 * 0.5 - (d * x1 + f * p1) * 0.5
    z2 = x2 * r0
    s1 = r0 * u1 + z1 * s0
    r2 = z1 * r1 + z2 * r0
    p2 = r0 * r2 + 0.5 * r1 * r1
    q = s0 * s1
    x3 = c * q * 0.3333333333333333 - k * x1 * 0.16666666666666666 - (d * x2 + f * p2) * 0.3333333333333333
    z3 = x3 * r0
    s2 = r0 * u2 + z1 * s1 + z2 * s0
    r3 = z1 * r2 + z2 * r1 + z3 * r0
    p3 = r0 * r3 + r1 * r2
    q = s0 * s2 + 0.5 * s1 * s1
    x4 = c * q * 0.16666666666666666 - k * x2 * 0.08333333333333333 - (d * x3 + f * p3) * 0.25
    z4 = x4 * r0
    s3 = r0 * u3 + z1 * s2 + z2 * s1 + z3 * s0
    r4 = z1 * r3 + z2 * r2 + z3 * r1 + z4 * r0
    p4 = r0 * r4 + r1 * r3 + 0.5 * r2 * r2
    q = s0 * s3 + s1 * s2
    x5 = c * q * 0.1 - k * x3 * 0.05 - (d * x4 + f * p4) * 0.2
    z5 = x5 * r0
    s4 = r0 * u4 + z1 * s3 + z2 * s2 + z3 * s1 + z4 * s0
    r5 = z1 * r4 + z2 * r3 + z3 * r2 + z4 * r1 + z5 * r0
    p5 = r0 * r5 + r1 * r4 + r2 * r3
    q = s0 * s4 + s1 * s3 + 0.5 * s2 * s2
    x6 = c * q * 0.06666666666666667 - k * x4 * 0.03333333333333333 - (d * x5 + f * p5) * 0.16666666666666666
    z6 = x6 * r0
    s5 = r0 * u5 + z1 * s4 + z2 * s3 + z3 * s2 + z4 * s1 + z5 * s0
    r6 = z1 * r5 + z2 * r4 + z3 * r3 + z4 * r2 + z5 * r1 + z6 * r0
    p6 = r0 * r6 + r1 * r5 + r2 * r4 + 0.5 * r3 * r3
    q = s0 * s5 + s1 * s4 + s2 * s3
    x7 = c * q * 0.047619047619047616 - k * x5 * 0.023809523809523808 - (d * x6 + f * p6) * 0.14285714285714285
    z7 = x7 * r0
    s6 = r0 * u6 + z1 * s5 + z2 * s4 + z3 * s3 + z4 * s2 + z5 * s1 + z6 * s0
    r7 = z1 * r6 + z2 * r5 + z3 * r4 + z4 * r3 + z5 * r2 + z6 * r1 + z7 * r0
    p7 = r0 * r7 + r1 * r6 + r2 * r5 + r3 * r4
    q = s0 * s6 + s1 * s5 + s2 * s4 + 0.5 * s3 * s3
    x8 = c * q * 0.03571428571428571 - k * x6 * 0.017857142857142856 - (d * x7 + f * p7) * 0.125
    return x0, x1, x2, x3, x4, x5, x6, x7, x8


@njit(error_model="numpy", fastmath=_FAST, forceinline=True)
def short_return(x, rtol):  # type: ignore[no-untyped-def]
    """Instant and speed of the return of a short bounce x that starts on the contact; (-1, 0) where it is too long."""
    _x0, x1, x2, x3, x4, x5, x6, x7, x8 = x
    if x2 <= 0.0:
        return -1.0, 0.0
    t = -x1 / x2
    for _ in range(4):
        y = x8
        y = x7 + t * y
        y = x6 + t * y
        y = x5 + t * y
        y = x4 + t * y
        y = x3 + t * y
        y = x2 + t * y
        y = x1 + t * y
        d = 7.0 * x8
        d = 6.0 * x7 + t * d
        d = 5.0 * x6 + t * d
        d = 4.0 * x5 + t * d
        d = 3.0 * x4 + t * d
        d = 2.0 * x3 + t * d
        d = 1.0 * x2 + t * d
        t -= y / d
    y = 8.0 * x8
    y = 7.0 * x7 + t * y
    y = 6.0 * x6 + t * y
    y = 5.0 * x5 + t * y
    y = 4.0 * x4 + t * y
    y = 3.0 * x3 + t * y
    y = 2.0 * x2 + t * y
    y = x1 + t * y
    t2 = t * t
    t4 = t2 * t2
    rest = max(abs(x7), abs(x8 * t)) * t4 * t2
    if not (abs(x3) * t < 0.2 * x2 and rest < 10.0 * rtol * y):
        return -1.0, 0.0
    return t, y
