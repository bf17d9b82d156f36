"""Owns what the file of a population may say: its tables with their keys and types, checked by pydantic."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import replace
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator
from pydantic.dataclasses import dataclass

from softclose.allowed.refusal import Said
from softclose.allowed.tables import TABLE, Number
from softclose.population.distributions import Area, Bounded, PopulationError
from softclose.population.formula import LawTable
from softclose.population.laws import UNITS
from softclose.population.marginals import Empirical, Marginal, Parent, Truncated, Values

_PAPER_SHAPE_SUM = 4.0

HalfWidth = Annotated[Number, Field(ge=0, lt=1), Said("a fraction of the nominal, from 0 to below 1")]


@dataclass(frozen=True, slots=True, kw_only=True, config=TABLE)
class VariableTable:
    """`[D]` and the like: the distribution of one variable."""

    @abstractmethod
    def marginal(self) -> Marginal | float:
        """The distribution, or the relative half-width where the nominal value is left to the targets.

        Raises PopulationError where the keys make none.
        """

    @model_validator(mode="after")
    def _makes_one(self) -> Self:
        self.marginal()
        return self


@dataclass(frozen=True, slots=True, kw_only=True, config=TABLE)
class BetaTable(VariableTable):
    """A Beta distribution, by its mean or its shapes."""

    distribution: Literal["beta"]
    lower: Number
    upper: Number
    mean: Number | None = None
    shape_sum: Number = _PAPER_SHAPE_SUM
    alpha: Number | None = None
    beta: Number | None = None

    def marginal(self) -> Bounded:
        """The distribution."""
        if (self.mean is not None) == (self.alpha is not None or self.beta is not None):
            raise PopulationError("give either mean (and shape_sum), or alpha and beta")
        if self.mean is not None:
            return Bounded.from_mean(self.lower, self.upper, self.mean, self.shape_sum)
        if self.alpha is None or self.beta is None:
            raise PopulationError(f"{'alpha' if self.alpha is None else 'beta'} is missing")
        return Bounded(lower=self.lower, upper=self.upper, alpha=self.alpha, beta=self.beta)


@dataclass(frozen=True, slots=True, kw_only=True, config=TABLE)
class UniformTable(VariableTable):
    """All values of an interval alike, by its ends or around a nominal value."""

    distribution: Literal["uniform"]
    lower: Number | None = None
    upper: Number | None = None
    nominal: Number | None = None
    half_width: HalfWidth | None = None

    def marginal(self) -> Bounded | float:
        """The distribution, or the half-width where there is no nominal."""
        if self.half_width is not None:
            if self.lower is not None or self.upper is not None:
                raise PopulationError("give either lower and upper, or nominal and half_width, not both")
            return self.half_width if self.nominal is None else around(self.nominal, self.half_width)
        if self.lower is None or self.upper is None:
            raise PopulationError(f"{'lower' if self.lower is None else 'upper'} is missing")
        return Bounded(lower=self.lower, upper=self.upper)


@dataclass(frozen=True, slots=True, kw_only=True, config=TABLE)
class TruncatedTable(VariableTable):
    """A truncated normal or lognormal distribution, by its moments or its parameters."""

    distribution: Parent
    lower: Number
    upper: Number
    mean: Number | None = None
    sd: Number | None = None
    location: Number | None = None
    scale: Number | None = None
    offset: Number = 0.0
    factor: Number = 1.0

    def marginal(self) -> Truncated:
        """The distribution."""
        by_moments = self.mean is not None or self.sd is not None
        if by_moments == (self.location is not None or self.scale is not None):
            raise PopulationError("give either mean and sd, or location and scale, of the values before truncation")
        if by_moments:
            if self.mean is None or self.sd is None:
                raise PopulationError(f"{'mean' if self.mean is None else 'sd'} is missing")
            found = Truncated.from_moments(self.distribution, self.mean, self.sd, self.lower, self.upper)
        else:
            if self.location is None or self.scale is None:
                raise PopulationError(f"{'location' if self.location is None else 'scale'} is missing")
            found = Truncated(
                kind=self.distribution, location=self.location, scale=self.scale, low=self.lower, high=self.upper
            )
        return replace(found, offset=self.offset, factor=self.factor)


@dataclass(frozen=True, slots=True, kw_only=True, config=TABLE)
class EmpiricalTable(VariableTable):
    """A lot's own devices."""

    distribution: Literal["empirical"]
    values: Values

    def marginal(self) -> Empirical:
        """The distribution."""
        return Empirical(values=self.values)


@dataclass(frozen=True, slots=True, kw_only=True, config=TABLE)
class FixedTable(VariableTable):
    """One value."""

    distribution: Literal["fixed"]
    value: Number

    def marginal(self) -> Bounded:
        """An interval of no width."""
        return Bounded(lower=self.value, upper=self.value)


Described = Annotated[
    BetaTable | UniformTable | TruncatedTable | EmpiricalTable | FixedTable, Field(discriminator="distribution")
]


@dataclass(frozen=True, slots=True, kw_only=True, config=TABLE)
class Targets:
    """`[targets]`: means from which nominal values follow."""

    mean_M_ug: Number | None = None
    """Mean mass [µg], which gives T."""
    mean_K_N_per_m: Number | None = None
    """Mean stiffness [N/m], which gives E."""


@dataclass(frozen=True, slots=True, kw_only=True, config=TABLE)
class Transform:
    """`[transform.D]` and the like: what Eqs. 14 and 15 make of a variable."""

    shift_mean: Number = 0.0
    """What is added to the mean, in the variable's unit."""
    repeatability: Number = 1.0
    """What the spread is multiplied by."""


@dataclass(frozen=True, slots=True, kw_only=True, config=TABLE)
class PopulationFile:
    """A whole file."""

    name: str | None = None
    description: str | None = None
    plate_area_um2: Area | None = None
    base: Annotated[str, Said("the name of a population or a file's path")] | None = None
    """The population that the file changes."""
    D: Described | None = None
    G: Described | None = None
    E: Described | None = None
    T: Described | None = None
    K: Described | None = None
    M: Described | None = None
    f: Described | None = None
    U_pi: Described | None = None
    correlation: dict[str, Number] | None = None
    """`E-T = 0.78` each."""
    law: LawTable | None = None
    targets: Targets | None = None
    transform: dict[str, Transform] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _correlates(self) -> Self:
        self.pairs()
        return self

    @property
    def variables(self) -> dict[str, VariableTable]:
        """The variables that the file describes."""
        return {v: table for v in UNITS if (table := getattr(self, v)) is not None}

    def pairs(self) -> tuple[tuple[str, str, float], ...]:
        """Rank correlations of pairs of variables."""
        found = []
        for key, rho in (self.correlation or {}).items():
            a, dash, b = key.partition("-")
            if not (dash and a in UNITS and b in UNITS):
                raise PopulationError(
                    f"[correlation] {key!r} is no pair of variables; write two of {', '.join(UNITS)}, as E-T = 0.78"
                )
            found.append((a, b, rho))
        return tuple(found)


def around(nominal: float, half: float) -> Bounded:
    """Uniform within a fraction of a nominal value."""
    return Bounded(lower=nominal * (1.0 - half), upper=nominal * (1.0 + half))
