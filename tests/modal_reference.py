"""Slow oracle for one switch of several modes: scipy's Radau or DOP853 on whole coordinates, restarted at every event.

Shares with the kernel `Waveform.voltage` only: mass and stiffness are matrices, an impact is a projection.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field

import numpy as np
from scipy.integrate import solve_ivp

from softclose.waveform import Waveform

EPS0 = 8.8541878128e-12


@dataclass
class ModalSwitch:
    """Everything in µm, µs, µg and mN."""

    D: float
    G: float
    masses: np.ndarray
    stiffnesses: np.ndarray
    rates: np.ndarray
    """omega / Q of each mode."""
    contact: np.ndarray
    electrode: np.ndarray
    area_um2: float = 16700.0
    film: float = 0.0
    restitution: float = 0.5
    compliance: tuple[float, float, float] | None = None
    """Stiffness, exponent and loss of a compliant contact."""
    impacts: list[tuple[float, float]] = field(default_factory=list)
    final: float = math.nan

    def run(self, waveform: Waveform, until_us: float, *, least_speed: float = 1e-3) -> ModalSwitch:
        """Fly from rest until the time, or a rebound below the least speed: what is chatter is not compared."""
        n = len(self.masses)

        def force(t: float, y: np.ndarray, touching: bool) -> np.ndarray:
            q, p = y[:n], y[n:]
            left = self.G - self.electrode @ q
            u = float(waveform.voltage(np.array([t]))[0])
            pull = 0.5e3 * EPS0 * self.area_um2 * (u / left) ** 2 - self.film * (self.electrode @ p) / left**3
            generalised = self.electrode * pull - self.stiffnesses * q - self.masses * self.rates * p
            if touching and self.compliance is not None:
                k, power, loss = self.compliance
                depth = max(self.contact @ q - self.D, 0.0)
                generalised = generalised - self.contact * max(k * depth**power * (1.0 + loss * (self.contact @ p)), 0)
            return np.concatenate([p, generalised / self.masses])

        def cross(t: float, y: np.ndarray, *_: object) -> float:
            return float(self.contact @ y[:n]) - self.D

        knots = [0.0, *(k for k in waveform.breakpoints(until_us) if 0.0 < k < until_us), until_us]
        y, touching = np.zeros(2 * n), False
        for begin, end in itertools.pairwise(knots):
            t = begin
            while t < end:
                cross.terminal, cross.direction = True, -1.0 if touching else 1.0  # type: ignore[attr-defined]
                found = solve_ivp(
                    force, (t, end), y, "DOP853", events=cross, rtol=1e-12, atol=1e-13, max_step=0.25, args=(touching,)
                )
                t, y = float(found.t[-1]), found.y[:, -1]
                if found.status != 1:
                    continue
                speed = float(self.contact @ y[n:])
                if touching:
                    touching = False
                    continue
                self.impacts.append((t, speed))
                if self.compliance is not None:
                    touching = True
                elif self.restitution * speed < least_speed:
                    return self
                else:
                    inverse = self.contact / self.masses
                    y[n:] -= inverse * (1.0 + self.restitution) * speed / (self.contact @ inverse)
                    y[:n] -= inverse * (self.contact @ y[:n] - self.D) / (self.contact @ inverse) * 1.0000001
        self.final = float(self.contact @ y[:n])
        return self
