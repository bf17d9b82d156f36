"""Owns the shapes that charts draw: histograms, densities, convergence. Numbers only; drawing is elsewhere."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softclose.arrays import FloatArray
from softclose.metrics.intervals import clopper_pearson
from softclose.propose.dependence import Dependence
from softclose_workflows.report.data import ReportData

SPEED_STEP_CM_S = 0.25
"""Step of the axis of densities [cm/s]."""


def speed_edges(largest_cm_s: float) -> FloatArray:
    """Edges of histograms of V up to the largest: whole cm/s from 0 [cm/s]."""
    return np.arange(0.0, math.ceil(largest_cm_s if math.isfinite(largest_cm_s) else 1.0) + 1.5)


def shares(speed_cm_s: FloatArray, edges: FloatArray) -> FloatArray:
    """Histogram in per cent of the whole ensemble; what is missing to 100 never touched."""
    if speed_cm_s.size == 0:
        return np.zeros(len(edges) - 1)
    touched = speed_cm_s[np.isfinite(speed_cm_s)]
    return np.asarray(100.0 * np.histogram(touched, edges)[0] / speed_cm_s.size)


def speed_density(speed_cm_s: FloatArray, top_cm_s: float) -> tuple[FloatArray, FloatArray]:
    """Kernel estimate of the density of V among the switches in contact: speeds [cm/s], density [1/(cm/s)].

    Gaussian kernels with Silverman's width, mirrored at 0: a speed has no density below.
    Empty where fewer than two different speeds exist.
    """
    v = speed_cm_s[np.isfinite(speed_cm_s)]
    axis = np.arange(0.0, top_cm_s + SPEED_STEP_CM_S, SPEED_STEP_CM_S)
    return (axis, gaussian_density(v, axis, mirrors=(0.0,))) if v.size > 1 and np.ptp(v) > 0.0 else (axis[:0], axis[:0])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ExceedanceCurve:
    """P(V > v) among the switches in contact."""

    v_cm_s: FloatArray
    """(k,) speeds [cm/s], ascending."""
    probability: FloatArray
    """(k,) share of the switches that are faster; 0 beyond the fastest."""
    lower: FloatArray
    """(k,) Clopper and Pearson's interval, at each speed by itself."""
    upper: FloatArray
    """(k,) its upper end: above 0 also where no switch was so fast."""


def exceedance(speed_cm_s: FloatArray, top_cm_s: float, confidence: float) -> ExceedanceCurve:
    """Fraction of switches faster than v, up to top_cm_s; empty where no switch touched."""
    v = np.sort(speed_cm_s[np.isfinite(speed_cm_s)])
    axis = np.arange(0.0, top_cm_s + SPEED_STEP_CM_S, SPEED_STEP_CM_S) if v.size else np.empty(0)
    counts = v.size - np.searchsorted(v, axis, side="right")
    ends = np.array([clopper_pearson(int(count), v.size, confidence) for count in counts]).reshape(-1, 2)
    return ExceedanceCurve(v_cm_s=axis, probability=counts / max(v.size, 1), lower=ends[:, 0], upper=ends[:, 1])


def gaussian_density(sample: FloatArray, axis: FloatArray, *, mirrors: Sequence[float] = ()) -> FloatArray:
    """Density of a sample on an axis, in one over the axis's unit, with no loss at the bounds `mirrors`.

    Binned first: the cost does not grow with the sample.
    """
    quartiles = np.quantile(sample, [0.25, 0.75])
    spread = min(float(sample.std(ddof=1)), float(quartiles[1] - quartiles[0]) / 1.34 or math.inf)
    width = 0.9 * spread * sample.size**-0.2
    counts, edges = np.histogram(sample, 512)
    centres = 0.5 * (edges[1:] + edges[:-1])

    def kernels(at: FloatArray) -> FloatArray:
        z = (axis[:, None] - at[None]) / width
        return np.asarray(np.exp(-0.5 * z * z) @ counts)

    total = sum((kernels(2.0 * at - centres) for at in mirrors), start=kernels(centres))
    return np.asarray(total / (sample.size * width * math.sqrt(2.0 * math.pi)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Convergence:
    """g over the campaign."""

    index: FloatArray
    """(n,) candidates that have a g."""
    g_cm_s: FloatArray
    lower_cm_s: FloatArray
    """Ends of the intervals; NaN where none hold."""
    upper_cm_s: FloatArray
    best_cm_s: FloatArray
    """(n,) g of the best so far among the candidates of the same or a larger ensemble; a larger one starts afresh."""
    ceiling_cm_s: float
    """Top of an axis that shows the progress; candidates above it are drawn at it."""
    failed: FloatArray
    """Indices without a g."""
    larger: tuple[tuple[int, int], ...]
    """(candidate, switches) from which on a larger ensemble is used, where one follows a smaller one."""

    @property
    def steps(self) -> NDArray[np.intp]:
        """(m,) places where the best so far begins, changes and ends: its line needs no others."""
        return np.unique([*changes(self.best_cm_s), *range(self.best_cm_s.size)[-1:]]).astype(np.intp)


def convergence(data: ReportData) -> Convergence:
    """g, its interval and the best so far."""
    c = data.candidates.columns
    usable = np.flatnonzero(np.isfinite(c["g_cm_s"]) & ~data.candidates.failed)
    g = c["g_cm_s"][usable]
    best, larger = best_so_far(usable, g, c["rank_cm_s"][usable], data.candidates.n_switches[usable])
    ceiling = 1.0
    if len(g):
        low = float(g.min())
        ceiling = max(float(np.quantile(g, 0.6)), low + 10.0, 1.5 * low)
        ceiling = min(ceiling * 1.05, float(g.max()) * 1.05)
    return Convergence(
        index=usable.astype(np.float64),
        g_cm_s=g,
        lower_cm_s=c["g_lower_cm_s"][usable],
        upper_cm_s=c["g_upper_cm_s"][usable],
        best_cm_s=best,
        ceiling_cm_s=ceiling,
        failed=np.setdiff1d(np.arange(len(data.candidates)), usable).astype(np.float64),
        larger=larger,
    )


def changes(values: FloatArray) -> NDArray[np.intp]:
    """(m,) places where values (n,) begin and where they change."""
    return np.flatnonzero(np.diff(values, prepend=np.nan))


def best_so_far(
    index: NDArray[np.intp], g: FloatArray, rank: FloatArray, n_switches: NDArray[Any]
) -> tuple[FloatArray, tuple[tuple[int, int], ...]]:
    """(n,) g of the best so far among candidates of the same or a larger ensemble, and where a larger one begins.

    index, g, rank, n_switches: (n,) candidates that have a g, in order. Also (candidate, switches) of each larger
    ensemble.
    """
    best, lowest, largest = np.empty(len(g)), (math.inf, math.inf), 0
    larger = []
    for place, n in enumerate(map(int, n_switches)):
        if n > largest:
            if largest:
                larger.append((int(index[place]), n))
            lowest, largest = (math.inf, math.inf), n
        if n == largest:
            lowest = min(lowest, (float(rank[place]), float(g[place])))
        best[place] = lowest[1]
    return best, tuple(larger)


def length_scales(data: ReportData) -> dict[str, FloatArray]:
    """(n_candidate,) length scale of each parameter, NaN where no surrogate was asked; pulse by pulse."""
    prefix = "length_scale_"
    found = {
        name.removeprefix(prefix): values
        for name, values in data.candidates.surrogate.items()
        if name.startswith(prefix) and np.isfinite(values).any()
    }
    return dict(sorted(found.items(), key=lambda item: (item[0][-1], item[0])))


def dependence_span(d: Dependence) -> tuple[float, float]:
    """One axis of g for all parameters: every mean line, and bands of no more than twice their height [cm/s]."""
    lines = np.concatenate([d.mean_cm_s.ravel(), d.slice_cm_s.ravel()])
    low, high = float(lines.min()), float(lines.max())
    pad = 0.5 * max(high - low, 0.5)
    return max(low - pad, 0.0), high + pad
