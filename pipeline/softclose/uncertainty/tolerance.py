"""Owns the tolerance to the drive electronics: how v_u and p_nc move with gain error, timing jitter and slew rate.

Random errors are drawn once for each of a number of generators, as a lot that many boards drive would see them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softclose.evaluate import judge, respond
from softclose.metrics.objective import Assessment, Judged
from softclose.settings import CampaignConfig, load_config
from softclose.waveform import Pulse, Waveform

FloatArray = NDArray[np.float64]


class ToleranceError(ValueError):
    """A scenario that is out of range."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveError:
    """What the waveform generator does wrong."""

    gain: float = 0.0
    """Systematic relative gain error: 0.01 drives 1 % too high."""
    gain_sd: float = 0.0
    """Standard deviation of the relative gain from generator to generator."""
    jitter_us: float = 0.0
    """Standard deviation of the start of every pulse after the first [µs]: its timing relative to pulse 1."""
    slew_V_per_us: float = math.inf
    """Steepest slope that the generator reaches [V/µs]."""

    def __post_init__(self) -> None:
        for name, low in (("gain", -1.0), ("gain_sd", 0.0), ("jitter_us", 0.0), ("slew_V_per_us", 0.0)):
            value = getattr(self, name)
            if math.isnan(value) or value < low or (name == "slew_V_per_us" and value == 0.0):
                raise ToleranceError(
                    f"{name} is {value:g}; it must be {'above' if 'slew' in name else 'at least'} {low:g}"
                )


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveTolerance:
    """One row of the table: a scenario and what became of the ensemble."""

    error: DriveError
    """The scenario."""
    assessment: Assessment
    """The ensemble under it."""
    v_u_shift_cm_s: float
    """Change of v_u against the perfect generator, same switches [cm/s]; NaN where either is undefined."""
    p_nc_shift: float
    """Change of p_nc against the perfect generator, same switches."""


DEFAULT_ERRORS: tuple[DriveError, ...] = (
    *(DriveError(gain=x) for x in (-0.05, -0.02, -0.01, 0.01, 0.02, 0.05)),
    *(DriveError(gain_sd=x) for x in (0.005, 0.01, 0.02)),
    *(DriveError(jitter_us=x) for x in (0.1, 0.3, 1.0)),
    *(DriveError(slew_V_per_us=x) for x in (50.0, 30.0, 20.0)),
)
"""Scenarios of `drive_tolerance` where none are given: each error by itself."""


def drive_tolerance(
    switches: ArrayLike,
    waveform: Waveform,
    *,
    errors: Sequence[DriveError] = DEFAULT_ERRORS,
    n_generators: int = 64,
    seed: int = 0,
    config: CampaignConfig | None = None,
) -> tuple[DriveTolerance, ...]:
    """Assess one waveform under each scenario; the first row is the perfect generator.

    switches: (n, 4) D, G [µm], K [N/m], M [µg], in random order (as sampled). Where errors are random, n_generators
    drives are drawn, keyed by (seed, generator), and each drives an equal share of the switches. Gain multiplies the
    volts; jitter moves the pulses; slew stretches ramps, see `distorted`. Errors may exceed waveform.max_volts: the
    limit is for designs, not for faults.
    config: whose device model and objective apply; the defaults where it is left out. Intervals are those of
    independent random draws, which the switches have to be.
    """
    table = np.asarray(switches, dtype=np.float64)
    if n_generators < 1:
        raise ToleranceError(f"n_generators is {n_generators}; at least 1 generator must drive the switches")
    settings = load_config({}) if config is None else config

    def run(error: DriveError) -> Assessment:
        speed, closed = np.full(len(table), np.nan), np.zeros(len(table), dtype=np.bool_)
        status = np.zeros(len(table), dtype=np.int8)
        for share, drive in _drives(len(table), waveform, error, n_generators, seed):
            r = respond(settings, table[share], drive)
            speed[share], closed[share], status[share] = r.max_contact_speed, r.closed, r.status
        return judge(settings, Judged(max_contact_speed=speed, closed=closed, status=status), fresh=True)

    perfect = run(DriveError())
    rows = [DriveTolerance(error=DriveError(), assessment=perfect, v_u_shift_cm_s=0.0, p_nc_shift=0.0)]
    for error in errors:
        a = run(error)
        rows.append(
            DriveTolerance(
                error=error,
                assessment=a,
                v_u_shift_cm_s=a.v_u_cm_s - perfect.v_u_cm_s,
                p_nc_shift=a.p_nc - perfect.p_nc,
            )
        )
    return tuple(rows)


def _drives(
    n: int, waveform: Waveform, error: DriveError, n_generators: int, seed: int
) -> Iterator[tuple[slice, Waveform]]:
    """Shares of the switches, each with the waveform that its generator puts out."""
    if error.gain_sd == 0.0 and error.jitter_us == 0.0:
        yield slice(None), distorted(waveform, error)
        return
    edges = np.linspace(0, n, min(n_generators, n) + 1).astype(int)
    n_later = len(waveform.pulses) - 1
    for i, (a, b) in enumerate(itertools.pairwise(edges)):
        # The same standard draws in every scenario, so that scenarios differ by their size only.
        z = np.random.Generator(np.random.Philox(np.random.SeedSequence(seed, spawn_key=(i,)))).standard_normal(
            1 + n_later
        )
        gain = error.gain + error.gain_sd * float(z[0])
        yield slice(a, b), distorted(waveform, replace(error, gain=max(gain, -1.0)), error.jitter_us * z[1:])


def distorted(waveform: Waveform, error: DriveError, delays_us: ArrayLike | None = None) -> Waveform:
    """What a generator with this systematic gain and slew rate makes of a waveform.

    delays_us: (n_pulse - 1,) shifts of the pulses after the first [µs]; no pulse is moved to before t = 0. A slewed
    pulse begins to rise and to fall when it should: what its ramps gain its flat top loses, and its area stays. Where
    the top is used up it turns back before it has reached its voltage.
    """
    delays = [0.0, *(np.zeros(len(waveform.pulses) - 1) if delays_us is None else np.asarray(delays_us, dtype=float))]
    pulses = []
    for pulse, delay in zip(waveform.pulses, delays, strict=True):
        volts = pulse.volts * (1.0 + error.gain)
        rise, peak = pulse.rise_us, pulse.peak_us
        slewed = math.pi * volts / (2.0 * error.slew_V_per_us)  # steepest slope of a raised cosine: π u / (2 tr)
        if slewed > rise:
            until_fall = rise + peak
            rise = min(slewed, until_fall)
            volts *= rise / slewed
            peak = until_fall - rise
        pulses.append(Pulse(max(pulse.start_us + float(delay), 0.0), rise, peak, volts))
    return Waveform(pulses)
