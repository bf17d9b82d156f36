"""Claims about the generated reference: nothing that exists is left out, and plain text stays plain."""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "docs"))

import reference_pages
from hypothesis import given
from hypothesis import strategies as st

import softclose
import softclose_store
import softclose_workflows.api
from softclose import settings
from softclose.population.lot import COLUMNS
from softclose_store.schema import fields, hierarchy

INTERFACE = Path(reference_pages.__file__).parent / "reference" / "api.md"


def test_every_configuration_key_has_a_meaning() -> None:
    page = reference_pages.configuration_page()
    rows = {line.split("`")[1]: line.split(" | ") for line in page.splitlines() if line.startswith("| `")}
    expected = {f"{section}.{key}" for section, keys in settings.known_keys().items() for key in keys}
    assert set(rows) == expected
    assert [key for key, row in rows.items() if len(row[-1].strip(" |")) < 5] == []


def test_every_array_and_field_is_on_the_page() -> None:
    page = reference_pages.schema_page()
    arrays = [
        *(spec.name for spec in hierarchy.TABLES.values()),
        *hierarchy.BLOCK_SPECS,
        hierarchy.MARKER.name,
        *COLUMNS,
    ]
    known = [f.name for f in (*fields.RECORDED, *fields.RESPONSE_QUANTITIES, *fields.IMPACT_QUANTITIES)]
    assert [name for name in [*arrays, *known] if f"| `{name}` |" not in page] == []


MODULES = (softclose, softclose_store, softclose_workflows.api)


def test_the_interface_is_that_of_the_packages() -> None:
    """Sphinx takes the names from `__all__`."""
    page = INTERFACE.read_text("utf-8")
    assert [m.__name__ for m in MODULES if f".. automodule:: {m.__name__}\n" not in page] == []


def public_functions() -> Iterator[tuple[str, Any]]:
    for module in MODULES:
        for name in module.__all__:
            value = getattr(module, name)
            if inspect.isclass(value):
                for key, member in vars(value).items():
                    found = member.__func__ if isinstance(member, classmethod | staticmethod) else member
                    if inspect.isfunction(found) and not key.startswith("_"):
                        yield f"{module.__name__}.{name}.{key}", found
            elif inspect.isfunction(value):
                yield f"{module.__name__}.{name}", value


@pytest.mark.parametrize(("name", "function"), [pytest.param(*f, id=f[0]) for f in public_functions()])
def test_numpydoc_sections_name_the_parameters_there_are(name: str, function: Any) -> None:
    """Whoever takes more than one says what each is; nobody describes one that is gone."""
    parameters = [p for p in inspect.signature(function).parameters if p not in ("self", "cls")]
    text = inspect.getdoc(function) or ""
    _, heading, section = text.partition("Parameters\n----------\n")
    if not heading:
        assert len(parameters) < 2
        return
    section = re.split(r"\n\n\w+\n-+\n", section)[0]
    described = [re.split(r" : |: ", line)[0] for line in section.splitlines() if line and line[0] != " "]
    assert [p.lstrip("*") for line in described for p in line.split(", ")] == parameters


@given(st.text(alphabet="ab *_[]<>|`\n{}$#\\"))
def test_text_in_a_cell_is_one_line_whose_bars_are_escaped(text: str) -> None:
    cell = reference_pages.cell(text)
    assert "\n" not in cell
    outside = "".join(cell.split("`")[::2]) if cell.count("`") % 2 == 0 else cell
    assert outside.replace("\\\\", "").replace("\\|", "").count("|") == 0 or "`" in text
