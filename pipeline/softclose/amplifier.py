"""Owns the amplifier in the loop: what reaches the switch of the waveform that is commanded.

In the order of the signal's way: resolution in time and volts of the generator, gain and offset, delay, slew limit,
bandwidth (first or second order). What is searched, stored and exported is the commanded waveform; what is simulated is
the delivered one, as a `Trace`.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from softclose.population.population import index_uniforms
from softclose.waveform import FloatArray, Trace, Waveform

if TYPE_CHECKING:
    from softclose.config import AmplifierSection

_STREAM = 7_200_000
"""Added to an ensemble's stream: a drive's errors are independent of its switch."""

TOLERANCE_VOLTS = 1e-2
"""Samples of a delivered waveform that lines through the others meet to this are left out [V]: V moves by
0.001 cm/s in the median."""


@lru_cache(maxsize=64)
def deliver(amplifier: AmplifierSection, waveform: Waveform, horizon_us: float) -> Trace:
    """What of a commanded waveform reaches the switch, on [0, horizon].

    Parameters
    ----------
    amplifier : AmplifierSection
        Its settings.
    waveform : Waveform
        What is commanded; before 0 it is 0 V, and the amplifier is at rest.
    horizon_us : float
        End [µs].

    Returns
    -------
    Trace
        Sampled in steps of `amplifier.step_us`, without the samples that lines through the others meet to 10 mV.
    """
    a = amplifier
    n = math.ceil(horizon_us / a.step_us)
    t = a.step_us * np.arange(n + 1)
    command = t - a.delay_us
    if a.resolution_us > 0.0:
        command = a.resolution_us * np.floor(command / a.resolution_us + 1e-9)
    u = np.where(command >= 0.0, waveform.voltage(np.maximum(command, 0.0)), 0.0)
    if a.resolution_volts > 0.0:
        u = a.resolution_volts * np.round(u / a.resolution_volts)
    u = a.gain * u + a.offset_volts
    if a.slew_volts_per_us > 0.0:
        u = _slewed(u, a.slew_volts_per_us * a.step_us, a.offset_volts)
    if a.bandwidth_kHz > 0.0:
        u = a.offset_volts + _low_pass(a, u - a.offset_volts)
    return Trace(t, u).simplified(TOLERANCE_VOLTS)


def _slewed(u: FloatArray, most: float, first: float) -> FloatArray:
    """Follow u by at most so much a step, from `first` on."""
    if np.abs(np.diff(u, prepend=first)).max() <= most:
        return u
    found = np.empty_like(u)
    at = first
    for i, goal in enumerate(u.tolist()):
        at += min(max(goal - at, -most), most)
        found[i] = at
    return found


def _low_pass(a: AmplifierSection, u: FloatArray) -> FloatArray:
    """The low-pass from rest, exact where its input is lines between the samples ("first-order hold")."""
    from scipy.signal import cont2discrete, lfilter

    corner = 2.0 * math.pi * 1e-3 * a.bandwidth_kHz  # [1/µs]
    if a.order == 1:
        num, den = [1.0], [1.0 / corner, 1.0]
    else:
        z = a.damping
        # |H| = 1/sqrt(2) at the corner: with w = corner / natural, w^4 + (4 z^2 - 2) w^2 - 1 = 0
        ratio = math.sqrt(1.0 - 2.0 * z * z + math.sqrt((1.0 - 2.0 * z * z) ** 2 + 1.0))
        natural = corner / ratio
        num, den = [1.0], [1.0 / natural**2, 2.0 * z / natural, 1.0]
    b, c, _ = cont2discrete((num, den), a.step_us, method="foh")
    return np.asarray(lfilter(np.atleast_1d(np.squeeze(b)), c, u))


def scattered(amplifier: AmplifierSection, n: int, *, seed: int, start: int = 0, stream: int = 0) -> FloatArray:
    """(n, 2) voltage and time scale of the drives of switches `start` to `start + n`: normal about 1.

    The same for every candidate (common random numbers), independent of the switches; row i depends on
    (seed, stream, start + i) and nothing else.
    """
    from scipy.special import ndtri

    uniforms = index_uniforms(n, seed=seed, start=start, stream=_STREAM + stream)[:, :2]
    errors = np.array([amplifier.gain_error, amplifier.time_error]) * ndtri(np.clip(uniforms, 1e-12, 1.0 - 1e-12))
    return np.asarray(np.maximum(1.0 + errors, 0.05))
