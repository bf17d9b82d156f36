"""Owns what is said of a setting that is not allowed: what was got, what is allowed with its unit, and the default.

The validator's own sentences are its developers' words; these are made from the same constraints.
"""

from __future__ import annotations

import types
from collections.abc import Iterator, Sequence
from dataclasses import MISSING, dataclass, fields, is_dataclass
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from annotated_types import Ge, Gt, Le, Lt, MinLen

from softclose.naming import did_you_mean

_UNITS = {
    "_cm_s": "cm/s",
    "_um2": "µm²",
    "_us": "µs",
    "_um": "µm",
    "_V": "V",
    "_volts": "V",
    "_kHz": "kHz",
    "_ug": "µg",
}
_BOUNDS: dict[type, str] = {Gt: "gt", Ge: "ge", Lt: "lt", Le: "le"}

MOST_SHOWN = 120
"""Characters of a value that is not allowed, as it is shown."""


@dataclass(frozen=True, slots=True)
class Said:
    """Metadata of a type: how a sentence names what is allowed, where the type and its limits do not say it."""

    words: str
    """After `it must be`."""


def refusal(section: type, key: str, got: Any, name: str, entries: Sequence[int | str] = ()) -> str:
    """`model.horizon_us is -5; it must be a finite number above 0 µs (default 250)`.

    section: the class that holds the setting `key`; name: what the message calls it; entries: the way from the setting
    to the value that is wrong, in its lists and tables.
    """
    hint = hint_of(section, key)
    for entry in entries:
        hint = entry_of(hint, entry)
    choices = _choices(hint)
    close = did_you_mean(got, choices) if choices and isinstance(got, str) else ""
    default = _default(section, key)
    usual = f" (default {_plain(default)})" if isinstance(default, bool | int | float) else ""
    return f"{name} is {shown(got)}; {close}it must be {_allowed(hint, unit(key))}{usual}"


def missing(section: type, key: str, name: str) -> str:
    """`[D] lower is missing; it must be a finite number`."""
    return f"{name} is missing; it must be {_allowed(hint_of(section, key), unit(key))}"


def shown(got: Any) -> str:
    """A value as a message shows it: the beginning of one that is long."""
    text = _plain(got) if isinstance(got, float) else repr(got)
    return text if len(text) <= MOST_SHOWN else f"{text[:MOST_SHOWN]}…"


def hint_of(section: type, key: str) -> Any:
    """The type of a field with its limits; of a key that a model takes beside its fields, what those may be."""
    hints = get_type_hints(section, include_extras=True)
    return hints[key] if key in hints else entry_of(hints["__pydantic_extra__"])


def entry_of(hint: Any, entry: int | str = 0) -> Any:
    """What an entry of a list is, or one of a table."""
    hint = plain_hint(hint)
    if get_origin(hint) is dict:
        return get_args(hint)[1]
    kinds = get_args(hint) or (hint,)
    return kinds[entry] if isinstance(entry, int) and entry < len(kinds) and Ellipsis not in kinds else kinds[0]


def plain_hint(hint: Any) -> Any:
    """The type itself, without its limits and without None."""
    while True:
        if get_origin(hint) is Annotated:
            hint = get_args(hint)[0]
        elif get_origin(hint) in (Union, types.UnionType) and type(None) in get_args(hint):
            others = [a for a in get_args(hint) if a is not type(None)]
            if len(others) > 1:
                return Union[tuple(others)]  # noqa: UP007 - made of types that are known at run time only
            hint = others[0]
        else:
            return hint


def _default(section: type, key: str) -> Any:
    if is_dataclass(section):
        return next((f.default for f in fields(section) if f.name == key), MISSING)
    return None


def unit(key: str) -> str:
    """The unit that a setting's name says; empty for a pure number."""
    return next((u for end, u in _UNITS.items() if key.endswith(end)), "")


def _plain(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:g}" if isinstance(value, float) else str(value)


def _choices(hint: Any) -> tuple[str, ...]:
    return tuple(map(str, get_args(hint))) if get_origin(hint) is Literal else ()


def _allowed(hint: Any, unit: str) -> str:
    """The type and its limits in words."""
    if choices := _choices(hint):
        return f"one of {', '.join(choices)}"
    kind, limits = (get_args(hint)[0], list(_limits(hint))) if get_origin(hint) is Annotated else (hint, [])
    if words := next((limit.words for limit in limits if isinstance(limit, Said)), ""):
        return words
    if get_origin(kind) in (Union, types.UnionType):
        return _allowed(next(a for a in get_args(kind) if a is not type(None)), unit)
    if get_origin(kind) in (tuple, list):
        return f"a list, each entry {_allowed(entry_of(kind), unit)}"
    if get_origin(kind) is dict or is_dataclass(kind):
        return "a table of keys"
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
