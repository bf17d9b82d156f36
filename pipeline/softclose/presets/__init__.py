"""Owns the presets: campaigns that ship with the project, one TOML file each."""

from __future__ import annotations

import os
from pathlib import Path

from softclose.naming import did_you_mean
from softclose.tables import at_home

FOLDER = Path(__file__).parent


class PresetError(ValueError):
    """Neither the name of something shipped nor a file."""


def preset_names() -> list[str]:
    """Names of the shipped presets."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def find_preset(source: str | os.PathLike[str]) -> Path:
    """The file of a preset's name, or the file itself. Raises PresetError where there is neither."""
    return find_named(source, FOLDER, "preset")


def find_named(source: str | os.PathLike[str], folder: Path, what: str) -> Path:
    """The file of a name shipped in folder, or the file itself. Raises PresetError where there is neither."""
    names = sorted(p.stem for p in folder.glob("*.toml"))
    if not isinstance(source, str | os.PathLike):
        raise PresetError(f"{source!r} is no {what} or file; give a TOML file, or one of {', '.join(names)}")
    path = at_home(source)
    if path.suffix == ".toml" or path.is_file():
        return path
    name = os.fspath(source)
    if name in names:
        return folder / f"{name}.toml"
    if path.is_dir():
        raise PresetError(f"{name} is a folder; give a TOML file or a {what}: {', '.join(names)}")
    raise PresetError(f"no {what} or file {name!r}; {did_you_mean(name, names)}shipped: {', '.join(names)}")
