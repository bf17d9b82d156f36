"""Owns how a user's TOML is read, whole and bounded, with the reader's own error, and how TOML is written."""

from __future__ import annotations

import math
import os
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

MOST_BYTES = 4 * 2**20
"""A larger file is no settings: what an empirical lot of thousands of devices needs is a tenth of it."""
LARGEST_INTEGER = 2**63 - 1
"""As TOML has it: Python itself takes integers without end."""


def at_home(path: str | os.PathLike[str]) -> Path:
    """The path, `~` at its beginning expanded: else a folder of that name is made, which somebody removes one day."""
    text = os.fspath(path)
    return Path(os.path.expanduser(text) if text == "~" or text.startswith("~/") else text)


def read_tables(path: Path, what: str, error: type[ValueError]) -> dict[str, Any]:
    """The tables of a TOML file, with or without a byte-order mark; what: `the population file`. Raises `error`."""
    try:
        if path.exists() and not path.is_file():
            raise error(f"{what} {path} cannot be read: it is not a plain file")
        if path.exists() and path.stat().st_size > MOST_BYTES:
            raise error(
                f"{what} {path} has {path.stat().st_size / 2**20:.1f} MiB; at most {MOST_BYTES // 2**20} are read"
            )
        text = path.read_text("utf-8-sig")
    except FileNotFoundError as e:
        raise error(f"{what} {path} cannot be read: there is no such file") from e
    except UnicodeDecodeError as e:
        raise error(f"{what} {path} cannot be read: it is not UTF-8 ({e.reason} at byte {e.start})") from e
    except OSError as e:
        raise error(f"{what} {path} cannot be read: {e.strerror or e}") from e
    return parsed_tables(text, str(path), error)


def parsed_tables(text: str, where: str, error: type[ValueError]) -> dict[str, Any]:
    """The tables of a text in TOML. Raises `error`: also for brackets within brackets and integers without end."""
    try:
        found = tomllib.loads(text)
    except tomllib.TOMLDecodeError as e:
        raise error(f"{where} is not valid TOML: {e}") from e
    except (ValueError, RecursionError, MemoryError) as e:  # more digits than Python converts; 3,000 brackets
        raise error(f"{where} is not valid TOML: it has {_excess(e)}") from e
    _check_integers(found, where, error)
    return found


def _excess(e: Exception) -> str:
    return "an integer of thousands of digits" if isinstance(e, ValueError) else "brackets within brackets, too deep"


def _check_integers(value: Any, where: str, error: type[ValueError]) -> None:
    waiting = [value]  # no recursion: what a parser could nest may still be too deep for us
    while waiting:
        item = waiting.pop()
        if isinstance(item, dict):
            waiting += item.values()
        elif isinstance(item, list):
            waiting += item
        elif isinstance(item, int) and abs(item) > LARGEST_INTEGER:
            raise error(
                f"{where} has an integer of {math.floor(item.bit_length() * math.log10(2.0)) + 1} digits; TOML has 19"
            )


def toml_text(tables: Mapping[str, Any]) -> str:
    """TOML that reads as these tables: numbers, texts, lists, tables, lists of tables. What is None is left out."""
    return "\n".join(_lines_of(tables, "")).lstrip("\n") + "\n"


def _lines_of(table: Mapping[str, Any], where: str) -> list[str]:
    given = {k: v for k, v in table.items() if v is not None}
    tables = {k: v for k, v in given.items() if isinstance(v, Mapping) or _is_tables(v)}
    lines = [f"{k} = {toml_value(v)}" for k, v in given.items() if k not in tables]
    for key, value in tables.items():
        path = f"{where}{key}"
        if isinstance(value, Mapping):
            lines += ["", f"[{path}]", *_lines_of(value, path + ".")]
            continue
        for each in value:
            lines += ["", f"[[{path}]]", *_lines_of(each, path + ".")]
    return lines


def _is_tables(value: Any) -> bool:
    return isinstance(value, list | tuple) and bool(value) and all(isinstance(v, Mapping) for v in value)


def toml_value(value: Any) -> str:
    """A number, a text, or a list of them in TOML."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return toml_string(value)
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(toml_value, value)) + "]"
    if isinstance(value, float) and math.isinf(value):
        return "inf" if value > 0.0 else "-inf"
    return repr(value)


def toml_string(text: str) -> str:
    """A text in TOML's quotes."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() else f"\\u{ord(c):04x}" for c in escaped) + '"'
