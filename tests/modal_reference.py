"""Slow oracle for one switch of several modes: scipy's Radau or DOP853 on whole coordinates, restarted at every event.

Shares with the kernel `Waveform.voltage` only: mass and stiffness are matrices, an impact is a projection.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from softclose import Responses
from softclose.switch.reduced_order import ReducedOrder
from softclose.waveform import Drive

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
    dashpot: float = 0.0
    """Of that contact."""
    adhesion: float = 0.0
    """Force with which a contact sticks, rigid or compliant."""
    cubic: np.ndarray | float = 0.0
    """Cubic stiffness over stiffness of each mode."""
    coat: float = 0.0
    """Thickness over permittivity of a dielectric."""
    free_path: float = 0.0
    """Mean free path of the film's gas."""
    slope: Callable[[float], float] | None = None
    """dC/dx [fF/µm] over the electrode's displacement; None: parallel plates."""
    impacts: list[tuple[float, float]] = field(default_factory=list)
    final: float = math.nan
    ending: str = ""
    """Of `follow`: held, free or collapsed."""
    ended_us: float = math.nan
    """When it collapsed, or the horizon."""
    held_us: float = math.inf
    """Since when it is held, or touches a compliant contact."""
    motion: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Coordinates and their speeds at the end."""

    def run(self, waveform: Drive, until_us: float, *, least_speed: float = 1e-3) -> ModalSwitch:
        """Fly from rest until the time, or a rebound below the least speed: what is chatter is not compared."""
        n = len(self.masses)

        def force(t: float, y: np.ndarray, touching: bool) -> np.ndarray:
            q, p = y[:n], y[n:]
            left = self.G - self.electrode @ q
            u = float(waveform.voltage(np.array([t]))[0])
            slip = 1.0 + 9.638 * (self.free_path / left) ** 1.159
            film = self.film * (self.electrode @ p) / left**3 / slip
            plates = 1e9 * EPS0 * self.area_um2 / (left + self.coat) ** 2
            pull = 0.5e-6 * u**2 * (self.slope(self.G - left) if self.slope else plates) - film
            springs = self.stiffnesses * (q + self.cubic * q**3)
            generalised = self.electrode * pull - springs - self.masses * self.rates * p
            if touching and self.compliance is not None:
                k, power, loss = self.compliance
                depth = max(self.contact @ q - self.D, 0.0)
                speed = self.contact @ p
                push = k * depth**power * (1.0 + loss * speed) + self.dashpot * speed
                generalised = generalised - self.contact * (max(push, 0) - self.adhesion)
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
                    touching, self.held_us = False, math.inf
                    continue
                self.impacts.append((t, speed))
                if self.compliance is not None:
                    touching, self.held_us = True, t
                elif self.restitution * speed < least_speed:
                    return self
                else:
                    inverse = self.contact / self.masses
                    y[n:] -= inverse * (1.0 + self.restitution) * speed / (self.contact @ inverse)
                    y[:n] -= inverse * (self.contact @ y[:n] - self.D) / (self.contact @ inverse) * 1.0000001
        self.final, self.motion = float(self.contact @ y[:n]), y
        return self

    def follow(self, waveform: Drive, until_us: float, *, v_stick: float = 1e-5) -> ModalSwitch:
        """The whole life on a rigid contact: chatter, holding, letting go, and the electrode's collapse.

        In contact the constraint phi q = D has the force that makes phi q'' vanish; it presses, and pulls no more than
        the adhesion.
        """
        n = len(self.masses)
        inverse = self.contact / self.masses
        weight = float(self.contact @ inverse)
        closest = self.G - 1e-3 * (self.G - self.electrode[0] / self.contact[0] * self.D)

        def accelerations(t: float, y: np.ndarray) -> np.ndarray:
            q, p = y[:n], y[n:]
            left = self.G - self.electrode @ q
            u = float(waveform.voltage(np.array([t]))[0])
            pull = 0.5e3 * EPS0 * self.area_um2 * (u / left) ** 2 - self.film * (self.electrode @ p) / left**3
            return np.asarray((self.electrode * pull - self.stiffnesses * q) / self.masses - self.rates * p)

        def slope(t: float, y: np.ndarray, held: bool) -> np.ndarray:
            a = accelerations(t, y)
            if held:
                a = a - inverse * float(self.contact @ a) / weight
            return np.concatenate([y[n:], a])

        def meets(t: float, y: np.ndarray, _held: bool) -> float:
            return float(self.contact @ y[:n]) - self.D

        def presses(t: float, y: np.ndarray, _held: bool) -> float:
            return float(self.contact @ accelerations(t, y)) + self.adhesion * weight

        def collapses(t: float, y: np.ndarray, _held: bool) -> float:
            return float(self.electrode @ y[:n]) - closest

        for event, direction in ((meets, 1.0), (presses, -1.0), (collapses, 1.0)):
            event.terminal, event.direction = True, direction  # type: ignore[attr-defined]
        knots = [0.0, *(k for k in waveform.breakpoints(until_us) if 0.0 < k < until_us), until_us]
        y, held = np.zeros(2 * n), False
        for begin, end in itertools.pairwise(knots):
            t = begin
            while t < end:
                if held and presses(t, y, held) < 0.0:
                    held, self.held_us = False, math.inf
                events = (presses if held else meets, collapses)
                found = solve_ivp(
                    slope, (t, end), y, "DOP853", events=events, rtol=1e-11, atol=1e-13, max_step=0.5, args=(held,)
                )
                t, y = float(found.t[-1]), found.y[:, -1].copy()
                if found.status != 1:
                    continue
                if found.t_events[1].size:
                    self.ending, self.ended_us = "collapsed", t
                    return self
                if held:
                    held, self.held_us = False, math.inf
                    y[:n] -= inverse * (self.contact @ y[:n] - self.D) / weight
                    y[n:] -= inverse * (self.contact @ y[n:]) / weight
                    y[:n] -= inverse * 1e-11 / weight
                    continue
                speed = float(self.contact @ y[n:])
                self.impacts.append((t, speed))
                held = self.restitution * speed < v_stick and presses(t, y, True) >= 0.0
                self.held_us = t if held else math.inf
                y[n:] -= inverse * (1.0 + (0.0 if held else self.restitution)) * speed / weight
                y[:n] -= inverse * (self.contact @ y[:n] - self.D) / weight
                if not held:  # a little off the contact, so that the flight's end is its only crossing
                    y[:n] -= inverse * 1e-11 / weight
        self.ending, self.ended_us, self.final = "held" if held else "free", until_us, float(self.contact @ y[:n])
        self.motion = y
        return self


def oracle(modes: ReducedOrder, switch: np.ndarray, **others: object) -> ModalSwitch:
    """The same switch, its modes scaled so that the first has K and M where it moves the contact by 1."""
    d, g, k, m = switch
    first = modes.mode[0]
    scale = m / (first.mass_ug / first.contact**2)
    masses = np.array([mode.mass_ug * scale for mode in modes.mode])
    omega = np.sqrt(1e-3 * k / m) * np.array([mode.frequency_kHz / first.frequency_kHz for mode in modes.mode])
    return ModalSwitch(
        D=d,
        G=g,
        masses=masses,
        stiffnesses=masses * omega**2,
        rates=omega * np.array([1.0 / mode.quality_factor if mode.quality_factor else 0.0 for mode in modes.mode]),
        contact=np.array([mode.contact for mode in modes.mode]),
        electrode=np.array([mode.electrode for mode in modes.mode]),
        **others,  # type: ignore[arg-type]
    )


def agree(fast: Responses, tight: Responses, moves: Any = slice(None)) -> None:
    """Assert that a kernel says what its twin does of the switches, those that graze apart (SPEC §8).

    fast: of n switches. tight: of these, and of them twice more with a travel that is a little larger, and smaller:
    where the three differ in their impacts, a switch grazes. moves: (n,) those whose motion is compared.
    """
    n = len(fast.status)
    count, closed = tight.n_impacts.reshape(3, n), tight.closed.reshape(3, n)
    regular = (count == count[0]).all(axis=0) & (closed == closed[0]).all(axis=0)
    assert regular.mean() >= 0.3
    np.testing.assert_array_equal(fast.closed[regular], closed[0, regular])
    speeds = fast.max_contact_speed, tight.max_contact_speed[:n]
    np.testing.assert_allclose(speeds[0][regular], speeds[1][regular], atol=1e-5)  # 1e-3 cm/s
    bounces_agree(fast, tight, regular)
    assert fast.x is not None
    assert tight.x is not None
    moving = np.zeros(n, dtype=bool)
    moving[moves] = True
    np.testing.assert_allclose(fast.x[regular & moving], tight.x[:n][regular & moving], atol=1e-5)


def bounces_agree(fast: Responses, tight: Responses, regular: np.ndarray) -> None:
    """Assert that the first six impacts of these switches have the same speeds, and that what only one of both counts
    is slower than 1e-5 µm/µs: the last bounce of a series may be told or not.
    """
    assert fast.impact_speed is not None
    assert tight.impact_speed is not None
    ours, theirs = fast.impact_speed[regular], tight.impact_speed[: len(regular)][regular]
    np.testing.assert_allclose(np.nan_to_num(ours[:, :6]), np.nan_to_num(theirs[:, :6]), atol=1e-5)
    counted_once = np.isnan(ours) != np.isnan(theirs)
    assert np.fmax(ours, theirs)[counted_once].max(initial=0.0) < 1e-5


def impacts_agree(found: Responses, oracle: ModalSwitch) -> int:
    """Assert that the first six impacts of one switch are the oracle's; how many were compared."""
    assert found.impact_time_us is not None
    assert found.impact_speed is not None
    expected = oracle.impacts[:6]
    for j, (t, speed) in enumerate(expected):
        assert found.impact_time_us[0, j] == pytest.approx(t, abs=1e-5)
        assert found.impact_speed[0, j] == pytest.approx(speed, abs=1e-6)
    return len(expected)
