"""Claims about the tables of a population's file: which distribution they make, and what is missing of one."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import TypeAdapter, ValidationError

from softclose.population.described import Described, PopulationFile, Transform, VariableTable, around
from softclose.population.distributions import Bounded
from softclose.population.marginals import Empirical, Truncated

TABLES: TypeAdapter[VariableTable] = TypeAdapter(Described)
ENDS = {"lower": 2.0, "upper": 3.0}


def made(distribution: str, **keys: Any) -> Any:
    return TABLES.validate_python({"distribution": distribution} | keys).marginal()


def test_a_beta_is_told_by_its_mean_or_its_shapes() -> None:
    assert made("beta", **ENDS, mean=2.25) == Bounded(lower=2.0, upper=3.0, alpha=1.0, beta=3.0)
    assert made("beta", **ENDS, mean=2.25, shape_sum=8.0) == Bounded(lower=2.0, upper=3.0, alpha=2.0, beta=6.0)
    assert made("beta", **ENDS, alpha=1.5, beta=5.0) == Bounded(lower=2.0, upper=3.0, alpha=1.5, beta=5.0)


def test_a_uniform_is_told_by_its_ends_or_around_a_nominal_value() -> None:
    assert made("uniform", **ENDS) == Bounded(lower=2.0, upper=3.0)
    assert made("uniform", nominal=50.0, half_width=0.1) == around(50.0, 0.1)
    assert (around(50.0, 0.1).lower, around(50.0, 0.1).upper) == pytest.approx((45.0, 55.0))
    assert made("uniform", half_width=0.1) == 0.1, "what it lies around is left to the targets"
    assert made("uniform", half_width=0.0) == 0.0


@pytest.mark.parametrize("kind", ["normal", "lognormal"])
def test_a_truncated_one_is_told_by_its_moments_or_its_parameters(kind: Any) -> None:
    plain = made(kind, **ENDS, location=1.0, scale=0.2)
    assert plain == Truncated(kind=kind, location=1.0, scale=0.2, low=2.0, high=3.0, offset=0.0, factor=1.0)
    assert made(kind, **ENDS, mean=2.4, sd=0.3) == Truncated.from_moments(kind, 2.4, 0.3, 2.0, 3.0)
    moved = made(kind, **ENDS, mean=2.4, sd=0.3, offset=0.5, factor=1.5)
    assert (moved.offset, moved.factor) == (0.5, 1.5)
    assert moved.location == Truncated.from_moments(kind, 2.4, 0.3, 2.0, 3.0).location


def test_devices_and_one_value_are_themselves() -> None:
    assert made("empirical", values=[2.0, 2.5, 2.25, 2.75, 2.0]) == Empirical(values=(2.0, 2.5, 2.25, 2.75, 2.0))
    assert made("fixed", value=80.0) == Bounded(lower=80.0, upper=80.0)


@pytest.mark.parametrize(
    ("table", "said"),
    [
        (("beta", ENDS), "give either mean .* or alpha and beta"),
        (("beta", ENDS | {"mean": 2.5, "alpha": 2.0}), "give either mean"),
        (("beta", ENDS | {"mean": 2.5, "beta": 2.0}), "give either mean"),
        (("beta", ENDS | {"alpha": 2.0}), "beta is missing"),
        (("beta", ENDS | {"beta": 2.0}), "alpha is missing"),
        (("uniform", {"upper": 2.0}), "lower is missing"),
        (("uniform", {"lower": 2.0}), "upper is missing"),
        (("uniform", {"lower": 2.0, "half_width": 0.1}), "not both"),
        (("uniform", {"upper": 2.0, "nominal": 2.0, "half_width": 0.1}), "not both"),
        (("normal", ENDS), "give either mean and sd, or location and scale"),
        (("normal", ENDS | {"mean": 2.5, "scale": 1.0}), "give either mean and sd"),
        (("normal", ENDS | {"sd": 2.5, "location": 1.0}), "give either mean and sd"),
        (("normal", ENDS | {"mean": 2.5}), "sd is missing"),
        (("normal", ENDS | {"sd": 0.5}), "mean is missing"),
        (("normal", ENDS | {"location": 2.5}), "scale is missing"),
        (("lognormal", ENDS | {"scale": 0.5}), "location is missing"),
    ],
)
def test_what_is_missing_or_said_twice_is_named(table: tuple[str, dict[str, float]], said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        made(table[0], **table[1])


def test_a_file_has_the_variables_that_it_describes_in_one_order() -> None:
    one = {"distribution": "fixed", "value": 2.0}
    file = TypeAdapter(PopulationFile).validate_python({"G": one, "U_pi": one, "D": one})
    assert list(file.variables) == ["D", "G", "U_pi"]
    assert file.pairs() == ()
    assert file.transform == {}


def test_correlations_are_of_pairs_of_variables() -> None:
    whole = TypeAdapter(PopulationFile)
    assert whole.validate_python({"correlation": {"E-T": 0.78, "D-G": -0.2}}).pairs() == (
        ("E", "T", 0.78),
        ("D", "G", -0.2),
    )
    for key in ("E", "E-", "-T", "E-X", "X-T", "E_T"):
        with pytest.raises(ValidationError, match="is no pair of variables; write two of D, G"):
            whole.validate_python({"correlation": {key: 0.5}})


def test_what_is_not_said_of_a_transform_changes_nothing() -> None:
    assert (Transform().shift_mean, Transform().repeatability) == (0.0, 1.0)
