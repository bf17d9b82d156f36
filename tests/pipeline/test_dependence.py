"""Claims about partial dependence: it finds what matters in a history whose truth is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bowl import observation
from softclose.propose import dependence
from softclose.propose.dependence import Dependence, surrogate_dependence
from softclose.propose.protocol import Observation, Problem
from softclose.settings import load_config


def problem() -> Problem:
    return Problem(load_config({"campaign": {"budget": 60}, "waveform": {"space": "two-pulse-paper"}}))


def history(of: Problem, n: int = 60) -> list[Observation]:
    """g is a parabola in the second pulse's voltage, with its minimum at 0.6 of the range, and nothing else."""
    j = of.space.names.index("volts2")
    points = np.random.default_rng(5).random((n, of.space.dim))
    found = []
    for i, point in enumerate(points):
        waveform = of.space.waveform(point)
        at = of.space.coordinates_of(waveform)[j]
        g = 20.0 + 40.0 * (at - 0.6) ** 2
        found.append(observation(i, waveform, g))
    return found


@pytest.fixture(scope="module")
def learned() -> Dependence:
    of = problem()
    found = surrogate_dependence(of, history(of))
    assert found is not None
    return found


def test_the_only_parameter_that_matters_has_the_shortest_length_scale(learned: Dependence) -> None:
    assert learned.names[int(np.argmin(learned.length_scales))] == "volts2"
    j = learned.names.index("volts2")
    spans = np.ptp(learned.mean_cm_s, axis=1)
    assert spans[j] > 10.0 * np.delete(spans, j).max()
    assert all(j in pair for pair in learned.pairs[: len(learned.names) - 1])


def test_dependence_has_its_minimum_where_the_objective_has(learned: Dependence) -> None:
    j = learned.names.index("volts2")
    unit = problem().space.coordinates[j].unit(learned.grid[j])
    for curve in (learned.mean_cm_s[j], learned.slice_cm_s[j]):
        assert unit[int(np.argmin(curve))] == pytest.approx(0.6, abs=0.06)
    assert learned.slice_cm_s[j].min() == pytest.approx(20.0, abs=0.3)


def test_maps_agree_with_the_curves_through_the_best(monkeypatch: pytest.MonkeyPatch) -> None:
    """A map's own average along the parameter that does not matter is the curve of the one that does."""
    monkeypatch.setattr(dependence, "NEAR", 9.0)
    of = problem()
    learned = surrogate_dependence(of, history(of))
    assert learned is not None
    j = learned.names.index("volts2")
    place = next(k for k, pair in enumerate(learned.pairs) if j in pair)
    along = 0 if learned.pairs[place][0] == j else 1
    curve = learned.pair_cm_s[place].mean(axis=along)
    expected = np.interp(learned.pair_grid[j], learned.grid[j], learned.slice_cm_s[j])
    np.testing.assert_allclose(curve, expected, atol=0.3)


def test_a_map_says_nothing_where_no_candidate_is_near(learned: Dependence) -> None:
    axes = problem().space.coordinates
    for (i, j), values in zip(learned.pairs, learned.pair_cm_s, strict=True):
        u, v = (axes[k].unit(learned.pair_grid[k]) for k in (i, j))
        tried = np.column_stack([axes[k].unit(learned.tried[:, k]) for k in (i, j)])
        spans = np.ptp(u), np.ptp(v)
        for row, col in ((0, 0), (8, 3), (16, 16)):
            near = np.hypot(*((tried - (u[col], v[row])) / spans).T).min()
            assert np.isnan(values[row, col]) == (near > dependence.NEAR)
    assert np.isnan(learned.pair_cm_s).any()


def test_curves_and_maps_show_where_the_better_candidates_are(learned: Dependence) -> None:
    """Over the whole search range what matters is a dot."""
    j = learned.names.index("volts2")
    axis = problem().space.coordinates[j]
    u = axis.unit(learned.grid[j])
    assert u[0] > 0.05  # the better half of the candidates lies between 0.35 and 0.85 of it
    assert u[-1] < 0.999
    g = np.array([o.g_cm_s for o in history(problem())])
    for k, coordinate in enumerate(problem().space.coordinates):
        tried = coordinate.unit(learned.tried[g <= np.median(g), k])
        for grid in (coordinate.unit(learned.grid[k]), coordinate.unit(learned.pair_grid[k])):
            assert grid[0] <= tried.min() + 1e-9
            assert grid[-1] >= tried.max() - 1e-9
            assert np.ptp(grid) <= 1.5 * np.ptp(tried) + 1e-9


def test_the_best_candidate_lies_in_the_best_colours_of_every_map() -> None:
    """In a valley that runs askew, an average over all candidates would not show it so."""
    of = problem()
    i, j = of.space.names.index("volts2"), of.space.names.index("delay2")
    askew = []
    for o in history(of, 90):
        at = of.space.coordinates_of(o.waveform)
        g = float(20.0 + 40.0 * (at[i] + at[j] - 1.0) ** 2 - 4.0 * at[i])
        askew.append(replace(o, g_cm_s=g, rank_cm_s=g))
    learned = surrogate_dependence(of, askew)
    assert learned is not None
    for (a, b), values in zip(learned.pairs, learned.pair_cm_s, strict=True):
        row = int(np.argmin(np.abs(learned.pair_grid[b] - learned.incumbent[b])))
        column = int(np.argmin(np.abs(learned.pair_grid[a] - learned.incumbent[a])))
        if {a, b} & {i, j}:
            assert values[row, column] - np.nanmin(values) < 0.1 * np.nanmax(values - np.nanmin(values))


def test_leave_one_out_is_what_a_fit_without_that_candidate_foretells() -> None:
    """The oracle: a plain Gaussian process on all but one, with the same covariance."""
    rng = np.random.default_rng(8)
    x, y = rng.random((12, 2)), rng.standard_normal(12)
    covariance = np.exp(-((x[:, None] - x[None]) ** 2).sum(axis=2)) + 0.05 * np.eye(12)
    found = dependence._left_out(np.linalg.cholesky(covariance), y, 4.0, float(np.median(y)))
    assert len(found.error_cm_s) == 6
    for place, i in enumerate(np.flatnonzero(y <= np.median(y))):
        others = np.arange(12) != i
        weights = np.linalg.solve(covariance[np.ix_(others, others)], covariance[others, i])
        assert found.error_cm_s[place] == pytest.approx((weights @ y[others] - y[i]) / 4.0)
        variance = covariance[i, i] - weights @ covariance[others, i]
        assert found.sd_cm_s[place] == pytest.approx(np.sqrt(variance) / 4.0)


def test_a_smooth_objective_is_foretold_and_noise_is_not(learned: Dependence) -> None:
    assert len(learned.left_out.error_cm_s) == 30  # of 60, those at or below the median
    assert learned.left_out.median_error_cm_s < 0.3
    of, rng = problem(), np.random.default_rng(3)
    drawn = 20.0 + 10.0 * rng.random(60)
    noise = [replace(o, g_cm_s=float(g), rank_cm_s=float(g)) for o, g in zip(history(of), drawn, strict=True)]
    blind = surrogate_dependence(of, noise)
    assert blind is not None
    assert blind.left_out.median_error_cm_s > 1.0
    assert blind.left_out.share_inside > 0.7


def test_too_short_a_history_says_nothing() -> None:
    of = problem()
    assert surrogate_dependence(of, history(of, 4)) is None
    assert surrogate_dependence(of, []) is None
