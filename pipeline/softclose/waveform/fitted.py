"""Owns a sampled drive as polynomials, each as long as a tolerance allows.

What a switch feels of a drive is its area: a deviation that has the area e [V µs] at an instant is a speed of
2 a e / u there, with the acceleration a. So the integral of the voltage is what is fitted, to a tolerance at every
instant, and a piece is the derivative of what fits. What swings about its mean faster than anything moves, as a
generator's fine steps do, is left out, but for what it adds to the mean of u², which the force follows.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial
from numpy.typing import ArrayLike

from softclose.arrays import FloatArray, IntArray
from softclose.compiled import cached_njit
from softclose.waveform.pulses import MAX_VOLTS, WaveformError, is_above
from softclose.waveform.trace import Trace

DEGREE = 7
"""Degree of the polynomials."""
TOLERANCE_VOLT_US = 1e-3
"""How far the area under a fitted drive may be from that under its samples, at any instant [V µs]."""
MANY = 40
"""Pieces that a drive may have and stay exact: it takes as many steps without them."""
_FLAT_US = 1.0
"""A constant voltage that lasts so long is a piece of its own: bounces on it are told in closed form."""
_PARTS = 4
"""Parts of a cell at whose ends the area is looked at; an even number."""
_NEAR = 16
"""A piece is the longest that fits, but for one part in so many."""
_NODES = 96
"""Points of a fit; what fits is looked at everywhere."""

_ENDS_ARE_0 = np.zeros((DEGREE, DEGREE + 2))
"""Powers of (1 - z²) T_j(z), which vanishes at both ends, for each j."""
for _j in range(DEGREE):
    _powers = (Chebyshev.basis(_j).convert(kind=Polynomial) * Polynomial([1.0, 0.0, -1.0])).coef
    _ENDS_ARE_0[_j, : len(_powers)] = _powers


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """A voltage from sample to sample: (n,) parabolas, which need not join."""

    ends: FloatArray
    """(n + 1,) ends [µs], from 0."""
    first: FloatArray
    """(n,) voltage at the beginning of each [V]."""
    middle: FloatArray
    """(n,) voltage in the middle of each."""
    last: FloatArray
    """(n,) voltage at the end of each."""


@dataclass(frozen=True, slots=True, eq=False)
class Fitted:
    """Polynomials that follow one another; the last voltage ever after."""

    knots: FloatArray
    """(n + 1,) ends of the pieces [µs], from 0."""
    coefficients: FloatArray
    """(n, DEGREE + 1) of powers of the instant, from the middle of the piece [V, V/µs, ...]."""
    after: float
    """Voltage from the end of the last piece on [V]."""

    @classmethod
    def of(cls, trace: Trace, tolerance_volt_us: float = TOLERANCE_VOLT_US) -> Self:
        """The longest pieces, found one after another, whose area is that of a trace to the tolerance [V µs], but for
        what their level makes up for (see above).

        Raises WaveformError where that is not above 0.
        """
        if not tolerance_volt_us > 0.0:
            raise WaveformError(f"tolerance_volt_us is {tolerance_volt_us:g}; it must be above 0")
        u = trace.volts
        cells = Cells(ends=trace.times_us, first=u[:-1], middle=0.5 * (u[:-1] + u[1:]), last=u[1:])
        return cls.of_cells(cells, tolerance_volt_us)

    @classmethod
    def of_cells(cls, cells: Cells, tolerance_volt_us: float) -> Self:
        """The same of parabolas."""
        whole = _Whole.of(cells)
        knots, rows = [0], []
        for begin, end in _spans(cells):
            first = begin
            step = 1
            while first < end:
                reach, found = first + 1, whole.alone(first)
                while step > (reach - first) // _NEAR:  # by doubling, and halving where it fails
                    last = min(reach + step, end)
                    longer = whole.fit(first, last, tolerance_volt_us) if last > reach else None
                    if longer is None:
                        step //= 2
                    else:
                        reach, found, step = last, longer, 2 * step
                knots.append(reach)
                rows.append(found)
                first, step = reach, max(1, (reach - first) // 2)
        return cls(cells.ends[knots], np.array(rows), float(cells.last[-1]))

    def flat(self, horizon_us: float) -> tuple[FloatArray, IntArray, FloatArray]:
        """The pieces on [0, horizon] as the kernels read them; rows of one number, the powers from 1 on."""
        inside = int(np.searchsorted(self.knots[1:], horizon_us)) + 1
        c = self.coefficients[:inside]
        begin, end = self.knots[: len(c)], self.knots[1 : len(c) + 1]
        pieces = np.stack([begin, end, c[:, 0]], axis=1)
        rest = c[:, 1:, None].copy()
        if pieces[-1, 1] < horizon_us:
            pieces = np.concatenate([pieces, [[self.knots[-1], horizon_us, self.after]]])
            rest = np.concatenate([rest, np.zeros((1, DEGREE, 1))])
        elif pieces[-1, 1] > horizon_us:
            moved = _about(c[-1], 0.5 * (horizon_us - pieces[-1, 1]))
            pieces[-1, 1:], rest[-1, :, 0] = (horizon_us, moved[0]), moved[1:]
        return pieces, np.where(rest.any(axis=(1, 2)), DEGREE, 0).astype(np.int64), rest

    def voltage(self, t_us: ArrayLike) -> FloatArray:
        """u(t) [V] at instants t_us [µs]; any shape."""
        t = np.asarray(t_us, dtype=np.float64)
        which = np.clip(np.searchsorted(self.knots, t, side="right") - 1, 0, len(self.coefficients) - 1)
        s = t - 0.5 * (self.knots[which] + self.knots[which + 1])
        u = np.zeros(t.shape)
        for k in range(DEGREE, -1, -1):
            u = u * s + self.coefficients[which, k]
        return np.where(t < self.knots[-1], u, self.after)

    def breakpoints(self, horizon_us: float = math.inf) -> FloatArray:
        """Ends of the pieces in [0, horizon] [µs]."""
        return self.knots[self.knots <= horizon_us]

    def max_voltage(self, horizon_us: float = 250.0) -> float:
        """Largest |u| over [0, horizon] [V], to a thousandth of what a piece bends."""
        ends = np.minimum(self.knots, horizon_us)
        return float(np.abs(self.voltage(np.linspace(ends[:-1], ends[1:], 33, axis=1))).max())

    def check(self, max_volts: float = MAX_VOLTS, horizon_us: float = 250.0) -> None:
        """Raise WaveformError where |u| exceeds max_volts on [0, horizon]."""
        peak = self.max_voltage(horizon_us)
        if is_above(peak, max_volts):
            raise WaveformError(f"the drive reaches {peak:.6g} V; {max_volts:g} V are allowed (waveform.max_volts)")


def _spans(cells: Cells) -> list[tuple[int, int]]:
    """First and last end of what is fitted by itself: constant voltages that last, and what lies between them."""
    level = (cells.first == cells.last) & (cells.first == cells.middle)
    same = np.append(False, level[1:] & level[:-1] & (cells.first[1:] == cells.first[:-1]))
    begins = np.flatnonzero(level & ~same)
    stops = np.flatnonzero(level & ~np.append(same[1:], False)) + 1
    lasting = cells.ends[stops] - cells.ends[begins] >= _FLAT_US
    edges = sorted({0, len(level), *begins[lasting].tolist(), *stops[lasting].tolist()})
    return list(itertools.pairwise(edges))


@dataclass(frozen=True, slots=True, eq=False)
class _Whole:
    """Cells and their area."""

    cells: Cells
    at: FloatArray
    """(_PARTS n + 1,) ends of the cells and instants between them [µs]."""
    area: FloatArray
    """(_PARTS n + 1,) from 0 to each of them [V µs]."""

    @classmethod
    def of(cls, cells: Cells) -> Self:
        a, m, b, width = (f[:, None] for f in (cells.first, cells.middle, cells.last, np.diff(cells.ends)))
        s = np.arange(1, _PARTS + 1) / _PARTS
        inside = width * s * (a + s * (0.5 * (4.0 * m - 3.0 * a - b) + s * (2.0 / 3.0) * (a - 2.0 * m + b)))
        begins = np.append(0.0, np.cumsum(inside[:, -1])[:-1])
        at = np.append(cells.ends[0], cells.ends[:-1, None] + width * s)
        return cls(cells, at, np.append(0.0, begins[:, None] + inside))

    def alone(self, i: int) -> FloatArray:
        """A cell as it is, by its coefficients."""
        a, m, b = self.cells.first[i], self.cells.middle[i], self.cells.last[i]
        half = 0.5 * (self.cells.ends[i + 1] - self.cells.ends[i])
        row = np.zeros(DEGREE + 1)
        row[:3] = m, 0.5 * (b - a) / half, 0.5 * (a - 2.0 * m + b) / half**2
        return row

    def fit(self, first: int, last: int, tolerance: float) -> FloatArray | None:
        """Least squares through the area within, and at the two ends through it; None where it misses."""
        c, found = self.cells, np.zeros(DEGREE + 1)
        fits = _fit(c.ends, c.first, c.middle, c.last, self.at, self.area, first, last, tolerance, found)
        return found if fits else None


@cached_njit(error_model="numpy")
def _fit(ends, a, m, b, at, area, first, last, tolerance, found):  # type: ignore[no-untyped-def]
    """Write the coefficients of the piece from cell first to last; whether it has their area."""
    begin, end = _PARTS * first, _PARTS * last
    half = 0.5 * (at[end] - at[begin])
    mean = (area[end] - area[begin]) / (2.0 * half)
    constant = True
    for i in range(first, last):
        constant = constant and a[i] == a[first] and m[i] == a[first] and b[i] == a[first]
    if constant:
        mean = a[first]
    n = end - begin + 1
    where, off, most = np.empty(n), np.empty(n), 0.0
    for k in range(n):
        where[k] = (at[begin + k] - 0.5 * (at[begin] + at[end])) / half
        off[k] = area[begin + k] - area[begin] - mean * half * (where[k] + 1.0)
        most = max(most, abs(off[k]))
    inner = np.zeros(DEGREE + 2)
    if most > 0.01 * tolerance:
        _through(where, off, inner)
        for k in range(n):
            if not abs(_value(inner, DEGREE + 1, where[k]) - off[k]) <= tolerance:
                return False
    for k in range(DEGREE + 1):
        found[k] = (k + 1) * inner[k + 1]
    # What swings about the mean faster than anything moves is left out, but for its part of the mean of u².
    missed = more = peak = 0.0
    for i in range(first, last):
        width = (ends[i + 1] - ends[i]) / 6.0
        for part, told, weight in ((0, a[i], width), (1, m[i], 4.0 * width), (2, b[i], width)):
            volts = mean + _value(found, DEGREE, where[_PARTS * (i - first) + part * (_PARTS // 2)]) / half
            missed += weight * (volts - told) ** 2
            more += weight * (told * told - volts * volts)
        peak = max(peak, abs(m[i]))
    if missed > tolerance * max(peak, 1.0):
        return False
    scale = half
    for k in range(DEGREE + 1):
        found[k] /= scale
        scale *= half
    found[0] += math.copysign(math.sqrt(max(mean * mean + more / (2.0 * half), 0.0)), mean)
    return True


@cached_njit(error_model="numpy")
def _value(powers, degree, z):  # type: ignore[no-untyped-def]
    total = powers[degree]
    for k in range(degree - 1, -1, -1):
        total = total * z + powers[k]
    return total


@cached_njit(error_model="numpy")
def _through(where, off, inner):  # type: ignore[no-untyped-def]
    """Write the powers of the polynomial that is 0 at both ends and nearest to what is off, at `_NODES` points or so.

    By normal equations with Cholesky's factors, of fewer functions where the points do not tell all of them apart.
    """
    every = max(1, len(where) // _NODES)
    count = (len(where) - 3) // every + 1
    n = min(DEGREE, count // 2)
    basis, gram, best = np.empty(DEGREE), np.zeros((DEGREE, DEGREE)), np.zeros(DEGREE)
    for k in range(1, len(where) - 1, every):
        z = where[k]
        basis[0] = 1.0
        if n > 1:
            basis[1] = z
        for j in range(2, n):
            basis[j] = 2.0 * z * basis[j - 1] - basis[j - 2]
        for j in range(n):
            basis[j] *= 1.0 - z * z
            best[j] += basis[j] * off[k]
            for i in range(j + 1):
                gram[j, i] += basis[j] * basis[i]
    for j in range(n):
        size = gram[j, j]
        for i in range(j + 1):
            left = gram[j, i]
            for q in range(i):
                left -= gram[j, q] * gram[i, q]
            gram[j, i] = left / gram[i, i] if i < j else left
        if not gram[j, j] > 1e-12 * size:
            n = j
            break
        gram[j, j] = math.sqrt(gram[j, j])
    for j in range(n):
        for q in range(j):
            best[j] -= gram[j, q] * best[q]
        best[j] /= gram[j, j]
    for j in range(n - 1, -1, -1):
        for q in range(j + 1, n):
            best[j] -= gram[q, j] * best[q]
        best[j] /= gram[j, j]
    for j in range(n):
        for k in range(DEGREE + 2):
            inner[k] += best[j] * _ENDS_ARE_0[j, k]


def _about(coefficients: FloatArray, shift: float) -> FloatArray:
    """Coefficients of the same polynomial about a point so much later."""
    found = np.zeros(DEGREE + 1)
    moved = Polynomial(coefficients)(Polynomial([shift, 1.0])).coef
    found[: len(moved)] = moved
    return found
