"""Owns the free swing of a lot: how far the finite pulses alone carry a few of its switches, before the last pulse.

What the last pulse has to catch is decided by this swing: its reach, and where each switch is, how fast, when the last
pulse comes. It costs a few trajectories of Eq. 1 without contact, no ensemble, and serves as prior knowledge for the
engines (ADR 034, 036).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from softclose.arrays import FloatArray
from softclose.compiled import cached_njit
from softclose.conditions.trim import Trim
from softclose.device.device import Device
from softclose.device.scaled import effective
from softclose.device.told import mean_switch, sobol_switches
from softclose.kernel.dispatch import devices
from softclose.population import Population
from softclose.switch.plate import closing_voltage, holding_voltage

FARTHEST = 1.3
"""Reach beyond which nothing is told apart: the pulses alone slam the switch."""

_N_SWITCHES = 8
_N_STATIC = 1024


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FewSwitches:
    """A few switches that stand for the lot, and the voltages between which a hold is worth trying."""

    devices: FloatArray
    """(m, 4) travel, gap [µm], c [µm³/(µs² V²)], k [1/µs²]; the mean switch first, then Sobol points of the lot."""
    weak_hold_volts: float
    """Holds 90 % of the lot in contact (static) [V]."""
    strong_hold_volts: float
    """Pulls 99 % of the lot in (static, Eq. 3) [V]."""

    @classmethod
    def of(cls, population: Population, device: Device, *, trim: Trim | None = None) -> FewSwitches:
        """The lot of a population; the same every time. Where drives are trimmed, the switches that the common waveform
        moves alike, but for errors of measurement."""

        def drawn(n: int) -> FloatArray:
            switches = sobol_switches(population, device, n)
            return switches if trim is None else effective(switches, trim.scales(trim.true(switches)))

        few, many = drawn(_N_SWITCHES), drawn(_N_STATIC)
        mean, plate_area_um2 = mean_switch(population, device), device.plate_area_um2
        hold = holding_voltage(many, plate_area_um2)
        pull_in = closing_voltage(many, plate_area_um2)
        return cls(
            devices=devices(np.vstack([mean, few]), plate_area_um2),
            weak_hold_volts=float(np.quantile(hold, 0.9)),
            strong_hold_volts=float(np.quantile(pull_in, 0.99)),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Swing:
    """Free swings of n waveforms."""

    reach: FloatArray
    """(n, m) largest travel of each switch of the lot, undamped and without contact, in its own contact distance D;
    at most FARTHEST."""
    x: FloatArray
    """(n, m) its travel at the instant asked for, in D."""
    v: FloatArray
    """(n, m) its velocity there, in ω·D."""

    @property
    def mean(self) -> FloatArray:
        """(n,) mean reach of the lot."""
        return np.asarray(self.reach[:, 1:].mean(axis=1))

    @property
    def sd(self) -> FloatArray:
        """(n,) standard deviation of the reach over the lot."""
        return np.asarray(self.reach[:, 1:].std(axis=1))

    @property
    def scatter(self) -> FloatArray:
        """(n,) root mean square distance of the lot's states (x, v) from their mean."""
        return np.asarray(np.hypot(self.x[:, 1:].std(axis=1), self.v[:, 1:].std(axis=1)))


def free_swing(rows: FloatArray, lot: FewSwitches, *, instant_us: FloatArray) -> Swing:
    """rows: (n, n_pulse, 4) start, rise, peak [µs], volts, of which the last pulse is left out; instant_us: (n,) when
    the states are wanted.

    Eq. 1 by RK4 while the finite pulses act (32 steps a period or 8 in the shortest pulse), then in closed form.
    """
    rows = np.ascontiguousarray(rows, dtype=np.float64)
    reach = np.empty((len(rows), len(lot.devices)))
    state = np.empty((len(rows), len(lot.devices), 2))
    _swing(rows, np.ascontiguousarray(instant_us, dtype=np.float64), lot.devices, FARTHEST, reach, state)
    return Swing(reach=reach, x=state[:, :, 0], v=state[:, :, 1])


@cached_njit(nogil=True, error_model="numpy")
def _swing(rows, instant, lot, farthest, reach, state):  # type: ignore[no-untyped-def]
    """Fills reach (n, m) and state (n, m, 2). Self-contained: compiled and cached code give bit-identical results."""
    n_finite = rows.shape[1] - 1
    shortest_period = 2.0 * math.pi / math.sqrt(lot[:, 3].max())
    for i in range(rows.shape[0]):
        end, shortest = 0.0, math.inf
        for j in range(n_finite):
            width = 2.0 * rows[i, j, 1] + rows[i, j, 2]
            end = max(end, rows[i, j, 0] + width)
            shortest = min(shortest, width)
        n_steps = int(min(max(math.ceil(end / min(shortest_period / 32.0, shortest / 8.0)), 1.0), 4000.0))
        h = end / n_steps
        square = np.zeros(2 * n_steps + 1)  # u² at the steps and between them, the same for every switch
        for s in range(2 * n_steps + 1):
            t, u = 0.5 * s * h, 0.0
            for j in range(n_finite):
                since, rise, peak = t - rows[i, j, 0], rows[i, j, 1], rows[i, j, 2]
                if since <= 0.0 or since >= 2.0 * rise + peak:
                    continue
                if since < rise:
                    u += rows[i, j, 3] * 0.5 * (1.0 - math.cos(math.pi * since / rise))
                elif since <= rise + peak:
                    u += rows[i, j, 3]
                else:
                    u += rows[i, j, 3] * 0.5 * (1.0 + math.cos(math.pi * (since - rise - peak) / rise))
            square[s] = u * u
        for m in range(lot.shape[0]):
            travel, gap, c, k = lot[m, 0], lot[m, 1], lot[m, 2], lot[m, 3]
            limit = min(farthest * travel, 0.95 * gap)
            x, v, largest, x_then, v_then, slammed = 0.0, 0.0, 0.0, 0.0, 0.0, False
            for s in range(n_steps):
                if s * h <= instant[i]:
                    x_then, v_then = x, v
                f = c * square[2 * s]
                a1 = f / (gap - x) ** 2 - k * x
                x2, v2 = x + 0.5 * h * v, v + 0.5 * h * a1
                f = c * square[2 * s + 1]
                a2 = f / (gap - x2) ** 2 - k * x2
                x3, v3 = x + 0.5 * h * v2, v + 0.5 * h * a2
                a3 = f / (gap - x3) ** 2 - k * x3
                x4, v4 = x + h * v3, v + h * a3
                f = c * square[2 * s + 2]
                a4 = f / (gap - x4) ** 2 - k * x4
                x += h / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4)
                v += h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
                largest = max(largest, x)
                if x > limit:
                    slammed = True
                    break
            omega = math.sqrt(k)
            if slammed:
                reach[i, m] = farthest
            else:
                reach[i, m] = min(max(largest, math.hypot(x, v / omega)) / travel, farthest)
                if instant[i] >= end:
                    angle = omega * (instant[i] - end)
                    x_then = x * math.cos(angle) + v / omega * math.sin(angle)
                    v_then = v * math.cos(angle) - x * omega * math.sin(angle)
            state[i, m, 0] = x_then / travel
            state[i, m, 1] = v_then / (omega * travel)
