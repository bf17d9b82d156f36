"""Claims about truncated normal, lognormal and empirical parameters, against scipy.stats and by brute force."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter
from scipy import stats

from softclose import Population, load_population
from softclose.evaluate import draw
from softclose.population.distributions import Bounded, PopulationError
from softclose.population.files import write_population
from softclose.population.marginals import Empirical, Marginal, Truncated
from softclose.settings import load_config

P = np.linspace(0.0, 1.0, 401)


def _scipy(b: Truncated) -> stats.rv_frozen:
    if b.kind == "normal":
        low, high = (b.low - b.location) / b.scale, (b.high - b.location) / b.scale
        return stats.truncnorm(low, high, loc=b.location, scale=b.scale)
    return stats.truncate(stats.Normal(mu=b.location, sigma=b.scale), math.log(b.low), math.log(b.high))


truncated = st.builds(
    lambda kind, mean, cv, low, width: Truncated.from_moments(
        kind, mean, cv * mean, max(mean * (1.0 + low * cv), 0.05 * mean), mean * (1.0 + (low + width) * cv) + 0.1 * mean
    ),
    kind=st.sampled_from(["normal", "lognormal"]),
    mean=st.floats(0.5, 100.0),
    cv=st.floats(0.005, 0.3),
    low=st.floats(-3.0, 1.0),
    width=st.floats(0.5, 5.0),
)


@given(truncated)
def test_quantiles_densities_and_moments_are_scipys(b: Truncated) -> None:
    theirs = _scipy(b)
    y = np.linspace(b.lower, b.upper, 101)
    if b.kind == "normal":
        np.testing.assert_allclose(b.quantile(P), theirs.ppf(P), rtol=1e-9)
        np.testing.assert_allclose(b.density(y), theirs.pdf(y), rtol=1e-8)
        assert b.mean == pytest.approx(theirs.mean(), rel=1e-9)
        assert b.sd == pytest.approx(theirs.std(), rel=1e-6)
    else:
        np.testing.assert_allclose(np.log(b.quantile(P)), theirs.icdf(P), rtol=1e-7, atol=1e-8)
        y = y[1:-1]  # at the ends the logarithm of a bound is one bit inside or outside
        np.testing.assert_allclose(b.density(y) * y, theirs.pdf(np.log(y)), rtol=1e-7)
    assert b.quantile(np.array([0.0, 1.0])) == pytest.approx([b.lower, b.upper], rel=1e-9)
    assert np.trapezoid(b.density(np.linspace(b.lower, b.upper, 20_001)), dx=(b.upper - b.lower) / 20_000) == (
        pytest.approx(1.0, abs=1e-5)
    )


@given(truncated, st.floats(-0.3, 0.3), st.floats(0.0, 2.0))
def test_design_and_process_changes_are_eqs_14_and_15(b: Truncated, shift: float, factor: float) -> None:
    moved = b.shift_mean(shift * b.mean)
    assert moved.mean == pytest.approx((1.0 + shift) * b.mean, rel=1e-9)
    assert moved.sd / moved.mean == pytest.approx(b.sd / b.mean, rel=1e-9)
    spread = b.scale_spread(factor)
    assert spread.mean == pytest.approx(b.mean, rel=1e-9)
    assert spread.sd == pytest.approx(factor * b.sd, rel=1e-6, abs=1e-12 * b.mean)
    np.testing.assert_allclose(moved.quantile(P), (1.0 + shift) * b.quantile(P), rtol=1e-9)
    assert moved.density(moved.quantile(P[1:-1])).max() == pytest.approx(
        b.density(b.quantile(P[1:-1])).max() / (1.0 + shift), rel=1e-6
    )


def test_moments_are_those_before_truncation() -> None:
    b = Truncated.from_moments("lognormal", 3.0, 0.2, 1.0, 9.0)  # truncated so far out that it does not matter
    assert (b.mean, b.sd) == pytest.approx((3.0, 0.2), rel=1e-6)
    n = Truncated.from_moments("normal", 3.0, 0.2, 2.9, 9.0)
    assert n.mean > 3.0
    assert n.sd < 0.2


def test_far_tails_keep_their_digits() -> None:
    b = Truncated(kind="normal", location=0.0, scale=1.0, low=6.0, high=7.5)
    np.testing.assert_allclose(b.quantile(P), stats.truncnorm(6.0, 7.5).ppf(P), rtol=1e-9)
    mirrored = Truncated(kind="normal", location=0.0, scale=1.0, low=-7.5, high=-6.0)
    np.testing.assert_allclose(mirrored.quantile(P), -b.quantile(1.0 - P), rtol=1e-9)
    assert b.mean == pytest.approx(stats.truncnorm(6.0, 7.5).mean(), rel=1e-9)
    y = np.linspace(6.0, 7.5, 50)
    np.testing.assert_allclose(b.density(y), stats.truncnorm(6.0, 7.5).pdf(y), rtol=1e-9)
    np.testing.assert_allclose(mirrored.density(-y), b.density(y), rtol=1e-9)


def test_every_device_is_as_likely_as_every_other() -> None:
    values = (3.1, 2.9, 3.0, 3.4, 3.0, 2.8)
    b = Empirical(values=values)
    drawn = b.quantile((np.arange(6000) + 0.5) / 6000.0)
    found, counts = np.unique(drawn, return_counts=True)
    np.testing.assert_array_equal(found, sorted(set(values)))
    np.testing.assert_array_equal(counts, [1000, 1000, 2000, 1000, 1000])
    assert b.quantile(np.array([0.0, 1.0])).tolist() == [b.lower, b.upper] == [2.8, 3.4]
    assert (b.mean, b.sd) == pytest.approx((np.mean(values), np.std(values)))
    assert b.expect(np.square) == pytest.approx(np.mean(np.square(values)))
    halved = b.scale_spread(0.5)
    assert (halved.mean, halved.sd) == pytest.approx((b.mean, 0.5 * b.sd))
    y = np.linspace(1.0, 5.0, 4001)
    assert np.trapezoid(b.density(y), y) == pytest.approx(1.0, abs=1e-6)
    width = 0.9 * np.std(values) * len(values) ** -0.2 / np.std(values, ddof=1)
    np.testing.assert_allclose(b.density(y), stats.gaussian_kde(values, bw_method=width)(y), atol=1e-12)
    np.testing.assert_allclose(b.density(y[:3999].reshape(3, -1)), b.density(y[:3999]).reshape(3, -1))


@pytest.mark.parametrize(
    "b", [Truncated.from_moments("normal", 3.0, 0.2, 2.5, 3.5), Empirical(values=(3.1, 2.9, 3.0, 3.4, 3.2))]
)
def test_a_mean_is_not_moved_to_nothing(b: Truncated | Empirical) -> None:
    for delta in (-b.mean, -2.0 * b.mean):
        with pytest.raises(PopulationError, match="must stay above minus the mean"):
            b.shift_mean(delta)
    with pytest.raises(PopulationError, match="factor of 0 or more"):
        b.scale_spread(-0.1)


def test_only_what_was_moved_says_so() -> None:
    b = Truncated.from_moments("normal", 3.0, 0.2, 2.5, 3.5)
    assert set(b.to_dict()) == {"kind", "location", "scale", "low", "high"}
    assert b.shift_mean(0.3).to_dict()["factor"] == pytest.approx(1.1)
    for moved in (b.shift_mean(0.3), b.scale_spread(0.5)):
        assert TypeAdapter(Marginal).validate_python(moved.to_dict()) == moved


OWN = """
name = "own"
plate_area_um2 = 9000.0

[D]
distribution = "normal"
mean = 2.4
sd = 0.06
lower = 2.2
upper = 2.6

[G]
distribution = "lognormal"
mean = 3.7
sd = 0.05
lower = 3.5
upper = 4.0

[E]
distribution = "empirical"
values = [61.0, 64.5, 70.2, 66.1, 68.8, 63.0]

[T]
distribution = "fixed"
value = 6.9

[correlation]
D-G = 0.5
"""


@pytest.fixture
def own(tmp_path: Path) -> Path:
    path = tmp_path / "own.toml"
    path.write_text(OWN)
    return path


def test_a_file_is_read_written_and_read_as_the_same_population(own: Path, tmp_path: Path) -> None:
    population = load_population(own)
    assert isinstance(population.D, Truncated)
    assert isinstance(population.G, Truncated)
    assert isinstance(population.E, Empirical)
    assert isinstance(population.T, Bounded)
    write_population(population, tmp_path / "again.toml")
    assert load_population(tmp_path / "again.toml") == population
    assert Population.from_dict(population.to_dict()) == population
    for v in "DGET":
        b = getattr(population, v)
        assert TypeAdapter(Marginal).validate_python(b.to_dict()) == b


def test_an_ensemble_has_the_distributions_and_the_correlation(own: Path) -> None:
    p = load_population(own).sample_parameters(40_000, seed=3)
    assert p[:, 0].mean() == pytest.approx(2.4, abs=0.002)
    assert stats.kstest(p[:, 0], stats.truncnorm(-0.2 / 0.06, 0.2 / 0.06, loc=2.4, scale=0.06).cdf).pvalue > 1e-3
    assert stats.spearmanr(p[:, 0], p[:, 1]).statistic == pytest.approx(0.48, abs=0.03)
    assert set(p[:, 2]) == {61.0, 64.5, 70.2, 66.1, 68.8, 63.0}
    assert (p[:, 3] == 6.9).all()


def test_a_campaign_of_such_a_lot_runs_changes_and_knows_its_summary(own: Path) -> None:
    config = load_config({"population": {"name": str(own), "n_switches": 50}})
    lot = draw(config, 50, seed=1)
    assert len(lot) == 50
    again = draw(type(config).from_dict(config.to_dict()), 50, seed=1)
    for name in lot:
        np.testing.assert_array_equal(again[name], lot[name], name)
    summary = config.build_population().summary()
    sample = config.build_population().sample(100_000, seed=5)
    assert summary["K_mean_N_per_m"] == pytest.approx(sample[:, 2].mean(), rel=2e-3)
    assert summary["K_sd_N_per_m"] == pytest.approx(sample[:, 2].std(), rel=2e-2)
    assert summary["D_um_mean" if "D_um_mean" in summary else "D_mean_um"] == pytest.approx(
        sample[:, 0].mean(), abs=1e-3
    )


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ('distribution = "normal"\nmean = 2.4\nsd = 0\nlower = 2.2\nupper = 2.6', "sd is 0; it must be above 0"),
        ('distribution = "normal"\nmean = 2.4\nlower = 2.2\nupper = 2.6', "sd is missing"),
        ('distribution = "normal"\nmean = 2.4\nsd = 0.1\nupper = 2.6', "lower is missing"),
        ('distribution = "normal"\nlower = 2.2\nupper = 2.6', "give either mean and sd, or location and scale"),
        ('distribution = "normal"\nmean = 9\nsd = 0.1\nlower = 2.2\nupper = 2.6', "nothing is left"),
        ('distribution = "lognormal"\nmean = -2\nsd = 0.1\nlower = 2.2\nupper = 2.6', "mean is -2"),
        ('distribution = "normal"\nmean = 2.4\nsd = 0.1\nlower = 2.6\nupper = 2.2', "its upper end must be larger"),
        ('distribution = "empirical"\nvalues = [2.4, 2.5]', "values has 2 devices; 5 finite ones"),
        ('distribution = "empirical"\nvalues = "2.4"', "one a device"),
        ('distribution = "gaussian"', "must be one of beta, uniform, normal, lognormal, empirical, fixed"),
    ],
)
def test_what_is_no_distribution_is_named_with_its_variable(table: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    path.write_text(f'base = "current"\n[D]\n{table}\n')
    with pytest.raises(PopulationError) as e:
        load_population(path)
    assert said in str(e.value)
    assert "[D]" in str(e.value)
