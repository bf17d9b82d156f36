"""Owns a drive that an amplifier of limited bandwidth makes of pulses, in closed form."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from softclose.arrays import FloatArray, IntArray
from softclose.compiled import cached_njit
from softclose.waveform.fitted import MANY
from softclose.waveform.flat import flatten_pulses, volts
from softclose.waveform.lowpass import deliver_flat, poles, room
from softclose.waveform.pieced import Pieced
from softclose.waveform.pulses import MAX_VOLTS, Waveform, WaveformError, is_above

_compiled = cached_njit(error_model="numpy")(deliver_flat)
"""For more pieces than a drive may have and stay exact; fewer are not worth the compiler."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Delivered:
    """Pulses behind a low-pass: from rest, delayed, amplified, on a constant voltage."""

    command: Waveform | Pieced
    """What comes to the low-pass; before 0 it is 0 V."""
    bandwidth_kHz: float
    """Frequency at which a sine comes out at -3 dB [kHz]."""
    order: int = 1
    """Order of the low-pass, 1 or 2."""
    damping: float = 0.7071
    """Damping ratio of the second order."""
    gain: float = 1.0
    """Volts delivered over volts commanded, at rest."""
    offset_volts: float = 0.0
    """Added to what is delivered [V], from 0 on."""
    delay_us: float = 0.0
    """Everything arrives so much later [µs]."""

    def __post_init__(self) -> None:
        if not (self.bandwidth_kHz > 0.0 and math.isfinite(self.bandwidth_kHz)):
            raise WaveformError(f"bandwidth_kHz is {self.bandwidth_kHz:g}; it must be above 0 and finite")
        if self.order not in (1, 2):
            raise WaveformError(f"order is {self.order!r}; a low-pass of order 1 or 2 has a closed form here")
        if not (self.damping > 0.0 and self.gain > 0.0 and self.delay_us >= 0.0):
            raise WaveformError(
                f"damping is {self.damping:g}, gain {self.gain:g}, delay_us {self.delay_us:g}; the first two must be "
                "above 0, a delay 0 or more"
            )

    def path(self, horizon_us: float) -> FloatArray:
        """What `deliver_flat` reads of the way."""
        kind, first, second = poles(self.bandwidth_kHz, self.order, self.damping)
        return np.array([kind, first, second, self.gain, self.delay_us, self.offset_volts, horizon_us])

    def flat_command(self, horizon_us: float) -> tuple[FloatArray, IntArray, FloatArray]:
        """The pieces of the command on [0, horizon]."""
        if isinstance(self.command, Waveform):
            return flatten_pulses(self.command, horizon_us)
        return self.command.flat(horizon_us)

    def flat(self, horizon_us: float) -> tuple[FloatArray, IntArray, FloatArray]:
        """The pieces on [0, horizon], as the kernels read them: rows of four numbers, see `deliver_flat`."""
        command = self.flat_command(horizon_us)
        out = room(command[0], command[2])
        path = self.path(horizon_us)
        how = _compiled if len(command[0]) > MANY else deliver_flat
        m = how(*command, path, 1.0, self.delay_us, self.offset_volts, *out)
        return out[0][:m], out[1][:m], out[2][:m]

    def voltage(self, t_us: ArrayLike) -> FloatArray:
        """u(t) [V] at instants t_us [µs]; any shape."""
        t = np.asarray(t_us, dtype=np.float64)
        if t.size == 0:
            return np.zeros(t.shape)
        flat = self.flat(max(float(t.max()), 1.0))
        return volts(*flat, np.clip(np.searchsorted(flat[0][:, 0], t, side="right") - 1, 0, None), t)

    def breakpoints(self, horizon_us: float = math.inf) -> FloatArray:
        """Instants in [0, horizon] at which another formula begins [µs]."""
        knots = self.command.breakpoints() + self.delay_us
        return np.unique(np.append(0.0, knots[np.isfinite(knots) & (knots <= horizon_us)]))

    def max_voltage(self, horizon_us: float = 250.0) -> float:
        """Largest magnitude of the voltage over [0, horizon] [V], to a thousandth of what ripples on it."""
        pieces, _, ramps = self.flat(horizon_us)
        turns = float(((pieces[:, 1] - pieces[:, 0]) * ramps[..., 1].max(axis=1)).max()) / (2.0 * math.pi)
        inside = np.linspace(pieces[:, 0], pieces[:, 1], math.ceil(64.0 * max(turns, 1.0)) + 1, axis=1)
        return float(np.abs(self.voltage(inside)).max())

    def check(self, max_volts: float = MAX_VOLTS, horizon_us: float = 250.0) -> None:
        """Make sure that the magnitude stays within a limit.

        Parameters
        ----------
        max_volts : float
            The limit [V].
        horizon_us : float
            It holds on [0, horizon] [µs].

        Raises
        ------
        WaveformError
            Where it is exceeded, by how much.
        """
        peak = self.max_voltage(horizon_us)
        if is_above(peak, max_volts):
            raise WaveformError(f"{peak:.6g} V are delivered; {max_volts:g} V are allowed (waveform.max_volts)")
