"""Claims about partial dependence: it finds what matters in a history whose truth is known."""

from __future__ import annotations

import numpy as np
import pytest

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
        found.append(
            Observation(
                index=i,
                wave=i,
                waveform=waveform,
                origin="sobol",
                n_switches=100,
                g_cm_s=g,
                g_se_cm_s=0.1,
                v_u_cm_s=g,
                mean_cm_s=g,
                p_nc=0.0,
                p_contact=1.0,
                failed=False,
            )
        )
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
    unit = np.linspace(0.0, 1.0, learned.grid.shape[1])
    for curve in (learned.mean_cm_s[j], learned.slice_cm_s[j]):
        assert unit[int(np.argmin(curve))] == pytest.approx(0.6, abs=0.06)
    assert learned.slice_cm_s[j].min() == pytest.approx(20.0, abs=0.3)


def test_maps_agree_with_the_curves(monkeypatch: pytest.MonkeyPatch) -> None:
    """A map's own average along the parameter that does not matter is the curve of the one that does."""
    monkeypatch.setattr(dependence, "NEAR", 9.0)
    of = problem()
    learned = surrogate_dependence(of, history(of))
    assert learned is not None
    j = learned.names.index("volts2")
    place = next(k for k, pair in enumerate(learned.pairs) if j in pair)
    along = 0 if learned.pairs[place][0] == j else 1
    curve = learned.pair_cm_s[place].mean(axis=along)
    expected = np.interp(learned.pair_grid[j], learned.grid[j], learned.mean_cm_s[j])
    np.testing.assert_allclose(curve, expected, atol=0.3)


def test_a_map_says_nothing_where_no_candidate_is_near(learned: Dependence) -> None:
    axes = problem().space.coordinates
    for (i, j), values in zip(learned.pairs, learned.pair_cm_s, strict=True):
        u, v = (axes[k].unit(learned.pair_grid[k]) for k in (i, j))
        tried = np.column_stack([axes[k].unit(learned.tried[:, k]) for k in (i, j)])
        for row, col in ((0, 0), (8, 3), (16, 16)):
            near = np.hypot(*(tried - (u[col], v[row])).T).min()
            assert np.isnan(values[row, col]) == (near > dependence.NEAR)
    assert np.isnan(learned.pair_cm_s).any()


def test_too_short_a_history_says_nothing() -> None:
    of = problem()
    assert surrogate_dependence(of, history(of, 4)) is None
    assert surrogate_dependence(of, []) is None
