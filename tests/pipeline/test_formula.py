"""Claims about laws of one's own: stiffness and mass as formulas."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from softclose.population import PopulationError, load_population
from softclose.population.files import read_population, write_population
from softclose.population.formula import Formula
from softclose.population.population import Population
from softclose.settings import load_config
from softclose.switch.plate import A1, A2, B0, B1, KG_TO_UG

CANTILEVER = """
name = "cantilever"
[D]
distribution = "uniform"
lower = 1.4
upper = 1.6
[G]
distribution = "uniform"
lower = 2.4
upper = 2.6
[E]
distribution = "normal"
mean = 78.0
sd = 4.0
lower = 60.0
upper = 96.0
[T]
distribution = "uniform"
lower = 1.9
upper = 2.1
"""
LAW = """
[law]
W = 60.0
L = 90.0
rho = 19.3
K = "1e3 * E * W * T**3 / (4 * L**3)"
M = "1e-6 * 0.2427 * rho * W * L * T"
"""


def _lot(tmp_path: Path, text: str = CANTILEVER + LAW) -> Population:
    file = tmp_path / "lot.toml"
    file.write_text(text)
    return read_population(file)


def test_a_cantilever_is_as_stiff_and_heavy_as_its_formulas_say(tmp_path: Path) -> None:
    """K = E W T³ / (4 L³) of a cantilever that is loaded at its tip, M = 33/140 of its mass as Rayleigh has it."""
    lot = _lot(tmp_path)
    p = lot.sample_parameters(500, seed=3)
    switches = lot.switches(p)
    k = p[:, 2] * 1e9 * 60e-6 * (p[:, 3] * 1e-6) ** 3 / (4 * 90e-6**3)
    np.testing.assert_allclose(switches[:, 2], k, rtol=1e-12)
    np.testing.assert_allclose(switches[:, 3], 0.2427 * 19.3e3 * 60e-6 * 90e-6 * p[:, 3] * 1e-6 * 1e9, rtol=1e-12)
    np.testing.assert_array_equal(switches[:, :2], p[:, :2])
    many = lot.switches(lot.sample_parameters(200_000, seed=4))
    assert lot.mean_K == pytest.approx(many[:, 2].mean(), rel=2e-3)
    assert lot.mean_M == pytest.approx(many[:, 3].mean(), rel=2e-3)
    found = lot.summary(10_000.0)
    assert found["K_sd_N_per_m"] == pytest.approx(many[:, 2].std(), rel=1e-2)
    assert found["M_sd_ug"] == pytest.approx(many[:, 3].std(), rel=1e-2)


def test_the_plate_s_own_equations_as_formulas_are_the_plate() -> None:
    plate = load_population("current")
    own = Population(
        name="the same",
        D=plate.D,
        G=plate.G,
        E=plate.E,
        T=plate.T,
        formula=Formula(
            K="a2 * E * T * (T - a1)",
            M="unit * a2 * T * (T - a1) / (2 * pi * b1 * (T + b0))**2",
            constants=(("a1", A1), ("a2", A2), ("b0", B0), ("b1", B1), ("unit", KG_TO_UG)),
        ),
    )
    np.testing.assert_allclose(own.sample(1000, seed=1), plate.sample(1000, seed=1), rtol=1e-13)
    assert own.mean_K == pytest.approx(plate.mean_K, rel=1e-9)
    assert own.mean_M == pytest.approx(plate.mean_M, rel=1e-9)
    for name, value in plate.summary().items():
        assert own.summary()[name] == pytest.approx(value, rel=1e-6), name


@given(st.integers(0, 400), st.integers(1, 50))
def test_a_switch_does_not_depend_on_how_many_are_drawn_with_it(start: int, n: int) -> None:
    lot = Population.from_dict(load_population("current").to_dict() | {"law": {"K": "E*T**1.5", "M": "sqrt(T)+0.1*G"}})
    np.testing.assert_array_equal(lot.sample(n, seed=2, start=start), lot.sample(500, seed=2)[start : start + n])


def test_a_formula_may_use_the_gap(tmp_path: Path) -> None:
    lot = _lot(tmp_path, CANTILEVER + '[law]\nK = "E * T * G"\nM = "1 + G"')
    many = lot.switches(lot.sample_parameters(100_000, seed=4))
    assert lot.mean_M == pytest.approx(1.0 + 2.5, rel=1e-3)
    assert lot.mean_K == pytest.approx(many[:, 2].mean(), rel=5e-3)


def test_it_is_read_back_from_its_file_from_a_store_and_by_a_base(tmp_path: Path) -> None:
    lot = _lot(tmp_path)
    assert Population.from_dict(lot.to_dict()) == lot
    write_population(lot, tmp_path / "again.toml")
    assert read_population(tmp_path / "again.toml") == lot
    (tmp_path / "based.toml").write_text('base = "lot.toml"\n[D]\ndistribution = "fixed"\nvalue = 1.5\n')
    based = read_population(tmp_path / "based.toml")
    assert based.formula == lot.formula
    assert based.D.lower == based.D.upper == 1.5
    (tmp_path / "other.toml").write_text('base = "lot.toml"\n[K]\ndistribution = "fixed"\nvalue = 30.0\n[M]\n'
                                         'distribution = "fixed"\nvalue = 1.0\n')  # fmt: skip
    assert read_population(tmp_path / "other.toml").formula is None
    assert load_config({"population": {"name": str(tmp_path / "lot.toml")}}).build_population() == lot


@pytest.mark.parametrize(
    ("law", "said"),
    [
        ('K = "E * H"\nM = "T"', r"K = 'E \* H' names H; a formula may use E, G, T, pi"),
        ('K = "D * E"\nM = "T"', "names D"),
        ('K = "E *"\nM = "T"', "is no formula"),
        ('K = "__import__(\'os\').getcwd()"\nM = "T"', "is no formula"),
        ('K = "E"\n', r"M is missing; it must be a formula in quotes"),
        ('K = 3\nM = "T"', "K is 3; it must be a formula"),
        ('K = "E * (T - 2)"\nM = "T"', r"is -\d.* at G .* T 1.9 µm; it must be above 0"),
        ('K = "log(0 * E)"\nM = "T"', "is -inf at"),
        ('T = 3.0\nK = "E"\nM = "T"', "constant called 'T'"),
        ('W = "wide"\nK = "E*W"\nM = "T"', "W is 'wide'"),
        ('W = inf\nK = "E*W"\nM = "T"', "W is inf"),
        (f'K = "{"E+" * 600}E"\nM = "T"', "characters"),
        ('K = "E > 3"\nM = "foo(T)"', "is no formula"),
    ],
)
def test_what_is_no_law_is_said(law: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(PopulationError, match=said):
        _lot(tmp_path, CANTILEVER + "[law]\n" + law)


def test_a_law_does_not_go_with_what_replaces_it(tmp_path: Path) -> None:
    direct = CANTILEVER.replace("[E]", "[K]").replace("[T]", "[M]")
    with pytest.raises(PopulationError, match=r"\[law\] says how K and M follow from E and T"):
        _lot(tmp_path, direct + '[law]\nK = "E"\nM = "T"')
    targets = 'base = "current"\n[T]\ndistribution = "uniform"\nhalf_width = 0.1\n[targets]\nmean_M_ug = 3.0\n'
    with pytest.raises(PopulationError, match=r"targets are solved for by Eqs. 4 and 6"):
        _lot(tmp_path, targets + LAW)
