"""Owns the fit: weighted least squares from several starts, intervals, and what the data cannot tell, by name.

Parameters are fitted by their logarithms. The Jacobian of the weighted residuals has the singular values s: along its
direction the data know the parameters to 1/s. A direction that they know to no better than a factor is not told: its
parameters are named and have no interval, and the leading one stays where the campaign has it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from softclose.arrays import FloatArray
from softclose.device.device import Device
from softclose.identify.model import PARAMETERS, Model, predicted
from softclose.identify.readings import Dynamics, Reading
from softclose.metrics.intervals import Interval
from softclose.plugins import REDUCED_ORDER, SINGLE_MODE
from softclose.population.measurements import MeasurementError

UNTOLD = 0.5
"""Standard deviation of a logarithm from which a direction counts as not told: a factor of 1.6 either way."""
PART = 0.1
"""Parameters with less than this part of a direction's largest one do not belong to it."""
N_STARTS = 6
SPREAD = 0.25
"""Standard deviation of the starts about the campaign's own values, of logarithms."""
_REACH = math.log(30.0)
_HOLD = 1e-3
"""Pull towards the campaign's own values in errors per unit of a logarithm: what nothing tells stays there."""
_STEP = 2e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class Told:
    """One parameter."""

    value: float
    """Fitted; where it is not told, the campaign's own, or what goes with that."""
    interval: Interval
    """At the fit's confidence; (0, inf) where it is not told."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Untold:
    """What the data leave open: these parameters may change together, each by its power of one factor."""

    powers: dict[str, float]
    """Parameter -> power; the largest is 1."""

    def __str__(self) -> str:
        names = list(self.powers)
        if len(names) == 1:
            return f"nothing in these readings tells {names[0]}"
        changed = " and ".join(f"{n} to {1.1**p:.3g}" for n, p in self.powers.items())
        return f"{', '.join(names[:-1])} and {names[-1]} are not told apart: {changed} times gives the same readings"


@dataclass(frozen=True, slots=True, kw_only=True)
class Identified:
    """What was found."""

    parameters: dict[str, Told]
    """Those that were free."""
    fixed: dict[str, float]
    """Those that were not."""
    untold: tuple[Untold, ...]
    """What the readings leave open."""
    confidence: float
    """Of every interval."""
    misfit: float
    """Root mean square of the residuals in errors, per degree of freedom; NaN where there are none left."""
    freedom: int
    """Residuals less parameters that are told."""
    said: tuple[float, ...]
    """What the fitted model says of each reading."""
    readings: tuple[Reading, ...]
    """The readings."""
    agreeing: int
    """Starts that ended within 1 % of the best sum of squares."""
    starts: int
    """Starts."""
    switch: FloatArray
    """(4,) D, G [µm], K [N/m], M [µg]."""
    device: Device
    """The device model with what was found."""
    factors: dict[str, FloatArray]
    """Device -> (2,) its K and M over the fitted ones; empty of one device."""

    @property
    def values(self) -> dict[str, float]:
        """Every parameter's value, fixed ones too."""
        return self.fixed | {name: told.value for name, told in self.parameters.items()}

    def off(self, *kinds: str) -> float:
        """Root mean square of ln(said / measured) over the readings of some kinds, weighed by their errors, per degree
        of freedom; NaN where there are none."""
        chosen = [
            (math.log(s / r.value), r.weighed) for s, r in zip(self.said, self.readings, strict=True) if r.kind in kinds
        ]
        if not chosen or self.freedom <= 0:
            return math.nan
        logs, errors = np.array(chosen).T
        n = self.freedom + sum(not math.isinf(told.interval[1]) for told in self.parameters.values())
        return math.sqrt(float(np.average(logs**2, weights=errors**-2.0)) * n / self.freedom)

    @property
    def force_error(self) -> float:
        """Relative error of the force that the model leaves in static voltages: twice that of a voltage."""
        return 2.0 * self.off("pull-in", "pull-out")

    @property
    def time_error(self) -> float:
        """Relative error that it leaves in times and resonances."""
        return self.off("closing", "second contact", "resonance")


def identify(
    model: Model,
    dynamics: Dynamics,
    *,
    fixed: Mapping[str, float | None] | None = None,
    confidence: float = 0.95,
    n_starts: int = N_STARTS,
    seed: int = 0,
) -> Identified:
    """Fit a device model to what was measured, by weighted least squares from several starts.

    Parameters
    ----------
    model : Model
        Where it begins.
    dynamics : Dynamics
        What was measured; where several devices were, each then gets a K and an M of its own about the lot's.
    fixed : mapping, optional
        Parameter -> value at which it is not fitted; None: the model's own.
    confidence : float
        Of the intervals: those of Student's t, with the scatter that the residuals have about the fit.
    n_starts : int
        Starts: the model's own, and others about it.
    seed : int
        Of those others.

    Returns
    -------
    Identified

    Raises
    ------
    MeasurementError
        For a device model of somebody else's, a parameter that the model has not, or fewer readings than parameters
        that they could tell.
    """
    if model.device.name not in (SINGLE_MODE, REDUCED_ORDER):
        raise MeasurementError(f"the device model {model.device.name!r} has no parameters to fit: use a shipped one")
    if not dynamics.n:
        raise MeasurementError("there are no readings: give one table or more")
    if not 0.0 < confidence < 1.0:
        raise MeasurementError(f"confidence is {confidence:g}; it must lie between 0 and 1")
    own = model.values()
    held = _held(own, fixed or {})
    free = [name for name in own if name not in held]
    if not free:
        raise MeasurementError("every parameter is fixed: leave one free")
    center = np.log([own[name] for name in free])

    def values(logs: FloatArray) -> dict[str, float]:
        return held | dict(zip(free, np.exp(logs).tolist(), strict=True))

    def residuals(logs: FloatArray) -> FloatArray:
        return model.residuals(values(logs), dynamics)

    best, costs = _fit(residuals, center, np.ones(center.size, dtype=np.bool_), free, n_starts, seed)
    moving = np.ones(center.size, dtype=np.bool_)
    while True:  # each round holds one parameter more, or is the last
        singular, directions, told, misfit, freedom = _known(_jacobian(residuals, best), residuals(best))
        untold = _named(directions[~told], free)
        leading = [free.index(max(each.powers, key=lambda n: abs(each.powers[n]))) for each in untold]
        if all(not moving[i] for i in leading):
            break
        moving[leading] = False
        best[leading] = center[leading]
        if moving.any():
            best, _ = _fit(residuals, center, moving, free, 1, seed, best)
    open_ones = {name for each in untold for name in each.powers}
    deviations = np.sqrt(((directions[told] / singular[told, None]) ** 2).sum(axis=0))
    reach = _quantile(confidence, freedom) * (misfit if freedom > 0 else 1.0)
    parameters = {
        name: Told(
            value=math.exp(log),
            interval=(0.0, math.inf)
            if name in open_ones
            else (math.exp(log - reach * sd), min(math.exp(log + reach * sd), _most(name))),
        )
        for name, log, sd in zip(free, best.tolist(), deviations.tolist(), strict=True)
    }
    switch, device = model.at(values(best))
    return Identified(
        parameters=parameters,
        fixed=held,
        untold=untold,
        confidence=confidence,
        misfit=misfit,
        freedom=freedom,
        said=tuple(predicted(switch, device, dynamics.readings, model.rise_us)),
        readings=dynamics.readings,
        agreeing=int((np.array(costs) <= 1.01 * min(costs) + 1e-9).sum()),
        starts=len(costs),
        switch=switch,
        device=device,
        factors=_each_device(model, dynamics, values(best), [n for n in ("K", "M") if n in parameters]),
    )


def _held(own: Mapping[str, float], fixed: Mapping[str, float | None]) -> dict[str, float]:
    held: dict[str, float] = {}
    for name, value in fixed.items():
        if name not in own:
            why = "is no parameter" if name not in PARAMETERS else "is no part of this device model"
            raise MeasurementError(f"{name} {why}; it has {', '.join(own)}")
        held[name] = own[name] if value is None else float(value)
        if not 0.0 < held[name] <= _most(name):
            raise MeasurementError(f"{name} is fixed at {held[name]:g}; it must be above 0 and at most {_most(name):g}")
    return held


def _most(name: str) -> float:
    return 1.0 if name == "restitution" else math.inf


def _fit(  # type: ignore[no-untyped-def]
    residuals,
    center: FloatArray,
    moving: NDArray[np.bool_],
    free: list[str],
    n_starts: int,
    seed: int,
    begin: FloatArray | None = None,
) -> tuple[FloatArray, list[float]]:
    """The best end of several starts, and the sum of squares of each; what does not move stays where it begins."""
    from scipy.optimize import least_squares

    high = np.minimum(center + _REACH, [math.log(_most(name)) for name in free])
    low = center - _REACH
    first = center if begin is None else begin

    def whole(part: FloatArray) -> FloatArray:
        logs = first.copy()
        logs[moving] = part
        return logs

    def held(part: FloatArray) -> FloatArray:
        return np.concatenate([residuals(whole(part)), _HOLD * (part - center[moving])])

    starts = first + SPREAD * np.random.default_rng(seed).standard_normal((max(n_starts, 1), center.size))
    starts[0] = first
    ends = [
        least_squares(
            held,
            np.clip(start, low + 1e-6, high - 1e-6)[moving],
            bounds=(low[moving], high[moving]),
            diff_step=_STEP,
            max_nfev=60,
        )
        for start in starts
    ]
    best = min(ends, key=lambda end: float(end.cost))
    return whole(best.x), [2.0 * float(end.cost) for end in ends]


def _known(jacobian: FloatArray, left: FloatArray) -> tuple[FloatArray, FloatArray, NDArray[np.bool_], float, int]:
    """Singular values of all p directions, the directions as rows, which of them are told, misfit, and freedom.

    The scatter is that of the residuals, but never less than the errors that were stated.
    """
    n, p = jacobian.shape
    _, singular, directions = np.linalg.svd(jacobian, full_matrices=True)
    singular = np.concatenate([singular, np.zeros(p - singular.size)])
    told = singular * UNTOLD > 1.0
    freedom = n - int(told.sum())
    misfit = math.sqrt(float(left @ left) / freedom) if freedom > 0 else math.nan
    if freedom > 0:
        told = singular * UNTOLD > max(misfit, 1.0)
    return singular, directions, told, misfit, freedom


def _jacobian(residuals, at: FloatArray) -> FloatArray:  # type: ignore[no-untyped-def]
    """(n, p) by central differences of logarithms."""
    steps = _STEP * np.eye(at.size)
    return np.stack([(residuals(at + h) - residuals(at - h)) / (2.0 * _STEP) for h in steps], axis=1)


def _named(directions: FloatArray, free: list[str]) -> tuple[Untold, ...]:
    """The open directions, each with as few parameters as can be (row echelon form of what spans them)."""
    rows = directions.copy()
    for k in range(len(rows)):
        row, column = divmod(int(np.argmax(np.abs(rows[k:]))), rows.shape[1])
        rows[[k, k + row]] = rows[[k + row, k]]
        rows[k] /= rows[k, column]
        for other in range(len(rows)):
            if other != k:
                rows[other] -= rows[other, column] * rows[k]
    return tuple(
        Untold(powers={n: float(p) for n, p in zip(free, row / np.abs(row).max(), strict=True) if abs(p) > PART})
        for row in rows
    )


def _quantile(confidence: float, freedom: int) -> float:
    from scipy.stats import norm, t

    upper = 0.5 + 0.5 * confidence
    return float(t.ppf(upper, freedom)) if freedom > 0 else float(norm.ppf(upper))


def _each_device(model: Model, dynamics: Dynamics, values: dict[str, float], own: list[str]) -> dict[str, FloatArray]:
    """K and M of each device over the lot's, everything else as the lot's; those that its readings tell."""
    from scipy.optimize import least_squares

    if len(dynamics.devices) < 2 or not own:
        return {}
    found: dict[str, FloatArray] = {}
    for name in dynamics.devices:
        of_it = dynamics.of(name)

        def residuals(logs: FloatArray, of_it: Dynamics = of_it) -> FloatArray:
            changed = {n: values[n] * math.exp(x) for n, x in zip(own, logs.tolist(), strict=True)}
            return np.concatenate([model.residuals(values | changed, of_it), _HOLD * logs])

        end = least_squares(residuals, np.zeros(len(own)), diff_step=_STEP, x_scale=1.0, max_nfev=40)
        factors = dict(zip(own, np.exp(end.x).tolist(), strict=True))
        found[name] = np.array([factors.get("K", 1.0), factors.get("M", 1.0)])
    return found
