"""Calibration: a known population is recovered, its file is one that runs accept, bad files say what is wrong."""

from __future__ import annotations

import json
from dataclasses import replace
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from examples import in_turn
from softclose import load_population
from softclose.population import VARIABLES, Population, PopulationError
from softclose.population.calibrate import (
    Calibration,
    calibrate,
    device_parameters,
    rank_correlation,
    write_calibration,
)
from softclose.population.distributions import Bounded
from softclose.population.fit import estimate, fit
from softclose.population.measurements import MeasurementError, read_devices, read_measurements, write_synthetic
from softclose.population.plausible import FitKind, Lots, cramer_von_mises

EXAMPLE = Path(str(resources.files("softclose.population") / "shipped" / "example_measurements.csv"))


@pytest.fixture(scope="module")
def calibration() -> Calibration:
    return calibrate(read_measurements(EXAMPLE), n_bootstrap=200, confidence=0.99, seed=1)


def test_the_shipped_example_is_60_devices_of_the_current_design(tmp_path: Path) -> None:
    write_synthetic(load_population("current"), tmp_path / "again.csv", n=60, seed=2008)
    assert (tmp_path / "again.csv").read_text("utf-8") == EXAMPLE.read_text("utf-8")


def test_the_modulus_of_each_device_is_recovered_from_its_pull_in_voltage() -> None:
    truth = load_population("current").sample_parameters(60, seed=2008)
    np.testing.assert_allclose(device_parameters(read_measurements(EXAMPLE)), truth, rtol=2e-5)


def test_the_known_population_lies_within_the_intervals(calibration: Calibration) -> None:
    truth = load_population("current")
    for v in VARIABLES:
        b: Bounded = getattr(truth, v)
        for name in ("lower", "upper", "alpha", "beta", "mean", "sd"):
            low, high = calibration.fits[v].numbers[name].interval
            assert low <= getattr(b, name) <= high, (v, name)
        assert calibration.fits[v].p_value > 0.05
    (note,) = calibration.notes
    assert "of 60 devices the intervals of sd of D, G may hold less often" in note


def test_the_written_population_is_one_that_runs_accept(calibration: Calibration, tmp_path: Path) -> None:
    write_calibration(calibration, tmp_path / "lot.toml")
    assert load_population(tmp_path / "lot.toml") == calibration.population
    text = (tmp_path / "lot.toml").read_text("utf-8")
    assert text.count("Cramér-von Mises") == 4
    assert text.count("#   alpha: ") == text.count("#   beta: ") == 2  # D and G have shapes, E and T are uniform
    heads = [line for line in text.splitlines() if "Cramér-von Mises" in line]
    sections = {head[2]: text.partition(head)[2].partition("Cramér-von Mises")[0] for head in heads}
    assert {v: "alpha: " in below for v, below in sections.items()} == {"D": True, "G": True, "E": False, "T": False}
    assert json.loads(json.dumps(calibration.to_dict()))["n_devices"] == 60


def test_the_same_seed_gives_the_same_intervals() -> None:
    m = read_measurements(EXAMPLE)
    a, b = (calibrate(m, n_bootstrap=20, seed=4).to_dict() for _ in range(2))
    assert a == b


def test_fig_3_panels_are_densities(calibration: Calibration) -> None:
    for panel in calibration.panels(2001).values():
        assert panel["density"].size == 8  # the root of 60, rounded up
        assert panel["fitted"][0] == panel["fitted"][-1] == 0.0
        assert panel["grid"][0] < panel["edges"].min() < panel["edges"].max() < panel["grid"][-1]
        assert float((panel["density"] * np.diff(panel["edges"])).sum()) == pytest.approx(1.0)
        assert float(np.trapezoid(panel["fitted"], panel["grid"])) == pytest.approx(1.0, abs=0.01)


def test_within_given_bounds_the_fit_is_scipys_maximum_likelihood() -> None:
    x = Bounded(lower=2.3, upper=2.7, alpha=1.3, beta=2.7).quantile(np.random.default_rng(1).random(80))
    ours = fit(x, "beta", bounds=(2.3, 2.7), n_bootstrap=20)
    a, b, _, _ = stats.beta.fit(x, floc=2.3, fscale=0.4)
    likely = 80.0 / 78.0  # what is taken back for 80 values
    assert (likely * ours.distribution.alpha, likely * ours.distribution.beta) == pytest.approx((a, b), rel=1e-3)
    assert ours.numbers["lower"].interval == pytest.approx((2.3, 2.3))
    assert ours.numbers["alpha"].interval[0] < 1.3 < ours.numbers["alpha"].interval[1]


@pytest.mark.parametrize("seed", range(5))
def test_the_fitted_beta_is_likelier_than_the_true_one(seed: int) -> None:
    truth = Bounded(lower=2.3, upper=2.7, alpha=1.3, beta=2.7)
    x = truth.quantile(np.random.default_rng(seed).random(60))
    fitted = estimate(x, "beta").scale_spread(58.5 / 60.0)  # without the correction for 60 values
    assert fitted.lower < x.min() < x.max() < fitted.upper
    assert np.log(fitted.density(x)).sum() >= np.log(truth.density(x)).sum()


@pytest.mark.parametrize("seed", range(3))
def test_no_neighbour_of_the_fitted_beta_is_likelier(seed: int) -> None:
    x = Bounded(lower=2.3, upper=2.7, alpha=1.6, beta=2.4).quantile(np.random.default_rng(seed).random(60))
    best = estimate(x, "beta").scale_spread(58.5 / 60.0)  # without the correction for 60 values
    assert best.alpha + best.beta == pytest.approx(4.0)

    def likelihood(lower: float, upper: float, alpha: float) -> float:
        return float(stats.beta(alpha, 4.0 - alpha, loc=lower, scale=upper - lower).logpdf(x).sum())

    top = likelihood(best.lower, best.upper, best.alpha)
    for sign in (-1.0, 1.0):
        assert likelihood(best.lower + sign * 0.03 * (x.min() - best.lower), best.upper, best.alpha) < top + 1e-3
        assert likelihood(best.lower, best.upper + sign * 0.03 * (best.upper - x.max()), best.alpha) < top + 1e-3
        if 1.0 < best.alpha + sign * 0.03 < 3.0:
            assert likelihood(best.lower, best.upper, best.alpha + sign * 0.03) < top + 1e-3


def test_a_uniform_reaches_beyond_its_data_by_their_mean_spacing() -> None:
    fitted = fit(np.arange(1.0, 6.0), "uniform", n_bootstrap=20)
    assert fitted.distribution == Bounded(lower=0.0, upper=6.0)
    assert fitted.numbers["half_width"].value == 1.0
    given_bounds = fit(np.arange(1.0, 6.0), "uniform", bounds=(0.5, 8.0), n_bootstrap=20)
    assert given_bounds.numbers["half_width"].value == pytest.approx(7.5 / 8.5)
    assert given_bounds.distribution == Bounded(lower=0.5, upper=8.0)


@pytest.mark.parametrize(("kind", "bounds"), [("beta", None), ("beta", (0.0, 1.0)), ("uniform", None)])
@pytest.mark.parametrize("n", [12, 60])
def test_the_fitted_spread_is_right_on_average(kind: FitKind, bounds: tuple[float, float] | None, n: int) -> None:
    """Maximum likelihood's is 12 % too small at 12 values."""
    truth = Bounded(lower=0.0, upper=1.0, alpha=1.4, beta=2.6) if kind == "beta" else Bounded(lower=0.0, upper=1.0)
    rng = np.random.default_rng(n)
    spreads = [estimate(truth.quantile(rng.random(n)), kind, bounds).sd for _ in range(100)]
    assert np.mean(spreads) / truth.sd == pytest.approx(1.0, abs=0.055)


@pytest.mark.parametrize(("kind", "bounds"), [("beta", None), ("beta", (0.0, 1.0)), ("uniform", None)])
@pytest.mark.parametrize("alpha", in_turn([1.07, 2.0], 2))
def test_the_lot_is_among_those_that_twelve_devices_may_have_come_from(
    kind: FitKind, bounds: tuple[float, float] | None, alpha: float
) -> None:
    """Each of lower, upper, mean and sd within its interval in some 95 of 100 lots of 12; 50 to 70 of them before."""
    truth = Bounded(lower=0.0, upper=1.0, alpha=alpha, beta=4.0 - alpha)
    if kind == "uniform":
        truth = Bounded(lower=0.0, upper=1.0)
    rng = np.random.default_rng(int(100 * alpha))
    held = dict.fromkeys(("lower", "upper", "mean", "sd"), 0)
    n_lots = 60 if bounds else 400  # without bounds the lots that are tried are the same for all devices
    for _ in range(60):
        found = fit(truth.quantile(rng.random(12)), kind, bounds=bounds, n_bootstrap=n_lots).numbers
        for name in held:
            low, high = found[name].interval
            held[name] += low <= getattr(truth, name) <= high
    assert min(held.values()) >= 50, held


def test_a_fit_that_is_stretched_and_moved_stands_for_lots_that_are() -> None:
    x = Bounded(lower=0.0, upper=1.0, alpha=1.5, beta=2.5).quantile(np.random.default_rng(3).random(20))
    plain, moved = (fit(v, "beta", n_bootstrap=20, seed=2).numbers for v in (x, 3.0 + 2.0 * x))
    for name in ("lower", "upper", "mean"):
        np.testing.assert_allclose(moved[name].interval, 3.0 + 2.0 * np.array(plain[name].interval), rtol=2e-3)
    np.testing.assert_allclose(moved["sd"].interval, 2.0 * np.array(plain["sd"].interval), rtol=2e-3)
    np.testing.assert_allclose(moved["alpha"].interval, plain["alpha"].interval, atol=2e-2)


@pytest.mark.parametrize("n", [5, 12, 60])
def test_rank_correlations_are_scipy_s_bit_for_bit(n: int) -> None:
    x = np.random.default_rng(n).standard_normal((n, 4))
    x[:, 1] = np.exp(x[:, 0])  # of rank correlation 1
    x[:, 2] = np.round(x[:, 2])  # ties
    found, p_values = rank_correlation(x)
    theirs = stats.spearmanr(x)
    np.testing.assert_array_equal(found, theirs.statistic)
    np.testing.assert_array_equal(p_values, theirs.pvalue)
    x[:, 3] = 1.0
    found, p_values = rank_correlation(x)
    assert np.isnan(found[:3, 3]).all()
    assert not (p_values[:3, 3] < 1.0).any()
    np.testing.assert_array_equal(found[:3, :3], theirs.statistic[:3, :3])


def test_many_distributions_at_once_are_each_by_itself() -> None:
    each = [Bounded(lower=-1.0, upper=2.0, alpha=1.07, beta=2.93), Bounded(lower=0.3, upper=0.7, alpha=3.0, beta=1.0)]
    at_once = Lots.of(each)
    assert [at_once[i] for i in range(len(at_once))] == each
    assert at_once.only(np.array([1]))[0] == each[1]
    assert at_once.mean.tolist() == [b.mean for b in each]
    assert at_once.sd.tolist() == [b.sd for b in each]
    x = np.sort(np.array([b.quantile(np.random.default_rng(7).random(9)) for b in each]))
    alone = [float(cramer_von_mises(row, b)) for row, b in zip(x, each, strict=True)]
    assert cramer_von_mises(x, at_once).tolist() == alone


def test_more_confidence_is_a_wider_interval_and_another_seed_another() -> None:
    x = np.random.default_rng(3).random(40)
    wide, narrow, other = (
        fit(x, "uniform", n_bootstrap=100, confidence=c, seed=s).numbers["lower"].interval
        for c, s in ((0.99, 1), (0.5, 1), (0.99, 2))
    )
    assert wide[0] < narrow[0] < narrow[1] < wide[1]
    assert wide != other


def test_what_a_calibration_is_asked_reaches_every_fit() -> None:
    m = read_measurements(EXAMPLE)
    plain = calibrate(m, n_bootstrap=20, seed=4)
    bounded = calibrate(m, n_bootstrap=20, seed=4, bounds={"D": (1.5, 3.5)})
    assert (bounded.fits["D"].distribution.lower, bounded.fits["D"].distribution.upper) == (1.5, 3.5)
    assert bounded.fits["G"] == plain.fits["G"]
    low, high = plain.fits["D"].numbers["mean"].interval
    lower, higher = calibrate(m, n_bootstrap=20, seed=4, confidence=0.999).fits["D"].numbers["mean"].interval
    assert lower < low < high < higher
    assert calibrate(m, n_bootstrap=20, seed=5).fits["D"].numbers["mean"].interval != (low, high)


def test_bounds_may_be_the_extremes_and_not_one_value(tmp_path: Path) -> None:
    m = read_measurements(EXAMPLE)
    column = device_parameters(m)[:, 0]
    calibrate(m, n_bootstrap=20, bounds={"D": (column.min(), column.max())})
    with pytest.raises(MeasurementError, match="the bounds of D are"):
        calibrate(m, n_bootstrap=20, bounds={"D": (column.max(), column.max())})


def test_few_devices_are_drawn_in_five_bars() -> None:
    few = read_measurements(EXAMPLE)
    panels = calibrate(few, n_bootstrap=20).panels()
    assert {len(p["density"]) for p in panels.values()} == {8}  # the root of 60
    small = replace(calibrate(few, n_bootstrap=20), parameters=device_parameters(few)[:9])
    assert {len(p["density"]) for p in small.panels().values()} == {5}


def test_a_value_on_a_given_bound_is_taken_for_one_just_inside() -> None:
    x = np.array([0.0, 0.2, 0.3, 0.5, 0.6, 0.7, 1.0])
    inside = np.clip(x, 1e-6, 1.0 - 1e-6)
    a, b = (fit(v, "beta", bounds=(0.0, 1.0), n_bootstrap=20).distribution for v in (x, inside))
    assert (a.alpha, a.beta) == (b.alpha, b.beta)


def test_goodness_of_fit_is_scipys_statistic_and_rejects_another_family() -> None:
    rng = np.random.default_rng(2)
    two_lots = np.concatenate([rng.normal(2.4, 0.01, 40), rng.normal(2.6, 0.01, 40)])
    rejected = fit(two_lots, "uniform", n_bootstrap=200)
    b = rejected.distribution
    theirs = stats.cramervonmises(two_lots, stats.uniform(b.lower, b.upper - b.lower).cdf)
    assert cramer_von_mises(np.sort(two_lots), b) == pytest.approx(theirs.statistic)
    assert rejected.p_value == 1 / 201  # not one of the 200 lies as far away


def _file(tmp_path: Path, lines: list[str], header: str = "device,G_um,D_um,T_um,pull_in_V") -> Path:
    path = tmp_path / "m.csv"
    path.write_text("\n".join([header, *lines]) + "\n", "utf-8")
    return path


_ROW = "a,3.7,2.4,7.0,80"


def test_extra_columns_blank_lines_and_a_missing_device_name_are_tolerated(tmp_path: Path) -> None:
    lines = [f"x,{80 + i},7.0,,2.4,3.7" for i in range(9)]
    m = read_measurements(_file(tmp_path, [*lines, "", ",,"], "wafer,pull_in_V, T_um ,note,D_um,G_um"))
    assert m.device[0] == "line 2"
    assert m.pull_in_V.tolist() == [80.0 + i for i in range(9)]


@pytest.mark.parametrize("separator", [";", "\t"])
@pytest.mark.parametrize("decimal", [",", "."])
def test_semicolons_tabs_and_decimal_commas_are_read(separator: str, decimal: str, tmp_path: Path) -> None:
    lines = [f"x{i},3.{700 + i},2.4,7.0,{80 + i}.5" for i in range(9)]
    told = ["# lot7.csv", "device,G_um,D_um,T_um,pull_in_V", *lines]
    path = tmp_path / "theirs.csv"
    path.write_text("\n".join(line.replace(",", separator).replace(".", decimal) for line in told) + "\n", "utf-8-sig")
    read, plain = read_measurements(path), read_measurements(_file(tmp_path, lines))
    for name in ("G_um", "D_um", "T_um", "pull_in_V"):
        assert getattr(read, name).tolist() == getattr(plain, name).tolist()
    assert read.device == plain.device


def test_the_plate_area_of_the_fit_is_part_of_the_population(tmp_path: Path) -> None:
    m = read_measurements(EXAMPLE)
    mine = calibrate(m, n_bootstrap=20, plate_area_um2=15000.0)
    write_calibration(mine, tmp_path / "mine.toml")
    again = load_population(tmp_path / "mine.toml")
    assert again == mine.population
    assert again.plate_area_um2 == 15000.0
    assert Population.from_dict(json.loads(json.dumps(again.to_dict()))) == again
    # The lot pulls in where its devices did, whatever area the fit took; without it the voltages are another lot's.
    low, high = (again.summary()[f"U_pi_{end}_V"] for end in ("lower", "upper"))
    usual = calibrate(m, n_bootstrap=20).population.summary()
    assert (low, high) == pytest.approx((usual["U_pi_lower_V"], usual["U_pi_upper_V"]), rel=1e-9)
    with pytest.raises(PopulationError, match="fitted with 15000 µm²"):
        again.summary(16700.0)
    with pytest.raises(MeasurementError, match=r"plate area is 0 µm²; it must be above 0"):
        calibrate(m, plate_area_um2=0.0)


def test_the_limits_themselves_are_accepted(tmp_path: Path) -> None:
    columns = ("G_um", "D_um", "T_um", "pull_in_V")
    found = read_devices(_file(tmp_path, ["a,20,0.1,20,1000", "b,0.5,20,0.5,1"]), columns)
    assert [found.values[name].tolist() for name in columns] == [[20.0, 0.5], [0.1, 20.0], [20.0, 0.5], [1000.0, 1.0]]


@pytest.mark.parametrize(
    ("header", "lines", "words"),
    [
        ("device,gap_um,D_um,T_um,pull_in_V", [_ROW] * 9, "no column 'G_um'; is 'gap_um' meant"),
        ("device,G_um,D_um,T_um", [_ROW] * 9, "no column 'pull_in_V'"),
        ("G_um,G_um,D_um,T_um,pull_in_V", [_ROW] * 9, "2 columns 'G_um'"),
        (None, [f"d{i}" + _ROW[1:] for i in range(7)], "has 7 devices; at least 8"),
        (None, [_ROW, "b,3.7e-06,2.4,7,80"], "line 3: G_um is 3.7e-06; expected 0.5–20 µm: are these metres"),
        (None, ["b,3700,2.4,7,80"], "are these nanometres"),
        (None, ["b,3.7,2.4,7,0.08"], "pull_in_V is 0.08; expected 1–1000 V: are these kV"),
        (None, ["b,3.7,2.4,7,5e6"], r"pull_in_V is 5e\+06; expected 1–1000 V$"),
        (None, ["b,3.7,2.4,seven,80"], "T_um is 'seven'; it must be a number"),
        (None, ["b,3.7,2.4,7"], "pull_in_V is ''"),
        (
            None,
            ["b,3,7,2,4,7,80"],
            "line 2: 7 fields, but the heading in line 1 names 5 columns; numbers with a decimal comma need",
        ),
        (
            "G_um;D_um;T_um;pull_in_V",
            ["3,7;2.4;7,0;80"],
            "numbers are written in two ways: '3,7' in line 2 and '2.4' in line 2",
        ),
        ("G_um;D_um;T_um;pull_in_V", ["3,7;2,4;7,0;1.080,5"], r"pull_in_V is 1080\.5; expected 1–1000"),
        (
            "G_um;D_um;T_um;pull_in_V",
            ["3,7;2,4;7,0;1,080,5"],
            "pull_in_V is '1,080,5'; it must be a number such as 3.7",
        ),
        (None, ["b,nan,2.4,7,80"], "G_um is 'nan'"),
        (None, ["b,3.7,-0.5,7,80"], r"D_um is -0\.5; expected 0\.1–20 µm$"),
        (None, ["b,3.7,2.4,20.5,80"], "T_um is 20.5; expected 0.5–20 µm"),
        (None, ["b,3.7,2.4,2e-5,80"], "are these metres"),
        (None, ["b,3.7,2.4,0.02,80"], "are these millimetres"),
        (None, ["b,3.7,2.4,7,1e6"], r"pull_in_V is 1e\+06; expected 1–1000 V: are these mV"),
        (None, ["b,3.7,2.4,3.1458,80"], r"T_um is 3\.1458; Eq. 4 has no stiffness"),
        (None, ["b,2.4,2.4,7,80"], "the travel must be less than the gap"),
        (None, ["b,3.7,2.4,3.0,80"], r"at or below 3\.1458"),
    ],
)
def test_bad_files_are_refused_with_line_column_and_guess(
    header: str | None, lines: list[str], words: str, tmp_path: Path
) -> None:
    path = _file(tmp_path, lines, *([header] if header else []))
    with pytest.raises(MeasurementError, match=words):
        read_measurements(path)


def test_bad_settings_and_senseless_measurements_are_refused(tmp_path: Path) -> None:
    m = read_measurements(EXAMPLE)
    with pytest.raises(MeasurementError, match="cannot be read"):
        read_measurements(tmp_path / "none.csv")
    with pytest.raises(MeasurementError, match="known variables: D, G, E, T"):
        calibrate(m, bounds={"K": (1.0, 2.0)})
    with pytest.raises(MeasurementError, match=r"bounds of D are 2\.4 to 2\.5"):
        calibrate(m, bounds={"D": (2.4, 2.5)})
    for bounds in ((2.3, 2.5), (2.4, 2.7), (2.4, 2.4)):
        with pytest.raises(MeasurementError, match="bounds of D are"):
            calibrate(m, bounds={"D": bounds})
    with pytest.raises(MeasurementError, match="n_bootstrap is 19"):
        calibrate(m, n_bootstrap=19)
    with pytest.raises(MeasurementError, match=r"confidence is 1\.5"):
        calibrate(m, confidence=1.5)
    close = [f"d{i},{3.5 + 0.01 * i},{2.0 + 0.12 * i},{6.0 + 0.1 * i},80" for i in range(12)]
    with pytest.raises(MeasurementError, match=r"no population: .* Give the process's bounds"):
        calibrate(read_measurements(_file(tmp_path, close)), n_bootstrap=20)
    with pytest.raises(MeasurementError, match=r"a modulus of .* GPa; expected"):
        calibrate(m, plate_area_um2=10.0)
    same = read_measurements(_file(tmp_path, [f"d{i}" + _ROW[1:] for i in range(9)]))
    with pytest.raises(MeasurementError, match="D is the same for all devices"):
        calibrate(same)


def test_poor_fits_correlation_and_odd_thickness_are_noted(tmp_path: Path) -> None:
    thickness = [4.9, 5.0, *(9.0 + 0.01 * i for i in range(38))]
    rows = [f"d{i},{3.7 + 0.001 * i},{2.3 if i < 20 else 2.6 + 0.001 * i},{t},150" for i, t in enumerate(thickness)]
    notes = " ".join(calibrate(read_measurements(_file(tmp_path, rows)), n_bootstrap=40).notes)
    assert "38 devices are thinner or thicker" in notes
    assert "correlated" in notes
    assert "D is poorly described" in notes
