"""Owns the description of a study: a campaign repeated over the values of one parameter, as a TOML file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Annotated, Any, Self

from annotated_types import MinLen
from pydantic import Field, model_validator
from pydantic.dataclasses import dataclass

from softclose.allowed.refusal import Said, shown
from softclose.allowed.tables import TABLE, Number, checked, refuses_with
from softclose.allowed.types import Text
from softclose.population import UNITS, Population
from softclose.presets import PresetError, find_named
from softclose.settings import CampaignConfig, ConfigError, load_config, read_toml
from softclose.tables import LARGEST_INTEGER, toml_value
from softclose_workflows.studies.series import Member

FOLDER = Path(__file__).parent / "shipped"

TRANSFORMS = {
    "population.shift_mean": "Eq. 14: value times `weights` is added to the means",
    "population.repeatability": "Eq. 15: the spread of `variables` is multiplied by the value",
}
"""Parameters that are no key of the configuration but a transform of the population."""

TOGETHER = {"trim.error": ("trim.pull_in_error", "trim.resonance_error")}
"""Parameters that set several keys to one value."""


@dataclass(frozen=True, slots=True, kw_only=True, config=TABLE)
class StudyFile:
    """What a file says of a study."""

    name: Text
    """Short name."""
    title: str = ""
    """What it asks; the name where it is left out."""
    base: Text
    """Preset or file that every campaign starts from."""
    parameter: Text
    """`section.key` of the configuration, or one of TRANSFORMS or TOGETHER."""
    values: Annotated[tuple[Number, ...], MinLen(2), Said("a list of two or more numbers, each once")]
    """Its values."""
    unit: str = ""
    """Their unit."""
    set: dict[str, Any] = Field(default_factory=dict)
    """Settings common to all: keys such as campaign.budget, as tables or in quotes."""
    weights: dict[str, Number] = Field(default_factory=dict)
    """population.shift_mean: change of each variable's mean per unit of the value [µm, GPa]."""
    variables: tuple[str, ...] = ("D", "G", "T")
    """population.repeatability: variables whose spread changes."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if len({*self.values}) < len(self.values):
            raise ValueError(f"values is {shown(list(self.values))}; each value may be there once")
        for v in (*self.weights, *self.variables):
            if v not in UNITS:
                raise ValueError(f"{shown(v)} is no variable of a population; it must be one of {', '.join(UNITS)}")
        if self.parameter == "population.shift_mean" and not self.weights:
            raise ValueError("population.shift_mean needs [weights]: the change of each mean per unit of the value")
        return self


@refuses_with(ConfigError)
@dataclass(frozen=True, slots=True, kw_only=True, config=TABLE)
class Study(StudyFile):
    """A campaign over the values of one parameter."""

    overrides: tuple[str, ...] = ()
    """Settings common to all that were given beside the file, `section.key=value`."""

    @property
    def settings(self) -> tuple[str, ...]:
        """Settings common to all, `section.key=value`; the last of two counts."""
        return (*(f"{key}={toml_value(value)}" for key, value in _flat(self.set)), *self.overrides)

    def members(self) -> list[Member]:
        """One campaign per value; raises ConfigError or PopulationError where a value is not allowed."""
        return [self._member(value) for value in self.values]

    def _member(self, value: float) -> Member:
        path = self.base
        settings = list(self.settings)
        if self.parameter not in TRANSFORMS:
            settings += [f"{key}={_number(value)}" for key in TOGETHER.get(self.parameter, (self.parameter,))]
        config = load_config(path, settings)
        label = f"{self.parameter.rpartition('.')[2]} {value:g}"
        data = config.to_dict()
        if self.parameter in TRANSFORMS:
            data["population_model"] = self._transformed(config.build_population(), value, label).to_dict()
        data["campaign"]["name"] = f"{config.campaign.name}, {label}"
        return Member(name=label.replace(" ", "-"), config=CampaignConfig.from_dict(data))

    def _transformed(self, population: Population, value: float, label: str) -> Population:
        lacks = [v for v in (*self.weights, *self.variables) if v not in population.variables]
        if lacks and self.parameter.startswith("population."):
            raise ConfigError(
                f"population {population.name!r} has no {lacks[0]}, which the study changes; it has "
                f"{', '.join(population.variables)}"
            )
        if self.parameter == "population.shift_mean":
            changed = {v: getattr(population, v).shift_mean(w * value) for v, w in self.weights.items()}
        else:
            changed = {v: getattr(population, v).scale_spread(value) for v in self.variables}
        return replace(population, name=f"{population.name}, {label}", **changed)


def load_study(source: str, overrides: tuple[str, ...] = ()) -> Study:
    """A shipped study by name, or one described by a TOML file. Raises ConfigError naming the file and the problem."""
    try:
        path = find_named(source, FOLDER, "study")
    except PresetError as e:
        raise ConfigError(str(e)) from e
    try:
        file = checked(StudyFile, read_toml(path), ConfigError)
    except ConfigError as e:
        raise ConfigError(f"{path}: {e}") from e
    said = {f.name: getattr(file, f.name) for f in fields(StudyFile)}
    return Study(**said | {"title": file.title or file.name}, overrides=overrides)


def _flat(table: Mapping[str, Any]) -> list[tuple[str, Any]]:
    """[set] may be nested, as TOML reads `campaign.budget = 50`, or hold quoted dotted keys."""
    return [
        (f"{section}.{key}" if isinstance(values, Mapping) else section, value)
        for section, values in table.items()
        for key, value in (values.items() if isinstance(values, Mapping) else [(section, values)])
    ]


def _number(value: float) -> str:
    """A value in TOML; a whole one as an integer, which settings of both kinds take."""
    return str(int(value)) if value.is_integer() and abs(value) <= LARGEST_INTEGER else repr(value)
