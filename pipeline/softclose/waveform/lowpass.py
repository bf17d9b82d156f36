"""Owns the closed form of what a low-pass makes of pulses: on each piece a constant, cosines and decaying exponentials.

A constant and a cosine come out as themselves, the cosine smaller and later (|H| and arg H at its frequency); what the
state of the low-pass at the beginning of a piece is off from that dies away as its poles say. So a piece of the input
is one of the output, and one more once the exponentials are below `CUT_VOLTS` and are left out.

Plain functions of numbers and arrays: the kernels compile them, one call a switch where drives differ.
"""

from __future__ import annotations

import math

import numpy as np

from softclose.arrays import FloatArray, IntArray

CUT_VOLTS = 1e-5
"""Exponentials smaller than this are left out [V]: a ten-millionth of a drive, V moves by 1e-6 cm/s or less."""
_SNAP_US = 1e-9
N_PATH = 7
"""Numbers that describe the way: kind (`REAL`, `PAIR` or `TWO`), its two rates [1/µs], gain, delay [µs], offset [V]
and horizon [µs]."""
REAL, PAIR, TWO = 1.0, 2.0, 3.0
"""One real pole (rate, 0); a complex pair (decay, angular frequency); two real poles (slow, fast)."""


def poles(bandwidth_kHz: float, order: int, damping: float) -> tuple[float, float, float]:
    """Kind and rates [1/µs] of a low-pass of the first or second order whose corner is at -3 dB."""
    corner = 2.0 * math.pi * 1e-3 * bandwidth_kHz
    if order == 1:
        return REAL, corner, 0.0
    z = damping
    # |H| = 1/sqrt(2) at the corner: with w = corner / natural, w^4 + (4 z^2 - 2) w^2 - 1 = 0
    natural = corner / math.sqrt(1.0 - 2.0 * z * z + math.sqrt((1.0 - 2.0 * z * z) ** 2 + 1.0))
    if abs(z - 1.0) < 1e-6:  # a double pole would take t exp(-t); a pair this close answers a step the same to 1e-6
        z = 1.0 - 1e-6
    apart = math.sqrt(abs(1.0 - z * z))
    if z < 1.0:
        return PAIR, z * natural, apart * natural
    return TWO, natural / (z + apart), natural * (z + apart)


def deliver_flat(
    pieces: FloatArray,
    n_ramps: IntArray,
    ramps: FloatArray,
    path: FloatArray,
    rate: float,
    delay: float,
    offset: float,
    out_pieces: FloatArray,
    out_n: IntArray,
    out_ramps: FloatArray,
) -> int:
    """Write the flat form of what is delivered; returns its number of pieces.

    Parameters
    ----------
    pieces, n_ramps, ramps : ndarray
        The command, as `softclose.waveform.flat.flatten_pulses` gives it.
    path : (N_PATH,) ndarray of float64
        The way; its delay and offset are those of the next arguments where drives are not scaled.
    rate, delay, offset : float
        What the rates are multiplied by, delay [µs] and offset [V] of this drive.
    out_pieces, out_n, out_ramps : ndarray
        (m, 3), (m,), (m, n, 4) with m = 2 n_piece + 1 and n two more than in `ramps`: the rows of a piece are
        amplitude, angular frequency omega, origin and decay of
        amplitude exp(-decay (t - start of the piece)) cos(omega (t - origin)).
    """
    kind, first, second, gain, horizon = path[0], path[1] * rate, path[2] * rate, path[3], path[6]
    product = first * second if kind == 3.0 else first * first + second * second
    total = first + second if kind == 3.0 else 2.0 * first
    slowest = first
    y = dy = 0.0
    m = 0
    if delay > _SNAP_US:
        out_pieces[0, 0], out_pieces[0, 1], out_pieces[0, 2] = 0.0, min(delay, horizon), offset
        out_n[0] = 0
        m = 1
    for i in range(pieces.shape[0]):
        begin = pieces[i, 0] + delay if m > 0 else 0.0
        end = min(pieces[i, 1] + delay, horizon)
        if i == pieces.shape[0] - 1:
            end = horizon
        if horizon - end <= _SNAP_US:
            end = horizon
        if end - begin <= _SNAP_US:
            break
        level, at, slope = pieces[i, 2], pieces[i, 2], 0.0
        n = n_ramps[i]
        for j in range(n):
            omega = ramps[i, j, 1]
            if kind == 1.0:
                size, angle = first / math.sqrt(first * first + omega * omega), -math.atan2(omega, first)
            else:
                real, imaginary = product - omega * omega, total * omega
                size, angle = product / math.hypot(real, imaginary), -math.atan2(imaginary, real)
            amplitude = ramps[i, j, 0] * size
            origin = ramps[i, j, 2] + delay - angle / omega
            now = omega * (begin - origin)
            at += amplitude * math.cos(now)
            slope -= amplitude * omega * math.sin(now)
            out_ramps[m, j, 0], out_ramps[m, j, 1] = gain * amplitude, omega
            out_ramps[m, j, 2], out_ramps[m, j, 3] = origin, 0.0
        off, doff = y - at, dy - slope
        # What dies away: a exp(-first s); exp(-first s) (a cos + b sin); or a exp(-first s) + b exp(-second s).
        a = b = 0.0
        if kind == 1.0:
            a = off
        elif kind == 2.0:
            a, b = off, (doff + first * off) / second
        else:
            a, b = (doff + second * off) / (second - first), (doff + first * off) / (first - second)
        size = gain * (math.hypot(a, b) if kind == 2.0 else abs(a) + abs(b))
        length = end - begin
        last = math.log(size / CUT_VOLTS) / slowest if size > CUT_VOLTS else 0.0
        parts = 1 if last <= _SNAP_US or length - last <= _SNAP_US else 2
        for part in range(parts):
            row = m + part
            cut = begin + last
            out_pieces[row, 0] = begin if part == 0 else cut
            out_pieces[row, 1] = end if part == parts - 1 else cut
            out_pieces[row, 2] = gain * level + offset
            out_n[row] = n
            if part == 1:
                for j in range(n):
                    for q in range(4):
                        out_ramps[row, j, q] = out_ramps[m, j, q]
            elif last > _SNAP_US:
                if kind == 2.0:
                    out_ramps[row, n, 0], out_ramps[row, n, 1] = gain * math.hypot(a, b), second
                    out_ramps[row, n, 2], out_ramps[row, n, 3] = begin + math.atan2(b, a) / second, first
                    out_n[row] = n + 1
                else:
                    for q in range(1 if kind == 1.0 else 2):
                        out_ramps[row, n + q, 0] = gain * (a if q == 0 else b)
                        out_ramps[row, n + q, 1], out_ramps[row, n + q, 2] = 0.0, begin
                        out_ramps[row, n + q, 3] = first if q == 0 else second
                    out_n[row] = n + (1 if kind == 1.0 else 2)
        m += parts
        # The state at the end of the piece.
        y, dy = level, 0.0
        for j in range(n):
            amplitude, omega = out_ramps[m - parts, j, 0] / gain, out_ramps[m - parts, j, 1]
            now = omega * (end - out_ramps[m - parts, j, 2])
            y += amplitude * math.cos(now)
            dy -= amplitude * omega * math.sin(now)
        fade = math.exp(-first * length)
        if kind == 2.0:
            cosine, sine = fade * math.cos(second * length), fade * math.sin(second * length)
            y += a * cosine + b * sine
            dy += (b * second - a * first) * cosine - (a * second + b * first) * sine
        else:
            faster = math.exp(-second * length) if kind == 3.0 else 0.0
            y += a * fade + b * faster
            dy -= first * a * fade + second * b * faster
        if end >= horizon:
            break
    out_pieces[m - 1, 1] = horizon
    return m


def room(pieces: FloatArray, ramps: FloatArray) -> tuple[FloatArray, IntArray, FloatArray]:
    """Arrays that hold the flat form of what is delivered of a command."""
    m = 2 * len(pieces) + 1
    return np.zeros((m, 3)), np.zeros(m, dtype=np.int64), np.zeros((m, ramps.shape[1] + 2, 4))
