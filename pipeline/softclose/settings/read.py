"""Owns reading a configuration: a preset by name, a TOML file or a mapping, with overrides."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from softclose.plugins import EngineError, ModelError
from softclose.presets import PresetError, find_preset
from softclose.settings.config import CampaignConfig, validated
from softclose.settings.errors import ConfigError
from softclose.settings.overrides import apply, texts
from softclose.tables import at_home, read_tables


def load_config(source: str | Path | Mapping[str, Any], overrides: Iterable[str] = ()) -> CampaignConfig:
    """Read a preset by name, a TOML file or a mapping, apply overrides, validate.

    Parameters
    ----------
    source : str, Path or mapping
        Relative paths of populations and modes in a TOML are taken from its own folder, those of overrides from here.
    overrides : iterable of str
        `section.key=value` each.

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
    for override in texts(overrides):  # paths in them are from where the user stands, not from a file's own folder
        apply(data, override)
    config = validated(data)
    try:
        config.check_plugins()
    except (EngineError, ModelError) as e:
        raise ConfigError(str(e)) from e
    return config


def read_toml(path: Path) -> dict[str, Any]:
    """Parse one TOML file. Raises ConfigError with the path and the position."""
    return read_tables(at_home(path), "the configuration", ConfigError)


def _copy(source: Mapping[str, Any]) -> dict[str, Any]:
    return {k: _copy(v) if isinstance(v, Mapping) else v for k, v in source.items()}
