"""Owns the refusal of a name that is not known: what was got, the nearest known one, all of them, and the setting."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


def unknown_name(what: str, name: str, known: Iterable[str], key: str) -> str:
    """`no engine named 'skop'; did you mean 'skopt'? Known: skopt, sobol (optimiser.engine)`."""
    names = list(known)
    near = difflib.get_close_matches(name, names, n=1)
    hint = f"; did you mean {near[0]!r}?" if near else "."
    return f"no {what} named {name!r}{hint} Known: {', '.join(names)} ({key})"
