"""Owns what is said of a setting that is not allowed: what was got, what is allowed with its unit, and the default.

The validator's own sentences are its developers' words; these are made from the same constraints.
"""

from __future__ import annotations

import types
from collections.abc import Iterator, Sequence
from dataclasses import fields
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from annotated_types import Ge, Gt, Le, Lt, MinLen

from softclose.naming import did_you_mean

_UNITS = {"_cm_s": "cm/s", "_um2": "µm²", "_us": "µs", "_um": "µm", "_V": "V", "_volts": "V"}
_BOUNDS: dict[type, str] = {Gt: "gt", Ge: "ge", Lt: "lt", Le: "le"}


def refusal(section: type, key: str, got: Any, place: Sequence[int | str]) -> str:
    """`model.horizon_us is -5; it must be a finite number above 0 µs (default 250)`.

    section: the dataclass that holds the setting `key`; place: the way to the value, from the section's name on.
    """
    hint = get_type_hints(section, include_extras=True)[key]
    for _ in place[2:]:
        hint = _entry(hint)
    choices = _choices(hint)
    close = did_you_mean(got, choices) if choices and isinstance(got, str) else ""
    default = next(f.default for f in fields(section) if f.name == key)
    usual = f" (default {_plain(default)})" if isinstance(default, bool | int | float) else ""
    where = ".".join(map(str, place))
    shown = _plain(got) if isinstance(got, float) else repr(got)
    return f"{where} is {shown}; {close}it must be {_allowed(hint, unit(key))}{usual}"


def unit(key: str) -> str:
    """The unit that a setting's name says; empty for a pure number."""
    return next((u for end, u in _UNITS.items() if key.endswith(end)), "")


def _plain(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:g}" if isinstance(value, float) else str(value)


def _choices(hint: Any) -> tuple[str, ...]:
    return tuple(map(str, get_args(hint))) if get_origin(hint) is Literal else ()


def _entry(hint: Any) -> Any:
    """What the entries of a list are, or those of a table."""
    if get_origin(hint) is dict:
        return get_args(hint)[1]
    return next((a for a in get_args(hint) if a is not Ellipsis), hint)


def _allowed(hint: Any, unit: str) -> str:
    """The type and its limits in words."""
    if choices := _choices(hint):
        return f"one of {', '.join(choices)}"
    kind, limits = (get_args(hint)[0], list(_limits(hint))) if get_origin(hint) is Annotated else (hint, [])
    if get_origin(kind) in (tuple, list):
        return f"a list, each entry {_allowed(_entry(kind), unit)}"
    if get_origin(kind) in (Union, types.UnionType):
        kind = next(a for a in get_args(kind) if a is not type(None))
    if kind is bool:
        return "true or false"
    if kind is str:
        return "a text that is not empty" if any(isinstance(limit, MinLen) for limit in limits) else "a text"
    noun = "a whole number" if kind is int else "a finite number"
    return f"{noun}{_range(limits, unit)}"


def _limits(hint: Any) -> Iterator[Any]:
    for part in get_args(hint)[1:]:
        yield from getattr(part, "metadata", [part])


def _range(limits: list[Any], unit: str) -> str:
    """` above 0 µs`, ` from 1 to 1000 V`, ` above 0 and below 1`."""
    said = {
        kind: _plain(getattr(limit, name))
        for limit in limits
        for kind, name in _BOUNDS.items()
        if isinstance(limit, kind)
    }
    u = f" {unit}" if unit else ""
    if Ge in said and Le in said:
        return f" from {said[Ge]} to {said[Le]}{u}"
    words = {Gt: "above {}{}", Ge: "of {}{} or more", Lt: "below {}{}", Le: "at most {}{}"}
    parts = [words[kind].format(said[kind], u) for kind in words if kind in said]
    return f" {' and '.join(parts)}" if parts else (f" [{unit}]" if unit else "")
