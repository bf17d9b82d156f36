"""Owns the refusal of a name that is not known: what was got, the nearest known one, all of them, and the setting."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


def nearest(name: str, known: Iterable[str], *, cutoff: float = 0.5) -> str | None:
    """The known name that is closest to `name`; None where none is close."""
    close = difflib.get_close_matches(name, list(known), n=1, cutoff=cutoff)
    return close[0] if close else None


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """`did you mean 'skopt'? ` where one of the known names is close, else nothing."""
    close = nearest(name, known)
    return f"did you mean {close!r}? " if close else ""


def unknown_name(what: str, name: str, known: Iterable[str], key: str) -> str:
    """`no engine named 'skop'; did you mean 'skopt'? Known: skopt, sobol (optimiser.engine)`."""
    names = list(known)
    return f"no {what} named {name!r}; {did_you_mean(name, names)}Known: {', '.join(names)} ({key})"


def unknown_key(key: str, known: Iterable[str]) -> str:
    """`unknown key 'lowr'; did you mean 'lower'? known: distribution, lower, upper`."""
    names = list(known)
    return f"unknown key {key[:80]!r}; {did_you_mean(key, names)}known: {', '.join(names)}"
