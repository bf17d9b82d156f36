"""Owns drift: what a waveform does to its lot once the pull-in voltages of the switches have moved.

Two ways. The plate's stiffness changes (creep, relaxed stress), and pull-in voltages by the same part; or charge is
trapped in an insulator, and they move by as many volts (van Spengen, J. Micromech. Microeng. 22, 074001, 2012). All
drifts act on the same switches, so that differences have paired intervals.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from softclose.evaluate import judge
from softclose.evaluate.pieces import Mapper, Sent, Work, here, respond_to_all
from softclose.metrics.objective import Assessment, Response
from softclose.metrics.paired import Comparison, compare
from softclose.population.lot import Lot
from softclose.settings import CampaignConfig
from softclose.waveform import Waveform

DriftKind = Literal["stiffness", "charge"]

KINDS: tuple[DriftKind, ...] = ("stiffness", "charge")

_STEPS = 24
"""Halvings of the way to where v_u has doubled."""


MOST_STIFFNESS = 10.0
"""A pull-in voltage of eleven times its own is another switch's."""


class DriftError(ValueError):
    """A drift that cannot be."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Drifted:
    """The lot after one drift."""

    drift: float
    """Of the pull-in voltages: relative (stiffness) or in volts (charge)."""
    assessment: Assessment
    """What the waveform does then."""
    comparison: Comparison
    """Against no drift, on the same switches."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Drift:
    """A waveform over a range of drifts."""

    kind: DriftKind
    rows: tuple[Drifted, ...]
    """One a drift, ascending."""
    doubled: tuple[float, float]
    """Largest negative and smallest positive drift at which v_u is twice what it is without; infinite where it is not
    within the range."""


def drifted(config: CampaignConfig, lot: Lot, kind: DriftKind, drift: float) -> tuple[CampaignConfig, Lot]:
    """Lot and campaign after a drift: what was measured on a switch was measured before.

    U_pi grows with sqrt(K): a relative drift d of it is K (1 + d)². Charge acts as a voltage between the plates: a
    drift of so many volts is that much less drive.
    """
    if kind == "stiffness":
        if not -1.0 < drift <= MOST_STIFFNESS:
            raise DriftError(
                f"a drift of {drift:g} is none of a switch; it must be above -1 (-100 %), which leaves no stiffness, "
                f"and at most {MOST_STIFFNESS:g}"
            )
        return config, lot.with_columns(K=lot["K"] * (1.0 + drift) ** 2)
    if not abs(drift) <= config.waveform.max_volts:
        raise DriftError(
            f"a drift of {drift:g} V is more than the drive (waveform.max_volts {config.waveform.max_volts:g})"
        )
    amplifier = replace(config.amplifier, offset_volts=config.amplifier.offset_volts - drift)
    return replace(config, amplifier=amplifier), lot


def drift(
    config: CampaignConfig,
    switches: Lot | ArrayLike,
    waveform: Waveform,
    kind: DriftKind,
    values: Sequence[float],
    *,
    mapper: Mapper = here,
    listener: Callable[[int, int], None] | None = None,
) -> Drift:
    """Assess a waveform under each drift.

    Parameters
    ----------
    config : CampaignConfig
        Objective, device model, drive.
    switches : Lot
        Independent random switches, as `softclose.evaluate.draw` gives them, before they drift; (n, 4) D, G, K, M where
        no condition needs more.
    waveform : Waveform
        What drives them.
    kind : {"stiffness", "charge"}
        See the module.
    values : sequence of float
        Drifts of the pull-in voltages, relative or in volts; 0 is always among them.
    mapper : Mapper
        Who simulates.
    listener : callable, optional
        Told (done, all).

    Returns
    -------
    Drift

    Raises
    ------
    DriftError
        For another kind, or a drift that cannot be.
    """
    if kind not in KINDS:
        raise DriftError(f"the kind of drift is {kind!r}; it must be one of {', '.join(KINDS)}")
    wanted = sorted({0.0, *(float(v) for v in values)})
    if not all(math.isfinite(v) for v in wanted):
        raise DriftError("a drift is no finite number")

    table = Lot.of(switches)

    sent = Sent(config)

    def after(value: float) -> Work:
        moved, lot = drifted(config, table, kind, value)
        return Work(sent=sent if moved is config else Sent(moved), lot=lot, drive=waveform)

    def under(*values: float) -> Iterator[tuple[Response, Assessment]]:
        for found in respond_to_all([after(value) for value in values], mapper):
            yield found, judge(config, found, fresh=True)

    answers = under(0.0, *(value for value in wanted if value != 0.0))
    still = next(answers)
    rows = []
    for k, value in enumerate(wanted, start=1):
        found = still if value == 0.0 else next(answers)
        comparison = compare(found, still, config.objective.confidence)
        rows.append(Drifted(drift=value, assessment=found[1], comparison=comparison))
        if listener is not None:
            listener(k, len(wanted))
    goal = 2.0 * still[1].v_u_cm_s

    def reached(value: float) -> float:
        return next(under(value))[1].v_u_cm_s

    return Drift(
        kind=kind, rows=tuple(rows), doubled=(_where(reached, rows, goal, -1.0), _where(reached, rows, goal, 1.0))
    )


def _where(v_u: Callable[[float], float], rows: Sequence[Drifted], goal: float, sign: float) -> float:
    """The first drift on one side at which v_u reaches the goal: between two rows, then by halving."""
    side = sorted((r for r in rows if sign * r.drift >= 0.0), key=lambda r: abs(r.drift))
    for near, far in itertools.pairwise(side):
        if not far.assessment.v_u_cm_s >= goal:
            continue
        low, high = near.drift, far.drift
        for _ in range(_STEPS):
            middle = 0.5 * (low + high)
            if abs(high - low) <= 1e-4 * max(abs(high), 1e-3):
                break
            low, high = (low, middle) if v_u(middle) >= goal else (middle, high)
        return float(np.round(0.5 * (low + high), 6))
    return sign * math.inf
