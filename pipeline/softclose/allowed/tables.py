"""Owns how a table of a file is checked by its pydantic model, and how all that is wrong becomes one message.

The message is the reader's own error: where each mistake stands, what was got, what is allowed.
"""

from __future__ import annotations

import functools
import types
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from pydantic import BaseModel, ConfigDict, Field, Tag, TypeAdapter, ValidationError

from softclose.allowed.refusal import entry_of, hint_of, missing, plain_hint, refusal, shown
from softclose.naming import did_you_mean, unknown_key

T = TypeVar("T")

TABLE = ConfigDict(extra="forbid", allow_inf_nan=False)
"""Of a table: its keys and no others, finite numbers."""

Number = Annotated[float, Field(strict=True)]
"""A number as TOML and JSON write it: no text, no true or false."""

MOST_PROBLEMS = 20
"""Of one file that are told."""


def refuses_with(error: type[ValueError]) -> Callable[[type[T]], type[T]]:
    """A class decorator: what pydantic says of arguments of a dataclass is raised as `error`, in our words."""

    def decorated(kind: type[T]) -> type[T]:
        plain = kind.__init__

        @functools.wraps(plain)
        def init(self: T, *arguments: Any, **values: Any) -> None:
            try:
                plain(self, *arguments, **values)
            except ValidationError as e:
                raise error(message_of(e, kind)) from e

        kind.__init__ = init  # type: ignore[method-assign, assignment]
        return kind

    return decorated


def checked(kind: type[T], table: object, error: type[ValueError], where: str = "") -> T:
    """A table as its model.

    Parameters
    ----------
    kind : type
        A pydantic dataclass or model.
    table : object
        What a file says.
    error : type
        What is raised.
    where : str
        How each problem begins, such as `[law] `; empty at the top of a file.

    Returns
    -------
    kind

    Raises
    ------
    error
        Naming every problem, at most `MOST_PROBLEMS`.
    """
    if not isinstance(table, Mapping):
        raise error(f"{where}{shown(table)} is no table; it must have the keys {', '.join(_keys(kind))}")
    odd = [key for key in table if not isinstance(key, str)]
    if odd:
        raise error(f"{where}{shown(odd[0])} is no key; it must be a text")
    try:
        return TypeAdapter(kind).validate_python(dict(table))  # no call, which would raise an error of the kind's own
    except ValidationError as e:
        raise error(message_of(e, kind, where)) from e


def message_of(e: ValidationError, kind: type, where: str = "") -> str:
    """Everything that is wrong with a table, in one message."""
    errors = e.errors(include_url=False)
    return listed([_problem(kind, dict(x), where) for x in errors[:MOST_PROBLEMS]], len(errors), "; ")


def listed(problems: Sequence[str], n: int, between: str = "\n") -> str:
    """The first problems of n; what follows is mostly the first one's consequence."""
    first = problems[:MOST_PROBLEMS]
    return between.join([*first, *([f"and {n - len(first):,} problems more"] if n > len(first) else [])])


@dataclass(frozen=True, slots=True)
class _Place:
    """Where in the tables of a file something is wrong."""

    section: type
    """The model of the innermost table."""
    key: str
    """Its key; empty for the file itself."""
    entries: tuple[int | str, ...]
    """Way into the lists and tables of that key's value."""
    path: tuple[int | str, ...]
    """Way from the file to the innermost table."""
    hint: Any
    """What should stand there."""

    @classmethod
    def of(cls, kind: type, loc: Sequence[int | str]) -> _Place:
        section, key, hint = kind, "", kind
        path: tuple[int | str, ...] = ()
        entries: tuple[int | str, ...] = ()
        for part in loc:
            hint = plain_hint(hint)
            if _is_union(hint):
                hint = _member(hint, part)
            elif _is_model(hint):
                path = (*path, key, *entries) if key else path
                section, key, entries = hint, str(part), ()
                hint = hint_of(section, key) if key in _keys(section) or _takes_more(section) else object
            else:
                entries, hint = (*entries, part), entry_of(hint, part)
        return cls(section, key, entries, path, plain_hint(hint))

    @property
    def is_table(self) -> bool:
        """Whether what is wrong is a table as a whole, not a value."""
        return _is_table(self.hint)

    @property
    def table(self) -> str:
        """`[transform.D] `; empty for the file itself."""
        return _bracketed((*self.path, self.key, *self.entries) if self.key else ())

    @property
    def name(self) -> str:
        """`[D] lower`, `[mode 2] mass_ug`, `[correlation] E-T`, `values.3`."""
        if self.entries and get_origin(plain_hint(hint_of(self.section, self.key))) is dict:
            return _bracketed((*self.path, self.key)) + ".".join(map(str, self.entries))
        return _bracketed(self.path) + ".".join(map(str, (self.key, *self.entries)))


def _problem(kind: type, error: Mapping[str, Any], where: str) -> str:
    place = _Place.of(kind, error["loc"])
    got = error["input"]
    if error["type"] == "value_error":  # a sentence of our own, which knows its table but not where that stands
        table = place.table if place.is_table else _bracketed(place.path)
        return where + table + str(error["msg"]).removeprefix("Value error, ")
    if error["type"] in ("union_tag_invalid", "union_tag_not_found") and isinstance(got, Mapping):
        return where + place.table + _no_choice(place.hint, got)
    keys = _keys(place.section)
    if place.key not in keys and not _takes_more(place.section):
        return where + _bracketed(place.path) + unknown_key(place.key, keys)
    if error["type"] == "missing":
        return where + missing(place.section, place.key, place.name)
    if place.is_table:
        return f"{where}{place.name} is {shown(got)}; it must be a table, {place.table.strip()}"
    return where + refusal(place.section, place.key, got, place.name, place.entries)


def _bracketed(path: Sequence[int | str]) -> str:
    """`[transform.D] `, `[mode 2] `."""
    text = ".".join(f" {part + 1}" if isinstance(part, int) else part for part in path).replace(". ", " ")
    return f"[{text}] " if text else ""


def _no_choice(union: Any, got: Mapping[str, Any]) -> str:
    """What is said of a table that is none of several kinds."""
    known = _tags(union)
    key = next(iter(known.values()))
    value = got.get(key)
    close = did_you_mean(value, known) if isinstance(value, str) else ""
    return f"{key} is {shown(value)}; {close}it must be one of {', '.join(known)}"


def _tags(union: Any) -> dict[str, str]:
    """The words that tell the members of a union apart, and the key that each stands in."""
    return {
        tag: key
        for member in get_args(union)
        for key, hint in get_type_hints(plain_hint(member)).items()
        if get_origin(hint) is Literal
        for tag in get_args(hint)
    }


def _member(union: Any, tag: int | str) -> Any:
    """The member of a union that a tag means."""
    for member in get_args(union):
        if any(isinstance(part, Tag) and part.tag == tag for part in get_args(member)[1:]):
            return member
        if any(get_origin(h) is Literal and tag in get_args(h) for h in get_type_hints(plain_hint(member)).values()):
            return member
    return union


def _is_union(hint: Any) -> bool:
    return get_origin(hint) in (Union, types.UnionType)


def _is_model(hint: Any) -> bool:
    return isinstance(hint, type) and (is_dataclass(hint) or issubclass(hint, BaseModel))


def _is_table(hint: Any) -> bool:
    return _is_model(hint) or (_is_union(hint) and all(_is_model(plain_hint(member)) for member in get_args(hint)))


def _keys(kind: Any) -> list[str]:
    return [f.name for f in fields(kind)] if is_dataclass(kind) else list(kind.model_fields)


def _takes_more(kind: Any) -> bool:
    """Whether a model takes keys beside its fields."""
    return not is_dataclass(kind) and kind.model_config.get("extra") == "allow"
