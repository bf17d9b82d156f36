"""Owns the error of the device model itself: by how much the force and the times of the whole lot may be off.

A model is fitted to some devices, and what it cannot say is left over for all switches alike. It comes before
everything that is measured on a switch: a trim reads the switch as it is, not as the model has it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass as section

from softclose.allowed.types import SETTINGS
from softclose.arrays import FloatArray
from softclose.conditions.amplifier import normal_quantiles
from softclose.conditions.protocol import Case, Condition, Coordinate, Surroundings, Uniforms
from softclose.conditions.streams import Stream
from softclose.population.lot import Lot

_LEAST = 0.05
"""Least force or time over the model's own: normal errors have no end, switches do."""


@section(frozen=True, slots=True, kw_only=True, config=SETTINGS)
class ModelErrorSection:
    """By how much the device model may be off, for the whole lot; by default it is right."""

    force: Annotated[float, Field(ge=0, le=0.3)] = 0.0
    """Relative standard deviation of the electrostatic force over the model's own: twice that of a pull-in voltage."""
    time: Annotated[float, Field(ge=0, le=0.3)] = 0.0
    """Relative standard deviation of the switches' times over the model's own."""
    counts: Literal["mean", "worst"] = "mean"
    """mean: the lots that it may be count alike, each switch standing in one of them; worst: each switch counts at its
    worst of the model as it is and `reach` standard deviations either way, of the force and of the times."""
    reach: Annotated[float, Field(gt=0, le=4)] = 2.0
    """Standard deviations to which the worst is looked for."""

    @property
    def n_cases(self) -> int:
        """Cases in which every switch is simulated."""
        return 1 + 2 * (bool(self.force) + bool(self.time)) if self.counts == "worst" else 1

    @property
    def none(self) -> bool:
        """Whether the model is taken to be right."""
        return not (self.force or self.time)


def mistaken(lot: Lot, force: FloatArray | float, time: FloatArray | float) -> Lot:
    """A lot of which the model has the force and the times wrong.

    Parameters
    ----------
    lot : Lot
        Switches as the model has them.
    force : (n,) ndarray or float
        Relative error of the electrostatic force, of each or of all.
    time : (n,) ndarray or float
        Relative error of the times.

    Returns
    -------
    Lot
        A force larger by a factor moves a switch as one that is softer and lighter by it does (films and adhesion
        apart, which it does not change); times grow with the root of the mass. With the columns `force_error` and
        `time_error`.
    """
    n = (len(lot),)
    f, t = (np.broadcast_to(np.asarray(x, dtype=np.float64), n) for x in (force, time))
    k = lot["K"] / np.maximum(1.0 + f, _LEAST)
    m = lot["M"] / np.maximum(1.0 + f, _LEAST) * np.maximum(1.0 + t, _LEAST) ** 2
    return lot.with_columns(K=k, M=m, force_error=f, time_error=t)


@dataclass(frozen=True, slots=True)
class UncertainModel(Condition):
    """Lots that the model may be wrong about, weighed alike or at their worst."""

    section: ClassVar[str] = "model_error"
    settings: ModelErrorSection

    @classmethod
    def of(cls, settings: Any, around: Surroundings) -> Self | None:
        """None where the model is taken to be right."""
        return None if settings.none else cls(settings)

    @classmethod
    def assumed(cls, e: ModelErrorSection) -> list[str]:
        """What it rests on."""
        facts = [
            *([f"its force by {100 * e.force:g} %"] if e.force else []),
            *([f"its times by {100 * e.time:g} %"] if e.time else []),
        ]
        if not facts:
            return []
        said = f"The device model may be off for the whole lot, {' and '.join(facts)} (standard deviation)"
        if e.counts == "worst":
            return [f"{said}: each switch counts at its worst of either error up to {e.reach:g} standard deviations."]
        return [f"{said}: the figures are those of the lots that it may be, weighed alike."]

    @property
    def coordinates(self) -> tuple[Coordinate, ...]:  # type: ignore[override]
        """Two, where lots that it may be count alike."""
        if self.settings.counts == "worst":
            return ()
        return (Coordinate(name="model_error", stream=Stream.MODEL_ERROR, parts=("force error", "time error")),)

    @property
    def columns(self) -> tuple[str, ...]:  # type: ignore[override]
        """Both errors, where lots that it may be count alike."""
        return () if self.settings.counts == "worst" else ("force_error", "time_error")

    def lot(self, lot: Lot, u: Uniforms) -> Lot:
        """Each switch in a lot of its own, whose error is normal; the same for every candidate."""
        s = self.settings
        if s.counts == "worst":
            return lot
        force, time = (np.array([s.force, s.time]) * normal_quantiles(u["model_error"][:, :2])).T
        return mistaken(lot, force, time)

    def cases(self) -> tuple[Case, ...]:
        """The model as it is, and either end of either error."""
        s = self.settings
        if s.counts == "mean":
            return ()
        ends = [(0.0, 0.0), *((sign * s.reach * s.force, 0.0) for sign in (-1.0, 1.0) if s.force)]
        ends += [(0.0, sign * s.reach * s.time) for sign in (-1.0, 1.0) if s.time]
        return tuple(
            Case(
                name=f"force {100.0 * f:+.1f} %, times {100.0 * t:+.1f} %",
                at=(("force_error", f), ("time_error", t)),
                change=partial(mistaken, force=f, time=t),
            )
            for f, t in ends
        )
