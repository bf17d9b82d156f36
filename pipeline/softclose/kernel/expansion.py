"""Owns the power series of a motion about an instant: which of the generated ones a drive and losses take."""

from __future__ import annotations

import math

from numba import njit

from softclose.kernel.drive_series import (
    decaying,
    fading,
    shifted,
    short_damped_driven,
    short_film_driven,
    short_flight_driven,
)
from softclose.kernel.lossy_series import damped_constant, damped_driven, film_constant, film_driven
from softclose.kernel.pieces import DECAYING, POLYNOMIAL
from softclose.kernel.series import constant, drive, flight_constant, flight_driven
from softclose.kernel.shaped_series import (
    shaped_constant,
    shaped_driven,
    shaped_film_constant,
    shaped_film_driven,
    short_shaped_driven,
    short_shaped_film_driven,
)
from softclose.kernel.table_series import (
    short_table_driven,
    short_table_film_driven,
    table_constant,
    table_driven,
    table_film_constant,
    table_film_driven,
)


@njit(error_model="numpy", inline="always")
def drive_series(form, pieces, n_ramps, ramps, i, t):  # type: ignore[no-untyped-def]
    """Taylor coefficients of u about t on piece i, which is not constant."""
    if form == POLYNOMIAL:
        u = shifted(pieces[i, 2], ramps, i, t - 0.5 * (pieces[i, 0] + pieces[i, 1]))
    else:
        u = constant(pieces[i, 2])
        for j in range(n_ramps[i]):
            omega = ramps[i, j, 1]
            angle = omega * (t - ramps[i, j, 2])
            if form == DECAYING and ramps[i, j, 3] > 0.0:
                decay = ramps[i, j, 3]
                a = ramps[i, j, 0] * math.exp(-decay * (t - pieces[i, 0]))
                if omega == 0.0:
                    u = fading(u, a, decay)
                else:
                    u = decaying(u, a * math.cos(angle), a * math.sin(angle), omega, decay)
            else:
                u = drive(u, ramps[i, j, 0] * math.cos(angle), ramps[i, j, 0] * math.sin(angle), omega)
    return u


@njit(error_model="numpy", inline="always")
def steady(lossy, film, u, x, v, gap, c, k, d, f):  # type: ignore[no-untyped-def]
    """Taylor coefficients of x where u is constant."""
    if film:
        series = film_constant(x, v, u, gap, c, k, d, f)
    elif lossy:
        series = damped_constant(x, v, u, gap, c, k, d)
    else:
        series = flight_constant(x, v, u, gap, c, k)
    return series


@njit(error_model="numpy", inline="always")
def expand(form, lossy, film, pieces, n_ramps, ramps, i, t, x, v, gap, c, k, d, f):  # type: ignore[no-untyped-def]
    """Taylor coefficients of x about t on piece i."""
    if n_ramps[i] == 0:
        series = steady(lossy, film, pieces[i, 2], x, v, gap, c, k, d, f)
    else:
        u = drive_series(form, pieces, n_ramps, ramps, i, t)
        if film:
            series = film_driven(x, v, u, gap, c, k, d, f)
        elif lossy:
            series = damped_driven(x, v, u, gap, c, k, d)
        else:
            series = flight_driven(x, v, u, gap, c, k)
    return series


@njit(error_model="numpy", inline="always")
def short(form, lossy, film, pieces, n_ramps, ramps, i, t, x, v, gap, c, k, d, f):  # type: ignore[no-untyped-def]
    """The first few Taylor coefficients of x about t on piece i, which is not constant."""
    u = drive_series(form, pieces, n_ramps, ramps, i, t)
    if film:
        series = short_film_driven(x, v, u, gap, c, k, d, f)
    elif lossy:
        series = short_damped_driven(x, v, u, gap, c, k, d)
    else:
        series = short_flight_driven(x, v, u, gap, c, k)
    return series


@njit(error_model="numpy", inline="always")
def steady_shaped(film, table, u, x, v, gap, c, k, d, f, shape, cell):  # type: ignore[no-untyped-def]
    """Taylor coefficients of x where u is constant; shape: cubic stiffness, dielectric and slip; cell: of a table."""
    cubic, coat, slip = shape
    if table:
        origin, q0, q1, q2 = cell
        if film:
            series = table_film_constant(x, v, u, gap, k, d, cubic, origin, q0, q1, q2, f, slip)
        else:
            series = table_constant(x, v, u, gap, k, d, cubic, origin, q0, q1, q2)
    elif film:
        series = shaped_film_constant(x, v, u, gap, c, k, d, cubic, coat, f, slip)
    else:
        series = shaped_constant(x, v, u, gap, c, k, d, cubic, coat)
    return series


@njit(error_model="numpy", inline="always")
def expand_shaped(  # type: ignore[no-untyped-def]
    form, film, table, pieces, n_ramps, ramps, i, t, x, v, gap, c, k, d, f, shape, cell
):
    """Taylor coefficients of x about t on piece i; shape and cell as in `steady_shaped`."""
    cubic, coat, slip = shape
    if n_ramps[i] == 0:
        series = steady_shaped(film, table, pieces[i, 2], x, v, gap, c, k, d, f, shape, cell)
    else:
        u = drive_series(form, pieces, n_ramps, ramps, i, t)
        if table:
            origin, q0, q1, q2 = cell
            if film:
                series = table_film_driven(x, v, u, gap, k, d, cubic, origin, q0, q1, q2, f, slip)
            else:
                series = table_driven(x, v, u, gap, k, d, cubic, origin, q0, q1, q2)
        elif film:
            series = shaped_film_driven(x, v, u, gap, c, k, d, cubic, coat, f, slip)
        else:
            series = shaped_driven(x, v, u, gap, c, k, d, cubic, coat)
    return series


@njit(error_model="numpy", inline="always")
def short_shaped(  # type: ignore[no-untyped-def]
    form, film, table, pieces, n_ramps, ramps, i, t, x, v, gap, c, k, d, f, shape, cell
):
    """The first few Taylor coefficients of x about t on piece i, which is not constant."""
    cubic, coat, slip = shape
    u = drive_series(form, pieces, n_ramps, ramps, i, t)
    if table:
        origin, q0, q1, q2 = cell
        if film:
            series = short_table_film_driven(x, v, u, gap, k, d, cubic, origin, q0, q1, q2, f, slip)
        else:
            series = short_table_driven(x, v, u, gap, k, d, cubic, origin, q0, q1, q2)
    elif film:
        series = short_shaped_film_driven(x, v, u, gap, c, k, d, cubic, coat, f, slip)
    else:
        series = short_shaped_driven(x, v, u, gap, c, k, d, cubic, coat)
    return series
