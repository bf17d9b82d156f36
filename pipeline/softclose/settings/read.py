"""Owns reading a configuration: a preset by name, a TOML file or a mapping, with overrides."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from softclose.plugins import EngineError, ModelError, QuantityError
from softclose.presets import FOLDER, PresetError, find_preset
from softclose.settings.config import CampaignConfig, validated
from softclose.settings.errors import ConfigError
from softclose.settings.overrides import apply, texts
from softclose.settings.scaled import PUBLISHED
from softclose.tables import at_home, read_tables


def load_config(source: str | Path | Mapping[str, Any], overrides: Iterable[str] = ()) -> CampaignConfig:
    """Read a preset by name, a TOML file or a mapping, apply overrides, validate.

    Parameters
    ----------
    source : str, Path or mapping
        Relative paths of populations and modes in a TOML are taken from its own folder, those of overrides from here.
    overrides : iterable of str
        `section.key=value` each. With another `population.name` than a shipped preset's, the prices, limits and the
        step that it spells out for its own lot are left to scale with the new one.

    Returns
    -------
    CampaignConfig

    Raises
    ------
    ConfigError
        Naming every problem: what was got, what is allowed.
    """
    if isinstance(source, Mapping):
        data, where = _copy(source), None
    else:
        try:
            where = find_preset(source)
        except PresetError as e:
            raise ConfigError(str(e)) from e
        data = read_toml(where)
    for section, key in (("population", "name"), ("model", "modes")):
        table = data.get(section)
        if not isinstance(table, dict):
            continue
        name = table.get(key)
        if isinstance(name, str) and name.startswith("~"):
            table[key] = str(at_home(name))
        elif where is not None and isinstance(name, str) and name.endswith(".toml") and not Path(name).is_absolute():
            beside = where.parent / name
            if beside.exists():
                table[key] = str(beside)
    given = texts(overrides)
    if where is not None and where.parent == FOLDER:
        _leave_to_the_lot(data, {text.partition("=")[0].strip() for text in given})
    for override in given:  # paths in them are from where the user stands, not from a file's own folder
        apply(data, override)
    config = validated(data)
    try:
        config.check_plugins()
        config = config.with_options()
    except (EngineError, ModelError, QuantityError) as e:
        raise ConfigError(str(e)) from e
    return config


def read_toml(path: Path) -> dict[str, Any]:
    """Parse one TOML file. Raises ConfigError with the path and the position."""
    return read_tables(at_home(path), "the configuration", ConfigError)


def _leave_to_the_lot(data: dict[str, Any], given: set[str]) -> None:
    """Drop what a shipped preset says of its own lot, where the user puts another one in its place: prices and limits
    of the published study's are no other lot's."""
    if "population.name" in given:
        objective = data.get("objective", {})
        chance = objective.get("form") == "chance"  # its penalty is a choice, and an exact one for many lots
        for name in {*PUBLISHED, "max_open"} - ({"chance_penalty_cm_s"} if chance else set()):
            objective.pop(name, None)
    if given & {"population.name", "waveform.max_volts"}:
        data.get("reference", {}).pop("step_volts", None)


def _copy(source: Mapping[str, Any]) -> dict[str, Any]:
    return {k: _copy(v) if isinstance(v, Mapping) else v for k, v in source.items()}
