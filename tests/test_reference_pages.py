"""Claims about the generated reference: nothing that exists is left out, and plain text stays plain."""

from __future__ import annotations

import sys
from pathlib import Path

import click

sys.path.insert(0, str(Path(__file__).parents[1] / "docs"))

import reference_pages
from hypothesis import given
from hypothesis import strategies as st

import softclose
import softclose_store
from softclose import config
from softclose.moved import MOVED
from softclose_store.schema import fields, hierarchy
from softclose_workflows.cli import main


def test_every_command_and_option_is_on_the_page() -> None:
    page = reference_pages.cli_page()

    def check(command: click.Command) -> None:
        for parameter in command.params:
            if isinstance(parameter, click.Option):
                assert all(name in page for name in parameter.opts)
        if isinstance(command, click.Group):
            for name, sub in command.commands.items():
                assert f" {name}`" in page
                check(sub)

    check(main)


def test_every_configuration_key_has_a_meaning() -> None:
    page = reference_pages.configuration_page()
    rows = {line.split("`")[1]: line.split(" | ") for line in page.splitlines() if line.startswith("| `")}
    expected = {f"{section}.{key}" for section, keys in config.known_keys().items() for key in keys}
    assert set(rows) == expected
    assert [key for key, row in rows.items() if len(row[-1].strip(" |")) < 5] == []


def test_every_array_and_field_is_on_the_page() -> None:
    page = reference_pages.schema_page()
    arrays = [*hierarchy.TABLES, *hierarchy.BLOCK_SPECS, hierarchy.MARKER.name, *fields.POPULATION]
    known = [f.name for f in (*fields.RECORDED, *fields.QUANTITIES, *fields.IMPACT_QUANTITIES)]
    assert [name for name in [*arrays, *known] if f"| `{name}` |" not in page] == []


def test_every_public_name_is_on_the_page() -> None:
    page = reference_pages.api_page()
    names = [f"{m.__name__}.{n}" for m in (softclose, softclose_store) for n in m.__all__ if not n.startswith("__")]
    assert [name for name in names if f"### `{name}`" not in page] == []


def test_every_address_of_version_0_1_is_on_the_page() -> None:
    page = reference_pages.api_page()
    assert [old for old, now in MOVED.items() if f"| `{old}` | `{now}` |" not in page] == []


@given(st.text(alphabet="ab *_[]<>|`\n{}$#\\"))
def test_text_in_a_cell_is_one_line_whose_bars_are_escaped(text: str) -> None:
    cell = reference_pages.cell(text)
    assert "\n" not in cell
    outside = "".join(cell.split("`")[::2]) if cell.count("`") % 2 == 0 else cell
    assert outside.replace("\\\\", "").replace("\\|", "").count("|") == 0 or "`" in text
