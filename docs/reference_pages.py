"""Owns the generated reference: command line, configuration, store schema and Python interface, as Markdown.

Everything comes from the code that it describes: click's commands, the configuration's fields with their docstrings,
the table of arrays, the public names. A page can be incomplete only where the code says nothing.
"""

from __future__ import annotations

import ast
import dataclasses
import importlib
import inspect
import itertools
import re
import textwrap
import typing
from pathlib import Path
from typing import Any

import click

GENERATED = "<!-- Generated from the code by docs/reference_pages.py; changes here are lost. -->\n\n"


def write_reference(folder: Path) -> None:
    """Write the generated pages; leaves files alone that are the same already."""
    folder.mkdir(exist_ok=True)
    pages = {"cli": cli_page, "configuration": configuration_page, "schema": schema_page, "api": api_page}
    for name, page in pages.items():
        text, target = GENERATED + page(), folder / f"{name}.md"
        if not target.exists() or target.read_text(encoding="utf-8") != text:
            target.write_text(text, encoding="utf-8")


def escaped(text: str) -> str:
    """Plain text as Markdown: only `code` keeps its meaning."""
    parts = re.split(r"(`[^`]+`)", text)
    return "".join(p if len(p) > 1 and p.startswith("`") else re.sub(r"([\\*_\[\]<>|$#{}])", r"\\\1", p) for p in parts)


def cell(text: str) -> str:
    """Text inside a table."""
    return escaped(" ".join(text.split()))


def paragraphs(docstring: str | None) -> str:
    """A docstring as Markdown paragraphs."""
    return "\n\n".join(cell(p) for p in re.split(r"\n\s*\n", inspect.cleandoc(docstring or "")))


def cli_page() -> str:
    """Every command: usage, what it does, arguments and options, examples."""
    from softclose_workflows.cli import main

    lines = ["# Command line", ""]
    _command(main, ("softclose",), lines)
    return "\n".join(lines) + "\n"


def _command(command: click.Command, path: tuple[str, ...], lines: list[str]) -> None:
    context = click.Context(command, info_name=" ".join(path), help_option_names=["-h", "--help"])
    usage = " ".join(command.collect_usage_pieces(context))
    lines += [
        f"## `{' '.join(path)}`",
        "",
        "```text",
        f"{' '.join(path)} {usage}",
        "```",
        "",
        paragraphs(command.help),
        "",
    ]
    records = [p.get_help_record(context) for p in command.get_params(context) if isinstance(p, click.Option)]
    rows = [row for row in records if row is not None]
    if rows:
        lines += ["| option | meaning |", "| --- | --- |"]
        lines += [f"| `{option.replace('|', chr(92) + '|')}` | {cell(meaning)} |" for option, meaning in rows] + [""]
    if command.epilog:
        lines += ["```text", inspect.cleandoc(command.epilog).replace("\b\n", "").strip(), "```", ""]
    if isinstance(command, click.Group):
        arguments = tuple(p.make_metavar(context) for p in command.params if isinstance(p, click.Argument))
        for name, sub in sorted(command.commands.items()):
            _command(sub, (*path, *arguments, name), lines)


def field_docs(cls: type) -> dict[str, str]:
    """The strings below the fields of a class, its bases included, by field."""
    found: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        try:
            tree = ast.parse(textwrap.dedent(inspect.getsource(base)))
        except (OSError, TypeError, SyntaxError):
            continue
        body = typing.cast(ast.ClassDef, tree.body[0]).body
        for field, after in itertools.pairwise(body):
            named = isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)
            if named and isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant):
                found[typing.cast(Any, field).target.id] = str(after.value.value)
    return found


def configuration_page() -> str:
    """Every key of a campaign's TOML file: type, default, meaning."""
    from softclose import config

    lines = [
        "# Configuration",
        "",
        "A campaign is one TOML file, or a shipped preset; `--set section.key=value` overrides single keys. Every "
        "value is checked before any work starts, and unknown keys are refused. All keys are part of the campaign's "
        "identity.",
        "",
    ]
    known = config.known_keys()
    hints = typing.get_type_hints(config.CampaignConfig)
    for section in known:
        cls = hints[section]
        source = _annotations(cls)
        docs = field_docs(cls)
        lines += [
            f"## `[{section}]`",
            "",
            paragraphs(cls.__doc__),
            "",
            "| key | type | default | meaning |",
            "| --- | --- | --- | --- |",
        ]
        for field in dataclasses.fields(cls):
            columns = f"`{section}.{field.name}`", cell(kind(source[field.name])), toml_value(field.default)
            lines.append(f"| {' | '.join(columns)} | {cell(docs.get(field.name, ''))} |")
        lines.append("")
    return "\n".join(lines) + "\n"


def _annotations(cls: type) -> dict[str, Any]:
    return typing.get_type_hints(cls, include_extras=True)


def toml_value(value: Any) -> str:
    """A default as TOML would write it."""
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if isinstance(value, str):
        return f'`"{value}"`'
    return f"`{list(value) if isinstance(value, tuple) else value}`"


def kind(annotation: Any) -> str:
    """A type and its limits in words."""
    limits = ""
    if typing.get_origin(annotation) is typing.Annotated:
        annotation, *extras = typing.get_args(annotation)
        words = {"ge": "≥", "gt": ">", "le": "≤", "lt": "<"}
        bounds = [
            f"{words[n]} {getattr(m, n):g}"
            for e in extras
            for m in getattr(e, "metadata", ())
            for n in words
            if hasattr(m, n)
        ]
        limits = ", ".join(["", *bounds]).replace("9.22337e+18", "2^63")
    if typing.get_origin(annotation) is typing.Literal:
        return "one of " + ", ".join(f"`{v}`" for v in typing.get_args(annotation))
    if typing.get_origin(annotation) is tuple:
        return "list"
    names = {int: "integer", float: "number", str: "text", bool: "true or false"}
    return names.get(annotation, str(annotation)) + limits


def schema_page() -> str:
    """Every array of a store: dimensions, type, unit, meaning, who writes it; and every column of its tables."""
    from softclose_store.schema import fields, hierarchy

    lines = [
        "# Store schema",
        "",
        f"Schema version {fields.SCHEMA_VERSION}. A store is one Zarr version 3 hierarchy. Tables of candidates lie "
        "at its root, each stage (search, explore, finish) is a group. Dimensions are named, `units` are in the "
        "attributes, or beside the coordinate that names the columns. Lengths along `candidate` and `stage_candidate` "
        "are those of the committed candidates.",
        "",
        "The roles say who writes what: *block* arrays and their *marker* come from the workers, a file an array and "
        "block; *table* arrays from the driver, at each commit. Timings are the only values that two runs of one "
        "campaign do not share.",
        "",
        "## The ensemble",
        "",
        "| array | dimensions | type | unit | meaning |",
        "| --- | --- | --- | --- | --- |",
    ]
    for name, (meaning, unit) in fields.POPULATION.items():
        lines.append(f"| `{name}` | switch | f8 | {cell(unit)} | {cell(meaning)} |")
    for title, specs in (
        ("At the root", hierarchy.TABLES.values()),
        ("In the group of a stage", (*hierarchy.BLOCK_SPECS.values(), hierarchy.MARKER)),
    ):
        lines += [
            "",
            f"## {title}",
            "",
            "| array | dimensions | type | unit | role | meaning |",
            "| --- | --- | --- | --- | --- | --- |",
        ]
        lines += [
            f"| `{s.name}` | {', '.join(s.dims)} | {s.dtype} | {cell(s.unit)} | {s.role} | {cell(s.long_name)} |"
            for s in specs
        ]
    for title, columns in (
        ("Columns of `records` (two pulses, one limit)", fields.number_fields(2, (19.7,))),
        ("Columns of `words`", fields.WORDS),
        ("Columns of `wall_times`", fields.WALL),
        ("Columns of `response`", fields.QUANTITIES),
        ("Columns of `impact`", fields.IMPACT_QUANTITIES),
    ):
        lines += ["", f"## {title}", "", "| column | type | unit | meaning |", "| --- | --- | --- | --- |"]
        lines += [f"| `{c.name}` | {c.type} | {cell(c.unit)} | {cell(c.long_name)} |" for c in columns]
    return "\n".join(lines) + "\n"


MODULES = {
    "softclose": "The science: simulate ensembles, assess waveforms, describe populations.",
    "softclose_store": "The store: read campaigns; create and drive them.",
}


def api_page() -> str:
    """Every public name of the two libraries: signature, docstring, fields."""
    lines = ["# Python interface", ""]
    for module_name, purpose in MODULES.items():
        module = importlib.import_module(module_name)
        lines += [f"## {module_name}", "", purpose, ""]
        for name in module.__all__:
            if not name.startswith("__"):
                _public(f"{module_name}.{name}", getattr(module, name), lines)
    return "\n".join(lines) + "\n"


def _public(name: str, value: Any, lines: list[str]) -> None:
    if inspect.isclass(value):
        lines += [f"### `{name}`", "", paragraphs(value.__doc__), ""]
        docs = field_docs(value)
        lines += [f"- `{field}`: {cell(text)}" for field, text in docs.items() if not field.startswith("_")] + [""]
        for member, found in vars(value).items():
            if member.startswith("_") or member in docs:
                continue
            found = found.__func__ if isinstance(found, classmethod | staticmethod) else found
            if isinstance(found, property):
                lines += [f"- `{member}` (property): {cell(found.__doc__ or '')}"]
            elif inspect.isfunction(found):
                lines += [f"- `{member}{_signature(found)}`: {cell(found.__doc__ or '')}"]
        lines.append("")
    elif callable(value):
        lines += [
            f"### `{name}`",
            "",
            "```text",
            f"{name.rpartition('.')[2]}{_signature(value)}",
            "```",
            "",
            paragraphs(value.__doc__),
            "",
        ]
    else:
        lines += [f"### `{name}`", "", f"`{value!r}`", ""]


def _signature(function: Any) -> str:
    text = str(inspect.signature(function)).replace("'", "")
    return re.sub(r"\b(?:np|numpy|typing|collections\.abc)\.", "", text)
