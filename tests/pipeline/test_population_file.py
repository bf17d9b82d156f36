"""Population TOML: bases, transforms, targets, and errors that name the place and the nearest known word."""

from __future__ import annotations

from pathlib import Path

import pytest

from softclose import Population, load_population
from softclose.population.distributions import Bounded, PopulationError
from softclose.population.files import write_population

_D = '[D]\ndistribution = "uniform"\nlower = 2.0\nupper = 2.5\n'
_G = '[G]\ndistribution = "beta"\nlower = 3.0\nupper = 4.0\nalpha = 2\nbeta = 3\n'
_E = '[E]\ndistribution = "fixed"\nvalue = 80\n'
_T = '[T]\ndistribution = "uniform"\nnominal = 7.0\nhalf_width = 0.1\n'


def _load(tmp_path: Path, text: str) -> Population:
    path = tmp_path / "mine.toml"
    path.write_text(text, "utf-8")
    return load_population(path)


def test_a_file_describes_all_four_variables(tmp_path: Path) -> None:
    p = _load(tmp_path, 'name = "mine"\n' + _D + _G + _E + _T)
    assert p.name == "mine"
    assert Bounded(lower=2.0, upper=2.5) == p.D
    assert Bounded(lower=3.0, upper=4.0, alpha=2.0, beta=3.0) == p.G
    assert Bounded(lower=80.0, upper=80.0) == p.E
    assert p.T.lower == pytest.approx(6.3)
    assert (p.sample_parameters(5, seed=0)[:, 2] == 80.0).all()
    assert p.summary()["K_sd_N_per_m"] > 0.0


def test_a_beta_with_a_mean_has_the_papers_shapes_unless_others_are_given(tmp_path: Path) -> None:
    d = '[D]\ndistribution = "beta"\nlower = 2.0\nupper = 2.5\nmean = 2.1\n'
    p = _load(tmp_path, d + _G + _E + _T)
    assert (p.D.alpha, p.D.beta) == pytest.approx((0.8, 3.2))
    assert _load(tmp_path, d + "shape_sum = 10\n" + _G + _E + _T).D.alpha == pytest.approx(2.0)


def test_a_nominal_without_scatter_is_a_fixed_value_that_meets_the_target(tmp_path: Path) -> None:
    t = '[T]\ndistribution = "uniform"\nhalf_width = 0\n'
    p = _load(tmp_path, _D + _G + _E + t + "[targets]\nmean_M_ug = 3.41\n")
    assert p.T.lower == p.T.upper
    assert p.mean_M == pytest.approx(3.41, rel=1e-11)


def test_what_is_written_reads_back_equal_with_a_fixed_variable_before_others(tmp_path: Path) -> None:
    p = _load(tmp_path, _D + _G + _E + _T)
    write_population(p, tmp_path / "x.toml")
    assert load_population(tmp_path / "x.toml") == p
    assert (tmp_path / "x.toml").read_text("utf-8").endswith("\n")


def test_transforms_compose_and_may_fix_a_variable(tmp_path: Path) -> None:
    p = _load(tmp_path, 'base = "current"\n[transform.D]\nshift_mean = -0.1\nrepeatability = 0.0\n')
    assert p.D.lower == pytest.approx(2.33)
    assert p.D.upper == pytest.approx(2.33)
    assert load_population("current").G == p.G


def test_a_base_may_be_a_file_beside_it(tmp_path: Path) -> None:
    (tmp_path / "lot.toml").write_text(_D + _G + _E + _T, "utf-8")
    assert _load(tmp_path, 'base = "lot.toml"\n' + _E.replace("80", "75")).E.mean == 75.0


def test_transform_by_file_equals_the_shipped_modified_design(tmp_path: Path) -> None:
    text = 'name = "modified"\nbase = "current"\n'
    text += "".join(f"[transform.{v}]\nshift_mean = {x}\n" for v, x in (("D", -0.5), ("G", 0.5), ("T", 0.6)))
    mine, shipped = _load(tmp_path, text), load_population("modified")
    assert [mine.D, mine.G, mine.E, mine.T] == [shipped.D, shipped.G, shipped.E, shipped.T]


@pytest.mark.parametrize("name", ["current", "modified"])
def test_what_is_written_reads_back_equal(name: str, tmp_path: Path) -> None:
    population = load_population(name)
    odd = Population.from_dict(population.to_dict() | {"name": 'a "lot"\\7', "description": "two\nlines"})
    write_population(odd, tmp_path / "x.toml", comments=["fitted", ""])
    assert load_population(tmp_path / "x.toml") == odd


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[D\n", "not valid TOML"),
        ('base = "curent"\n', "did you mean 'current'"),
        ("base = 3\n", "base is 3"),
        (_D + _G + _E, r"\[T\] is missing"),
        ('bass = "current"\n', "unknown key 'bass'; did you mean 'base'"),
        ('base = "current"\nD = 3\n', r"it must be a table, \[D\]"),
        ('base = "current"\n[D]\ndistribution = "bta"\n', "did you mean 'beta'"),
        ('base = "current"\n[D]\ndistribution = "beta"\nlowr = 2\n', "did you mean 'lower'"),
        ('base = "current"\n[D]\ndistribution = "beta"\nlower = 2\nupper = 3\n', "either mean .* or alpha and beta"),
        ('base = "current"\n[D]\ndistribution = "beta"\nlower = 2\nupper = 3\nmean = 3.1\n', "between lower, 2"),
        ('base = "current"\n[D]\ndistribution = "uniform"\nlower = "2"\nupper = 3\n', "lower is '2'"),
        ('base = "current"\n[D]\ndistribution = "uniform"\nlower = 2.5\nupper = 2.4\n', "exchange them"),
        ('base = "current"\n[D]\ndistribution = "uniform"\nlower = 2.5\nupper = 3.6\n', "every switch needs D < G"),
        ('base = "current"\n[D]\ndistribution = "uniform"\nlower = -1\nupper = 2\n', "must stay above 0"),
        ('base = "current"\n[D]\ndistribution = "uniform"\nhalf_width = 0.1\n', "only those of E and T"),
        ('base = "current"\n[T]\ndistribution = "uniform"\nhalf_width = 0.1\n', "targets.mean_M_ug"),
        ('base = "current"\n[T]\ndistribution = "uniform"\nhalf_width = 1\n', "half_width is 1"),
        ('base = "current"\n[T]\ndistribution = "uniform"\nhalf_width = -0.5\n', "half_width is -0.5"),
        ('base = "current"\n[T]\ndistribution = "uniform"\nlower = 6\n', "upper is missing"),
        ('base = "current"\n[T]\ndistribution = "fixed"\nvalue = true\n', "value is True"),
        ('base = "current"\n[T]\ndistribution = "fixed"\nvalue = nan\n', "value is nan"),
        ('base = "current"\n[T]\ndistribution = "uniform"\nhalf_width = 0.1\nlower = 2\n', "not both"),
        ('base = "current"\n[T]\ndistribution = "uniform"\nhalf_width = 0\n[targets]\nmean_M_ug = 99\n', "Eq. 6 gives"),
        ('base = "current"\n[T]\ndistribution = "uniform"\nlower = 3\nupper = 7\n', "Eq. 4 has no stiffness"),
        ('base = "current"\n[targets]\nmean_M_ug = 3.0\n', "leaves no nominal"),
        ('base = "current"\n[transform.K]\nshift_mean = 1\n', "unknown key 'K'"),
        ('base = "current"\n[transform.T]\nshift = 1\n', "did you mean 'shift_mean'"),
        ('base = "current"\n[transform.T]\nshift_mean = -9\n', "above minus the mean"),
        ('base = "current"\n[transform.T]\nrepeatability = -1\n', "0 or more"),
        ('base = "current"\n[transform.D]\nshift_mean = 1\n', "every switch needs D < G"),
        ('base = "mine.toml"\n', "in a circle"),
    ],
)
def test_errors_name_the_file_the_place_and_the_way_out(text: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(PopulationError, match=words) as caught:
        _load(tmp_path, text)
    assert "mine.toml" in str(caught.value)


def test_unknown_names_and_unreadable_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(PopulationError, match=r"'modifed'; did you mean 'modified'\? known"):
        load_population("modifed")
    with pytest.raises(PopulationError, match="cannot be read"):
        load_population(tmp_path / "none.toml")
