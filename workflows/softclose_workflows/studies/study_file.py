"""Owns the description of a study: a campaign repeated over the values of one parameter, as a TOML file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from softclose.population import UNITS, Population
from softclose.presets import PresetError, find_named
from softclose.settings import CampaignConfig, ConfigError, load_config, read_toml
from softclose_workflows.studies.series import Member

FOLDER = Path(__file__).parent / "shipped"

TRANSFORMS = {
    "population.shift_mean": "Eq. 14: value times `weights` is added to the means",
    "population.repeatability": "Eq. 15: the spread of `variables` is multiplied by the value",
}
"""Parameters that are no key of the configuration but a transform of the population."""

TOGETHER = {"trim.error": ("trim.pull_in_error", "trim.resonance_error")}
"""Parameters that set several keys to one value."""

KEYS = ("name", "title", "base", "parameter", "values", "unit", "set", "weights", "variables")


@dataclass(frozen=True, slots=True, kw_only=True)
class Study:
    """A campaign over the values of one parameter."""

    name: str
    """Short name."""
    title: str
    """What it asks."""
    base: str
    """Preset or file that every campaign starts from."""
    parameter: str
    """`section.key` of the configuration, or one of TRANSFORMS or TOGETHER."""
    values: tuple[float, ...]
    """Its values."""
    unit: str = ""
    """Their unit."""
    settings: tuple[str, ...] = ()
    """Overrides common to all, `section.key=value`."""
    weights: Mapping[str, float] = field(default_factory=dict)
    """population.shift_mean: change of each variable's mean per unit of the value [µm, GPa]."""
    variables: tuple[str, ...] = ("D", "G", "T")
    """population.repeatability: variables whose spread changes."""

    def members(self) -> list[Member]:
        """One campaign per value; raises ConfigError or PopulationError where a value is not allowed."""
        return [self._member(value) for value in self.values]

    def _member(self, value: float) -> Member:
        path = self.base
        settings = list(self.settings)
        if self.parameter not in TRANSFORMS:
            settings += [f"{key}={value!r}" for key in TOGETHER.get(self.parameter, (self.parameter,))]
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
    data = read_toml(path)
    try:
        study = _study(data)
    except ConfigError as e:
        raise ConfigError(f"{path}: {e}") from e
    return replace(study, settings=(*study.settings, *overrides))


def _study(data: Mapping[str, Any]) -> Study:
    unknown = [key for key in data if key not in KEYS]
    if unknown:
        raise ConfigError(f"unknown key {unknown[0]!r}; a study has {', '.join(KEYS)}")
    missing = [key for key in ("name", "base", "parameter", "values") if key not in data]
    if missing:
        raise ConfigError(f"{missing[0]} is missing; a study needs name, base, parameter and values")
    values = data["values"]
    if not isinstance(values, list) or len(values) < 2 or not all(_is_number(v) for v in values):
        raise ConfigError(f"values is {values!r}; it must be a list of two or more numbers")
    if len(set(values)) < len(values):
        raise ConfigError(f"values is {values!r}; each value may be there once")
    settings = data.get("set", {})
    if not isinstance(settings, Mapping):
        raise ConfigError("set is no table; write settings of all campaigns as [set] with keys such as campaign.budget")
    weights, variables = data.get("weights", {}), tuple(data.get("variables", ("D", "G", "T")))
    for v in (*weights, *variables):
        if v not in UNITS:
            raise ConfigError(f"{v!r} is no variable of a population; it must be one of {', '.join(UNITS)}")
    if data["parameter"] == "population.shift_mean" and not weights:
        raise ConfigError("population.shift_mean needs [weights]: the change of each mean per unit of the value")
    return Study(
        name=str(data["name"]),
        title=str(data.get("title", data["name"])),
        base=str(data["base"]),
        parameter=str(data["parameter"]),
        values=tuple(values),
        unit=str(data.get("unit", "")),
        settings=tuple(f"{key}={_toml(value)}" for key, value in _flat(settings)),
        weights={k: float(w) for k, w in weights.items()},
        variables=variables,
    )


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _flat(table: Mapping[str, Any]) -> list[tuple[str, Any]]:
    """[set] may be nested, as TOML reads `campaign.budget = 50`, or hold quoted dotted keys."""
    return [
        (f"{section}.{key}" if isinstance(values, Mapping) else section, value)
        for section, values in table.items()
        for key, value in (values.items() if isinstance(values, Mapping) else [(section, values)])
    ]


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    return f'"{value}"' if isinstance(value, str) else str(value)
