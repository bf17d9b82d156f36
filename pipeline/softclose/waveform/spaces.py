"""Owns the search spaces: unit cube <-> waveform, in coordinates that mean the same for every design.

A finite pulse is its impulse I = u²·(tp + ¾·tr) (the time integral of u²: what decides the momentum of the plate),
its rise time and its voltage; the delay to the next pulse runs from centre to centre, in natural periods: the phase in
which it meets the plate. The centre of the last pulse is the middle of its rise. Every scale follows from the mean
switch and the limits, so another thickness, gap or voltage limit needs no other numbers (ADR 030, 035).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softclose.arrays import FloatArray
from softclose.naming import unknown_name
from softclose.switch.plate import EPSILON_0, holding_voltage, pull_in_voltage
from softclose.waveform.coordinates import FAR, Axis
from softclose.waveform.pulses import MAX_VOLTS, MIN_RISE_US, Pulse, Waveform

_RAMPS = 0.75
"""∫s² over the rise and the fall together, in rise times: raised cosines give 2·3/8."""

_NO_VOLTS = 1e-3
"""Weakest pulse in units of the limit: a millionth of the force."""


class SpaceError(ValueError):
    """A search space that does not exist, or a waveform or point that does not belong to it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NaturalScales:
    """The natural units of a design, and the limits of its drive."""

    period_us: float
    """Natural period of the mean switch [µs]."""
    impulse: float
    """Impulse that lets a mean switch with its gap fixed coast to contact, ω·D·G²/c [V²·µs]."""
    pull_in_volts: float
    """Static pull-in voltage of the mean switch, Eq. 3 [V]."""
    hold_volts: float
    """Voltage that just holds the mean switch in contact [V]."""
    max_volts: float = MAX_VOLTS
    """Limit on the sum of the pulses [V]."""
    min_rise_us: float = MIN_RISE_US
    """Fastest rise [µs]."""
    horizon_us: float = 250.0
    """End of the simulated time [µs]."""

    @classmethod
    def from_switch(
        cls,
        switch: ArrayLike,
        *,
        plate_area_um2: float,
        max_volts: float = MAX_VOLTS,
        min_rise_us: float = MIN_RISE_US,
        horizon_us: float = 250.0,
    ) -> NaturalScales:
        """Scales of one switch: (4,) D, G [µm], K [N/m], M [µg], the population's mean as a rule."""
        mean = np.asarray(switch, dtype=np.float64)
        travel, gap, stiffness, mass = (float(v) for v in mean)
        c = EPSILON_0 * 1e6 * plate_area_um2 / (2000.0 * mass)
        omega = math.sqrt(stiffness / (1000.0 * mass))
        return cls(
            period_us=2.0 * math.pi / omega,
            impulse=omega * travel * gap**2 / c,
            pull_in_volts=float(pull_in_voltage(mean, plate_area_um2)),
            hold_volts=float(holding_voltage(mean, plate_area_um2)),
            max_volts=max_volts,
            min_rise_us=min_rise_us,
            horizon_us=horizon_us,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Space:
    """A search space: d coordinates in [0, 1], every one of which yields an admissible waveform.

    In a `-full` or `-release` space all are reached whose pulses begin, rise and stay at their top within a horizon
    each and are no weaker than a thousandth of the limit.

    Points whose pulses would exceed the voltage limit are repaired, deterministically: the later pulse is delayed
    until the sum fits. `canonical` gives the point that stands for the repaired waveform; on it `unit` and `waveform`
    are inverse.
    """

    name: str
    n_pulses: int
    holds: bool
    """True where the last pulse holds."""
    scales: NaturalScales
    coordinates: tuple[Axis, ...]
    fixed: tuple[tuple[str, float], ...] = ()
    """Physical values of the parameters that are not free."""

    @property
    def dim(self) -> int:
        """Number of free parameters."""
        return len(self.coordinates)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the coordinates."""
        return tuple(c.name for c in self.coordinates)

    def rows(self, points: ArrayLike) -> FloatArray:
        """(n, d) unit points -> (n, n_pulse, 4) start, rise, peak [µs], volts, before the limit on the sum is
        applied."""
        u = np.clip(np.atleast_2d(np.asarray(points, dtype=np.float64)), 0.0, 1.0)
        if u.shape[1] != self.dim:
            raise SpaceError(f"a point of {self.name} has {self.dim} coordinates; got {u.shape[1]}")
        values = {c.name: c.value(u[:, i]) for i, c in enumerate(self.coordinates)}
        values |= {name: np.full(len(u), value) for name, value in self.fixed}
        rows = np.empty((len(u), self.n_pulses, 4))
        s = self.scales
        least = {c.name: c.least for c in self.coordinates} | dict(self.fixed)
        start = centre = np.zeros(len(u))
        for j in range(1, self.n_pulses + 1):
            rise, volts = values[f"rise{j}"], values[f"volts{j}"]
            if j == self.n_pulses:
                peak = np.full(len(u), math.inf) if self.holds else values[f"peak{j}"]
            else:
                # The ramps alone hold ¾·tr·u². Where that is more than the impulse asked for, the voltage gives way:
                # the impulse is what the motion is most sensitive to.
                impulse = np.maximum(values[f"impulse{j}"] * s.impulse, _RAMPS * rise * least[f"volts{j}"] ** 2)
                volts = np.minimum(volts, np.sqrt(impulse / (_RAMPS * rise)))
                peak = np.clip(impulse / volts**2 - _RAMPS * rise, 0.0, s.horizon_us)
            half = _to_centre(rise, peak, last=j == self.n_pulses)
            if j > 1:
                start = np.maximum(start, centre + values[f"delay{j}"] * s.period_us - half)
            rows[:, j - 1] = np.stack([start, rise, peak, volts], axis=1)
            centre = start + half
        return rows

    def core(self, points: ArrayLike) -> FloatArray:
        """(n, d) points of a unit cube -> the same points of the cores of all axes."""
        begin, end = np.array([c.core for c in self.coordinates]).T
        return np.asarray(begin + np.asarray(points, dtype=np.float64) * (end - begin))

    def admissible_rows(self, points: ArrayLike) -> FloatArray:
        """(n, d) unit points, clipped to the cube -> (n, n_pulse, 4) rows whose sum respects the limit.

        Each pulse is delayed until the sum of the pulses so far fits; 0.02 ms a point.
        """
        from softclose.waveform.limit import separate  # imported where it is used: the compiler is slow to import

        rows, most = self.rows(points), self.scales.max_volts
        # Waveform.check allows 1e-9; what was repaired once must not be repaired again after a round trip.
        separate(rows, most * (1.0 + 8e-10), most * (1.0 + 1e-10))
        return rows

    def waveforms(self, points: ArrayLike) -> list[Waveform]:
        """(n, d) unit points, clipped to the cube -> n admissible waveforms."""
        return [Waveform(Pulse(*row) for row in rows) for rows in self.admissible_rows(points).tolist()]

    def waveform(self, point: ArrayLike) -> Waveform:
        """(d,) unit point, clipped to the cube -> an admissible waveform."""
        return self.waveforms(np.asarray(point, dtype=np.float64)[None, :])[0]

    def unit(self, waveform: Waveform, *, clip: bool = False) -> FloatArray:
        """(d,) unit point of a waveform; the inverse of `waveform`.

        Raises SpaceError where the waveform has another form (number of pulses, holding, a fixed parameter) or, unless
        clip, lies outside the ranges.
        """
        point = self.coordinates_of(waveform)
        outside = ~((point >= -1e-9) & (point <= 1.0 + 1e-9))
        if outside.any() and not clip:
            i = int(np.flatnonzero(outside)[0])
            c = self.coordinates[i]
            raise SpaceError(
                f"{c.name} is outside [{c.least:.6g}, {c.most:.6g}] of space {self.name} "
                f"(coordinate {point[i]:.3g} of 0 to 1): "
                "it cannot be a point of this space (clip=True takes the nearest)"
            )
        return np.clip(point, 0.0, 1.0)

    def coordinates_of(self, waveform: Waveform) -> FloatArray:
        """(d,) coordinates, outside [0, 1] where the waveform is outside the ranges. Raises SpaceError on another
        form."""
        self._check_form(waveform)
        return np.asarray(self.coordinates_of_rows(waveform.rows()[None])[0])

    def coordinates_of_all(self, waveforms: Sequence[Waveform]) -> tuple[FloatArray, NDArray[np.intp]]:
        """(m, d) coordinates of those waveforms that have the form of this space, as `coordinates_of`, and (m,) their
        places in the sequence."""
        places, rows = [], []
        for place, waveform in enumerate(waveforms):
            try:
                self._check_form(waveform)
            except SpaceError:
                continue
            places.append(place)
            rows.append(waveform.rows())
        table = np.array(rows, dtype=np.float64).reshape(-1, self.n_pulses, 4)
        return self.coordinates_of_rows(table), np.array(places, dtype=np.intp)

    def _check_form(self, waveform: Waveform) -> None:
        """Raise SpaceError where the waveform has another number of pulses, another last pulse or another fixed
        value."""
        pulses = waveform.pulses
        if len(pulses) != self.n_pulses:
            raise SpaceError(f"the waveform has {len(pulses)} pulses; space {self.name} has {self.n_pulses}")
        holding = [p.holds for p in pulses]
        if any(holding[:-1]) or holding[-1] != self.holds:
            last = "hold" if self.holds else "end"
            raise SpaceError(f"in space {self.name} the last pulse must {last}, and no other pulse may hold")
        if pulses[0].start_us > 1e-9:
            raise SpaceError(f"pulse 1 starts at {pulses[0].start_us:g} µs; in space {self.name} it starts at 0 µs")
        for name, value in self.fixed:
            p = pulses[int(name[-1]) - 1]
            got = p.rise_us if name.startswith("rise") else p.volts
            if not math.isclose(got, value, rel_tol=1e-9):
                raise SpaceError(f"{name} is {got:.6g}; space {self.name} fixes it at {value:.6g}")

    def canonical(self, points: ArrayLike) -> FloatArray:
        """(d,) or (n, d) the points that stand for the waveforms of `points`, after every repair."""
        points = np.asarray(points, dtype=np.float64)
        found = self.coordinates_of_rows(self.admissible_rows(points.reshape(-1, self.dim)))
        return np.clip(found, 0.0, 1.0).reshape(points.shape)

    def widths(self, point: ArrayLike) -> FloatArray:
        """(d,) how wide each axis is around a point: its core, or the tail in which the point is."""
        point = np.asarray(point, dtype=np.float64)
        begin, end = np.array([c.core for c in self.coordinates]).T
        return np.where((point < begin) | (point > end), FAR, 1.0)

    def coordinates_of_rows(self, rows: FloatArray) -> FloatArray:
        """(n, n_pulse, 4) rows start, rise, peak [µs], volts -> (n, d) coordinates, not clipped."""
        out = np.empty((len(rows), self.dim))
        centre = [
            rows[:, j, 0] + _to_centre(rows[:, j, 1], rows[:, j, 2], last=j == self.n_pulses - 1)
            for j in range(self.n_pulses)
        ]
        for i, c in enumerate(self.coordinates):
            j = int(c.name[-1]) - 1
            _, rise, peak, volts = rows[:, j].T
            if c.name.startswith("impulse"):
                value = volts**2 * (peak + _RAMPS * rise) / self.scales.impulse
            elif c.name.startswith("delay"):
                value = (centre[j] - centre[j - 1]) / self.scales.period_us
            else:
                value = {"rise": rise, "peak": peak, "volts": volts}[c.name[:-1]]
            out[:, i] = c.unit(value)
        return out


def _to_centre(rise: FloatArray, peak: FloatArray, *, last: bool) -> FloatArray:
    """From the start of a pulse to its centre [µs]; that of the last pulse is the middle of its rise."""
    return 0.5 * rise if last else rise + 0.5 * peak


def build_space(name: str, scales: NaturalScales) -> Space:
    """One of `SPACES` in the units of one design. Raises SpaceError naming the nearest known one."""
    if name not in SPACES:
        raise SpaceError(unknown_name("search space", name, SPACES, "waveform.space"))
    n_pulses, holds = SPACES[name]
    s = scales
    weakest = 0.5 * min(s.pull_in_volts, s.max_volts)  # a quarter of the force at pull-in
    idle = min(0.7 * s.hold_volts, 0.5 * s.max_volts)  # half of the force that holds the mean switch
    axes: list[Axis] = []
    for j in range(1, n_pulses + 1):
        last = j == n_pulses
        if j > 1:
            farthest = 2.5 * s.horizon_us / s.period_us  # starts, rises and flat tops of a horizon each
            axes.append(Axis(name=f"delay{j}", least=-farthest, low=0.0, high=1.5, most=farthest))
        if not last:
            longest = max(1.75 * s.horizon_us * s.max_volts**2 / s.impulse, 1.25)
            axes.append(Axis(name=f"impulse{j}", least=0.0, low=0.05, high=1.25, most=longest))
        # Short and strong pulses disperse the ensemble least (paper §3.2); a hold needs little more than what holds.
        slow = max(s.period_us if last else 0.5 * s.period_us, 2.0 * s.min_rise_us)
        axes.append(
            Axis(
                name=f"rise{j}",
                least=s.min_rise_us,
                low=s.min_rise_us,
                high=slow,
                most=max(s.horizon_us, slow),
                log=True,
                dense="evenly" if last else "low",
            )
        )
        axes.append(
            Axis(
                name=f"volts{j}",
                least=_NO_VOLTS * s.max_volts,
                low=idle if last else weakest,
                high=s.max_volts,
                most=s.max_volts,
                dense="low" if last else "high",
            )
        )
        if last and not holds:
            long = max(s.horizon_us, 4.0 * s.period_us)
            axes.append(
                Axis(name=f"peak{j}", least=0.0, low=0.25 * s.min_rise_us, high=2.0 * long, most=2.0 * long, log=True)
            )
    fixed: tuple[tuple[str, float], ...] = ()
    if name == "two-pulse-paper":
        fixed = (("rise1", s.min_rise_us), ("volts1", s.max_volts))
        axes = [a for a in axes if a.name not in dict(fixed)]
    return Space(name=name, n_pulses=n_pulses, holds=holds, scales=s, coordinates=tuple(axes), fixed=fixed)


SPACES: dict[str, tuple[int, bool]] = {
    "two-pulse-paper": (2, True),
    "two-pulse-full": (2, True),
    "two-pulse-release": (2, False),
    "three-pulse-full": (3, True),
    "three-pulse-release": (3, False),
}
"""Name -> number of pulses, whether the last one holds."""
