"""Owns the JSON schema of a campaign's TOML file, for editors: what may be written where, and what it means."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import textwrap
import typing
from typing import Any

from pydantic import TypeAdapter

from softclose.settings.config import WRITTEN_OUT, CampaignConfig

DIALECT = "https://json-schema.org/draft/2020-12/schema"


def configuration_schema() -> dict[str, Any]:
    """The schema of every section and key with its limits, its default and its meaning: plain values.

    What several settings say together (such as budgets that are both 0) no schema knows: `softclose run` does.
    """
    schema = TypeAdapter(CampaignConfig).json_schema()
    for name in WRITTEN_OUT:
        del schema["properties"][name]
    hints = typing.get_type_hints(CampaignConfig)
    for section in schema["properties"]:
        cls = hints[section]
        meanings = field_docs(cls)
        table = schema["$defs"][cls.__name__]
        for key, value in table["properties"].items():
            value["description"] = " ".join(meanings[key].split())
            value.pop("title", None)
            if value.get("default") != value.get("default"):  # NaN: it follows from the lot, and JSON has none
                del value["default"]
        table.pop("title", None)
        schema["properties"][section].pop("default", None)
    return {"$schema": DIALECT, **schema, "title": "A Softclose campaign", "description": "What `softclose run` reads."}


def field_docs(cls: type) -> dict[str, str]:
    """The strings below the fields of a class, its bases included, by field."""
    found: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        if not dataclasses.is_dataclass(base):
            continue
        (body,) = ast.parse(textwrap.dedent(inspect.getsource(base))).body
        assert isinstance(body, ast.ClassDef)
        for field, text in zip(body.body, body.body[1:], strict=False):
            if (
                isinstance(field, ast.AnnAssign)
                and isinstance(field.target, ast.Name)
                and isinstance(text, ast.Expr)
                and isinstance(text.value, ast.Constant)
            ):
                found[field.target.id] = str(text.value.value)
    return found
