"""Owns the power series of a switch whose capacitance is a table. Written by generate_series.py.

x'' = p u² - k x - cubic x³ - d x' - f w, where p is a parabola within a cell of the table, g0 + g1 z + g2 z² with
z = x - origin, and w the film's of `shaped_series`.
"""

from __future__ import annotations

from numba import njit

from softclose.kernel.series import _FAST


@njit(error_model="numpy", fastmath=_FAST, forceinline=True)
def table_constant(x0, x1, u, gap, k, d, cubic, origin, q0, q1, q2):  # type: ignore[no-untyped-def]
    """Coefficients 0..ORDER of x, at constant u."""
    z0 = x0 - origin
    p0 = q0 + z0 * (q1 + q2 * z0)
    q2 += q2
    v0 = u * u
    pull = p0 * v0
    y0 = 0.5 * x0 * x0
    m = y0 * x0
    force = pull - k * x0 - 2.0 * cubic * m
    x2 = force * 0.5 - d * x1 * 0.5
    m = z0 * x1
    p1 = q1 * x1 + q2 * m
    pull = p1 * v0
    y1 = x0 * x1
    m = y0 * x1 + y1 * x0
    force = pull - k * x1 - 2.0 * cubic * m
    x3 = force * 0.16666666666666666 - d * x2 * 0.3333333333333333
    m = z0 * x2 + 0.5 * x1 * x1
    p2 = q1 * x2 + q2 * m
    pull = p2 * v0
    y2 = x0 * x2 + 0.5 * x1 * x1
    m = y0 * x2 + y1 * x1 + y2 * x0
    force = pull - k * x2 - 2.0 * cubic * m
    x4 = force * 0.08333333333333333 - d * x3 * 0.25
    m = z0 * x3 + x1 * x2
    p3 = q1 * x3 + q2 * m
    pull = p3 * v0
    y3 = x0 * x3 + x1 * x2
    m = y0 * x3 + y1 * x2 + y2 * x1 + y3 * x0
    force = pull - k * x3 - 2.0 * cubic * m
    x5 = force * 0.05 - d * x4 * 0.2
    m = z0 * x4 + x1 * x3 + 0.5 * x2 * x2
    p4 = q1 * x4 + q2 * m
    pull = p4 * v0
    y4 = x0 * x4 + x1 * x3 + 0.5 * x2 * x2
    m = y0 * x4 + y1 * x3 + y2 * x2 + y3 * x1 + y4 * x0
    force = pull - k * x4 - 2.0 * cubic * m
    x6 = force * 0.03333333333333333 - d * x5 * 0.16666666666666666
    m = z0 * x5 + x1 * x4 + x2 * x3
    p5 = q1 * x5 + q2 * m
    pull = p5 * v0
    y5 = x0 * x5 + x1 * x4 + x2 * x3
    m = y0 * x5 + y1 * x4 + y2 * x3 + y3 * x2 + y4 * x1 + y5 * x0
    force = pull - k * x5 - 2.0 * cubic * m
    x7 = force * 0.023809523809523808 - d * x6 * 0.14285714285714285
    m = z0 * x6 + x1 * x5 + x2 * x4 + 0.5 * x3 * x3
    p6 = q1 * x6 + q2 * m
    pull = p6 * v0
    y6 = x0 * x6 + x1 * x5 + x2 * x4 + 0.5 * x3 * x3
    m = y0 * x6 + y1 * x5 + y2 * x4 + y3 * x3 + y4 * x2 + y5 * x1 + y6 * x0
    force = pull - k * x6 - 2.0 * cubic * m
    x8 = force * 0.017857142857142856 - d * x7 * 0.125
    m = z0 * x7 + x1 * x6 + x2 * x5 + x3 * x4
    p7 = q1 * x7 + q2 * m
    pull = p7 * v0
    y7 = x0 * x7 + x1 * x6 + x2 * x5 + x3 * x4
    m = y0 * x7 + y1 * x6 + y2 * x5 + y3 * x4 + y4 * x3 + y5 * x2 + y6 * x1 + y7 * x0
    force = pull - k * x7 - 2.0 * cubic * m
    x9 = force * 0.013888888888888888 - d * x8 * 0.1111111111111111
    m = z0 * x8 + x1 * x7 + x2 * x6 + x3 * x5 + 0.5 * x4 * x4
    p8 = q1 * x8 + q2 * m
    pull = p8 * v0
    y8 = x0 * x8 + x1 * x7 + x2 * x6 + x3 * x5 + 0.5 * x4 * x4
    m = y0 * x8 + y1 * x7 + y2 * x6 + y3 * x5 + y4 * x4 + y5 * x3 + y6 * x2 + y7 * x1 + y8 * x0
    force = pull - k * x8 - 2.0 * cubic * m
    x10 = force * 0.011111111111111112 - d * x9 * 0.1
    m = z0 * x9 + x1 * x8 + x2 * x7 + x3 * x6 + x4 * x5
    p9 = q1 * x9 + q2 * m
    pull = p9 * v0
    y9 = x0 * x9 + x1 * x8 + x2 * x7 + x3 * x6 + x4 * x5
    m = y0 * x9 + y1 * x8 + y2 * x7 + y3 * x6 + y4 * x5 + y5 * x4 + y6 * x3 + y7 * x2 + y8 * x1 + y9 * x0
    force = pull - k * x9 - 2.0 * cubic * m
    x11 = force * 0.00909090909090909 - d * x10 * 0.09090909090909091
    m = z0 * x10 + x1 * x9 + x2 * x8 + x3 * x7 + x4 * x6 + 0.5 * x5 * x5
    p10 = q1 * x10 + q2 * m
    pull = p10 * v0
    y10 = x0 * x10 + x1 * x9 + x2 * x8 + x3 * x7 + x4 * x6 + 0.5 * x5 * x5
    m = y0 * x10 + y1 * x9 + y2 * x8 + y3 * x7 + y4 * x6 + y5 * x5 + y6 * x4 + y7 * x3 + y8 * x2 + y9 * x1 + y10 * x0
    force = pull - k * x10 - 2.0 * cubic * m
    x12 = force * 0.007575757575757576 - d * x11 * 0.08333333333333333
    m = z0 * x11 + x1 * x10 + x2 * x9 + x3 * x8 + x4 * x7 + x5 * x6
    p11 = q1 * x11 + q2 * m
    pull = p11 * v0
    y11 = x0 * x11 + x1 * x10 + x2 * x9 + x3 * x8 + x4 * x7 + x5 * x6
    m = (
        y0 * x11
        + y1 * x10
        + y2 * x9
        + y3 * x8
        + y4 * x7
        + y5 * x6
        + y6 * x5
        + y7 * x4
        + y8 * x3
        + y9 * x2
        + y10 * x1
        + y11 * x0
    )
    force = pull - k * x11 - 2.0 * cubic * m
    x13 = force * 0.00641025641025641 - d * x12 * 0.07692307692307693
    m = z0 * x12 + x1 * x11 + x2 * x10 + x3 * x9 + x4 * x8 + x5 * x7 + 0.5 * x6 * x6
    p12 = q1 * x12 + q2 * m
    pull = p12 * v0
    y12 = x0 * x12 + x1 * x11 + x2 * x10 + x3 * x9 + x4 * x8 + x5 * x7 + 0.5 * x6 * x6
    m = (
        y0 * x12
        + y1 * x11
        + y2 * x10
        + y3 * x9
        + y4 * x8
        + y5 * x7
        + y6 * x6
        + y7 * x5
        + y8 * x4
        + y9 * x3
        + y10 * x2
        + y11 * x1
        + y12 * x0
    )
    force = pull - k * x12 - 2.0 * cubic * m
    x14 = force * 0.005494505494505495 - d * x13 * 0.07142857142857142
    m = z0 * x13 + x1 * x12 + x2 * x11 + x3 * x10 + x4 * x9 + x5 * x8 + x6 * x7
    p13 = q1 * x13 + q2 * m
    pull = p13 * v0
    y13 = x0 * x13 + x1 * x12 + x2 * x11 + x3 * x10 + x4 * x9 + x5 * x8 + x6 * x7
    m = (
        y0 * x13
        + y1 * x12
        + y2 * x11
        + y3 * x10
        + y4 * x9
        + y5 * x8
        + y6 * x7
        + y7 * x6
        + y8 * x5
        + y9 * x4
        + y10 * x3
        + y11 * x2
        + y12 * x1
        + y13 * x0
    )
    force = pull - k * x13 - 2.0 * cubic * m
    x15 = force * 0.004761904761904762 - d * x14 * 0.06666666666666667
    m = z0 * x14 + x1 * x13 + x2 * x12 + x3 * x11 + x4 * x10 + x5 * x9 + x6 * x8 + 0.5 * x7 * x7
    p14 = q1 * x14 + q2 * m
    pull = p14 * v0
    y14 = x0 * x14 + x1 * x13 + x2 * x12 + x3 * x11 + x4 * x10 + x5 * x9 + x6 * x8 + 0.5 * x7 * x7
    m = (
        y0 * x14
        + y1 * x13
        + y2 * x12
        + y3 * x11
        + y4 * x10
        + y5 * x9
        + y6 * x8
        + y7 * x7
        + y8 * x6
        + y9 * x5
        + y10 * x4
        + y11 * x3
        + y12 * x2
        + y13 * x1
        + y14 * x0
    )
    force = pull - k * x14 - 2.0 * cubic * m
    x16 = force * 0.004166666666666667 - d * x15 * 0.0625
    return x0, x1, x2, x3, x4, x5, x6, x7, x8, x9, x10, x11, x12, x13, x14, x15, x16


@njit(error_model="numpy", fastmath=_FAST, forceinline=True)
def table_driven(x0, x1, u, gap, k, d, cubic, origin, q0, q1, q2):  # type: ignore[no-untyped-def]
    """Coefficients 0..ORDER of x, where u has the coefficients u[0..]."""
    u0, u1, u2, u3, u4, u5, u6, u7, u8, u9, u10, u11, u12, u13, u14 = u
    z0 = x0 - origin
    p0 = q0 + z0 * (q1 + q2 * z0)
    q2 += q2
    v = 0.5 * u0 * u0
    v0 = v + v
    pull = p0 * v0
    y0 = 0.5 * x0 * x0
    m = y0 * x0
    force = pull - k * x0 - 2.0 * cubic * m
    x2 = force * 0.5 - d * x1 * 0.5
    v = u0 * u1
    v1 = v + v
    m = z0 * x1
    p1 = q1 * x1 + q2 * m
    pull = p0 * v1 + p1 * v0
    y1 = x0 * x1
    m = y0 * x1 + y1 * x0
    force = pull - k * x1 - 2.0 * cubic * m
    x3 = force * 0.16666666666666666 - d * x2 * 0.3333333333333333
    v = u0 * u2 + 0.5 * u1 * u1
    v2 = v + v
    m = z0 * x2 + 0.5 * x1 * x1
    p2 = q1 * x2 + q2 * m
    pull = p0 * v2 + p1 * v1 + p2 * v0
    y2 = x0 * x2 + 0.5 * x1 * x1
    m = y0 * x2 + y1 * x1 + y2 * x0
    force = pull - k * x2 - 2.0 * cubic * m
    x4 = force * 0.08333333333333333 - d * x3 * 0.25
    v = u0 * u3 + u1 * u2
    v3 = v + v
    m = z0 * x3 + x1 * x2
    p3 = q1 * x3 + q2 * m
    pull = p0 * v3 + p1 * v2 + p2 * v1 + p3 * v0
    y3 = x0 * x3 + x1 * x2
    m = y0 * x3 + y1 * x2 + y2 * x1 + y3 * x0
    force = pull - k * x3 - 2.0 * cubic * m
    x5 = force * 0.05 - d * x4 * 0.2
    v = u0 * u4 + u1 * u3 + 0.5 * u2 * u2
    v4 = v + v
    m = z0 * x4 + x1 * x3 + 0.5 * x2 * x2
    p4 = q1 * x4 + q2 * m
    pull = p0 * v4 + p1 * v3 + p2 * v2 + p3 * v1 + p4 * v0
    y4 = x0 * x4 + x1 * x3 + 0.5 * x2 * x2
    m = y0 * x4 + y1 * x3 + y2 * x2 + y3 * x1 + y4 * x0
    force = pull - k * x4 - 2.0 * cubic * m
    x6 = force * 0.03333333333333333 - d * x5 * 0.16666666666666666
    v = u0 * u5 + u1 * u4 + u2 * u3
    v5 = v + v
    m = z0 * x5 + x1 * x4 + x2 * x3
    p5 = q1 * x5 + q2 * m
    pull = p0 * v5 + p1 * v4 + p2 * v3 + p3 * v2 + p4 * v1 + p5 * v0
    y5 = x0 * x5 + x1 * x4 + x2 * x3
    m = y0 * x5 + y1 * x4 + y2 * x3 + y3 * x2 + y4 * x1 + y5 * x0
    force = pull - k * x5 - 2.0 * cubic * m
    x7 = force * 0.023809523809523808 - d * x6 * 0.14285714285714285
    v = u0 * u6 + u1 * u5 + u2 * u4 + 0.5 * u3 * u3
    v6 = v + v
    m = z0 * x6 + x1 * x5 + x2 * x4 + 0.5 * x3 * x3
    p6 = q1 * x6 + q2 * m
    pull = p0 * v6 + p1 * v5 + p2 * v4 + p3 * v3 + p4 * v2 + p5 * v1 + p6 * v0
    y6 = x0 * x6 + x1 * x5 + x2 * x4 + 0.5 * x3 * x3
    m = y0 * x6 + y1 * x5 + y2 * x4 + y3 * x3 + y4 * x2 + y5 * x1 + y6 * x0
    force = pull - k * x6 - 2.0 * cubic * m
    x8 = force * 0.017857142857142856 - d * x7 * 0.125
    v = u0 * u7 + u1 * u6 + u2 * u5 + u3 * u4
    v7 = v + v
    m = z0 * x7 + x1 * x6 + x2 * x5 + x3 * x4
    p7 = q1 * x7 + q2 * m
    pull = p0 * v7 + p1 * v6 + p2 * v5 + p3 * v4 + p4 * v3 + p5 * v2 + p6 * v1 + p7 * v0
    y7 = x0 * x7 + x1 * x6 + x2 * x5 + x3 * x4
    m = y0 * x7 + y1 * x6 + y2 * x5 + y3 * x4 + y4 * x3 + y5 * x2 + y6 * x1 + y7 * x0
    force = pull - k * x7 - 2.0 * cubic * m
    x9 = force * 0.013888888888888888 - d * x8 * 0.1111111111111111
    v = u0 * u8 + u1 * u7 + u2 * u6 + u3 * u5 + 0.5 * u4 * u4
    v8 = v + v
    m = z0 * x8 + x1 * x7 + x2 * x6 + x3 * x5 + 0.5 * x4 * x4
    p8 = q1 * x8 + q2 * m
    pull = p0 * v8 + p1 * v7 + p2 * v6 + p3 * v5 + p4 * v4 + p5 * v3 + p6 * v2 + p7 * v1 + p8 * v0
    y8 = x0 * x8 + x1 * x7 + x2 * x6 + x3 * x5 + 0.5 * x4 * x4
    m = y0 * x8 + y1 * x7 + y2 * x6 + y3 * x5 + y4 * x4 + y5 * x3 + y6 * x2 + y7 * x1 + y8 * x0
    force = pull - k * x8 - 2.0 * cubic * m
    x10 = force * 0.011111111111111112 - d * x9 * 0.1
    v = u0 * u9 + u1 * u8 + u2 * u7 + u3 * u6 + u4 * u5
    v9 = v + v
    m = z0 * x9 + x1 * x8 + x2 * x7 + x3 * x6 + x4 * x5
    p9 = q1 * x9 + q2 * m
    pull = p0 * v9 + p1 * v8 + p2 * v7 + p3 * v6 + p4 * v5 + p5 * v4 + p6 * v3 + p7 * v2 + p8 * v1 + p9 * v0
    y9 = x0 * x9 + x1 * x8 + x2 * x7 + x3 * x6 + x4 * x5
    m = y0 * x9 + y1 * x8 + y2 * x7 + y3 * x6 + y4 * x5 + y5 * x4 + y6 * x3 + y7 * x2 + y8 * x1 + y9 * x0
    force = pull - k * x9 - 2.0 * cubic * m
    x11 = force * 0.00909090909090909 - d * x10 * 0.09090909090909091
    v = u0 * u10 + u1 * u9 + u2 * u8 + u3 * u7 + u4 * u6 + 0.5 * u5 * u5
    v10 = v + v
    m = z0 * x10 + x1 * x9 + x2 * x8 + x3 * x7 + x4 * x6 + 0.5 * x5 * x5
    p10 = q1 * x10 + q2 * m
    pull = p0 * v10 + p1 * v9 + p2 * v8 + p3 * v7 + p4 * v6 + p5 * v5 + p6 * v4 + p7 * v3 + p8 * v2 + p9 * v1 + p10 * v0
    y10 = x0 * x10 + x1 * x9 + x2 * x8 + x3 * x7 + x4 * x6 + 0.5 * x5 * x5
    m = y0 * x10 + y1 * x9 + y2 * x8 + y3 * x7 + y4 * x6 + y5 * x5 + y6 * x4 + y7 * x3 + y8 * x2 + y9 * x1 + y10 * x0
    force = pull - k * x10 - 2.0 * cubic * m
    x12 = force * 0.007575757575757576 - d * x11 * 0.08333333333333333
    v = u0 * u11 + u1 * u10 + u2 * u9 + u3 * u8 + u4 * u7 + u5 * u6
    v11 = v + v
    m = z0 * x11 + x1 * x10 + x2 * x9 + x3 * x8 + x4 * x7 + x5 * x6
    p11 = q1 * x11 + q2 * m
    pull = (
        p0 * v11
        + p1 * v10
        + p2 * v9
        + p3 * v8
        + p4 * v7
        + p5 * v6
        + p6 * v5
        + p7 * v4
        + p8 * v3
        + p9 * v2
        + p10 * v1
        + p11 * v0
    )
    y11 = x0 * x11 + x1 * x10 + x2 * x9 + x3 * x8 + x4 * x7 + x5 * x6
    m = (
        y0 * x11
        + y1 * x10
        + y2 * x9
        + y3 * x8
        + y4 * x7
        + y5 * x6
        + y6 * x5
        + y7 * x4
        + y8 * x3
        + y9 * x2
        + y10 * x1
        + y11 * x0
    )
    force = pull - k * x11 - 2.0 * cubic * m
    x13 = force * 0.00641025641025641 - d * x12 * 0.07692307692307693
    v = u0 * u12 + u1 * u11 + u2 * u10 + u3 * u9 + u4 * u8 + u5 * u7 + 0.5 * u6 * u6
    v12 = v + v
    m = z0 * x12 + x1 * x11 + x2 * x10 + x3 * x9 + x4 * x8 + x5 * x7 + 0.5 * x6 * x6
    p12 = q1 * x12 + q2 * m
    pull = (
        p0 * v12
        + p1 * v11
        + p2 * v10
        + p3 * v9
        + p4 * v8
        + p5 * v7
        + p6 * v6
        + p7 * v5
        + p8 * v4
        + p9 * v3
        + p10 * v2
        + p11 * v1
        + p12 * v0
    )
    y12 = x0 * x12 + x1 * x11 + x2 * x10 + x3 * x9 + x4 * x8 + x5 * x7 + 0.5 * x6 * x6
    m = (
        y0 * x12
        + y1 * x11
        + y2 * x10
        + y3 * x9
        + y4 * x8
        + y5 * x7
        + y6 * x6
        + y7 * x5
        + y8 * x4
        + y9 * x3
        + y10 * x2
        + y11 * x1
        + y12 * x0
    )
    force = pull - k * x12 - 2.0 * cubic * m
    x14 = force * 0.005494505494505495 - d * x13 * 0.07142857142857142
    v = u0 * u13 + u1 * u12 + u2 * u11 + u3 * u10 + u4 * u9 + u5 * u8 + u6 * u7
    v13 = v + v
    m = z0 * x13 + x1 * x12 + x2 * x11 + x3 * x10 + x4 * x9 + x5 * x8 + x6 * x7
    p13 = q1 * x13 + q2 * m
    pull = (
        p0 * v13
        + p1 * v12
        + p2 * v11
        + p3 * v10
        + p4 * v9
        + p5 * v8
        + p6 * v7
        + p7 * v6
        + p8 * v5
        + p9 * v4
        + p10 * v3
        + p11 * v2
        + p12 * v1
        + p13 * v0
    )
    y13 = x0 * x13 + x1 * x12 + x2 * x11 + x3 * x10 + x4 * x9 + x5 * x8 + x6 * x7
    m = (
        y0 * x13
        + y1 * x12
        + y2 * x11
        + y3 * x10
        + y4 * x9
        + y5 * x8
        + y6 * x7
        + y7 * x6
        + y8 * x5
        + y9 * x4
        + y10 * x3
        + y11 * x2
        + y12 * x1
        + y13 * x0
    )
    force = pull - k * x13 - 2.0 * cubic * m
    x15 = force * 0.004761904761904762 - d * x14 * 0.06666666666666667
    v = u0 * u14 + u1 * u13 + u2 * u12 + u3 * u11 + u4 * u10 + u5 * u9 + u6 * u8 + 0.5 * u7 * u7
    v14 = v + v
    m = z0 * x14 + x1 * x13 + x2 * x12 + x3 * x11 + x4 * x10 + x5 * x9 + x6 * x8 + 0.5 * x7 * x7
    p14 = q1 * x14 + q2 * m
    pull = (
        p0 * v14
        + p1 * v13
        + p2 * v12
        + p3 * v11
        + p4 * v10
        + p5 * v9
        + p6 * v8
        + p7 * v7
        + p8 * v6
        + p9 * v5
        + p10 * v4
        + p11 * v3
        + p12 * v2
        + p13 * v1
        + p14 * v0
    )
    y14 = x0 * x14 + x1 * x13 + x2 * x12 + x3 * x11 + x4 * x10 + x5 * x9 + x6 * x8 + 0.5 * x7 * x7
    m = (
        y0 * x14
        + y1 * x13
        + y2 * x12
        + y3 * x11
        + y4 * x10
        + y5 * x9
        + y6 * x8
        + y7 * x7
        + y8 * x6
        + y9 * x5
        + y10 * x4
        + y11 * x3
        + y12 * x2
        + y13 * x1
        + y14 * x0
    )
    force = pull - k * x14 - 2.0 * cubic * m
    x16 = force * 0.004166666666666667 - d * x15 * 0.0625
    return x0, x1, x2, x3, x4, x5, x6, x7, x8, x9, x10, x11, x12, x13, x14, x15, x16


@njit(error_model="numpy", fastmath=_FAST, forceinline=True)
def table_film_constant(x0, x1, u, gap, k, d, cubic, origin, q0, q1, q2, f, slip):  # type: ignore[no-untyped-def]
    """Coefficients 0..ORDER of x, behind a film, at constant u."""
    z0 = x0 - origin
    p0 = q0 + z0 * (q1 + q2 * z0)
    q2 += q2
    h0 = gap - x0
    i0 = 1.0 / h0
    a0 = h0 * h0
    e0 = slip * h0**1.841
    j0 = 1.0 / (h0 * a0 + e0)
    w0 = x1 * j0
    v0 = u * u
    pull = p0 * v0
    y0 = 0.5 * x0 * x0
    m = y0 * x0
    force = pull - k * x0 - 2.0 * cubic * m - f * w0
    x2 = force * 0.5 - d * x1 * 0.5
    m = z0 * x1
    p1 = q1 * x1 + q2 * m
    pull = p1 * v0
    y1 = x0 * x1
    m = y0 * x1 + y1 * x0
    a1 = -2.0 * h0 * x1
    b = h0 * a1 + -x1 * a0
    e1 = -i0 * 1.8410000000000002 * x1 * e0
    g1 = b + e1
    w1 = j0 * (2.0 * x2 + -g1 * w0)
    force = pull - k * x1 - 2.0 * cubic * m - f * w1
    x3 = force * 0.16666666666666666 - d * x2 * 0.3333333333333333
    m = z0 * x2 + 0.5 * x1 * x1
    p2 = q1 * x2 + q2 * m
    pull = p2 * v0
    y2 = x0 * x2 + 0.5 * x1 * x1
    m = y0 * x2 + y1 * x1 + y2 * x0
    a2 = -2.0 * h0 * x2 + x1 * x1
    b = h0 * a2 + -x1 * a1 + -x2 * a0
    e2 = -i0 * (0.4205000000000001 * x1 * e1 + 1.8410000000000002 * x2 * e0)
    g2 = b + e2
    w2 = j0 * (3.0 * x3 + -g1 * w1 + -g2 * w0)
    force = pull - k * x2 - 2.0 * cubic * m - f * w2
    x4 = force * 0.08333333333333333 - d * x3 * 0.25
    m = z0 * x3 + x1 * x2
    p3 = q1 * x3 + q2 * m
    pull = p3 * v0
    y3 = x0 * x3 + x1 * x2
    m = y0 * x3 + y1 * x2 + y2 * x1 + y3 * x0
    a3 = -2.0 * h0 * x3 + x1 * x2 + x2 * x1
    b = h0 * a3 + -x1 * a2 + -x2 * a1 + -x3 * a0
    e3 = -i0 * (-0.052999999999999936 * x1 * e2 + 0.8940000000000001 * x2 * e1 + 1.841 * x3 * e0)
    g3 = b + e3
    w3 = j0 * (4.0 * x4 + -g1 * w2 + -g2 * w1 + -g3 * w0)
    force = pull - k * x3 - 2.0 * cubic * m - f * w3
    x5 = force * 0.05 - d * x4 * 0.2
    m = z0 * x4 + x1 * x3 + 0.5 * x2 * x2
    p4 = q1 * x4 + q2 * m
    pull = p4 * v0
    y4 = x0 * x4 + x1 * x3 + 0.5 * x2 * x2
    m = y0 * x4 + y1 * x3 + y2 * x2 + y3 * x1 + y4 * x0
    a4 = -2.0 * h0 * x4 + x1 * x3 + x2 * x2 + x3 * x1
    b = h0 * a4 + -x1 * a3 + -x2 * a2 + -x3 * a1 + -x4 * a0
    e4 = -i0 * (
        -0.28974999999999995 * x1 * e3 + 0.4205000000000001 * x2 * e2 + 1.13075 * x3 * e1 + 1.8410000000000002 * x4 * e0
    )
    g4 = b + e4
    w4 = j0 * (5.0 * x5 + -g1 * w3 + -g2 * w2 + -g3 * w1 + -g4 * w0)
    force = pull - k * x4 - 2.0 * cubic * m - f * w4
    x6 = force * 0.03333333333333333 - d * x5 * 0.16666666666666666
    m = z0 * x5 + x1 * x4 + x2 * x3
    p5 = q1 * x5 + q2 * m
    pull = p5 * v0
    y5 = x0 * x5 + x1 * x4 + x2 * x3
    m = y0 * x5 + y1 * x4 + y2 * x3 + y3 * x2 + y4 * x1 + y5 * x0
    a5 = -2.0 * h0 * x5 + x1 * x4 + x2 * x3 + x3 * x2 + x4 * x1
    b = h0 * a5 + -x1 * a4 + -x2 * a3 + -x3 * a2 + -x4 * a1 + -x5 * a0
    e5 = -i0 * (
        -0.43179999999999996 * x1 * e4
        + 0.13640000000000008 * x2 * e3
        + 0.7045999999999999 * x3 * e2
        + 1.2728000000000002 * x4 * e1
        + 1.8410000000000004 * x5 * e0
    )
    g5 = b + e5
    w5 = j0 * (6.0 * x6 + -g1 * w4 + -g2 * w3 + -g3 * w2 + -g4 * w1 + -g5 * w0)
    force = pull - k * x5 - 2.0 * cubic * m - f * w5
    x7 = force * 0.023809523809523808 - d * x6 * 0.14285714285714285
    m = z0 * x6 + x1 * x5 + x2 * x4 + 0.5 * x3 * x3
    p6 = q1 * x6 + q2 * m
    pull = p6 * v0
    y6 = x0 * x6 + x1 * x5 + x2 * x4 + 0.5 * x3 * x3
    m = y0 * x6 + y1 * x5 + y2 * x4 + y3 * x3 + y4 * x2 + y5 * x1 + y6 * x0
    a6 = -2.0 * h0 * x6 + x1 * x5 + x2 * x4 + x3 * x3 + x4 * x2 + x5 * x1
    b = h0 * a6 + -x1 * a5 + -x2 * a4 + -x3 * a3 + -x4 * a2 + -x5 * a1 + -x6 * a0
    e6 = -i0 * (
        -0.5265 * x1 * e5
        + -0.052999999999999936 * x2 * e4
        + 0.42049999999999993 * x3 * e3
        + 0.8940000000000001 * x4 * e2
        + 1.3675000000000004 * x5 * e1
        + 1.841 * x6 * e0
    )
    g6 = b + e6
    w6 = j0 * (7.0 * x7 + -g1 * w5 + -g2 * w4 + -g3 * w3 + -g4 * w2 + -g5 * w1 + -g6 * w0)
    force = pull - k * x6 - 2.0 * cubic * m - f * w6
    x8 = force * 0.017857142857142856 - d * x7 * 0.125
    m = z0 * x7 + x1 * x6 + x2 * x5 + x3 * x4
    p7 = q1 * x7 + q2 * m
    pull = p7 * v0
    y7 = x0 * x7 + x1 * x6 + x2 * x5 + x3 * x4
    m = y0 * x7 + y1 * x6 + y2 * x5 + y3 * x4 + y4 * x3 + y5 * x2 + y6 * x1 + y7 * x0
    a7 = -2.0 * h0 * x7 + x1 * x6 + x2 * x5 + x3 * x4 + x4 * x3 + x5 * x2 + x6 * x1
    b = h0 * a7 + -x1 * a6 + -x2 * a5 + -x3 * a4 + -x4 * a3 + -x5 * a2 + -x6 * a1 + -x7 * a0
    e7 = -i0 * (
        -0.5941428571428571 * x1 * e6
        + -0.18828571428571422 * x2 * e5
        + 0.21757142857142853 * x3 * e4
        + 0.6234285714285716 * x4 * e3
        + 1.0292857142857146 * x5 * e2
        + 1.435142857142857 * x6 * e1
        + 1.841 * x7 * e0
    )
    g7 = b + e7
    w7 = j0 * (8.0 * x8 + -g1 * w6 + -g2 * w5 + -g3 * w4 + -g4 * w3 + -g5 * w2 + -g6 * w1 + -g7 * w0)
    force = pull - k * x7 - 2.0 * cubic * m - f * w7
    x9 = force * 0.013888888888888888 - d * x8 * 0.1111111111111111
    m = z0 * x8 + x1 * x7 + x2 * x6 + x3 * x5 + 0.5 * x4 * x4
    p8 = q1 * x8 + q2 * m
    pull = p8 * v0
    y8 = x0 * x8 + x1 * x7 + x2 * x6 + x3 * x5 + 0.5 * x4 * x4
    m = y0 * x8 + y1 * x7 + y2 * x6 + y3 * x5 + y4 * x4 + y5 * x3 + y6 * x2 + y7 * x1 + y8 * x0
    a8 = -2.0 * h0 * x8 + x1 * x7 + x2 * x6 + x3 * x5 + x4 * x4 + x5 * x3 + x6 * x2 + x7 * x1
    b = h0 * a8 + -x1 * a7 + -x2 * a6 + -x3 * a5 + -x4 * a4 + -x5 * a3 + -x6 * a2 + -x7 * a1 + -x8 * a0
    e8 = -i0 * (
        -0.644875 * x1 * e7
        + -0.28974999999999995 * x2 * e6
        + 0.06537499999999996 * x3 * e5
        + 0.4205000000000001 * x4 * e4
        + 0.7756250000000002 * x5 * e3
        + 1.13075 * x6 * e2
        + 1.485875 * x7 * e1
        + 1.8410000000000002 * x8 * e0
    )
    g8 = b + e8
    w8 = j0 * (9.0 * x9 + -g1 * w7 + -g2 * w6 + -g3 * w5 + -g4 * w4 + -g5 * w3 + -g6 * w2 + -g7 * w1 + -g8 * w0)
    force = pull - k * x8 - 2.0 * cubic * m - f * w8
    x10 = force * 0.011111111111111112 - d * x9 * 0.1
    m = z0 * x9 + x1 * x8 + x2 * x7 + x3 * x6 + x4 * x5
    p9 = q1 * x9 + q2 * m
    pull = p9 * v0
    y9 = x0 * x9 + x1 * x8 + x2 * x7 + x3 * x6 + x4 * x5
    m = y0 * x9 + y1 * x8 + y2 * x7 + y3 * x6 + y4 * x5 + y5 * x4 + y6 * x3 + y7 * x2 + y8 * x1 + y9 * x0
    a9 = -2.0 * h0 * x9 + x1 * x8 + x2 * x7 + x3 * x6 + x4 * x5 + x5 * x4 + x6 * x3 + x7 * x2 + x8 * x1
    b = h0 * a9 + -x1 * a8 + -x2 * a7 + -x3 * a6 + -x4 * a5 + -x5 * a4 + -x6 * a3 + -x7 * a2 + -x8 * a1 + -x9 * a0
    e9 = -i0 * (
        -0.6843333333333333 * x1 * e8
        + -0.36866666666666664 * x2 * e7
        + -0.05300000000000003 * x3 * e6
        + 0.26266666666666677 * x4 * e5
        + 0.5783333333333336 * x5 * e4
        + 0.8939999999999999 * x6 * e3
        + 1.2096666666666667 * x7 * e2
        + 1.5253333333333334 * x8 * e1
        + 1.8410000000000002 * x9 * e0
    )
    g9 = b + e9
    w9 = j0 * (
        10.0 * x10 + -g1 * w8 + -g2 * w7 + -g3 * w6 + -g4 * w5 + -g5 * w4 + -g6 * w3 + -g7 * w2 + -g8 * w1 + -g9 * w0
    )
    force = pull - k * x9 - 2.0 * cubic * m - f * w9
    x11 = force * 0.00909090909090909 - d * x10 * 0.09090909090909091
    m = z0 * x10 + x1 * x9 + x2 * x8 + x3 * x7 + x4 * x6 + 0.5 * x5 * x5
    p10 = q1 * x10 + q2 * m
    pull = p10 * v0
    y10 = x0 * x10 + x1 * x9 + x2 * x8 + x3 * x7 + x4 * x6 + 0.5 * x5 * x5
    m = y0 * x10 + y1 * x9 + y2 * x8 + y3 * x7 + y4 * x6 + y5 * x5 + y6 * x4 + y7 * x3 + y8 * x2 + y9 * x1 + y10 * x0
    a10 = -2.0 * h0 * x10 + x1 * x9 + x2 * x8 + x3 * x7 + x4 * x6 + x5 * x5 + x6 * x4 + x7 * x3 + x8 * x2 + x9 * x1
    b = (
        h0 * a10
        + -x1 * a9
        + -x2 * a8
        + -x3 * a7
        + -x4 * a6
        + -x5 * a5
        + -x6 * a4
        + -x7 * a3
        + -x8 * a2
        + -x9 * a1
        + -x10 * a0
    )
    e10 = -i0 * (
        -0.7159 * x1 * e9
        + -0.43179999999999996 * x2 * e8
        + -0.14770000000000003 * x3 * e7
        + 0.13640000000000008 * x4 * e6
        + 0.4205000000000002 * x5 * e5
        + 0.7045999999999999 * x6 * e4
        + 0.9887 * x7 * e3
        + 1.2728000000000002 * x8 * e2
        + 1.5569000000000002 * x9 * e1
        + 1.8410000000000004 * x10 * e0
    )
    g10 = b + e10
    w10 = j0 * (
        11.0 * x11
        + -g1 * w9
        + -g2 * w8
        + -g3 * w7
        + -g4 * w6
        + -g5 * w5
        + -g6 * w4
        + -g7 * w3
        + -g8 * w2
        + -g9 * w1
        + -g10 * w0
    )
    force = pull - k * x10 - 2.0 * cubic * m - f * w10
    x12 = force * 0.007575757575757576 - d * x11 * 0.08333333333333333
    m = z0 * x11 + x1 * x10 + x2 * x9 + x3 * x8 + x4 * x7 + x5 * x6
    p11 = q1 * x11 + q2 * m
    pull = p11 * v0
    y11 = x0 * x11 + x1 * x10 + x2 * x9 + x3 * x8 + x4 * x7 + x5 * x6
    m = (
        y0 * x11
        + y1 * x10
        + y2 * x9
        + y3 * x8
        + y4 * x7
        + y5 * x6
        + y6 * x5
        + y7 * x4
        + y8 * x3
        + y9 * x2
        + y10 * x1
        + y11 * x0
    )
    a11 = (
        -2.0 * h0 * x11
        + x1 * x10
        + x2 * x9
        + x3 * x8
        + x4 * x7
        + x5 * x6
        + x6 * x5
        + x7 * x4
        + x8 * x3
        + x9 * x2
        + x10 * x1
    )
    b = (
        h0 * a11
        + -x1 * a10
        + -x2 * a9
        + -x3 * a8
        + -x4 * a7
        + -x5 * a6
        + -x6 * a5
        + -x7 * a4
        + -x8 * a3
        + -x9 * a2
        + -x10 * a1
        + -x11 * a0
    )
    e11 = -i0 * (
        -0.7417272727272727 * x1 * e10
        + -0.4834545454545454 * x2 * e9
        + -0.2251818181818182 * x3 * e8
        + 0.033090909090909164 * x4 * e7
        + 0.29136363636363655 * x5 * e6
        + 0.5496363636363636 * x6 * e5
        + 0.8079090909090909 * x7 * e4
        + 1.0661818181818183 * x8 * e3
        + 1.3244545454545458 * x9 * e2
        + 1.582727272727273 * x10 * e1
        + 1.8410000000000002 * x11 * e0
    )
    g11 = b + e11
    w11 = j0 * (
        12.0 * x12
        + -g1 * w10
        + -g2 * w9
        + -g3 * w8
        + -g4 * w7
        + -g5 * w6
        + -g6 * w5
        + -g7 * w4
        + -g8 * w3
        + -g9 * w2
        + -g10 * w1
        + -g11 * w0
    )
    force = pull - k * x11 - 2.0 * cubic * m - f * w11
    x13 = force * 0.00641025641025641 - d * x12 * 0.07692307692307693
    m = z0 * x12 + x1 * x11 + x2 * x10 + x3 * x9 + x4 * x8 + x5 * x7 + 0.5 * x6 * x6
    p12 = q1 * x12 + q2 * m
    pull = p12 * v0
    y12 = x0 * x12 + x1 * x11 + x2 * x10 + x3 * x9 + x4 * x8 + x5 * x7 + 0.5 * x6 * x6
    m = (
        y0 * x12
        + y1 * x11
        + y2 * x10
        + y3 * x9
        + y4 * x8
        + y5 * x7
        + y6 * x6
        + y7 * x5
        + y8 * x4
        + y9 * x3
        + y10 * x2
        + y11 * x1
        + y12 * x0
    )
    a12 = (
        -2.0 * h0 * x12
        + x1 * x11
        + x2 * x10
        + x3 * x9
        + x4 * x8
        + x5 * x7
        + x6 * x6
        + x7 * x5
        + x8 * x4
        + x9 * x3
        + x10 * x2
        + x11 * x1
    )
    b = (
        h0 * a12
        + -x1 * a11
        + -x2 * a10
        + -x3 * a9
        + -x4 * a8
        + -x5 * a7
        + -x6 * a6
        + -x7 * a5
        + -x8 * a4
        + -x9 * a3
        + -x10 * a2
        + -x11 * a1
        + -x12 * a0
    )
    e12 = -i0 * (
        -0.7632499999999999 * x1 * e11
        + -0.5265 * x2 * e10
        + -0.28975 * x3 * e9
        + -0.052999999999999936 * x4 * e8
        + 0.18375000000000016 * x5 * e7
        + 0.42049999999999993 * x6 * e6
        + 0.65725 * x7 * e5
        + 0.8940000000000001 * x8 * e4
        + 1.1307500000000001 * x9 * e3
        + 1.3675000000000004 * x10 * e2
        + 1.6042500000000002 * x11 * e1
        + 1.841 * x12 * e0
    )
    g12 = b + e12
    w12 = j0 * (
        13.0 * x13
        + -g1 * w11
        + -g2 * w10
        + -g3 * w9
        + -g4 * w8
        + -g5 * w7
        + -g6 * w6
        + -g7 * w5
        + -g8 * w4
        + -g9 * w3
        + -g10 * w2
        + -g11 * w1
        + -g12 * w0
    )
    force = pull - k * x12 - 2.0 * cubic * m - f * w12
    x14 = force * 0.005494505494505495 - d * x13 * 0.07142857142857142
    m = z0 * x13 + x1 * x12 + x2 * x11 + x3 * x10 + x4 * x9 + x5 * x8 + x6 * x7
    p13 = q1 * x13 + q2 * m
    pull = p13 * v0
    y13 = x0 * x13 + x1 * x12 + x2 * x11 + x3 * x10 + x4 * x9 + x5 * x8 + x6 * x7
    m = (
        y0 * x13
        + y1 * x12
        + y2 * x11
        + y3 * x10
        + y4 * x9
        + y5 * x8
        + y6 * x7
        + y7 * x6
        + y8 * x5
        + y9 * x4
        + y10 * x3
        + y11 * x2
        + y12 * x1
        + y13 * x0
    )
    a13 = (
        -2.0 * h0 * x13
        + x1 * x12
        + x2 * x11
        + x3 * x10
        + x4 * x9
        + x5 * x8
        + x6 * x7
        + x7 * x6
        + x8 * x5
        + x9 * x4
        + x10 * x3
        + x11 * x2
        + x12 * x1
    )
    b = (
        h0 * a13
        + -x1 * a12
        + -x2 * a11
        + -x3 * a10
        + -x4 * a9
        + -x5 * a8
        + -x6 * a7
        + -x7 * a6
        + -x8 * a5
        + -x9 * a4
        + -x10 * a3
        + -x11 * a2
        + -x12 * a1
        + -x13 * a0
    )
    e13 = -i0 * (
        -0.7814615384615384 * x1 * e12
        + -0.5629230769230769 * x2 * e11
        + -0.3443846153846154 * x3 * e10
        + -0.12584615384615377 * x4 * e9
        + 0.09269230769230784 * x5 * e8
        + 0.3112307692307692 * x6 * e7
        + 0.5297692307692308 * x7 * e6
        + 0.7483076923076925 * x8 * e5
        + 0.966846153846154 * x9 * e4
        + 1.1853846153846157 * x10 * e3
        + 1.403923076923077 * x11 * e2
        + 1.6224615384615384 * x12 * e1
        + 1.841 * x13 * e0
    )
    g13 = b + e13
    w13 = j0 * (
        14.0 * x14
        + -g1 * w12
        + -g2 * w11
        + -g3 * w10
        + -g4 * w9
        + -g5 * w8
        + -g6 * w7
        + -g7 * w6
        + -g8 * w5
        + -g9 * w4
        + -g10 * w3
        + -g11 * w2
        + -g12 * w1
        + -g13 * w0
    )
    force = pull - k * x13 - 2.0 * cubic * m - f * w13
    x15 = force * 0.004761904761904762 - d * x14 * 0.06666666666666667
    m = z0 * x14 + x1 * x13 + x2 * x12 + x3 * x11 + x4 * x10 + x5 * x9 + x6 * x8 + 0.5 * x7 * x7
    p14 = q1 * x14 + q2 * m
    pull = p14 * v0
    y14 = x0 * x14 + x1 * x13 + x2 * x12 + x3 * x11 + x4 * x10 + x5 * x9 + x6 * x8 + 0.5 * x7 * x7
    m = (
        y0 * x14
        + y1 * x13
        + y2 * x12
        + y3 * x11
        + y4 * x10
        + y5 * x9
        + y6 * x8
        + y7 * x7
        + y8 * x6
        + y9 * x5
        + y10 * x4
        + y11 * x3
        + y12 * x2
        + y13 * x1
        + y14 * x0
    )
    a14 = (
        -2.0 * h0 * x14
        + x1 * x13
        + x2 * x12
        + x3 * x11
        + x4 * x10
        + x5 * x9
        + x6 * x8
        + x7 * x7
        + x8 * x6
        + x9 * x5
        + x10 * x4
        + x11 * x3
        + x12 * x2
        + x13 * x1
    )
    b = (
        h0 * a14
        + -x1 * a13
        + -x2 * a12
        + -x3 * a11
        + -x4 * a10
        + -x5 * a9
        + -x6 * a8
        + -x7 * a7
        + -x8 * a6
        + -x9 * a5
        + -x10 * a4
        + -x11 * a3
        + -x12 * a2
        + -x13 * a1
        + -x14 * a0
    )
    e14 = -i0 * (
        -0.7970714285714285 * x1 * e13
        + -0.5941428571428571 * x2 * e12
        + -0.39121428571428574 * x3 * e11
        + -0.18828571428571422 * x4 * e10
        + 0.014642857142857275 * x5 * e9
        + 0.21757142857142853 * x6 * e8
        + 0.42050000000000004 * x7 * e7
        + 0.6234285714285716 * x8 * e6
        + 0.826357142857143 * x9 * e5
        + 1.0292857142857146 * x10 * e4
        + 1.2322142857142857 * x11 * e3
        + 1.435142857142857 * x12 * e2
        + 1.6380714285714286 * x13 * e1
        + 1.841 * x14 * e0
    )
    g14 = b + e14
    w14 = j0 * (
        15.0 * x15
        + -g1 * w13
        + -g2 * w12
        + -g3 * w11
        + -g4 * w10
        + -g5 * w9
        + -g6 * w8
        + -g7 * w7
        + -g8 * w6
        + -g9 * w5
        + -g10 * w4
        + -g11 * w3
        + -g12 * w2
        + -g13 * w1
        + -g14 * w0
    )
    force = pull - k * x14 - 2.0 * cubic * m - f * w14
    x16 = force * 0.004166666666666667 - d * x15 * 0.0625
    return x0, x1, x2, x3, x4, x5, x6, x7, x8, x9, x10, x11, x12, x13, x14, x15, x16


@njit(error_model="numpy", fastmath=_FAST, forceinline=True)
def table_film_driven(x0, x1, u, gap, k, d, cubic, origin, q0, q1, q2, f, slip):  # type: ignore[no-untyped-def]
    """Coefficients 0..ORDER of x, behind a film, where u has the coefficients u[0..]."""
    u0, u1, u2, u3, u4, u5, u6, u7, u8, u9, u10, u11, u12, u13, u14 = u
    z0 = x0 - origin
    p0 = q0 + z0 * (q1 + q2 * z0)
    q2 += q2
    h0 = gap - x0
    i0 = 1.0 / h0
    a0 = h0 * h0
    e0 = slip * h0**1.841
    j0 = 1.0 / (h0 * a0 + e0)
    w0 = x1 * j0
    v = 0.5 * u0 * u0
    v0 = v + v
    pull = p0 * v0
    y0 = 0.5 * x0 * x0
    m = y0 * x0
    force = pull - k * x0 - 2.0 * cubic * m - f * w0
    x2 = force * 0.5 - d * x1 * 0.5
    v = u0 * u1
    v1 = v + v
    m = z0 * x1
    p1 = q1 * x1 + q2 * m
    pull = p0 * v1 + p1 * v0
    y1 = x0 * x1
    m = y0 * x1 + y1 * x0
    a1 = -2.0 * h0 * x1
    b = h0 * a1 + -x1 * a0
    e1 = -i0 * 1.8410000000000002 * x1 * e0
    g1 = b + e1
    w1 = j0 * (2.0 * x2 + -g1 * w0)
    force = pull - k * x1 - 2.0 * cubic * m - f * w1
    x3 = force * 0.16666666666666666 - d * x2 * 0.3333333333333333
    v = u0 * u2 + 0.5 * u1 * u1
    v2 = v + v
    m = z0 * x2 + 0.5 * x1 * x1
    p2 = q1 * x2 + q2 * m
    pull = p0 * v2 + p1 * v1 + p2 * v0
    y2 = x0 * x2 + 0.5 * x1 * x1
    m = y0 * x2 + y1 * x1 + y2 * x0
    a2 = -2.0 * h0 * x2 + x1 * x1
    b = h0 * a2 + -x1 * a1 + -x2 * a0
    e2 = -i0 * (0.4205000000000001 * x1 * e1 + 1.8410000000000002 * x2 * e0)
    g2 = b + e2
    w2 = j0 * (3.0 * x3 + -g1 * w1 + -g2 * w0)
    force = pull - k * x2 - 2.0 * cubic * m - f * w2
    x4 = force * 0.08333333333333333 - d * x3 * 0.25
    v = u0 * u3 + u1 * u2
    v3 = v + v
    m = z0 * x3 + x1 * x2
    p3 = q1 * x3 + q2 * m
    pull = p0 * v3 + p1 * v2 + p2 * v1 + p3 * v0
    y3 = x0 * x3 + x1 * x2
    m = y0 * x3 + y1 * x2 + y2 * x1 + y3 * x0
    a3 = -2.0 * h0 * x3 + x1 * x2 + x2 * x1
    b = h0 * a3 + -x1 * a2 + -x2 * a1 + -x3 * a0
    e3 = -i0 * (-0.052999999999999936 * x1 * e2 + 0.8940000000000001 * x2 * e1 + 1.841 * x3 * e0)
    g3 = b + e3
    w3 = j0 * (4.0 * x4 + -g1 * w2 + -g2 * w1 + -g3 * w0)
    force = pull - k * x3 - 2.0 * cubic * m - f * w3
    x5 = force * 0.05 - d * x4 * 0.2
    v = u0 * u4 + u1 * u3 + 0.5 * u2 * u2
    v4 = v + v
    m = z0 * x4 + x1 * x3 + 0.5 * x2 * x2
    p4 = q1 * x4 + q2 * m
    pull = p0 * v4 + p1 * v3 + p2 * v2 + p3 * v1 + p4 * v0
    y4 = x0 * x4 + x1 * x3 + 0.5 * x2 * x2
    m = y0 * x4 + y1 * x3 + y2 * x2 + y3 * x1 + y4 * x0
    a4 = -2.0 * h0 * x4 + x1 * x3 + x2 * x2 + x3 * x1
    b = h0 * a4 + -x1 * a3 + -x2 * a2 + -x3 * a1 + -x4 * a0
    e4 = -i0 * (
        -0.28974999999999995 * x1 * e3 + 0.4205000000000001 * x2 * e2 + 1.13075 * x3 * e1 + 1.8410000000000002 * x4 * e0
    )
    g4 = b + e4
    w4 = j0 * (5.0 * x5 + -g1 * w3 + -g2 * w2 + -g3 * w1 + -g4 * w0)
    force = pull - k * x4 - 2.0 * cubic * m - f * w4
    x6 = force * 0.03333333333333333 - d * x5 * 0.16666666666666666
    v = u0 * u5 + u1 * u4 + u2 * u3
    v5 = v + v
    m = z0 * x5 + x1 * x4 + x2 * x3
    p5 = q1 * x5 + q2 * m
    pull = p0 * v5 + p1 * v4 + p2 * v3 + p3 * v2 + p4 * v1 + p5 * v0
    y5 = x0 * x5 + x1 * x4 + x2 * x3
    m = y0 * x5 + y1 * x4 + y2 * x3 + y3 * x2 + y4 * x1 + y5 * x0
    a5 = -2.0 * h0 * x5 + x1 * x4 + x2 * x3 + x3 * x2 + x4 * x1
    b = h0 * a5 + -x1 * a4 + -x2 * a3 + -x3 * a2 + -x4 * a1 + -x5 * a0
    e5 = -i0 * (
        -0.43179999999999996 * x1 * e4
        + 0.13640000000000008 * x2 * e3
        + 0.7045999999999999 * x3 * e2
        + 1.2728000000000002 * x4 * e1
        + 1.8410000000000004 * x5 * e0
    )
    g5 = b + e5
    w5 = j0 * (6.0 * x6 + -g1 * w4 + -g2 * w3 + -g3 * w2 + -g4 * w1 + -g5 * w0)
    force = pull - k * x5 - 2.0 * cubic * m - f * w5
    x7 = force * 0.023809523809523808 - d * x6 * 0.14285714285714285
    v = u0 * u6 + u1 * u5 + u2 * u4 + 0.5 * u3 * u3
    v6 = v + v
    m = z0 * x6 + x1 * x5 + x2 * x4 + 0.5 * x3 * x3
    p6 = q1 * x6 + q2 * m
    pull = p0 * v6 + p1 * v5 + p2 * v4 + p3 * v3 + p4 * v2 + p5 * v1 + p6 * v0
    y6 = x0 * x6 + x1 * x5 + x2 * x4 + 0.5 * x3 * x3
    m = y0 * x6 + y1 * x5 + y2 * x4 + y3 * x3 + y4 * x2 + y5 * x1 + y6 * x0
    a6 = -2.0 * h0 * x6 + x1 * x5 + x2 * x4 + x3 * x3 + x4 * x2 + x5 * x1
    b = h0 * a6 + -x1 * a5 + -x2 * a4 + -x3 * a3 + -x4 * a2 + -x5 * a1 + -x6 * a0
    e6 = -i0 * (
        -0.5265 * x1 * e5
        + -0.052999999999999936 * x2 * e4
        + 0.42049999999999993 * x3 * e3
        + 0.8940000000000001 * x4 * e2
        + 1.3675000000000004 * x5 * e1
        + 1.841 * x6 * e0
    )
    g6 = b + e6
    w6 = j0 * (7.0 * x7 + -g1 * w5 + -g2 * w4 + -g3 * w3 + -g4 * w2 + -g5 * w1 + -g6 * w0)
    force = pull - k * x6 - 2.0 * cubic * m - f * w6
    x8 = force * 0.017857142857142856 - d * x7 * 0.125
    v = u0 * u7 + u1 * u6 + u2 * u5 + u3 * u4
    v7 = v + v
    m = z0 * x7 + x1 * x6 + x2 * x5 + x3 * x4
    p7 = q1 * x7 + q2 * m
    pull = p0 * v7 + p1 * v6 + p2 * v5 + p3 * v4 + p4 * v3 + p5 * v2 + p6 * v1 + p7 * v0
    y7 = x0 * x7 + x1 * x6 + x2 * x5 + x3 * x4
    m = y0 * x7 + y1 * x6 + y2 * x5 + y3 * x4 + y4 * x3 + y5 * x2 + y6 * x1 + y7 * x0
    a7 = -2.0 * h0 * x7 + x1 * x6 + x2 * x5 + x3 * x4 + x4 * x3 + x5 * x2 + x6 * x1
    b = h0 * a7 + -x1 * a6 + -x2 * a5 + -x3 * a4 + -x4 * a3 + -x5 * a2 + -x6 * a1 + -x7 * a0
    e7 = -i0 * (
        -0.5941428571428571 * x1 * e6
        + -0.18828571428571422 * x2 * e5
        + 0.21757142857142853 * x3 * e4
        + 0.6234285714285716 * x4 * e3
        + 1.0292857142857146 * x5 * e2
        + 1.435142857142857 * x6 * e1
        + 1.841 * x7 * e0
    )
    g7 = b + e7
    w7 = j0 * (8.0 * x8 + -g1 * w6 + -g2 * w5 + -g3 * w4 + -g4 * w3 + -g5 * w2 + -g6 * w1 + -g7 * w0)
    force = pull - k * x7 - 2.0 * cubic * m - f * w7
    x9 = force * 0.013888888888888888 - d * x8 * 0.1111111111111111
    v = u0 * u8 + u1 * u7 + u2 * u6 + u3 * u5 + 0.5 * u4 * u4
    v8 = v + v
    m = z0 * x8 + x1 * x7 + x2 * x6 + x3 * x5 + 0.5 * x4 * x4
    p8 = q1 * x8 + q2 * m
    pull = p0 * v8 + p1 * v7 + p2 * v6 + p3 * v5 + p4 * v4 + p5 * v3 + p6 * v2 + p7 * v1 + p8 * v0
    y8 = x0 * x8 + x1 * x7 + x2 * x6 + x3 * x5 + 0.5 * x4 * x4
    m = y0 * x8 + y1 * x7 + y2 * x6 + y3 * x5 + y4 * x4 + y5 * x3 + y6 * x2 + y7 * x1 + y8 * x0
    a8 = -2.0 * h0 * x8 + x1 * x7 + x2 * x6 + x3 * x5 + x4 * x4 + x5 * x3 + x6 * x2 + x7 * x1
    b = h0 * a8 + -x1 * a7 + -x2 * a6 + -x3 * a5 + -x4 * a4 + -x5 * a3 + -x6 * a2 + -x7 * a1 + -x8 * a0
    e8 = -i0 * (
        -0.644875 * x1 * e7
        + -0.28974999999999995 * x2 * e6
        + 0.06537499999999996 * x3 * e5
        + 0.4205000000000001 * x4 * e4
        + 0.7756250000000002 * x5 * e3
        + 1.13075 * x6 * e2
        + 1.485875 * x7 * e1
        + 1.8410000000000002 * x8 * e0
    )
    g8 = b + e8
    w8 = j0 * (9.0 * x9 + -g1 * w7 + -g2 * w6 + -g3 * w5 + -g4 * w4 + -g5 * w3 + -g6 * w2 + -g7 * w1 + -g8 * w0)
    force = pull - k * x8 - 2.0 * cubic * m - f * w8
    x10 = force * 0.011111111111111112 - d * x9 * 0.1
    v = u0 * u9 + u1 * u8 + u2 * u7 + u3 * u6 + u4 * u5
    v9 = v + v
    m = z0 * x9 + x1 * x8 + x2 * x7 + x3 * x6 + x4 * x5
    p9 = q1 * x9 + q2 * m
    pull = p0 * v9 + p1 * v8 + p2 * v7 + p3 * v6 + p4 * v5 + p5 * v4 + p6 * v3 + p7 * v2 + p8 * v1 + p9 * v0
    y9 = x0 * x9 + x1 * x8 + x2 * x7 + x3 * x6 + x4 * x5
    m = y0 * x9 + y1 * x8 + y2 * x7 + y3 * x6 + y4 * x5 + y5 * x4 + y6 * x3 + y7 * x2 + y8 * x1 + y9 * x0
    a9 = -2.0 * h0 * x9 + x1 * x8 + x2 * x7 + x3 * x6 + x4 * x5 + x5 * x4 + x6 * x3 + x7 * x2 + x8 * x1
    b = h0 * a9 + -x1 * a8 + -x2 * a7 + -x3 * a6 + -x4 * a5 + -x5 * a4 + -x6 * a3 + -x7 * a2 + -x8 * a1 + -x9 * a0
    e9 = -i0 * (
        -0.6843333333333333 * x1 * e8
        + -0.36866666666666664 * x2 * e7
        + -0.05300000000000003 * x3 * e6
        + 0.26266666666666677 * x4 * e5
        + 0.5783333333333336 * x5 * e4
        + 0.8939999999999999 * x6 * e3
        + 1.2096666666666667 * x7 * e2
        + 1.5253333333333334 * x8 * e1
        + 1.8410000000000002 * x9 * e0
    )
    g9 = b + e9
    w9 = j0 * (
        10.0 * x10 + -g1 * w8 + -g2 * w7 + -g3 * w6 + -g4 * w5 + -g5 * w4 + -g6 * w3 + -g7 * w2 + -g8 * w1 + -g9 * w0
    )
    force = pull - k * x9 - 2.0 * cubic * m - f * w9
    x11 = force * 0.00909090909090909 - d * x10 * 0.09090909090909091
    v = u0 * u10 + u1 * u9 + u2 * u8 + u3 * u7 + u4 * u6 + 0.5 * u5 * u5
    v10 = v + v
    m = z0 * x10 + x1 * x9 + x2 * x8 + x3 * x7 + x4 * x6 + 0.5 * x5 * x5
    p10 = q1 * x10 + q2 * m
    pull = p0 * v10 + p1 * v9 + p2 * v8 + p3 * v7 + p4 * v6 + p5 * v5 + p6 * v4 + p7 * v3 + p8 * v2 + p9 * v1 + p10 * v0
    y10 = x0 * x10 + x1 * x9 + x2 * x8 + x3 * x7 + x4 * x6 + 0.5 * x5 * x5
    m = y0 * x10 + y1 * x9 + y2 * x8 + y3 * x7 + y4 * x6 + y5 * x5 + y6 * x4 + y7 * x3 + y8 * x2 + y9 * x1 + y10 * x0
    a10 = -2.0 * h0 * x10 + x1 * x9 + x2 * x8 + x3 * x7 + x4 * x6 + x5 * x5 + x6 * x4 + x7 * x3 + x8 * x2 + x9 * x1
    b = (
        h0 * a10
        + -x1 * a9
        + -x2 * a8
        + -x3 * a7
        + -x4 * a6
        + -x5 * a5
        + -x6 * a4
        + -x7 * a3
        + -x8 * a2
        + -x9 * a1
        + -x10 * a0
    )
    e10 = -i0 * (
        -0.7159 * x1 * e9
        + -0.43179999999999996 * x2 * e8
        + -0.14770000000000003 * x3 * e7
        + 0.13640000000000008 * x4 * e6
        + 0.4205000000000002 * x5 * e5
        + 0.7045999999999999 * x6 * e4
        + 0.9887 * x7 * e3
        + 1.2728000000000002 * x8 * e2
        + 1.5569000000000002 * x9 * e1
        + 1.8410000000000004 * x10 * e0
    )
    g10 = b + e10
    w10 = j0 * (
        11.0 * x11
        + -g1 * w9
        + -g2 * w8
        + -g3 * w7
        + -g4 * w6
        + -g5 * w5
        + -g6 * w4
        + -g7 * w3
        + -g8 * w2
        + -g9 * w1
        + -g10 * w0
    )
    force = pull - k * x10 - 2.0 * cubic * m - f * w10
    x12 = force * 0.007575757575757576 - d * x11 * 0.08333333333333333
    v = u0 * u11 + u1 * u10 + u2 * u9 + u3 * u8 + u4 * u7 + u5 * u6
    v11 = v + v
    m = z0 * x11 + x1 * x10 + x2 * x9 + x3 * x8 + x4 * x7 + x5 * x6
    p11 = q1 * x11 + q2 * m
    pull = (
        p0 * v11
        + p1 * v10
        + p2 * v9
        + p3 * v8
        + p4 * v7
        + p5 * v6
        + p6 * v5
        + p7 * v4
        + p8 * v3
        + p9 * v2
        + p10 * v1
        + p11 * v0
    )
    y11 = x0 * x11 + x1 * x10 + x2 * x9 + x3 * x8 + x4 * x7 + x5 * x6
    m = (
        y0 * x11
        + y1 * x10
        + y2 * x9
        + y3 * x8
        + y4 * x7
        + y5 * x6
        + y6 * x5
        + y7 * x4
        + y8 * x3
        + y9 * x2
        + y10 * x1
        + y11 * x0
    )
    a11 = (
        -2.0 * h0 * x11
        + x1 * x10
        + x2 * x9
        + x3 * x8
        + x4 * x7
        + x5 * x6
        + x6 * x5
        + x7 * x4
        + x8 * x3
        + x9 * x2
        + x10 * x1
    )
    b = (
        h0 * a11
        + -x1 * a10
        + -x2 * a9
        + -x3 * a8
        + -x4 * a7
        + -x5 * a6
        + -x6 * a5
        + -x7 * a4
        + -x8 * a3
        + -x9 * a2
        + -x10 * a1
        + -x11 * a0
    )
    e11 = -i0 * (
        -0.7417272727272727 * x1 * e10
        + -0.4834545454545454 * x2 * e9
        + -0.2251818181818182 * x3 * e8
        + 0.033090909090909164 * x4 * e7
        + 0.29136363636363655 * x5 * e6
        + 0.5496363636363636 * x6 * e5
        + 0.8079090909090909 * x7 * e4
        + 1.0661818181818183 * x8 * e3
        + 1.3244545454545458 * x9 * e2
        + 1.582727272727273 * x10 * e1
        + 1.8410000000000002 * x11 * e0
    )
    g11 = b + e11
    w11 = j0 * (
        12.0 * x12
        + -g1 * w10
        + -g2 * w9
        + -g3 * w8
        + -g4 * w7
        + -g5 * w6
        + -g6 * w5
        + -g7 * w4
        + -g8 * w3
        + -g9 * w2
        + -g10 * w1
        + -g11 * w0
    )
    force = pull - k * x11 - 2.0 * cubic * m - f * w11
    x13 = force * 0.00641025641025641 - d * x12 * 0.07692307692307693
    v = u0 * u12 + u1 * u11 + u2 * u10 + u3 * u9 + u4 * u8 + u5 * u7 + 0.5 * u6 * u6
    v12 = v + v
    m = z0 * x12 + x1 * x11 + x2 * x10 + x3 * x9 + x4 * x8 + x5 * x7 + 0.5 * x6 * x6
    p12 = q1 * x12 + q2 * m
    pull = (
        p0 * v12
        + p1 * v11
        + p2 * v10
        + p3 * v9
        + p4 * v8
        + p5 * v7
        + p6 * v6
        + p7 * v5
        + p8 * v4
        + p9 * v3
        + p10 * v2
        + p11 * v1
        + p12 * v0
    )
    y12 = x0 * x12 + x1 * x11 + x2 * x10 + x3 * x9 + x4 * x8 + x5 * x7 + 0.5 * x6 * x6
    m = (
        y0 * x12
        + y1 * x11
        + y2 * x10
        + y3 * x9
        + y4 * x8
        + y5 * x7
        + y6 * x6
        + y7 * x5
        + y8 * x4
        + y9 * x3
        + y10 * x2
        + y11 * x1
        + y12 * x0
    )
    a12 = (
        -2.0 * h0 * x12
        + x1 * x11
        + x2 * x10
        + x3 * x9
        + x4 * x8
        + x5 * x7
        + x6 * x6
        + x7 * x5
        + x8 * x4
        + x9 * x3
        + x10 * x2
        + x11 * x1
    )
    b = (
        h0 * a12
        + -x1 * a11
        + -x2 * a10
        + -x3 * a9
        + -x4 * a8
        + -x5 * a7
        + -x6 * a6
        + -x7 * a5
        + -x8 * a4
        + -x9 * a3
        + -x10 * a2
        + -x11 * a1
        + -x12 * a0
    )
    e12 = -i0 * (
        -0.7632499999999999 * x1 * e11
        + -0.5265 * x2 * e10
        + -0.28975 * x3 * e9
        + -0.052999999999999936 * x4 * e8
        + 0.18375000000000016 * x5 * e7
        + 0.42049999999999993 * x6 * e6
        + 0.65725 * x7 * e5
        + 0.8940000000000001 * x8 * e4
        + 1.1307500000000001 * x9 * e3
        + 1.3675000000000004 * x10 * e2
        + 1.6042500000000002 * x11 * e1
        + 1.841 * x12 * e0
    )
    g12 = b + e12
    w12 = j0 * (
        13.0 * x13
        + -g1 * w11
        + -g2 * w10
        + -g3 * w9
        + -g4 * w8
        + -g5 * w7
        + -g6 * w6
        + -g7 * w5
        + -g8 * w4
        + -g9 * w3
        + -g10 * w2
        + -g11 * w1
        + -g12 * w0
    )
    force = pull - k * x12 - 2.0 * cubic * m - f * w12
    x14 = force * 0.005494505494505495 - d * x13 * 0.07142857142857142
    v = u0 * u13 + u1 * u12 + u2 * u11 + u3 * u10 + u4 * u9 + u5 * u8 + u6 * u7
    v13 = v + v
    m = z0 * x13 + x1 * x12 + x2 * x11 + x3 * x10 + x4 * x9 + x5 * x8 + x6 * x7
    p13 = q1 * x13 + q2 * m
    pull = (
        p0 * v13
        + p1 * v12
        + p2 * v11
        + p3 * v10
        + p4 * v9
        + p5 * v8
        + p6 * v7
        + p7 * v6
        + p8 * v5
        + p9 * v4
        + p10 * v3
        + p11 * v2
        + p12 * v1
        + p13 * v0
    )
    y13 = x0 * x13 + x1 * x12 + x2 * x11 + x3 * x10 + x4 * x9 + x5 * x8 + x6 * x7
    m = (
        y0 * x13
        + y1 * x12
        + y2 * x11
        + y3 * x10
        + y4 * x9
        + y5 * x8
        + y6 * x7
        + y7 * x6
        + y8 * x5
        + y9 * x4
        + y10 * x3
        + y11 * x2
        + y12 * x1
        + y13 * x0
    )
    a13 = (
        -2.0 * h0 * x13
        + x1 * x12
        + x2 * x11
        + x3 * x10
        + x4 * x9
        + x5 * x8
        + x6 * x7
        + x7 * x6
        + x8 * x5
        + x9 * x4
        + x10 * x3
        + x11 * x2
        + x12 * x1
    )
    b = (
        h0 * a13
        + -x1 * a12
        + -x2 * a11
        + -x3 * a10
        + -x4 * a9
        + -x5 * a8
        + -x6 * a7
        + -x7 * a6
        + -x8 * a5
        + -x9 * a4
        + -x10 * a3
        + -x11 * a2
        + -x12 * a1
        + -x13 * a0
    )
    e13 = -i0 * (
        -0.7814615384615384 * x1 * e12
        + -0.5629230769230769 * x2 * e11
        + -0.3443846153846154 * x3 * e10
        + -0.12584615384615377 * x4 * e9
        + 0.09269230769230784 * x5 * e8
        + 0.3112307692307692 * x6 * e7
        + 0.5297692307692308 * x7 * e6
        + 0.7483076923076925 * x8 * e5
        + 0.966846153846154 * x9 * e4
        + 1.1853846153846157 * x10 * e3
        + 1.403923076923077 * x11 * e2
        + 1.6224615384615384 * x12 * e1
        + 1.841 * x13 * e0
    )
    g13 = b + e13
    w13 = j0 * (
        14.0 * x14
        + -g1 * w12
        + -g2 * w11
        + -g3 * w10
        + -g4 * w9
        + -g5 * w8
        + -g6 * w7
        + -g7 * w6
        + -g8 * w5
        + -g9 * w4
        + -g10 * w3
        + -g11 * w2
        + -g12 * w1
        + -g13 * w0
    )
    force = pull - k * x13 - 2.0 * cubic * m - f * w13
    x15 = force * 0.004761904761904762 - d * x14 * 0.06666666666666667
    v = u0 * u14 + u1 * u13 + u2 * u12 + u3 * u11 + u4 * u10 + u5 * u9 + u6 * u8 + 0.5 * u7 * u7
    v14 = v + v
    m = z0 * x14 + x1 * x13 + x2 * x12 + x3 * x11 + x4 * x10 + x5 * x9 + x6 * x8 + 0.5 * x7 * x7
    p14 = q1 * x14 + q2 * m
    pull = (
        p0 * v14
        + p1 * v13
        + p2 * v12
        + p3 * v11
        + p4 * v10
        + p5 * v9
        + p6 * v8
        + p7 * v7
        + p8 * v6
        + p9 * v5
        + p10 * v4
        + p11 * v3
        + p12 * v2
        + p13 * v1
        + p14 * v0
    )
    y14 = x0 * x14 + x1 * x13 + x2 * x12 + x3 * x11 + x4 * x10 + x5 * x9 + x6 * x8 + 0.5 * x7 * x7
    m = (
        y0 * x14
        + y1 * x13
        + y2 * x12
        + y3 * x11
        + y4 * x10
        + y5 * x9
        + y6 * x8
        + y7 * x7
        + y8 * x6
        + y9 * x5
        + y10 * x4
        + y11 * x3
        + y12 * x2
        + y13 * x1
        + y14 * x0
    )
    a14 = (
        -2.0 * h0 * x14
        + x1 * x13
        + x2 * x12
        + x3 * x11
        + x4 * x10
        + x5 * x9
        + x6 * x8
        + x7 * x7
        + x8 * x6
        + x9 * x5
        + x10 * x4
        + x11 * x3
        + x12 * x2
        + x13 * x1
    )
    b = (
        h0 * a14
        + -x1 * a13
        + -x2 * a12
        + -x3 * a11
        + -x4 * a10
        + -x5 * a9
        + -x6 * a8
        + -x7 * a7
        + -x8 * a6
        + -x9 * a5
        + -x10 * a4
        + -x11 * a3
        + -x12 * a2
        + -x13 * a1
        + -x14 * a0
    )
    e14 = -i0 * (
        -0.7970714285714285 * x1 * e13
        + -0.5941428571428571 * x2 * e12
        + -0.39121428571428574 * x3 * e11
        + -0.18828571428571422 * x4 * e10
        + 0.014642857142857275 * x5 * e9
        + 0.21757142857142853 * x6 * e8
        + 0.42050000000000004 * x7 * e7
        + 0.6234285714285716 * x8 * e6
        + 0.826357142857143 * x9 * e5
        + 1.0292857142857146 * x10 * e4
        + 1.2322142857142857 * x11 * e3
        + 1.435142857142857 * x12 * e2
        + 1.6380714285714286 * x13 * e1
        + 1.841 * x14 * e0
    )
    g14 = b + e14
    w14 = j0 * (
        15.0 * x15
        + -g1 * w13
        + -g2 * w12
        + -g3 * w11
        + -g4 * w10
        + -g5 * w9
        + -g6 * w8
        + -g7 * w7
        + -g8 * w6
        + -g9 * w5
        + -g10 * w4
        + -g11 * w3
        + -g12 * w2
        + -g13 * w1
        + -g14 * w0
    )
    force = pull - k * x14 - 2.0 * cubic * m - f * w14
    x16 = force * 0.004166666666666667 - d * x15 * 0.0625
    return x0, x1, x2, x3, x4, x5, x6, x7, x8, x9, x10, x11, x12, x13, x14, x15, x16


@njit(error_model="numpy", fastmath=_FAST, forceinline=True)
def short_table_driven(x0, x1, u, gap, k, d, cubic, origin, q0, q1, q2):  # type: ignore[no-untyped-def]
    """Coefficients 0..SHORT of x, where u has the coefficients u[0..]."""
    u0, u1, u2, u3, u4, u5, u6, _u7, _u8, _u9, _u10, _u11, _u12, _u13, _u14 = u
    z0 = x0 - origin
    p0 = q0 + z0 * (q1 + q2 * z0)
    q2 += q2
    v = 0.5 * u0 * u0
    v0 = v + v
    pull = p0 * v0
    y0 = 0.5 * x0 * x0
    m = y0 * x0
    force = pull - k * x0 - 2.0 * cubic * m
    x2 = force * 0.5 - d * x1 * 0.5
    v = u0 * u1
    v1 = v + v
    m = z0 * x1
    p1 = q1 * x1 + q2 * m
    pull = p0 * v1 + p1 * v0
    y1 = x0 * x1
    m = y0 * x1 + y1 * x0
    force = pull - k * x1 - 2.0 * cubic * m
    x3 = force * 0.16666666666666666 - d * x2 * 0.3333333333333333
    v = u0 * u2 + 0.5 * u1 * u1
    v2 = v + v
    m = z0 * x2 + 0.5 * x1 * x1
    p2 = q1 * x2 + q2 * m
    pull = p0 * v2 + p1 * v1 + p2 * v0
    y2 = x0 * x2 + 0.5 * x1 * x1
    m = y0 * x2 + y1 * x1 + y2 * x0
    force = pull - k * x2 - 2.0 * cubic * m
    x4 = force * 0.08333333333333333 - d * x3 * 0.25
    v = u0 * u3 + u1 * u2
    v3 = v + v
    m = z0 * x3 + x1 * x2
    p3 = q1 * x3 + q2 * m
    pull = p0 * v3 + p1 * v2 + p2 * v1 + p3 * v0
    y3 = x0 * x3 + x1 * x2
    m = y0 * x3 + y1 * x2 + y2 * x1 + y3 * x0
    force = pull - k * x3 - 2.0 * cubic * m
    x5 = force * 0.05 - d * x4 * 0.2
    v = u0 * u4 + u1 * u3 + 0.5 * u2 * u2
    v4 = v + v
    m = z0 * x4 + x1 * x3 + 0.5 * x2 * x2
    p4 = q1 * x4 + q2 * m
    pull = p0 * v4 + p1 * v3 + p2 * v2 + p3 * v1 + p4 * v0
    y4 = x0 * x4 + x1 * x3 + 0.5 * x2 * x2
    m = y0 * x4 + y1 * x3 + y2 * x2 + y3 * x1 + y4 * x0
    force = pull - k * x4 - 2.0 * cubic * m
    x6 = force * 0.03333333333333333 - d * x5 * 0.16666666666666666
    v = u0 * u5 + u1 * u4 + u2 * u3
    v5 = v + v
    m = z0 * x5 + x1 * x4 + x2 * x3
    p5 = q1 * x5 + q2 * m
    pull = p0 * v5 + p1 * v4 + p2 * v3 + p3 * v2 + p4 * v1 + p5 * v0
    y5 = x0 * x5 + x1 * x4 + x2 * x3
    m = y0 * x5 + y1 * x4 + y2 * x3 + y3 * x2 + y4 * x1 + y5 * x0
    force = pull - k * x5 - 2.0 * cubic * m
    x7 = force * 0.023809523809523808 - d * x6 * 0.14285714285714285
    v = u0 * u6 + u1 * u5 + u2 * u4 + 0.5 * u3 * u3
    v6 = v + v
    m = z0 * x6 + x1 * x5 + x2 * x4 + 0.5 * x3 * x3
    p6 = q1 * x6 + q2 * m
    pull = p0 * v6 + p1 * v5 + p2 * v4 + p3 * v3 + p4 * v2 + p5 * v1 + p6 * v0
    y6 = x0 * x6 + x1 * x5 + x2 * x4 + 0.5 * x3 * x3
    m = y0 * x6 + y1 * x5 + y2 * x4 + y3 * x3 + y4 * x2 + y5 * x1 + y6 * x0
    force = pull - k * x6 - 2.0 * cubic * m
    x8 = force * 0.017857142857142856 - d * x7 * 0.125
    return x0, x1, x2, x3, x4, x5, x6, x7, x8


@njit(error_model="numpy", fastmath=_FAST, forceinline=True)
def short_table_film_driven(x0, x1, u, gap, k, d, cubic, origin, q0, q1, q2, f, slip):  # type: ignore[no-untyped-def]
    """Coefficients 0..SHORT of x, behind a film, where u has the coefficients u[0..]."""
    u0, u1, u2, u3, u4, u5, u6, _u7, _u8, _u9, _u10, _u11, _u12, _u13, _u14 = u
    z0 = x0 - origin
    p0 = q0 + z0 * (q1 + q2 * z0)
    q2 += q2
    h0 = gap - x0
    i0 = 1.0 / h0
    a0 = h0 * h0
    e0 = slip * h0**1.841
    j0 = 1.0 / (h0 * a0 + e0)
    w0 = x1 * j0
    v = 0.5 * u0 * u0
    v0 = v + v
    pull = p0 * v0
    y0 = 0.5 * x0 * x0
    m = y0 * x0
    force = pull - k * x0 - 2.0 * cubic * m - f * w0
    x2 = force * 0.5 - d * x1 * 0.5
    v = u0 * u1
    v1 = v + v
    m = z0 * x1
    p1 = q1 * x1 + q2 * m
    pull = p0 * v1 + p1 * v0
    y1 = x0 * x1
    m = y0 * x1 + y1 * x0
    a1 = -2.0 * h0 * x1
    b = h0 * a1 + -x1 * a0
    e1 = -i0 * 1.8410000000000002 * x1 * e0
    g1 = b + e1
    w1 = j0 * (2.0 * x2 + -g1 * w0)
    force = pull - k * x1 - 2.0 * cubic * m - f * w1
    x3 = force * 0.16666666666666666 - d * x2 * 0.3333333333333333
    v = u0 * u2 + 0.5 * u1 * u1
    v2 = v + v
    m = z0 * x2 + 0.5 * x1 * x1
    p2 = q1 * x2 + q2 * m
    pull = p0 * v2 + p1 * v1 + p2 * v0
    y2 = x0 * x2 + 0.5 * x1 * x1
    m = y0 * x2 + y1 * x1 + y2 * x0
    a2 = -2.0 * h0 * x2 + x1 * x1
    b = h0 * a2 + -x1 * a1 + -x2 * a0
    e2 = -i0 * (0.4205000000000001 * x1 * e1 + 1.8410000000000002 * x2 * e0)
    g2 = b + e2
    w2 = j0 * (3.0 * x3 + -g1 * w1 + -g2 * w0)
    force = pull - k * x2 - 2.0 * cubic * m - f * w2
    x4 = force * 0.08333333333333333 - d * x3 * 0.25
    v = u0 * u3 + u1 * u2
    v3 = v + v
    m = z0 * x3 + x1 * x2
    p3 = q1 * x3 + q2 * m
    pull = p0 * v3 + p1 * v2 + p2 * v1 + p3 * v0
    y3 = x0 * x3 + x1 * x2
    m = y0 * x3 + y1 * x2 + y2 * x1 + y3 * x0
    a3 = -2.0 * h0 * x3 + x1 * x2 + x2 * x1
    b = h0 * a3 + -x1 * a2 + -x2 * a1 + -x3 * a0
    e3 = -i0 * (-0.052999999999999936 * x1 * e2 + 0.8940000000000001 * x2 * e1 + 1.841 * x3 * e0)
    g3 = b + e3
    w3 = j0 * (4.0 * x4 + -g1 * w2 + -g2 * w1 + -g3 * w0)
    force = pull - k * x3 - 2.0 * cubic * m - f * w3
    x5 = force * 0.05 - d * x4 * 0.2
    v = u0 * u4 + u1 * u3 + 0.5 * u2 * u2
    v4 = v + v
    m = z0 * x4 + x1 * x3 + 0.5 * x2 * x2
    p4 = q1 * x4 + q2 * m
    pull = p0 * v4 + p1 * v3 + p2 * v2 + p3 * v1 + p4 * v0
    y4 = x0 * x4 + x1 * x3 + 0.5 * x2 * x2
    m = y0 * x4 + y1 * x3 + y2 * x2 + y3 * x1 + y4 * x0
    a4 = -2.0 * h0 * x4 + x1 * x3 + x2 * x2 + x3 * x1
    b = h0 * a4 + -x1 * a3 + -x2 * a2 + -x3 * a1 + -x4 * a0
    e4 = -i0 * (
        -0.28974999999999995 * x1 * e3 + 0.4205000000000001 * x2 * e2 + 1.13075 * x3 * e1 + 1.8410000000000002 * x4 * e0
    )
    g4 = b + e4
    w4 = j0 * (5.0 * x5 + -g1 * w3 + -g2 * w2 + -g3 * w1 + -g4 * w0)
    force = pull - k * x4 - 2.0 * cubic * m - f * w4
    x6 = force * 0.03333333333333333 - d * x5 * 0.16666666666666666
    v = u0 * u5 + u1 * u4 + u2 * u3
    v5 = v + v
    m = z0 * x5 + x1 * x4 + x2 * x3
    p5 = q1 * x5 + q2 * m
    pull = p0 * v5 + p1 * v4 + p2 * v3 + p3 * v2 + p4 * v1 + p5 * v0
    y5 = x0 * x5 + x1 * x4 + x2 * x3
    m = y0 * x5 + y1 * x4 + y2 * x3 + y3 * x2 + y4 * x1 + y5 * x0
    a5 = -2.0 * h0 * x5 + x1 * x4 + x2 * x3 + x3 * x2 + x4 * x1
    b = h0 * a5 + -x1 * a4 + -x2 * a3 + -x3 * a2 + -x4 * a1 + -x5 * a0
    e5 = -i0 * (
        -0.43179999999999996 * x1 * e4
        + 0.13640000000000008 * x2 * e3
        + 0.7045999999999999 * x3 * e2
        + 1.2728000000000002 * x4 * e1
        + 1.8410000000000004 * x5 * e0
    )
    g5 = b + e5
    w5 = j0 * (6.0 * x6 + -g1 * w4 + -g2 * w3 + -g3 * w2 + -g4 * w1 + -g5 * w0)
    force = pull - k * x5 - 2.0 * cubic * m - f * w5
    x7 = force * 0.023809523809523808 - d * x6 * 0.14285714285714285
    v = u0 * u6 + u1 * u5 + u2 * u4 + 0.5 * u3 * u3
    v6 = v + v
    m = z0 * x6 + x1 * x5 + x2 * x4 + 0.5 * x3 * x3
    p6 = q1 * x6 + q2 * m
    pull = p0 * v6 + p1 * v5 + p2 * v4 + p3 * v3 + p4 * v2 + p5 * v1 + p6 * v0
    y6 = x0 * x6 + x1 * x5 + x2 * x4 + 0.5 * x3 * x3
    m = y0 * x6 + y1 * x5 + y2 * x4 + y3 * x3 + y4 * x2 + y5 * x1 + y6 * x0
    a6 = -2.0 * h0 * x6 + x1 * x5 + x2 * x4 + x3 * x3 + x4 * x2 + x5 * x1
    b = h0 * a6 + -x1 * a5 + -x2 * a4 + -x3 * a3 + -x4 * a2 + -x5 * a1 + -x6 * a0
    e6 = -i0 * (
        -0.5265 * x1 * e5
        + -0.052999999999999936 * x2 * e4
        + 0.42049999999999993 * x3 * e3
        + 0.8940000000000001 * x4 * e2
        + 1.3675000000000004 * x5 * e1
        + 1.841 * x6 * e0
    )
    g6 = b + e6
    w6 = j0 * (7.0 * x7 + -g1 * w5 + -g2 * w4 + -g3 * w3 + -g4 * w2 + -g5 * w1 + -g6 * w0)
    force = pull - k * x6 - 2.0 * cubic * m - f * w6
    x8 = force * 0.017857142857142856 - d * x7 * 0.125
    return x0, x1, x2, x3, x4, x5, x6, x7, x8
