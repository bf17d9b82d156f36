"""Owns questions about one waveform of a store: what errors of its generator do, what its spread comes from."""

from __future__ import annotations

import math
from collections.abc import Sequence

from softclose.evaluate.pieces import Mapper, here
from softclose.uncertainty.sensitivity import Sensitivity
from softclose.uncertainty.sensitivity import sensitivity as analyse
from softclose.uncertainty.tolerance import DEFAULT_ERRORS, DriveError, DriveTolerance, drive_tolerance
from softclose_workflows.analyses.certify import fresh_switches
from softclose_workflows.analyses.chosen import Chosen, choose
from softclose_workflows.run.needs import check, check_fresh, of_ensemble
from softclose_workflows.tell.console import OnStep
from softclose_workflows.tell.labels import signed


def tolerance(
    path: str,
    errors: Sequence[DriveError] = (),
    *,
    candidate: int | None = None,
    n_switches: int = 20_000,
    n_generators: int = 64,
    mapper: Mapper = here,
    listener: OnStep | None = None,
) -> tuple[Chosen, list[DriveTolerance]]:
    """A waveform under each error by itself, by default a usual set of them, on the certification's new switches."""
    check_fresh(n_switches, 1)
    chosen = choose(path, candidate)
    wanted = errors or DEFAULT_ERRORS
    return chosen, tolerance_of(
        chosen, wanted, n_switches=n_switches, n_generators=n_generators, mapper=mapper, listener=listener
    )


def tolerance_of(
    chosen: Chosen,
    errors: Sequence[DriveError],
    *,
    n_switches: int,
    n_generators: int = 64,
    mapper: Mapper = here,
    listener: OnStep | None = None,
) -> list[DriveTolerance]:
    """A chosen waveform under each error by itself, on the certification's new switches."""
    rows = drive_tolerance(
        fresh_switches(chosen.config, n_switches, seed=chosen.seed),
        chosen.waveform,
        errors=errors,
        n_generators=n_generators,
        seed=chosen.seed,
        config=chosen.config,
        mapper=mapper,
        listener=listener,
    )
    return list(rows)


def sensitivity(
    path: str,
    *,
    candidate: int | None = None,
    points: int = 512,
    replicates: int = 8,
    seed: int = 0,
    mapper: Mapper = here,
    listener: OnStep | None = None,
) -> tuple[Chosen, Sensitivity]:
    """Shares of the variance of V and of closing that come from each of D, G, E and T."""
    # One replicate is simulated at once: n points, and n for each of the four variables exchanged, twice over.
    check(
        of_ensemble(6 * max(points, 0)), f"{points:,} points of 4 variables", "lower --points; --replicates helps too"
    )
    chosen = choose(path, candidate)
    found = analyse(
        chosen.config.build_population(),
        chosen.waveform,
        n=points,
        n_replicates=replicates,
        seed=seed,
        confidence=chosen.config.objective.confidence,
        config=chosen.config,
        mapper=mapper,
        listener=listener,
    )
    return chosen, found


def describe(error: DriveError) -> str:
    """`gain +1 %`, `perfect`, …"""
    parts = []
    if error.gain:
        parts.append(f"gain {signed(100.0 * error.gain, 2)} %")
    if error.gain_sd:
        parts.append(f"gain ± {100.0 * error.gain_sd:.2f} % (sd)")
    if error.jitter_us:
        parts.append(f"jitter {error.jitter_us:g} µs (sd)")
    if math.isfinite(error.slew_volts_per_us):
        parts.append(f"slew {error.slew_volts_per_us:g} V/µs")
    return ", ".join(parts) or "perfect"
