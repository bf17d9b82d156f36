"""Owns the presets: campaigns that ship with the project, one TOML file each."""

from __future__ import annotations

import difflib
from pathlib import Path

from softclose.config import ConfigError

FOLDER = Path(__file__).parent


def preset_names() -> list[str]:
    """Names of the shipped presets."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def find_preset(source: str) -> Path:
    """The file of a preset's name, or the file itself. Raises ConfigError where there is neither."""
    path = Path(source)
    if path.suffix == ".toml" or path.is_file():
        return path
    if path.is_dir():
        raise ConfigError(f"{source} is a folder; give a TOML file or a preset: {', '.join(preset_names())}")
    shipped = FOLDER / f"{source}.toml"
    if shipped.exists():
        return shipped
    near = difflib.get_close_matches(source, preset_names(), n=1)
    hint = f"did you mean {near[0]}? " if near else ""
    raise ConfigError(f"no preset or file {source!r}; {hint}presets: {', '.join(preset_names())}")
