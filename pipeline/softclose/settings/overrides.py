"""Owns overrides of a configuration: texts of the form section.key=value."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable
from typing import Any

from softclose.settings.errors import ConfigError


def texts(overrides: Iterable[str]) -> list[str]:
    found = [overrides] if isinstance(overrides, str) or not isinstance(overrides, Iterable) else list(overrides)
    for text in found:
        if not isinstance(text, str):
            raise ConfigError(f"{text!r} is no setting; give texts of the form section.key=value, e.g. campaign.seed=7")
    return found


def apply(data: dict[str, Any], override: str) -> None:
    """Set one `section.key=value`; the value is TOML, and a bare word is a string."""
    key, sign, text = override.partition("=")
    section, dot, name = key.strip().partition(".")
    if not (sign and dot and section and name):
        raise ConfigError(f"--set {override!r} is not of the form section.key=value, e.g. campaign.seed=7")
    try:
        value = tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        value = text.strip()
    table = data.setdefault(section, {})
    if not isinstance(table, dict):
        raise ConfigError(f"{section} is {table!r}; it must be a table of keys")
    table[name] = value
