"""Owns what a surrogate can be asked after a campaign: which parameters matter, how g depends on one and two of them.

The process is fitted by the skopt engine's own function, on the recorded history: nothing here fits differently.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve
from threadpoolctl import threadpool_limits

from softclose.arrays import FloatArray
from softclose.propose.protocol import Observation, Problem, search_history
from softclose.waveform.coordinates import FAR

MIN_CANDIDATES = 5
"""Usable candidates below which a surrogate says nothing worth printing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LeftOut:
    """How well the process foretells each candidate from all the others, n of them."""

    error_cm_s: FloatArray
    """(n,) foretold g minus the recorded one [cm/s]."""
    sd_cm_s: FloatArray
    """(n,) the process's own standard deviation of that [cm/s], noise included."""

    @property
    def median_error_cm_s(self) -> float:
        """Median of the errors' magnitude [cm/s]."""
        return float(np.median(np.abs(self.error_cm_s)))

    @property
    def share_inside(self) -> float:
        """Share of the candidates that lie within two standard deviations of what was foretold."""
        return float(np.mean(np.abs(self.error_cm_s) <= 2.0 * self.sd_cm_s))


@dataclass(frozen=True, slots=True, kw_only=True)
class Dependence:
    """What the Gaussian process predicts of g, d parameters of the search space."""

    names: tuple[str, ...]
    """Names of the parameters, as in the search space."""
    length_scales: FloatArray
    """(d,) of the fit, in units of the search range: short means that g reacts strongly."""
    incumbent: FloatArray
    """(d,) best recorded point, in physical units."""
    grid: FloatArray
    """(d, n_grid) values of each parameter, in its physical unit: where the better half of the candidates is."""
    mean_cm_s: FloatArray
    """(d, n_grid) partial dependence: expected g averaged over the recorded points [cm/s]."""
    slice_cm_s: FloatArray
    """(d, n_grid) expected g on the line through the best point [cm/s]."""
    slice_sd_cm_s: FloatArray
    """(d, n_grid) the surrogate's standard deviation there [cm/s]."""
    pairs: tuple[tuple[int, int], ...]
    """Pairs of parameters, those that matter most first."""
    pair_grid: FloatArray
    """(d, n_pair_grid) values of each parameter in the pairs' maps."""
    pair_cm_s: FloatArray
    """(n_pair, n_pair_grid, n_pair_grid) expected g with all other parameters at the best point [cm/s]: an average over
    the candidates would show the best one among the worst. The first of the pair runs along the last axis; NaN where no
    candidate is near."""
    tried: FloatArray
    """(n, d) the candidates of the fit, in physical units."""
    left_out: LeftOut
    """Leave-one-out errors of the candidates whose g was not cut off."""


def surrogate_dependence(
    problem: Problem,
    history: Sequence[Observation],
    *,
    n_grid: int = 41,
    n_pair_grid: int = 17,
    n_average: int = 48,
    max_pairs: int = 21,
) -> Dependence | None:
    """How g depends on one parameter and on two, from a fit to the recorded search.

    None where fewer than MIN_CANDIDATES usable candidates lie in the search space, or the process cannot be fitted.
    g far above its median is cut off before the fit: high plateaus are lower bounds, and the logarithm that the engine
    takes cannot be averaged back.
    """
    from softclose.propose.surrogate import clipped, collect, fit  # imported where it is used: skopt is slow to import

    data = collect(problem, search_history(problem, history))
    if len(data.g) < MIN_CANDIDATES:
        return None
    y, per_cm_s = clipped(data.g)
    with threadpool_limits(limits=1), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # bounds of the length scales are met often, as in the engine
        try:
            model = fit(data.points, y, problem.config.optimiser.fit_iterations)
        except (np.linalg.LinAlgError, ValueError, FloatingPointError):
            return None
        best = int(np.argmin(data.g))
        # y = (g - offset) * per_cm_s, and the best candidate is never cut off.
        offset = float(data.g[best] - y[best] / per_cm_s)

        def expected(points: FloatArray) -> FloatArray:
            return np.asarray(model.predict(points), dtype=np.float64) / per_cm_s + offset

        fitted = np.asarray(model.kernel_.get_params()["k1__k2__length_scale"], dtype=np.float64)
        scales = np.broadcast_to(fitted, (problem.space.dim,)).copy()
        d, point = problem.space.dim, data.points[best]
        low, high = _useful(data.points[data.g <= np.median(data.g)])
        unit = np.linspace(low, high, n_grid).T
        average = data.points[np.unique(np.linspace(0, len(data.points) - 1, n_average).astype(int))]
        mean, line, sd = (np.empty((d, n_grid)) for _ in range(3))
        for j in range(d):
            mean[j] = _averaged(expected, average, (j,), unit[j][:, None])
            on_line = np.repeat(point[None], n_grid, axis=0)
            on_line[:, j] = unit[j]
            _, std = model.predict(on_line, return_std=True)
            line[j], sd[j] = expected(on_line), np.asarray(std) / per_cm_s
        coarse = np.linspace(low, high, n_pair_grid).T
        pairs = tuple(sorted(combinations(range(d), 2), key=lambda p: float(scales[p[0]] * scales[p[1]])))[:max_pairs]
        left_out = _left_out(model.L_, model.y_train_, per_cm_s, float(np.median(y)))

        def mapped(pair: tuple[int, int]) -> FloatArray:
            first, second = np.meshgrid(*coarse[list(pair)])
            both = np.column_stack([first.ravel(), second.ravel()])
            reach = high[list(pair)] - low[list(pair)]
            near = _near(data.points[:, pair] / reach, both / reach)
            return np.where(near, _averaged(expected, point[None], pair, both), np.nan)

        maps = [mapped(pair) for pair in pairs]
    axes = problem.space.coordinates
    return Dependence(
        names=problem.space.names,
        length_scales=scales,
        incumbent=np.array([float(c.value(point[i : i + 1])[0]) for i, c in enumerate(axes)]),
        grid=np.array([c.value(unit[i]) for i, c in enumerate(axes)]),
        mean_cm_s=mean,
        slice_cm_s=line,
        slice_sd_cm_s=sd,
        pairs=pairs,
        pair_grid=np.array([c.value(coarse[i]) for i, c in enumerate(axes)]),
        tried=np.array([c.value(data.points[:, i]) for i, c in enumerate(axes)]).T,
        left_out=left_out,
        pair_cm_s=np.array(maps).reshape(len(pairs), n_pair_grid, n_pair_grid),
    )


def _left_out(factor: FloatArray, y: FloatArray, per_cm_s: float, most: float) -> LeftOut:
    """Leave-one-out in closed form, Eqs. 5.10-5.12 of Rasmussen and Williams (2006): one factor serves all n.

    factor: (n, n) Cholesky's, of the covariance with noise, rows as y. most: largest y that counts; what lies above was
    cut off. Hyperparameters stay those of the fit to all.
    """
    kept = y <= most
    inverse = cho_solve((factor, True), np.eye(len(y)))
    variance = 1.0 / np.diag(inverse)
    error = -(inverse @ y) * variance
    return LeftOut(error_cm_s=error[kept] / per_cm_s, sd_cm_s=np.sqrt(variance[kept]) / per_cm_s)


BESIDE = 0.25
"""Part of the spread of the better half of the candidates by which curves and maps go on beside it."""
LEAST_SPAN = 0.04
"""Least span of a curve or map, in units of the search range."""


def _useful(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(d,) where curves and maps begin and end: where the better candidates (n, d) are, and a little beside them.

    Over the whole search range the region that matters would be a dot; in a tail nobody tried anything.
    """
    low, high = points.min(axis=0), points.max(axis=0)
    pad = np.maximum(BESIDE * (high - low), 0.5 * LEAST_SPAN)
    low, high = np.maximum(low - pad, FAR), np.minimum(high + pad, 1.0 - FAR)
    # A candidate in a tail keeps its place on the curve.
    return np.minimum(low, points.min(axis=0)), np.maximum(high, points.max(axis=0))


NEAR = 0.15
"""How far from the nearest candidate, in units of the span of both parameters, a map still says something."""


def _near(points: FloatArray, grid: FloatArray) -> NDArray[np.bool_]:
    """(n_grid,) whether any of `points` (n, 2) is within NEAR of each place."""
    distance = np.linalg.norm(grid[:, None] - points[None], axis=2)
    return np.asarray(distance.min(axis=1) <= NEAR)


def _averaged(
    expected: Callable[[FloatArray], FloatArray], points: FloatArray, axes: tuple[int, ...], values: FloatArray
) -> FloatArray:
    """(n_value,) mean over `points` of the expectation with the coordinates `axes` set to each row of values."""
    stacked = np.repeat(points[None], len(values), axis=0)
    stacked[:, :, list(axes)] = values[:, None, :]
    found = expected(stacked.reshape(-1, points.shape[1])).reshape(len(values), len(points))
    return np.asarray(found.mean(axis=1))
