"""The population: printed figures, exact transforms, samples keyed by (seed, stream, index)."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from examples import examples
from softclose import Population, load_population
from softclose.population import VARIABLES, population_names, switches_from_parameters
from softclose.population.distributions import Bounded, PopulationError
from softclose.population.population import SAMPLINGS
from softclose.switch.plate import A1, frequency, holding_voltage, modulus, pull_in_voltage, stiffness_from_pull_in


def test_the_deterministic_switch_has_the_printed_means() -> None:
    np.testing.assert_allclose(load_population("current").mean_switch, [2.43, 3.68, 65.3, 3.41], rtol=1e-11)


@pytest.mark.parametrize(
    ("name", "thickness_um", "modulus_GPa", "half_width"),
    [("current", 6.933, 90.614, 0.125), ("paper-text", 7.0326, 84.680, 0.25)],
)
def test_nominal_thickness_and_modulus_follow_from_the_printed_means(
    name: str, thickness_um: float, modulus_GPa: float, half_width: float
) -> None:
    population = load_population(name)
    assert population.T.mean == pytest.approx(thickness_um, abs=5e-4)
    assert population.E.mean == pytest.approx(modulus_GPa, abs=1e-3)
    assert population.T.upper / population.T.mean - 1.0 == pytest.approx(half_width)
    assert population.mean_M == pytest.approx(3.41, rel=1e-11)
    assert population.mean_K == pytest.approx(65.3, rel=1e-11)


@pytest.mark.parametrize(
    ("name", "lower", "upper"), [("current", 0.59, 0.75), ("modified", 0.41, 0.52), ("paper-text", 0.59, 0.75)]
)
def test_travel_to_gap_ratio_spans_the_printed_range(name: str, lower: float, upper: float) -> None:
    summary = load_population(name).summary()
    assert round(summary["D_over_G_lower"], 2) == lower
    assert round(summary["D_over_G_upper"], 2) == upper


def test_natural_frequency_of_the_mean_switch_is_about_20_khz() -> None:
    population = load_population("current")
    assert 20e3 < float(frequency(population.E.mean, population.T.mean)) < 23e3


def test_pull_in_inverts_to_stiffness_and_modulus() -> None:
    population = load_population("current")
    parameters = population.sample_parameters(50, seed=3)
    switches = switches_from_parameters(parameters)
    k = stiffness_from_pull_in(pull_in_voltage(switches), switches[:, 1])
    np.testing.assert_allclose(k, switches[:, 2], rtol=1e-12)
    np.testing.assert_allclose(modulus(k, parameters[:, 3]), parameters[:, 2], rtol=1e-12)
    assert (holding_voltage(switches) < pull_in_voltage(switches)).all()


def test_modified_design_is_eq_14_applied_switch_by_switch() -> None:
    before = load_population("current").sample_parameters(200, seed=5)
    after = load_population("modified").sample_parameters(200, seed=5)
    mean = np.array([getattr(load_population("current"), v).mean for v in VARIABLES])
    np.testing.assert_allclose(after, before * (1.0 + np.array([-0.5, 0.5, 0.0, 0.6]) / mean), rtol=1e-12)


def test_improved_process_is_eq_15_applied_switch_by_switch() -> None:
    before = load_population("current").sample_parameters(200, seed=5)
    after = load_population("process-improved").sample_parameters(200, seed=5)
    mean = np.array([getattr(load_population("current"), v).mean for v in VARIABLES])
    factor = np.array([0.5, 0.5, 1.0, 0.5])
    np.testing.assert_allclose(after, mean * (1.0 - factor) + factor * before, rtol=1e-12)


@given(delta=st.floats(-1.0, 3.0), factor=st.floats(0.0, 1.0))
def test_eq_14_keeps_the_coefficient_of_variation_and_eq_15_scales_it(delta: float, factor: float) -> None:
    y = Bounded(lower=2.3, upper=2.7, alpha=1.3, beta=2.7)
    moved = y.shift_mean(delta)
    assert moved.mean == pytest.approx(y.mean + delta)
    assert moved.sd / moved.mean == pytest.approx(y.sd / y.mean)
    both, other_order = moved.scale_spread(factor), y.scale_spread(factor).shift_mean(delta)
    assert both.mean == pytest.approx(moved.mean)
    assert both.sd == pytest.approx(factor * moved.sd, abs=1e-12)
    assert other_order.lower == pytest.approx(both.lower)


@pytest.mark.parametrize("shapes", [(1.0, 1.0), (1.0, 2.0), (2.0, 1.0), (1.3, 2.7), (0.5, 0.5)])
def test_a_bounded_variable_is_scipys_beta(shapes: tuple[float, float]) -> None:
    y = Bounded(lower=2.0, upper=5.0, alpha=shapes[0], beta=shapes[1])
    theirs = stats.beta(*shapes, loc=2.0, scale=3.0)
    p = np.linspace(0.01, 0.99, 7)
    np.testing.assert_allclose(y.quantile(p), theirs.ppf(p), rtol=1e-12)
    at = np.array([1.9, 2.5, 4.0, 5.1])
    np.testing.assert_allclose(y.density(at), theirs.pdf(at), rtol=1e-12)
    assert (y.mean, y.sd) == pytest.approx((theirs.mean(), theirs.std()))
    assert y.expect(lambda v: v) == pytest.approx(theirs.mean())
    assert y.expect(lambda v: v**3) == pytest.approx(theirs.moment(3))
    assert y.is_uniform == (shapes == (1.0, 1.0))


def test_without_shapes_it_is_uniform_and_without_width_it_is_fixed() -> None:
    assert Bounded(lower=2.0, upper=5.0) == Bounded(lower=2.0, upper=5.0, alpha=1.0, beta=1.0)
    fixed = Bounded(lower=2.0, upper=2.0)
    assert fixed.quantile(np.array([0.0, 0.3, 1.0])).tolist() == [2.0, 2.0, 2.0]
    assert fixed.expect(lambda v: v**2) == 4.0
    assert Bounded(lower=2.0, upper=5.0).scale_spread(0.0) == Bounded(lower=3.5, upper=3.5)
    half = Bounded.from_mean(0.0, 1.0, 0.5, 0.5)
    assert (half.alpha, half.beta) == (0.25, 0.25)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Bounded(lower=True, upper=2.0), "lower is True"),
        (lambda: Bounded(lower=1.0, upper=math.inf), "upper is inf"),
        (lambda: Bounded(lower=1.0, upper=2.0, beta=0.0), "both must be above 0"),
        (lambda: Bounded.from_mean(1.0, 2.0, 2.0, 4.0), "mean is 2"),
        (lambda: Bounded.from_mean(1.0, 2.0, 1.0, 4.0), "mean is 1"),
        (lambda: Bounded.from_mean(1.0, 2.0, 1.5, 0.0), "shape_sum is 0"),
        (lambda: Bounded(lower=1.0, upper=2.0).shift_mean(-1.5), "shift_mean is -1.5"),
        (lambda: Bounded(lower=1.0, upper=2.0).scale_spread(math.inf), "repeatability is inf"),
        (lambda: _with(D=Bounded(lower=0.0, upper=1.0)), "D reaches down to 0 µm"),
        (lambda: _with(D=Bounded(lower=2.0, upper=3.0), G=Bounded(lower=3.0, upper=4.0)), "every switch needs D < G"),
        (lambda: _with(T=Bounded(lower=A1, upper=7.0)), "no stiffness at or below"),
    ],
)
def test_a_distribution_at_the_edge_of_sense_is_refused(make: Callable[[], object], words: str) -> None:
    with pytest.raises(PopulationError, match=words):
        make()


def _with(**variables: Bounded) -> Population:
    return replace(load_population("current"), **variables)


def test_the_summary_is_that_of_a_large_sample() -> None:
    population = load_population("current")
    said, switches = population.summary(), population.sample(200_000, seed=1)
    volts = pull_in_voltage(switches)
    for name, values in (("K", switches[:, 2]), ("M", switches[:, 3])):
        unit = "N_per_m" if name == "K" else "ug"
        assert said[f"{name}_mean_{unit}"] == pytest.approx(values.mean(), rel=2e-3)
        assert said[f"{name}_sd_{unit}"] == pytest.approx(values.std(), rel=1e-2)
        assert 0.9 * values.min() < said[f"{name}_lower_{unit}"] <= values.min()
        assert values.max() <= said[f"{name}_upper_{unit}"] < 1.1 * values.max()
    assert 0.8 * volts.min() < said["U_pi_lower_V"] <= volts.min()
    assert volts.max() <= said["U_pi_upper_V"] < 1.2 * volts.max()
    assert said["U_pi_mean_switch_V"] == pytest.approx(volts.mean(), rel=0.01)
    assert (said["E_mean_GPa"], said["D_lower_um"]) == (population.E.mean, 2.3)


@pytest.mark.parametrize("thickness", np.linspace(5.0, 9.0, 21).tolist())
def test_a_lot_without_scatter_has_none(thickness: float) -> None:
    said = _with(T=Bounded(lower=thickness, upper=thickness), E=Bounded(lower=90.0, upper=90.0)).summary()
    assert said["K_sd_N_per_m"] == pytest.approx(0.0, abs=1e-3)
    assert said["M_sd_ug"] == pytest.approx(0.0, abs=1e-4)


def test_an_ensemble_begins_at_its_first_switch_where_nothing_is_said() -> None:
    population = load_population("current")
    said = {"start": 0, "stream": 0, "sampling": "monte-carlo"}
    for draw in (population.sample, population.sample_parameters):
        np.testing.assert_array_equal(draw(3, seed=1), draw(3, seed=1, **said))  # type: ignore[arg-type]
    assert population.sample(2, seed=1)[1].tolist() == population.sample(1, seed=1, start=1)[0].tolist()


@settings(max_examples=examples(40), deadline=None)
@given(
    n=st.integers(1, 300),
    start=st.integers(0, 300),
    seed=st.integers(0, 2**80),
    stream=st.integers(0, 5),
    sampling=st.sampled_from(SAMPLINGS),
)
def test_row_i_depends_on_seed_and_index_only(n: int, start: int, seed: int, stream: int, sampling: str) -> None:
    population = load_population("current")
    kwargs = {"seed": seed, "stream": stream, "sampling": sampling}
    whole = population.sample(start + n, **kwargs)  # type: ignore[arg-type]
    np.testing.assert_array_equal(population.sample(n, start=start, **kwargs), whole[start:])  # type: ignore[arg-type]
    np.testing.assert_array_equal(population.sample(n, **kwargs), whole[:n])  # type: ignore[arg-type]


def test_another_process_draws_the_same_bits_and_loading_needs_no_scipy() -> None:
    code = (
        "import sys\nfrom softclose import load_population\np = load_population('current')\n"
        "assert 'scipy' not in sys.modules\n"
        "print([p.sample(33, seed=9, sampling=s).tobytes().hex() for s in ('monte-carlo', 'sobol')])"
    )
    env = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    there = subprocess.run([sys.executable, "-c", code], env=env, check=True, capture_output=True, text=True).stdout
    population = load_population("current")
    here = [population.sample(33, seed=9, sampling=s).tobytes().hex() for s in ("monte-carlo", "sobol")]
    assert there.strip() == str(here)


def test_seeds_streams_and_samplings_are_independent_ensembles() -> None:
    population = load_population("current")
    draws = [
        population.sample(400, seed=1),
        population.sample(400, seed=2),
        population.sample(400, seed=1, stream=1),
        population.sample(400, seed=1, sampling="sobol"),
    ]
    for i, a in enumerate(draws):
        for b in draws[:i]:
            assert abs(np.corrcoef(a[:, 0], b[:, 0])[0, 1]) < 0.2
            assert not np.isin(a, b).any()


@pytest.mark.parametrize("sampling", SAMPLINGS)
@pytest.mark.parametrize("name", population_names())
def test_samples_follow_the_stated_distributions(name: str, sampling: str) -> None:
    population = load_population(name)
    parameters = population.sample_parameters(4096, seed=11, sampling=sampling)  # type: ignore[arg-type]
    for column, v in zip(parameters.T, VARIABLES, strict=True):
        b: Bounded = getattr(population, v)
        assert b.lower <= column.min()
        assert column.max() <= b.upper
        cdf = stats.beta(b.alpha, b.beta, loc=b.lower, scale=b.upper - b.lower).cdf
        assert stats.kstest(column, cdf).pvalue > 1e-3
        assert b.density(np.array([b.mean]))[0] > 0.0
    corr = np.corrcoef(parameters.T) - np.eye(4)
    assert np.abs(corr).max() < 0.06
    switches = switches_from_parameters(parameters)
    assert (switches[:, 0] < switches[:, 1]).all()
    summary = population.summary()
    for i, key in ((2, "K_{}_N_per_m"), (3, "M_{}_ug")):
        column = switches[:, i]
        sd = summary[key.format("sd")]
        assert abs(column.mean() - summary[key.format("mean")]) < 4.0 * sd / 64.0
        assert column.std() == pytest.approx(sd, rel=0.05)
        assert summary[key.format("lower")] <= column.min() < column.max() <= summary[key.format("upper")]
    u_pi = pull_in_voltage(switches)
    assert summary["U_pi_lower_V"] < u_pi.min() < summary["U_pi_mean_switch_V"] < u_pi.max() < summary["U_pi_upper_V"]


def test_sobol_estimates_the_mean_ten_times_better() -> None:
    population = load_population("current")
    error = {
        s: np.std([population.sample(1024, seed=i, sampling=s)[:, 2].mean() for i in range(20)])  # type: ignore[arg-type]
        for s in SAMPLINGS
    }
    assert error["sobol"] < 0.1 * error["monte-carlo"]


@pytest.mark.parametrize(
    ("kwargs", "words"),
    [
        ({"n": 0, "seed": 1}, "n is 0"),
        ({"n": 3, "seed": -1}, "seed is -1"),
        ({"n": 3, "seed": 1.5}, "seed is 1.5"),
        ({"n": 3, "seed": 1, "start": -1}, "start is -1"),
        ({"n": 3, "seed": 1, "stream": -1}, "stream is -1"),
        ({"n": True, "seed": 1}, "n is True"),
        ({"n": 1, "seed": 1, "start": 2**30, "sampling": "sobol"}, "at most 1073741824 points"),
        ({"n": 3, "seed": 1, "sampling": "sobel"}, "one of monte-carlo, sobol"),
    ],
)
def test_bad_sample_arguments_are_named(kwargs: dict[str, object], words: str) -> None:
    with pytest.raises(PopulationError, match=words):
        load_population("current").sample(**kwargs)  # type: ignore[arg-type]


def test_parameters_of_the_wrong_shape_or_thickness_are_refused() -> None:
    with pytest.raises(PopulationError, match=r"\(4,\); expected \(n, 4\)"):
        switches_from_parameters([2.4, 3.7, 90.0, 7.0])
    with pytest.raises(PopulationError, match="needs more than"):
        switches_from_parameters([[2.4, 3.7, 90.0, 7.0], [2.4, 3.7, 90.0, 3.0]])
    with pytest.raises(PopulationError, match=r"\(1, 5\); expected \(n, 4\)"):
        switches_from_parameters([[2.4, 3.7, 90.0, 7.0, 1.0]])


@pytest.mark.parametrize("name", population_names())
def test_a_population_survives_json(name: str) -> None:
    population = load_population(name)
    assert Population.from_dict(json.loads(json.dumps(population.to_dict()))) == population


@pytest.mark.parametrize("data", [{}, {"name": "x", "D": 1}, {"name": "x", "D": {"low": 2}}])
def test_a_dictionary_that_is_no_population_is_refused(data: dict[str, object]) -> None:
    with pytest.raises(PopulationError, match="not a stored population"):
        Population.from_dict(data)


def _names(items: Sequence[str]) -> set[str]:
    return set(items)


def test_shipped_names_are_their_files_names() -> None:
    assert _names(population_names()) == {"current", "modified", "process-improved", "paper-text"}
    for name in population_names():
        assert load_population(name).name == name


@pytest.mark.parametrize("area", [0.0, -1.0, math.inf, math.nan])
def test_a_plate_area_that_is_none_is_refused(area: float) -> None:
    with pytest.raises(PopulationError, match=r"plate_area_um2 is .*; it must be a finite number above 0 µm²"):
        replace(load_population("current"), plate_area_um2=area)


def test_the_area_of_the_fit_counts_and_another_is_refused() -> None:
    usual = load_population("current")
    assert (usual.plate_area(), usual.plate_area(12000.0)) == (16700.0, 12000.0)
    own = replace(usual, plate_area_um2=15000.0)
    assert own.plate_area() == own.plate_area(15000.0 * (1.0 + 1e-10)) == 15000.0
    for other in (15000.0 * (1.0 + 1e-8), 15000.0 * (1.0 - 1e-8), 7500.0):
        with pytest.raises(PopulationError, match="was fitted with 15000 µm²"):
            own.plate_area(other)
