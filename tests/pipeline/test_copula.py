"""Claims about correlated parameters: rank correlations as asked for, the distributions as they were."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import kstest, spearmanr

from examples import examples
from softclose import Population, load_population
from softclose.population import VARIABLES, PopulationError
from softclose.population.calibrate import calibrate, write_calibration
from softclose.population.files import write_population
from softclose.population.measurements import read_measurements, write_synthetic
from softclose.settings import load_config
from softclose.switch.plate import stiffness


def correlated(*pairs):
    return replace(load_population("current"), correlation=pairs)


@pytest.mark.parametrize("sampling", ["monte-carlo", "sobol"])
def test_ranks_correlate_as_asked_for_and_each_distribution_stays(sampling):
    population = correlated(("E", "T", 0.78), ("D", "G", -0.4))
    x = population.sample_parameters(16384, seed=3, sampling=sampling)
    found = spearmanr(x).statistic
    expected = np.eye(4)
    for a, b, rho in population.correlation:
        i, j = VARIABLES.index(a), VARIABLES.index(b)
        expected[i, j] = expected[j, i] = rho
    np.testing.assert_allclose(found, expected, atol=0.02)
    for i, v in enumerate(VARIABLES):
        b = getattr(population, v)
        p = np.linspace(0.0, 1.0, 2001)
        q = b.quantile(p)
        assert kstest(x[:, i], lambda value, q=q, p=p: np.interp(value, q, p)).statistic < 0.02


@settings(max_examples=examples(20), deadline=None)
@given(st.floats(-0.95, 0.95))
def test_the_mean_stiffness_is_that_of_the_correlated_lot(rho):
    population = correlated(("E", "T", rho))
    k = population.sample(60_000, seed=1, sampling="sobol")[:, 2]
    assert population.mean_K == pytest.approx(k.mean(), rel=2e-3)
    assert population.summary()["K_sd_N_per_m"] == pytest.approx(k.std(), rel=2e-2)


def test_a_row_is_the_same_alone_and_among_others():
    population = correlated(("E", "T", 0.78))
    whole = population.sample(50, seed=5)
    np.testing.assert_array_equal(population.sample(7, seed=5, start=30), whole[30:37])
    np.testing.assert_array_equal(population.sample(1, seed=5, start=30), whole[30:31])


def test_without_a_correlation_nothing_changes():
    plain = load_population("current")
    np.testing.assert_array_equal(correlated().sample(50, seed=5), plain.sample(50, seed=5))
    assert "correlation" not in plain.to_dict()
    d = correlated(("E", "T", 0.78)).sample_parameters(50, seed=5)
    np.testing.assert_allclose(d[:, :3], plain.sample_parameters(50, seed=5)[:, :3], rtol=1e-12)


def test_a_stiffer_lot_where_stiff_and_thick_go_together():
    """Positive correlation of E and T widens K; negative narrows it."""
    sd = {rho: correlated(("E", "T", rho)).summary()["K_sd_N_per_m"] for rho in (-0.7, 0.7)}
    none = load_population("current").summary()["K_sd_N_per_m"]
    assert sd[-0.7] < none < sd[0.7]
    assert stiffness(170.0, 7.0) < stiffness(170.0, 8.0)


def test_a_population_with_correlations_is_kept_by_files_stores_and_campaigns(tmp_path):
    population = correlated(("E", "T", 0.78), ("D", "G", -0.4))
    assert Population.from_dict(population.to_dict()) == population
    write_population(population, tmp_path / "p.toml")
    assert load_population(tmp_path / "p.toml") == population
    config = load_config("current", [f"population.name={tmp_path / 'p.toml'}"])
    assert config.build_population() == population
    (tmp_path / "q.toml").write_text(f'base = "{tmp_path / "p.toml"}"\n[correlation]\nE-T = -0.2\n')
    assert load_population(tmp_path / "q.toml").correlation == (("E", "T", -0.2),)


def test_calibration_hands_on_the_correlation_that_it_finds(tmp_path):
    truth = correlated(("E", "T", 0.78))
    write_synthetic(truth, tmp_path / "m.csv", n=400, seed=2)
    found = calibrate(read_measurements(tmp_path / "m.csv"), n_bootstrap=20)
    ((a, b, rho),) = found.population.correlation
    assert (a, b) == ("E", "T")
    assert rho == pytest.approx(0.78, abs=0.06)
    assert "E and T are correlated" in found.notes[-1]
    write_calibration(found, tmp_path / "p.toml")
    assert load_population(tmp_path / "p.toml").correlation == found.population.correlation
    write_synthetic(load_population("current"), tmp_path / "n.csv", n=400, seed=2)
    assert calibrate(read_measurements(tmp_path / "n.csv"), n_bootstrap=20).population.correlation == ()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("E-T = 1.5", "rank correlation of E and T is 1.5; it must lie between -1 and 1"),
        ("E-X = 0.5", "'E-X' is no pair of variables; write two of D, G, E, T"),
        ("ET = 0.5", "'ET' is no pair of variables"),
        ("E-E = 0.5", "correlation of E with itself"),
        ("E-T = 0.5\nT-E = 0.2", "correlation of E and T is given twice|correlation of T and E is given twice"),
        ('E-T = "much"', "correlation"),
        ("D-G = 0.9\nG-E = 0.9\nD-E = -0.9", "not positive definite"),
    ],
)
def test_correlations_that_cannot_be_are_refused(tmp_path, text, said):
    path = tmp_path / "p.toml"
    path.write_text(f'base = "current"\n[correlation]\n{text}\n')
    with pytest.raises(PopulationError, match=said):
        load_population(path)
