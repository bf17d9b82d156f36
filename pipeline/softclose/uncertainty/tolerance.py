"""Owns the tolerance to the drive electronics: how v_u and p_nc move with gain error, timing jitter and slew rate.

Random errors are drawn once for each of a number of generators, as a lot that many boards drive would see them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from softclose.conditions.streams import Draw, key
from softclose.evaluate import judge
from softclose.evaluate.pieces import Mapper, Sent, Work, here, joined_judged, respond_to_all
from softclose.metrics.objective import Assessment
from softclose.population.lot import Lot
from softclose.settings import CampaignConfig, load_config
from softclose.waveform import Waveform

LARGEST = 10.0
"""Largest relative error of gain, and largest jitter [µs]: beyond it nothing is a tolerance any more."""


FASTEST = 1e6
"""Slew rate beyond which none is a limit [V/µs]."""


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
    slew_volts_per_us: float = math.inf
    """Steepest slope that the generator reaches [V/µs]."""

    def __post_init__(self) -> None:
        for name, low in (("gain", -1.0), ("gain_sd", 0.0), ("jitter_us", 0.0), ("slew_volts_per_us", 0.0)):
            value = getattr(self, name)
            high = math.inf if "slew" in name else LARGEST
            if math.isnan(value) or not low <= value <= high or (name == "slew_volts_per_us" and value == 0.0):
                allowed = f"above {low:g}" if "slew" in name else f"from {low:g} to {high:g}"
                raise ToleranceError(f"{name} is {value:g}; it must be {allowed}")


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
    *(DriveError(slew_volts_per_us=x) for x in (50.0, 30.0, 20.0)),
)
"""Scenarios of `drive_tolerance` where none are given: each error by itself."""


def drive_tolerance(
    switches: Lot | ArrayLike,
    waveform: Waveform,
    *,
    errors: Sequence[DriveError] = DEFAULT_ERRORS,
    n_generators: int = 64,
    seed: int = 0,
    config: CampaignConfig | None = None,
    mapper: Mapper = here,
    listener: Callable[[int, int], None] | None = None,
) -> tuple[DriveTolerance, ...]:
    """Assess one waveform under each scenario; the first row is the generator without these errors.

    Parameters
    ----------
    switches : Lot
        Independent random switches, as `softclose.evaluate.draw` gives them; (n, 4) D, G, K, M where no condition
        needs more.
    waveform : Waveform
        What is commanded. Errors may exceed waveform.max_volts: the limit is for designs, not for faults.
    errors : sequence of DriveError
        The scenarios. They come on top of what the campaign's own amplifier does: gains multiply its gain, jitter moves
        the pulses, and a slew rate limits it where its own is faster.
    n_generators : int
        Where errors are random, so many drives are drawn, keyed by (seed, generator); each drives an equal share.
    seed : int
        Of the generators.
    config : CampaignConfig, optional
        Whose device model, conditions and objective apply; the defaults where it is left out.
    mapper : Mapper
        Who simulates.
    listener : callable, optional
        Told (done, all).

    Returns
    -------
    tuple of DriveTolerance
        The perfect generator, then one for each scenario.

    Raises
    ------
    ToleranceError
        Where no generator drives the switches.
    """
    lot = Lot.of(switches)
    if n_generators < 1:
        raise ToleranceError(f"n_generators is {n_generators}; at least 1 generator must drive the switches")
    settings = load_config({}) if config is None else config

    usual = Sent(settings)
    scenarios = (DriveError(), *errors)
    works: list[list[Work]] = []
    for error in scenarios:
        faulty = _slewed(settings, error)
        sent = usual if faulty is settings else Sent(faulty)
        works.append(
            [
                Work(sent=sent, lot=driven(lot.rows(share), gain), drive=drive)
                for share, drive, gain in _drives(len(lot), waveform, error, n_generators, seed)
            ]
        )
    answers = respond_to_all([work for own in works for work in own], mapper)
    rows: list[DriveTolerance] = []
    for k, (error, own) in enumerate(zip(scenarios, works, strict=True), start=1):
        a = judge(own[0].sent.config, joined_judged([next(answers) for _ in own]), fresh=True)
        perfect = rows[0].assessment if rows else a
        rows.append(
            DriveTolerance(
                error=error,
                assessment=a,
                v_u_shift_cm_s=a.v_u_cm_s - perfect.v_u_cm_s,
                p_nc_shift=a.p_nc - perfect.p_nc,
            )
        )
        if listener is not None:
            listener(k, len(scenarios))
    return tuple(rows)


def driven(lot: Lot, gain: float) -> Lot:
    """A lot whose drives all have another gain, on top of their own."""
    return lot if gain == 0.0 else lot.with_columns(gain=lot.get("gain", 1.0) * (1.0 + gain))


def _slewed(config: CampaignConfig, error: DriveError) -> CampaignConfig:
    """The campaign whose amplifier is no faster than the error says."""
    if math.isinf(error.slew_volts_per_us):
        return config
    slew = min(config.amplifier.slew_volts_per_us or math.inf, error.slew_volts_per_us, FASTEST)
    return replace(config, amplifier=replace(config.amplifier, slew_volts_per_us=slew))


def _drives(
    n: int, waveform: Waveform, error: DriveError, n_generators: int, seed: int
) -> Iterator[tuple[slice, Waveform, float]]:
    """Shares of the switches, each with the waveform that its generator commands and its relative error of gain."""
    if error.gain_sd == 0.0 and error.jitter_us == 0.0:
        yield slice(None), waveform, error.gain
        return
    edges = np.linspace(0, n, min(n_generators, n) + 1).astype(int)
    n_later = len(waveform.pulses) - 1
    for i, (a, b) in enumerate(itertools.pairwise(edges)):
        # The same standard draws in every scenario, so that scenarios differ by their size only.
        z = np.random.Generator(np.random.Philox(key(seed, Draw.TOLERANCE, i))).standard_normal(1 + n_later)
        gain = error.gain + error.gain_sd * float(z[0])
        yield slice(a, b), jittered(waveform, error.jitter_us * z[1:]), max(gain, -1.0)


def jittered(waveform: Waveform, delays_us: ArrayLike) -> Waveform:
    """The waveform whose pulses after the first come later.

    delays_us: (n_pulse - 1,) shifts [µs]; no pulse is moved to before t = 0.
    """
    first, *later = waveform.pulses
    delays = np.asarray(delays_us, dtype=np.float64)
    return Waveform(
        [first, *(replace(p, start_us=max(p.start_us + float(d), 0.0)) for p, d in zip(later, delays, strict=True))]
    )
