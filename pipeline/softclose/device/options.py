"""Owns `[model.options]`: settings of a device model's own, checked by the model itself.

A plug-in that has such names what they are in an attribute `Options`, a pydantic model, and is given one of them as the
keyword `options`. Every name, type and limit is the plug-in's: nothing here knows any of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel, ValidationError

from softclose.naming import did_you_mean
from softclose.plugins import MODELS, ModelError

ATTRIBUTE = "Options"
"""Of the function or class that an entry point names."""
MOST_TOLD = 5
"""Problems of one table of options that are told."""


def options_of(name: str, given: Mapping[str, Any]) -> BaseModel | None:
    """The options of a device model, checked, with its own defaults where nothing is said.

    Parameters
    ----------
    name : str
        The device model.
    given : mapping
        What `[model.options]` says.

    Returns
    -------
    pydantic.BaseModel or None
        None for a model that has none.

    Raises
    ------
    ModelError
        Where the model has no options and some are given, or where they are not what it allows.
    """
    declared = None if name in MODELS.shipped else getattr(MODELS.load(name), ATTRIBUTE, None)
    if declared is None:
        if given:
            whose = "takes its settings from [model] itself" if name in MODELS.shipped else f"declares no {ATTRIBUTE}"
            raise ModelError(f"model.options has {', '.join(given)}, and model {name!r} {whose}: leave the table out")
        return None
    if not (isinstance(declared, type) and issubclass(declared, BaseModel)):
        raise ModelError(f"{ATTRIBUTE} of model {name!r} is {declared!r}; it must be a pydantic model")
    known = list(declared.model_fields)
    for key in given:
        if key not in known:
            allowed = ", ".join(known) or "none"
            raise ModelError(
                f"model.options.{key} is no option of model {name!r}; {did_you_mean(key, known)}it has {allowed}"
            )
    try:
        return declared.model_validate(dict(given))
    except ValidationError as e:
        problems = e.errors(include_url=False)
        told = [
            f"model.options.{'.'.join(map(str, p['loc']))} is {p['input']!r}: {p['msg'].removeprefix('Value error, ')}"
            for p in problems[:MOST_TOLD]
        ]
        more = [f"and {len(problems) - MOST_TOLD} more"] if len(problems) > MOST_TOLD else []
        raise ModelError("; ".join([*told, *more])) from e


def options_where_installed(name: str, given: Mapping[str, Any]) -> BaseModel | None:
    """`options_of`, but None where the model's package is not installed: only who simulates asks for it, and is told.

    Raises ModelError as `options_of` does of a model that is there.
    """
    if name not in MODELS.shipped:
        try:
            MODELS.load(name)
        except ModelError:
            return None
    return options_of(name, given)
