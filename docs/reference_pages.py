"""Owns the reference that no stock tool knows how to write: configuration and store schema, as Markdown.

Everything comes from the code that it describes: the configuration's fields with their docstrings, the table of arrays.
The command line and the Python interface are written by sphinx-click and Sphinx's own autodoc.
"""

from __future__ import annotations

import dataclasses
import inspect
import json
import math
import re
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from softclose.population.lot import COLUMNS
from softclose.settings.json_schema import field_docs

GENERATED = "<!-- Generated from the code by docs/reference_pages.py; changes here are lost. -->\n\n"


def write_reference(folder: Path) -> None:
    """Write the generated pages; leaves files alone that are the same already."""
    folder.mkdir(exist_ok=True)
    pages = {"configuration": configuration_page, "schema": schema_page}
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


def configuration_page() -> str:
    """Every key of a campaign's TOML file: type, default, meaning."""
    from softclose import settings

    lines = [
        "# Configuration",
        "",
        "A campaign is one TOML file, or a shipped preset; `--set section.key=value` overrides single keys. Every "
        "value is checked before any work starts, and unknown keys are refused. All keys are part of the campaign's "
        "identity.",
        "",
    ]
    known = settings.known_keys()
    hints = typing.get_type_hints(settings.CampaignConfig)
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
            default = toml_value(field.default) if field.default is not dataclasses.MISSING else "`{}`"
            columns = f"`{section}.{field.name}`", cell(kind(source[field.name])), default
            lines.append(f"| {' | '.join(columns)} | {cell(docs.get(field.name, ''))} |")
        lines.append("")
    return "\n".join(lines) + "\n"


def _annotations(cls: type) -> dict[str, Any]:
    return typing.get_type_hints(cls, include_extras=True)


def toml_value(value: Any) -> str:
    """A default as TOML would write it."""
    if value != value or value == (math.nan,):
        return "scales with the lot"
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
    if typing.get_origin(annotation) is dict:
        return "table"
    if typing.get_origin(annotation) is tuple:
        return "list"
    names = {int: "integer", float: "number", str: "text", bool: "true or false"}
    return names.get(annotation, str(annotation)) + limits


def schema_page() -> str:
    """Every array of a store: dimensions, type, unit, meaning, who writes it; and every field of its tables."""
    from softclose_store.schema import fields, hierarchy, layout

    lines = [
        "# Store schema",
        "",
        f"Schema version {fields.SCHEMA_VERSION}. A store is one Zarr version 3 hierarchy with named dimensions and "
        "`units` in the attributes of its arrays. The group `population` holds the ensemble, a row per switch; the "
        "group `candidates` the tables, a row per candidate; each stage of the campaign (`search`, `explore`, "
        "`finish`, `extend1` …) is a group that holds what was kept of every switch under every candidate of it. "
        "`candidate` and `switch` are counted through the whole campaign, in every group alike. Lengths along "
        "`candidate` are those of the committed candidates. The root's attributes say the configuration and the "
        "constants that all switches share; result groups, such as `certification/100000-1`, are listed beside the "
        "campaign's own.",
        "",
        "Workers write the arrays of a stage, block by block: one block is some candidates × some switches, one chunk "
        "of each array, and its marker. The driver writes the tables, wave by wave. `wall_times` are the only values "
        "that two runs of one campaign do not share.",
    ]
    columns = tuple(fields.PopulationColumn(c.name, c.unit, c.long_name) for c in COLUMNS.values())
    example = layout.StageLayout(name="stage", n_candidates=1, n_switches=1, block_candidates=1, block_switches=1)
    documents = hierarchy.schema_of(
        layout.Layout(
            stages=(example,),
            times_us=np.arange(2.0),
            max_impacts=1,
            n_pulses=1,
            columns=columns,
            cases=(fields.CaseColumn("celsius", COLUMNS["celsius"].unit, "temperature of the case", (0.0, 1.0)),),
            n_modes=2,
        )
    )
    for title, group in (
        ("Group `population`", layout.POPULATION),
        ("Group `candidates`", layout.CANDIDATES),
        ("Group of a stage", example.name),
    ):
        lines += ["", f"## {title}", "", *_array_table(documents, group)]
    lines += [
        "",
        "`population` has those columns that the campaign's lot has. `impact` is there where `store.max_impacts` is "
        "not 0, `x` and `v` where `store.n_times` is not. `mode_…` hold the further modes of a switch, where it has "
        "any. Where each switch is simulated in several cases, such as temperatures, `case_…` hold each of them, and "
        "the arrays without prefix what counts of the switch. `records` has a field `design_…` for each nominal value "
        "that a search may change.",
        "",
        "## Result groups",
        "",
        "Written by `softclose certify`, by campaigns that design an opening, and by `softclose assess --keep`. Their "
        "attributes say what was asked for. Those in `trajectories` hold the motion behind them: of every release that "
        "was tried, and of every actuation by which a trim learns, unless `store.trials` is false; of a certificate "
        "where `softclose certify --store-trajectories` asks for it. `x` and `v` have an axis `time`, or "
        "`release_time`. `mode_x` and `mode_v` of further modes, and `case_…` of several cases, are as in a stage.",
        "",
        "| group | array | meaning |",
        "| --- | --- | --- |",
    ]
    lines += [
        f"| `{group}` | `{name}` | {cell(meaning)} |"
        for group, arrays in RESULT_ARRAYS.items()
        for name, meaning in arrays.items()
    ]
    lines += [
        "",
        "A certification has the fields of `records` that are results, too, one value a design. Arrays whose names "
        "begin with `off_` are those of the best candidate where every drive is off by `drive_gain`: of its first new "
        "switches (`off_switch`) what is there of a switch under a design, and the same figures.",
    ]
    pulses = tuple(
        fields.Field(name=f"pulse1_{name}", unit=unit, long_name=f"{meaning} of pulse 1; further pulses likewise")
        for name, (meaning, unit) in fields.PARAMETERS.items()
    )
    for title, known in (
        ("Fields of `records`", (*pulses, *fields.PROPOSALS, fields.WAVE, *fields.RESULTS)),
        ("Columns of `words`", fields.WORDS),
        ("Columns of `wall_times`", fields.WALL),
        ("Quantities of `response`", fields.RESPONSE_QUANTITIES),
        ("Quantities of `impact`", fields.IMPACT_QUANTITIES),
    ):
        lines += ["", f"## {title}", "", "| name | unit | meaning |", "| --- | --- | --- |"]
        lines += [f"| `{f.name}` | {cell(f.unit)} | {cell(_per_limit(f))} |" for f in known]
    return "\n".join(lines) + "\n"


def _array_table(documents: Mapping[str, bytes], group: str) -> list[str]:
    """Every array of a group: name, dimensions, type, unit, meaning."""
    lines = ["| array | dimensions | type | unit | meaning |", "| --- | --- | --- | --- | --- |"]
    for key in sorted(documents):
        name = key.removeprefix(f"{group}/").removesuffix("/zarr.json")
        if not key.startswith(f"{group}/") or "/" in name or name == "zarr.json" or not key.endswith("/zarr.json"):
            continue
        array = json.loads(documents[key])
        dims, about = ", ".join(array["dimension_names"]), array["attributes"]
        kind = "text" if array["data_type"] == "string" else array["data_type"]
        lines.append(f"| `{name}` | {dims} | {kind} | {cell(about['units'])} | {cell(about['long_name'])} |")
    return lines


_RELEASE = {
    "release": "without and with a brake",
    "release_waveform": "the whole drive: start, rise, peak [µs], volts of each pulse",
    "parameter": "columns of a waveform",
    "release_time": "time since the fall began [µs]",
    "quantile": "5, 50 and 95 %",
    "release_quantiles": "these quantiles of x / D",
    "release_held": "held when the fall began",
    "release_stuck": "never left the contact",
    "release_rebound": "touched the contact again",
    "release_overshoot": "largest displacement beyond rest, in travels",
    "release_rest_us": "time until it stays near rest [µs]",
}
RESULT_ARRAYS = {
    "certification/…": {
        "design": "name of the candidate or reference design",
        "candidate": "its index in the campaign; -1: a reference design",
        "waveform": "start, rise, peak [µs], volts of each pulse",
        "parameter": "columns of a waveform",
        "fresh_switch": "index of the switch, which is none of the campaign's",
        "max_contact_speed": "V of each fresh switch under each design [µm/µs]",
        "closed": "whether it is held in contact at the horizon",
        "status": "outcome of its integration; 0: ok",
        "settling": "instant from which it is held [µs]",
        "first_contact": "instant of its first contact [µs]; inf: never",
        "n_impacts": "number of its impacts",
        "contact_time": "of the lot: instant of the first contact [µs]; `_lower` and `_upper` bound it",
        "contact_time_lower": "its interval's lower end [µs]",
        "contact_time_upper": "its interval's upper end [µs]",
        "impacts": "of the lot: number of impacts; `_lower` and `_upper` bound it",
        "impacts_lower": "its interval's lower end",
        "impacts_upper": "its interval's upper end",
        "drive_gain": "relative error of the best candidate's volts",
        "off_switch": "index of the fresh switch, of the first ones, under drives that are a little off",
        "limit": "contact-speed limits [cm/s]",
        "training_g_cm_s": "g on the training ensemble",
        "training_n_switches": "size of the training ensemble",
        **{c.name: f"of each fresh switch: {c.long_name} [{c.unit}]" for c in COLUMNS.values()},
        **_RELEASE,
    },
    "trajectories/release-…": {
        "trial": "in order; 0: without a brake",
        "switch": "index of the switch in the campaign",
        "release_time": "time since the fall began [µs]",
        "parameter": "columns of a waveform",
        "release_waveform": "the whole drive of each trial: start, rise, peak [µs], volts of each pulse",
        "cost": "what the brake is chosen by; 10: above the largest voltage, and not simulated",
        "x": "travel of each switch in each trial [µm]",
        "v": "its velocity [µm/µs]",
    },
    "trajectories/actuations": {
        "actuation": "in order; the last is the one that is timed",
        "switch": "index of the switch in the campaign",
        "time": "time since the step starts [µs]",
        "volts": "step of each switch [V]",
        "first_contact": "its first contact [µs]; inf: never",
        "x": "travel of each switch in each actuation [µm]",
        "v": "its velocity [µm/µs]",
    },
    "trajectories/certification-…/…": {
        "fresh_switch": "index of the switch, which is none of the campaign's",
        "time": "instants of the motion [µs]; `release_time` since the fall began, where it is an opening",
        "waveform": "start, rise, peak [µs], volts of each pulse",
        "parameter": "columns of a waveform",
        "x": "travel of each switch [µm]",
        "v": "its velocity [µm/µs]",
    },
    "opening/…": {"switch": "index of the switch in the campaign", **_RELEASE},
    "traces/…": {
        "time": "instants of the drive [µs]",
        "volts": "drive voltage [V]",
        "max_contact_speed": "V of each fresh switch [µm/µs]",
        "closed": "whether it is held in contact at the horizon",
        "status": "outcome of its integration; 0: ok",
    },
}
"""Arrays of result groups, as a certified campaign with an opening is asked for them by a test."""


def _per_limit(field: Any) -> str:
    return f"{field.long_name}; one for each limit" if field.per_limit else str(field.long_name)
