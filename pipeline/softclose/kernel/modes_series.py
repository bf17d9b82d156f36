"""Owns the power series of a switch of two modes as straight-line code. Written by generate_series.py.

a'' = p F - ka a - da a' and b'' = q F - kb b - db b', F = h (u / (G - e))² - f e' / (G - e)³, e = ea a + eb b: what
the modes share is the electrode. `blend` is another point that moves with both, `press` and
`press_under` are the force on a held contact.
"""

from __future__ import annotations

from numba import njit

from softclose.kernel.series import _FAST


@njit(error_model="numpy", fastmath=_FAST, forceinline=True)
def two(a0, a1, b0, b1, u, gap, ea, eb, ha, hb, ka, kb, da, db):  # type: ignore[no-untyped-def]
    """Coefficients 0..ORDER of a and b, where u has the coefficients u[0..ORDER-2]."""
    u0, u1, u2, u3, u4, u5, u6, u7, u8, u9, u10, u11, u12, u13, u14 = u
    e0 = ea * a0 + eb * b0
    e1 = ea * a1 + eb * b1
    r0 = 1.0 / (gap - e0)
    z1 = e1 * r0
    s0 = u0 * r0
    q = 0.5 * s0 * s0
    q *= 1.0
    a2 = ha * q - ka * a0 * 0.5 - (da * a1) * 0.5
    b2 = hb * q - kb * b0 * 0.5 - (db * b1) * 0.5
    z2 = (ea * a2 + eb * b2) * r0
    s1 = r0 * u1 + z1 * s0
    q = s0 * s1
    q *= 0.3333333333333333
    a3 = ha * q - ka * a1 * 0.16666666666666666 - (da * a2) * 0.3333333333333333
    b3 = hb * q - kb * b1 * 0.16666666666666666 - (db * b2) * 0.3333333333333333
    z3 = (ea * a3 + eb * b3) * r0
    s2 = r0 * u2 + z1 * s1 + z2 * s0
    q = s0 * s2 + 0.5 * s1 * s1
    q *= 0.16666666666666666
    a4 = ha * q - ka * a2 * 0.08333333333333333 - (da * a3) * 0.25
    b4 = hb * q - kb * b2 * 0.08333333333333333 - (db * b3) * 0.25
    z4 = (ea * a4 + eb * b4) * r0
    s3 = r0 * u3 + z1 * s2 + z2 * s1 + z3 * s0
    q = s0 * s3 + s1 * s2
    q *= 0.1
    a5 = ha * q - ka * a3 * 0.05 - (da * a4) * 0.2
    b5 = hb * q - kb * b3 * 0.05 - (db * b4) * 0.2
    z5 = (ea * a5 + eb * b5) * r0
    s4 = r0 * u4 + z1 * s3 + z2 * s2 + z3 * s1 + z4 * s0
    q = s0 * s4 + s1 * s3 + 0.5 * s2 * s2
    q *= 0.06666666666666667
    a6 = ha * q - ka * a4 * 0.03333333333333333 - (da * a5) * 0.16666666666666666
    b6 = hb * q - kb * b4 * 0.03333333333333333 - (db * b5) * 0.16666666666666666
    z6 = (ea * a6 + eb * b6) * r0
    s5 = r0 * u5 + z1 * s4 + z2 * s3 + z3 * s2 + z4 * s1 + z5 * s0
    q = s0 * s5 + s1 * s4 + s2 * s3
    q *= 0.047619047619047616
    a7 = ha * q - ka * a5 * 0.023809523809523808 - (da * a6) * 0.14285714285714285
    b7 = hb * q - kb * b5 * 0.023809523809523808 - (db * b6) * 0.14285714285714285
    z7 = (ea * a7 + eb * b7) * r0
    s6 = r0 * u6 + z1 * s5 + z2 * s4 + z3 * s3 + z4 * s2 + z5 * s1 + z6 * s0
    q = s0 * s6 + s1 * s5 + s2 * s4 + 0.5 * s3 * s3
    q *= 0.03571428571428571
    a8 = ha * q - ka * a6 * 0.017857142857142856 - (da * a7) * 0.125
    b8 = hb * q - kb * b6 * 0.017857142857142856 - (db * b7) * 0.125
    z8 = (ea * a8 + eb * b8) * r0
    s7 = r0 * u7 + z1 * s6 + z2 * s5 + z3 * s4 + z4 * s3 + z5 * s2 + z6 * s1 + z7 * s0
    q = s0 * s7 + s1 * s6 + s2 * s5 + s3 * s4
    q *= 0.027777777777777776
    a9 = ha * q - ka * a7 * 0.013888888888888888 - (da * a8) * 0.1111111111111111
    b9 = hb * q - kb * b7 * 0.013888888888888888 - (db * b8) * 0.1111111111111111
    z9 = (ea * a9 + eb * b9) * r0
    s8 = r0 * u8 + z1 * s7 + z2 * s6 + z3 * s5 + z4 * s4 + z5 * s3 + z6 * s2 + z7 * s1 + z8 * s0
    q = s0 * s8 + s1 * s7 + s2 * s6 + s3 * s5 + 0.5 * s4 * s4
    q *= 0.022222222222222223
    a10 = ha * q - ka * a8 * 0.011111111111111112 - (da * a9) * 0.1
    b10 = hb * q - kb * b8 * 0.011111111111111112 - (db * b9) * 0.1
    z10 = (ea * a10 + eb * b10) * r0
    s9 = r0 * u9 + z1 * s8 + z2 * s7 + z3 * s6 + z4 * s5 + z5 * s4 + z6 * s3 + z7 * s2 + z8 * s1 + z9 * s0
    q = s0 * s9 + s1 * s8 + s2 * s7 + s3 * s6 + s4 * s5
    q *= 0.01818181818181818
    a11 = ha * q - ka * a9 * 0.00909090909090909 - (da * a10) * 0.09090909090909091
    b11 = hb * q - kb * b9 * 0.00909090909090909 - (db * b10) * 0.09090909090909091
    z11 = (ea * a11 + eb * b11) * r0
    s10 = r0 * u10 + z1 * s9 + z2 * s8 + z3 * s7 + z4 * s6 + z5 * s5 + z6 * s4 + z7 * s3 + z8 * s2 + z9 * s1 + z10 * s0
    q = s0 * s10 + s1 * s9 + s2 * s8 + s3 * s7 + s4 * s6 + 0.5 * s5 * s5
    q *= 0.015151515151515152
    a12 = ha * q - ka * a10 * 0.007575757575757576 - (da * a11) * 0.08333333333333333
    b12 = hb * q - kb * b10 * 0.007575757575757576 - (db * b11) * 0.08333333333333333
    z12 = (ea * a12 + eb * b12) * r0
    s11 = (
        r0 * u11
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
    q *= 0.01282051282051282
    a13 = ha * q - ka * a11 * 0.00641025641025641 - (da * a12) * 0.07692307692307693
    b13 = hb * q - kb * b11 * 0.00641025641025641 - (db * b12) * 0.07692307692307693
    z13 = (ea * a13 + eb * b13) * r0
    s12 = (
        r0 * u12
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
    q *= 0.01098901098901099
    a14 = ha * q - ka * a12 * 0.005494505494505495 - (da * a13) * 0.07142857142857142
    b14 = hb * q - kb * b12 * 0.005494505494505495 - (db * b13) * 0.07142857142857142
    z14 = (ea * a14 + eb * b14) * r0
    s13 = (
        r0 * u13
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
    q *= 0.009523809523809525
    a15 = ha * q - ka * a13 * 0.004761904761904762 - (da * a14) * 0.06666666666666667
    b15 = hb * q - kb * b13 * 0.004761904761904762 - (db * b14) * 0.06666666666666667
    s14 = (
        r0 * u14
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
    q *= 0.008333333333333333
    a16 = ha * q - ka * a14 * 0.004166666666666667 - (da * a15) * 0.0625
    b16 = hb * q - kb * b14 * 0.004166666666666667 - (db * b15) * 0.0625
    found_a = (a0, a1, a2, a3, a4, a5, a6, a7, a8, a9, a10, a11, a12, a13, a14, a15, a16)
    found_b = (b0, b1, b2, b3, b4, b5, b6, b7, b8, b9, b10, b11, b12, b13, b14, b15, b16)
    return found_a, found_b


@njit(error_model="numpy", fastmath=_FAST, forceinline=True)
def two_film(a0, a1, b0, b1, u, gap, ea, eb, ha, hb, ka, kb, da, db, fa, fb):  # type: ignore[no-untyped-def]
    """Coefficients 0..ORDER of a and b behind a film, where u has the coefficients u[0..ORDER-2]."""
    u0, u1, u2, u3, u4, u5, u6, u7, u8, u9, u10, u11, u12, u13, u14 = u
    e0 = ea * a0 + eb * b0
    e1 = ea * a1 + eb * b1
    r0 = 1.0 / (gap - e0)
    z1 = e1 * r0
    s0 = u0 * r0
    r1 = z1 * r0
    p1 = r0 * r1
    q = 0.5 * s0 * s0
    q *= 1.0
    a2 = ha * q - ka * a0 * 0.5 - (da * a1 + fa * p1) * 0.5
    b2 = hb * q - kb * b0 * 0.5 - (db * b1 + fb * p1) * 0.5
    z2 = (ea * a2 + eb * b2) * r0
    s1 = r0 * u1 + z1 * s0
    r2 = z1 * r1 + z2 * r0
    p2 = r0 * r2 + 0.5 * r1 * r1
    q = s0 * s1
    q *= 0.3333333333333333
    a3 = ha * q - ka * a1 * 0.16666666666666666 - (da * a2 + fa * p2) * 0.3333333333333333
    b3 = hb * q - kb * b1 * 0.16666666666666666 - (db * b2 + fb * p2) * 0.3333333333333333
    z3 = (ea * a3 + eb * b3) * r0
    s2 = r0 * u2 + z1 * s1 + z2 * s0
    r3 = z1 * r2 + z2 * r1 + z3 * r0
    p3 = r0 * r3 + r1 * r2
    q = s0 * s2 + 0.5 * s1 * s1
    q *= 0.16666666666666666
    a4 = ha * q - ka * a2 * 0.08333333333333333 - (da * a3 + fa * p3) * 0.25
    b4 = hb * q - kb * b2 * 0.08333333333333333 - (db * b3 + fb * p3) * 0.25
    z4 = (ea * a4 + eb * b4) * r0
    s3 = r0 * u3 + z1 * s2 + z2 * s1 + z3 * s0
    r4 = z1 * r3 + z2 * r2 + z3 * r1 + z4 * r0
    p4 = r0 * r4 + r1 * r3 + 0.5 * r2 * r2
    q = s0 * s3 + s1 * s2
    q *= 0.1
    a5 = ha * q - ka * a3 * 0.05 - (da * a4 + fa * p4) * 0.2
    b5 = hb * q - kb * b3 * 0.05 - (db * b4 + fb * p4) * 0.2
    z5 = (ea * a5 + eb * b5) * r0
    s4 = r0 * u4 + z1 * s3 + z2 * s2 + z3 * s1 + z4 * s0
    r5 = z1 * r4 + z2 * r3 + z3 * r2 + z4 * r1 + z5 * r0
    p5 = r0 * r5 + r1 * r4 + r2 * r3
    q = s0 * s4 + s1 * s3 + 0.5 * s2 * s2
    q *= 0.06666666666666667
    a6 = ha * q - ka * a4 * 0.03333333333333333 - (da * a5 + fa * p5) * 0.16666666666666666
    b6 = hb * q - kb * b4 * 0.03333333333333333 - (db * b5 + fb * p5) * 0.16666666666666666
    z6 = (ea * a6 + eb * b6) * r0
    s5 = r0 * u5 + z1 * s4 + z2 * s3 + z3 * s2 + z4 * s1 + z5 * s0
    r6 = z1 * r5 + z2 * r4 + z3 * r3 + z4 * r2 + z5 * r1 + z6 * r0
    p6 = r0 * r6 + r1 * r5 + r2 * r4 + 0.5 * r3 * r3
    q = s0 * s5 + s1 * s4 + s2 * s3
    q *= 0.047619047619047616
    a7 = ha * q - ka * a5 * 0.023809523809523808 - (da * a6 + fa * p6) * 0.14285714285714285
    b7 = hb * q - kb * b5 * 0.023809523809523808 - (db * b6 + fb * p6) * 0.14285714285714285
    z7 = (ea * a7 + eb * b7) * r0
    s6 = r0 * u6 + z1 * s5 + z2 * s4 + z3 * s3 + z4 * s2 + z5 * s1 + z6 * s0
    r7 = z1 * r6 + z2 * r5 + z3 * r4 + z4 * r3 + z5 * r2 + z6 * r1 + z7 * r0
    p7 = r0 * r7 + r1 * r6 + r2 * r5 + r3 * r4
    q = s0 * s6 + s1 * s5 + s2 * s4 + 0.5 * s3 * s3
    q *= 0.03571428571428571
    a8 = ha * q - ka * a6 * 0.017857142857142856 - (da * a7 + fa * p7) * 0.125
    b8 = hb * q - kb * b6 * 0.017857142857142856 - (db * b7 + fb * p7) * 0.125
    z8 = (ea * a8 + eb * b8) * r0
    s7 = r0 * u7 + z1 * s6 + z2 * s5 + z3 * s4 + z4 * s3 + z5 * s2 + z6 * s1 + z7 * s0
    r8 = z1 * r7 + z2 * r6 + z3 * r5 + z4 * r4 + z5 * r3 + z6 * r2 + z7 * r1 + z8 * r0
    p8 = r0 * r8 + r1 * r7 + r2 * r6 + r3 * r5 + 0.5 * r4 * r4
    q = s0 * s7 + s1 * s6 + s2 * s5 + s3 * s4
    q *= 0.027777777777777776
    a9 = ha * q - ka * a7 * 0.013888888888888888 - (da * a8 + fa * p8) * 0.1111111111111111
    b9 = hb * q - kb * b7 * 0.013888888888888888 - (db * b8 + fb * p8) * 0.1111111111111111
    z9 = (ea * a9 + eb * b9) * r0
    s8 = r0 * u8 + z1 * s7 + z2 * s6 + z3 * s5 + z4 * s4 + z5 * s3 + z6 * s2 + z7 * s1 + z8 * s0
    r9 = z1 * r8 + z2 * r7 + z3 * r6 + z4 * r5 + z5 * r4 + z6 * r3 + z7 * r2 + z8 * r1 + z9 * r0
    p9 = r0 * r9 + r1 * r8 + r2 * r7 + r3 * r6 + r4 * r5
    q = s0 * s8 + s1 * s7 + s2 * s6 + s3 * s5 + 0.5 * s4 * s4
    q *= 0.022222222222222223
    a10 = ha * q - ka * a8 * 0.011111111111111112 - (da * a9 + fa * p9) * 0.1
    b10 = hb * q - kb * b8 * 0.011111111111111112 - (db * b9 + fb * p9) * 0.1
    z10 = (ea * a10 + eb * b10) * r0
    s9 = r0 * u9 + z1 * s8 + z2 * s7 + z3 * s6 + z4 * s5 + z5 * s4 + z6 * s3 + z7 * s2 + z8 * s1 + z9 * s0
    r10 = z1 * r9 + z2 * r8 + z3 * r7 + z4 * r6 + z5 * r5 + z6 * r4 + z7 * r3 + z8 * r2 + z9 * r1 + z10 * r0
    p10 = r0 * r10 + r1 * r9 + r2 * r8 + r3 * r7 + r4 * r6 + 0.5 * r5 * r5
    q = s0 * s9 + s1 * s8 + s2 * s7 + s3 * s6 + s4 * s5
    q *= 0.01818181818181818
    a11 = ha * q - ka * a9 * 0.00909090909090909 - (da * a10 + fa * p10) * 0.09090909090909091
    b11 = hb * q - kb * b9 * 0.00909090909090909 - (db * b10 + fb * p10) * 0.09090909090909091
    z11 = (ea * a11 + eb * b11) * r0
    s10 = r0 * u10 + z1 * s9 + z2 * s8 + z3 * s7 + z4 * s6 + z5 * s5 + z6 * s4 + z7 * s3 + z8 * s2 + z9 * s1 + z10 * s0
    r11 = z1 * r10 + z2 * r9 + z3 * r8 + z4 * r7 + z5 * r6 + z6 * r5 + z7 * r4 + z8 * r3 + z9 * r2 + z10 * r1 + z11 * r0
    p11 = r0 * r11 + r1 * r10 + r2 * r9 + r3 * r8 + r4 * r7 + r5 * r6
    q = s0 * s10 + s1 * s9 + s2 * s8 + s3 * s7 + s4 * s6 + 0.5 * s5 * s5
    q *= 0.015151515151515152
    a12 = ha * q - ka * a10 * 0.007575757575757576 - (da * a11 + fa * p11) * 0.08333333333333333
    b12 = hb * q - kb * b10 * 0.007575757575757576 - (db * b11 + fb * p11) * 0.08333333333333333
    z12 = (ea * a12 + eb * b12) * r0
    s11 = (
        r0 * u11
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
    r12 = (
        z1 * r11
        + z2 * r10
        + z3 * r9
        + z4 * r8
        + z5 * r7
        + z6 * r6
        + z7 * r5
        + z8 * r4
        + z9 * r3
        + z10 * r2
        + z11 * r1
        + z12 * r0
    )
    p12 = r0 * r12 + r1 * r11 + r2 * r10 + r3 * r9 + r4 * r8 + r5 * r7 + 0.5 * r6 * r6
    q = s0 * s11 + s1 * s10 + s2 * s9 + s3 * s8 + s4 * s7 + s5 * s6
    q *= 0.01282051282051282
    a13 = ha * q - ka * a11 * 0.00641025641025641 - (da * a12 + fa * p12) * 0.07692307692307693
    b13 = hb * q - kb * b11 * 0.00641025641025641 - (db * b12 + fb * p12) * 0.07692307692307693
    z13 = (ea * a13 + eb * b13) * r0
    s12 = (
        r0 * u12
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
    r13 = (
        z1 * r12
        + z2 * r11
        + z3 * r10
        + z4 * r9
        + z5 * r8
        + z6 * r7
        + z7 * r6
        + z8 * r5
        + z9 * r4
        + z10 * r3
        + z11 * r2
        + z12 * r1
        + z13 * r0
    )
    p13 = r0 * r13 + r1 * r12 + r2 * r11 + r3 * r10 + r4 * r9 + r5 * r8 + r6 * r7
    q = s0 * s12 + s1 * s11 + s2 * s10 + s3 * s9 + s4 * s8 + s5 * s7 + 0.5 * s6 * s6
    q *= 0.01098901098901099
    a14 = ha * q - ka * a12 * 0.005494505494505495 - (da * a13 + fa * p13) * 0.07142857142857142
    b14 = hb * q - kb * b12 * 0.005494505494505495 - (db * b13 + fb * p13) * 0.07142857142857142
    z14 = (ea * a14 + eb * b14) * r0
    s13 = (
        r0 * u13
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
    r14 = (
        z1 * r13
        + z2 * r12
        + z3 * r11
        + z4 * r10
        + z5 * r9
        + z6 * r8
        + z7 * r7
        + z8 * r6
        + z9 * r5
        + z10 * r4
        + z11 * r3
        + z12 * r2
        + z13 * r1
        + z14 * r0
    )
    p14 = r0 * r14 + r1 * r13 + r2 * r12 + r3 * r11 + r4 * r10 + r5 * r9 + r6 * r8 + 0.5 * r7 * r7
    q = s0 * s13 + s1 * s12 + s2 * s11 + s3 * s10 + s4 * s9 + s5 * s8 + s6 * s7
    q *= 0.009523809523809525
    a15 = ha * q - ka * a13 * 0.004761904761904762 - (da * a14 + fa * p14) * 0.06666666666666667
    b15 = hb * q - kb * b13 * 0.004761904761904762 - (db * b14 + fb * p14) * 0.06666666666666667
    z15 = (ea * a15 + eb * b15) * r0
    s14 = (
        r0 * u14
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
    r15 = (
        z1 * r14
        + z2 * r13
        + z3 * r12
        + z4 * r11
        + z5 * r10
        + z6 * r9
        + z7 * r8
        + z8 * r7
        + z9 * r6
        + z10 * r5
        + z11 * r4
        + z12 * r3
        + z13 * r2
        + z14 * r1
        + z15 * r0
    )
    p15 = r0 * r15 + r1 * r14 + r2 * r13 + r3 * r12 + r4 * r11 + r5 * r10 + r6 * r9 + r7 * r8
    q = s0 * s14 + s1 * s13 + s2 * s12 + s3 * s11 + s4 * s10 + s5 * s9 + s6 * s8 + 0.5 * s7 * s7
    q *= 0.008333333333333333
    a16 = ha * q - ka * a14 * 0.004166666666666667 - (da * a15 + fa * p15) * 0.0625
    b16 = hb * q - kb * b14 * 0.004166666666666667 - (db * b15 + fb * p15) * 0.0625
    found_a = (a0, a1, a2, a3, a4, a5, a6, a7, a8, a9, a10, a11, a12, a13, a14, a15, a16)
    found_b = (b0, b1, b2, b3, b4, b5, b6, b7, b8, b9, b10, b11, b12, b13, b14, b15, b16)
    return found_a, found_b


@njit(error_model="numpy", fastmath=_FAST, forceinline=True)
def blend(a, b, p, q):  # type: ignore[no-untyped-def]
    """Coefficients of p a + q b."""
    a0, a1, a2, a3, a4, a5, a6, a7, a8, a9, a10, a11, a12, a13, a14, a15, a16 = a
    b0, b1, b2, b3, b4, b5, b6, b7, b8, b9, b10, b11, b12, b13, b14, b15, b16 = b
    return (
        p * a0 + q * b0,
        p * a1 + q * b1,
        p * a2 + q * b2,
        p * a3 + q * b3,
        p * a4 + q * b4,
        p * a5 + q * b5,
        p * a6 + q * b6,
        p * a7 + q * b7,
        p * a8 + q * b8,
        p * a9 + q * b9,
        p * a10 + q * b10,
        p * a11 + q * b11,
        p * a12 + q * b12,
        p * a13 + q * b13,
        p * a14 + q * b14,
        p * a15 + q * b15,
        p * a16 + q * b16,
    )


@njit(error_model="numpy", fastmath=_FAST, forceinline=True)
def at_rest(x):  # type: ignore[no-untyped-def]
    """The same motion from rest: without the rounding of its speed."""
    x0, _x1, x2, x3, x4, x5, x6, x7, x8, x9, x10, x11, x12, x13, x14, x15, x16 = x
    return x0, 0.0, x2, x3, x4, x5, x6, x7, x8, x9, x10, x11, x12, x13, x14, x15, x16


@njit(error_model="numpy", fastmath=_FAST, forceinline=True)
def press(x, p2, p1, p0, pc):  # type: ignore[no-untyped-def]
    """Coefficients of -(p2 x'' + p1 x' + p0 x + pc)."""
    x0, x1, x2, x3, x4, x5, x6, x7, x8, x9, x10, x11, x12, x13, x14, x15, x16 = x
    return (
        -(p2 * (2.0 * x2) + p1 * (1.0 * x1) + p0 * x0 + pc),
        -(p2 * (6.0 * x3) + p1 * (2.0 * x2) + p0 * x1),
        -(p2 * (12.0 * x4) + p1 * (3.0 * x3) + p0 * x2),
        -(p2 * (20.0 * x5) + p1 * (4.0 * x4) + p0 * x3),
        -(p2 * (30.0 * x6) + p1 * (5.0 * x5) + p0 * x4),
        -(p2 * (42.0 * x7) + p1 * (6.0 * x6) + p0 * x5),
        -(p2 * (56.0 * x8) + p1 * (7.0 * x7) + p0 * x6),
        -(p2 * (72.0 * x9) + p1 * (8.0 * x8) + p0 * x7),
        -(p2 * (90.0 * x10) + p1 * (9.0 * x9) + p0 * x8),
        -(p2 * (110.0 * x11) + p1 * (10.0 * x10) + p0 * x9),
        -(p2 * (132.0 * x12) + p1 * (11.0 * x11) + p0 * x10),
        -(p2 * (156.0 * x13) + p1 * (12.0 * x12) + p0 * x11),
        -(p2 * (182.0 * x14) + p1 * (13.0 * x13) + p0 * x12),
        -(p2 * (210.0 * x15) + p1 * (14.0 * x14) + p0 * x13),
        -(p2 * (240.0 * x16) + p1 * (15.0 * x15) + p0 * x14),
        0.0,
        0.0,
    )


@njit(error_model="numpy", fastmath=_FAST, forceinline=True)
def press_under(x, u, p1, p0, pc, pu):  # type: ignore[no-untyped-def]
    """Coefficients of -(pu u² + p1 x' + p0 x + pc)."""
    x0, x1, x2, x3, x4, x5, x6, x7, x8, x9, x10, x11, x12, x13, x14, x15, _x16 = x
    u0, u1, u2, u3, u4, u5, u6, u7, u8, u9, u10, u11, u12, u13, u14 = u
    q0 = 0.5 * u0 * u0
    q1 = u0 * u1
    q2 = u0 * u2 + 0.5 * u1 * u1
    q3 = u0 * u3 + u1 * u2
    q4 = u0 * u4 + u1 * u3 + 0.5 * u2 * u2
    q5 = u0 * u5 + u1 * u4 + u2 * u3
    q6 = u0 * u6 + u1 * u5 + u2 * u4 + 0.5 * u3 * u3
    q7 = u0 * u7 + u1 * u6 + u2 * u5 + u3 * u4
    q8 = u0 * u8 + u1 * u7 + u2 * u6 + u3 * u5 + 0.5 * u4 * u4
    q9 = u0 * u9 + u1 * u8 + u2 * u7 + u3 * u6 + u4 * u5
    q10 = u0 * u10 + u1 * u9 + u2 * u8 + u3 * u7 + u4 * u6 + 0.5 * u5 * u5
    q11 = u0 * u11 + u1 * u10 + u2 * u9 + u3 * u8 + u4 * u7 + u5 * u6
    q12 = u0 * u12 + u1 * u11 + u2 * u10 + u3 * u9 + u4 * u8 + u5 * u7 + 0.5 * u6 * u6
    q13 = u0 * u13 + u1 * u12 + u2 * u11 + u3 * u10 + u4 * u9 + u5 * u8 + u6 * u7
    q14 = u0 * u14 + u1 * u13 + u2 * u12 + u3 * u11 + u4 * u10 + u5 * u9 + u6 * u8 + 0.5 * u7 * u7
    return (
        -(p1 * (1.0 * x1) + p0 * x0 + 2.0 * pu * q0 + pc),
        -(p1 * (2.0 * x2) + p0 * x1 + 2.0 * pu * q1),
        -(p1 * (3.0 * x3) + p0 * x2 + 2.0 * pu * q2),
        -(p1 * (4.0 * x4) + p0 * x3 + 2.0 * pu * q3),
        -(p1 * (5.0 * x5) + p0 * x4 + 2.0 * pu * q4),
        -(p1 * (6.0 * x6) + p0 * x5 + 2.0 * pu * q5),
        -(p1 * (7.0 * x7) + p0 * x6 + 2.0 * pu * q6),
        -(p1 * (8.0 * x8) + p0 * x7 + 2.0 * pu * q7),
        -(p1 * (9.0 * x9) + p0 * x8 + 2.0 * pu * q8),
        -(p1 * (10.0 * x10) + p0 * x9 + 2.0 * pu * q9),
        -(p1 * (11.0 * x11) + p0 * x10 + 2.0 * pu * q10),
        -(p1 * (12.0 * x12) + p0 * x11 + 2.0 * pu * q11),
        -(p1 * (13.0 * x13) + p0 * x12 + 2.0 * pu * q12),
        -(p1 * (14.0 * x14) + p0 * x13 + 2.0 * pu * q13),
        -(p1 * (15.0 * x15) + p0 * x14 + 2.0 * pu * q14),
        0.0,
        0.0,
    )
