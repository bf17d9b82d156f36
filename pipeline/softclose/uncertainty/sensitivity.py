"""Owns global sensitivity: what the spread of V and the failure to close come from (Sobol' indices).

Of the lot's four variables, and of whatever its conditions draw: errors of measurement, gain and clock, temperature.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softclose.arrays import FloatArray
from softclose.conditions.streams import Draw, key
from softclose.device.status import not_integrated
from softclose.evaluate import coordinates, realise, respond
from softclose.evaluate.pieces import Mapper, Sent, here, rows_of_pieces
from softclose.metrics.intervals import student_interval
from softclose.metrics.objective import CM_S, MAX_FAILED, in_time
from softclose.population import Population
from softclose.population.nets import scrambled_sobol
from softclose.settings import CampaignConfig, load_config
from softclose.waveform import Waveform

OUTPUTS = ("v_cm_s", "closed")


class SensitivityError(ValueError):
    """A sensitivity analysis that cannot be made."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SensitivityIndex:
    """Share of one output's variance that one variable accounts for. Estimates may stray below 0 or above 1."""

    output: str
    """`v_cm_s`: V with 0 for a switch that never touches (it hits with no speed); `closed`: 1 if closed, else 0."""
    variable: str
    """D, G, E, T or another variable of the lot, or what a condition draws, such as `gain`; correlated variables stand
    together, as `D and G`."""
    first: float
    """First-order index: the variable by itself. NaN where the output does not vary."""
    first_interval: tuple[float, float]
    """Its interval, from independent replicates."""
    total: float
    """Total index: by itself and in all its interactions."""
    total_interval: tuple[float, float]
    """Its interval, from independent replicates."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensitivity:
    """Sobol' indices of one waveform on one population."""

    indices: tuple[SensitivityIndex, ...]
    """One for each output and variable."""
    p_contact: float
    """Fraction of all simulated switches that touched: how much the 0 of `v_cm_s` matters."""
    p_closed: float
    """Fraction closed."""
    n_simulated: int
    """Switches simulated."""
    confidence: float
    """Confidence of the intervals."""


def _measured(piece: tuple[Sent, Waveform, FloatArray]) -> tuple[FloatArray, NDArray[np.bool_], int]:
    """V [µm/µs], held or not, of each switch at (n, n_variable) points of the unit cube; how many failed."""
    sent, waveform, points = piece
    drawn = coordinates(sent.config)
    parts = np.split(points, np.cumsum([len(c.parts) for c in drawn])[:-1], axis=1)
    r = respond(sent.config, realise(sent.config, {c.name: u for c, u in zip(drawn, parts, strict=True)}), waveform)
    held = in_time(r, sent.config.objective.closed_by_us)
    return np.asarray(r.max_contact_speed, dtype=np.float64), held, int((np.asarray(r.status) != 0).sum())


def together(parts: Sequence[str], correlated: Sequence[tuple[str, str, float]]) -> list[tuple[str, ...]]:
    """What is independent of everything else: single inputs, and those that correlations join, in the order given.

    Parameters
    ----------
    parts : sequence of str
        Inputs.
    correlated : sequence of (str, str, float)
        Pairs and their correlations.
    """
    joined = {part: {part} for part in parts}
    for one, other, rho in correlated:
        if rho != 0.0:
            both = joined[one] | joined[other]
            joined.update(dict.fromkeys(both, both))
    return list(dict.fromkeys(tuple(part for part in parts if part in joined[own]) for own in parts))


def sensitivity(
    population: Population,
    waveform: Waveform,
    *,
    n: int = 512,
    n_replicates: int = 8,
    seed: int = 0,
    confidence: float = 0.95,
    config: CampaignConfig | None = None,
    mapper: Mapper = here,
    listener: Callable[[int, int], None] | None = None,
) -> Sensitivity:
    """First-order and total Sobol' indices of V and of closing to what each switch is drawn from (Saltelli's scheme).

    n: points of each replicate, a power of 2; n_replicates independently scrambled Sobol sequences give the mean index
    and Student's interval, which quasi-random points by themselves could not. With d variables, (d + 2) n n_replicates
    switches are simulated.
    The indices need V of every point, also where a switch never touches: there V counts as 0, and `p_contact` says
    how often. V "among those in contact" has no such indices: contact makes the inputs dependent.
    Variables that the population correlates have indices together, `D and G`: the variance has no shares of each.
    config: whose device model and conditions apply; the defaults where it is left out. mapper: who simulates; listener:
    told (done, all). Same seed, same indices.
    """
    if n < 2 or n & (n - 1):
        raise SensitivityError(f"n is {n}; it must be a power of 2, such as 512 or 4096")
    if n_replicates < 2:
        raise SensitivityError(f"n_replicates is {n_replicates}; intervals need at least 2 (8 is usual)")
    from scipy.stats import sobol_indices

    settings = load_config({}) if config is None else config
    area = population.plate_area(None if config is None else config.model.plate_area_um2)
    settings = replace(
        settings, population_model=population.to_dict(), model=replace(settings.model, plate_area_um2=area)
    )
    parts = [part for c in coordinates(settings) for part in c.parts]
    groups = together(parts, population.correlation)
    sent = Sent(settings)
    touched = closed = total = failed = 0
    spread: list[FloatArray] = []

    def outputs(p: FloatArray) -> FloatArray:
        nonlocal touched, closed, total, failed
        pieces = [
            (sent, waveform, np.ascontiguousarray(p.T[rows.start : rows.stop]))
            for rows in rows_of_pieces(settings, p.shape[1])
        ]
        answers = list(mapper(_measured, pieces))
        v, held = (np.concatenate([answer[k] for answer in answers]) for k in (0, 1))
        total += v.size
        failed += sum(answer[2] for answer in answers)
        if failed > MAX_FAILED * max(total, n):
            raise SensitivityError(
                f"{not_integrated(failed, total)}, and what they would have done has no shares of variance: lower the "
                "voltage, or mend the device model"
            )
        touched += int((~np.isnan(v)).sum())
        closed += int(np.sum(held))
        out = np.stack([np.nan_to_num(v, nan=0.0) * CM_S, held.astype(np.float64)])
        spread.append(np.ptp(out, axis=1))
        return out

    replicates = []
    for i in range(n_replicates):
        rng = np.random.default_rng(key(seed, Draw.SENSITIVITY, i))
        spread.clear()
        with np.errstate(divide="ignore", invalid="ignore"):
            # The indices of a group are those of one input of several dimensions: its columns are exchanged together.
            a, b = scrambled_sobol(2 * len(parts), n, rng, bits=64).T.reshape(2, len(parts), n)
            exchanged = np.stack([np.where(np.isin(parts, group)[:, None], b, a) for group in groups])
            f_ab = outputs(np.concatenate(list(exchanged), axis=1)).reshape(len(OUTPUTS), len(groups), n)
            known = {"f_A": outputs(a), "f_B": outputs(b), "f_AB": f_ab.transpose(1, 0, 2)}
            found: Any = sobol_indices(func=known, n=n)
        indices = np.array([found.first_order, found.total_order])
        indices[:, np.max(spread, axis=0) == 0.0] = np.nan  # 0/0, which scipy calls 0
        replicates.append(indices)
        if listener is not None:
            listener(i + 1, n_replicates)
    table = np.array(replicates)  # replicate, first or total, output, variable
    return Sensitivity(
        indices=tuple(
            SensitivityIndex(
                output=output,
                variable=v,
                first=float(table[:, 0, i, j].mean()),
                first_interval=student_interval(table[:, 0, i, j], confidence),
                total=float(table[:, 1, i, j].mean()),
                total_interval=student_interval(table[:, 1, i, j], confidence),
            )
            for i, output in enumerate(OUTPUTS)
            for j, v in enumerate(map(" and ".join, groups))
        ),
        p_contact=touched / total,
        p_closed=closed / total,
        n_simulated=total,
        confidence=confidence,
    )
