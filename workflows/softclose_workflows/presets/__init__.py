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
    if Path(source).is_dir() and Path(source).suffix != ".toml":
        raise ConfigError(f"{source} is a folder; give a TOML file or a preset: {', '.join(preset_names())}")
    return find_named(source, FOLDER, "preset")


def find_named(source: str, folder: Path, what: str) -> Path:
    """The file of a name shipped in folder, or the file itself. Raises ConfigError where there is neither."""
    path = Path(source)
    if path.suffix == ".toml" or path.is_file():
        return path
    names = sorted(p.stem for p in folder.glob("*.toml"))
    if source in names:
        return folder / f"{source}.toml"
    near = difflib.get_close_matches(source, names, n=1)
    hint = f"did you mean {near[0]}? " if near else ""
    raise ConfigError(f"no {what} or file {source!r}; {hint}shipped: {', '.join(names)}")
