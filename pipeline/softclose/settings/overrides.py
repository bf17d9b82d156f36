"""Owns overrides of a configuration: texts of the form section.key=value."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable
from typing import Any

from softclose.settings.errors import ConfigError
from softclose.tables import parsed_tables

MOST_CHARACTERS = 100_000


def texts(overrides: Iterable[str]) -> list[str]:
    found = [overrides] if isinstance(overrides, str) or not isinstance(overrides, Iterable) else list(overrides)
    for text in found:
        if not isinstance(text, str):
            raise ConfigError(f"{text!r} is no setting; give texts of the form section.key=value, e.g. campaign.seed=7")
    return found


def is_toml(text: str) -> bool:
    """Whether a value is TOML; else it is a word. What is TOML but for its size is, and is refused by its reader."""
    try:
        tomllib.loads(f"value = {text}")
    except tomllib.TOMLDecodeError:
        return False
    except (ValueError, RecursionError, MemoryError):
        return True
    return True


def apply(data: dict[str, Any], override: str) -> None:
    """Set one `section.key=value`, or `section.table.key=value`; the value is TOML, and a bare word is a string."""
    key, sign, text = override.partition("=")
    section, dot, name = key.strip().partition(".")
    if not (sign and dot and section and name):
        raise ConfigError(f"--set {override!r} is not of the form section.key=value, e.g. campaign.seed=7")
    if len(text) > MOST_CHARACTERS:
        raise ConfigError(f"--set {key.strip()} has {len(text):,} characters; at most {MOST_CHARACTERS:,}: use a file")
    if is_toml(text):
        value = parsed_tables(f"value = {text}", f"--set {key.strip()}", ConfigError)["value"]
    else:
        value = text.strip()
    *tables, last = [section, *name.split(".")]
    table = data
    for depth, part in enumerate(tables, start=1):
        table = table.setdefault(part, {})
        if not isinstance(table, dict):
            raise ConfigError(f"{'.'.join(tables[:depth])} is {table!r}; it must be a table of keys")
    table[last] = value
