"""Claims about what is public: everything a script or a plug-in needs comes from `softclose` itself, and quickly."""

from __future__ import annotations

import ast
import contextlib
import enum
import inspect
import itertools
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

import softclose
import softclose_store
import softclose_workflows.api
from softclose import load_config
from softclose.presets import preset_names
from softclose_workflows.cli import main

PACKAGES = {m.__name__: m for m in (softclose, softclose_store, softclose_workflows.api)}
NAMES = Path(__file__).parent / "public_names.json"
DOCS = sorted((Path(__file__).parents[1] / "docs" / "how-to").glob("*.md"))


@pytest.mark.parametrize("name", softclose.__all__)
def test_every_public_name_is_there(name: str) -> None:
    found = getattr(softclose, name)
    assert name.isupper() or name == "__version__" or getattr(found, "__name__", name) == name
    assert name in dir(softclose)


def test_what_an_engine_and_a_device_model_are_written_with_is_public() -> None:
    assert {"Engine", "Problem", "Proposal", "Observation", "DeviceModel", "Responses"} <= set(softclose.__all__)


def test_importing_softclose_imports_none_of_it() -> None:
    code = "import sys, softclose; found = {'numpy', 'numba', 'pydantic'} & set(sys.modules); assert not found, found"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("page", DOCS, ids=lambda p: p.stem)
def test_what_a_how_to_imports_is_public(page: Path) -> None:
    """Nothing of a room inside a package: those may move."""
    text = page.read_text(encoding="utf-8")
    assert re.findall(r"^\s*(?:from|import) softclose(?:_store|_workflows)?\.(?!api\b).*$", text, re.MULTILINE) == []
    for module, names in re.findall(r"^\s*from (softclose\w*) import ([\w, ]+)$", text, re.MULTILINE):
        if module != "softclose_workflows":
            assert {name.strip().split(" as ")[0] for name in names.split(",")} <= set(PACKAGES[module].__all__), page


@pytest.mark.parametrize("package", PACKAGES)
def test_public_names_are_those_that_were_decided_on(package: str) -> None:
    """A name that comes or goes is a change of `public_names.json`, which a reviewer sees."""
    decided = json.loads(NAMES.read_text("utf-8"))
    assert sorted(PACKAGES[package].__all__) == decided[package]


@pytest.mark.parametrize("name", preset_names())
def test_a_preset_is_loaded_by_its_name(name: str) -> None:
    config = load_config(name, ["campaign.seed=7"])
    assert config.campaign.seed == 7
    assert config.fingerprint() != load_config(name, ["campaign.seed=8"]).fingerprint()


def _defined() -> dict[str, list[str]]:
    """Classes and types by their names, and the modules that define them."""
    found: dict[str, list[str]] = {}
    for package in (softclose, softclose_store, softclose_workflows):
        for path in sorted(Path(package.__path__[0]).rglob("*.py")):
            for node in ast.parse(path.read_text("utf-8")).body:
                name = getattr(node, "name", "") if isinstance(node, ast.ClassDef) else ""
                if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
                    name = node.targets[0].id
                if name[:1].isupper() and not name.isupper():
                    found.setdefault(name, []).append(path.stem)
    return found


def test_a_class_or_type_has_a_name_of_its_own() -> None:
    """One name for one notion: who reads it in a message or an import knows which is meant."""
    assert {name: at for name, at in _defined().items() if len(at) > 1} == STORE_OF_ITS_OWN


STORE_OF_ITS_OWN = {"FloatArray": ["arrays", "reader"]}
"""The store does not import the science."""


def test_a_name_is_exported_once_but_for_commands() -> None:
    """`softclose assess` and `calibrate`, `softclose verify` are commands, which Python has by the same names."""
    pairs = itertools.combinations(PACKAGES.values(), 2)
    twice = set().union(*({*a.__all__} & {*b.__all__} for a, b in pairs))
    assert twice == {"assess", "calibrate", "verify"}
    assert twice <= set(main.commands)


@pytest.mark.parametrize("package", PACKAGES)
def test_what_public_names_are_given_is_what_was_decided_on(package: str) -> None:
    """The names of arguments and fields are as public as the names themselves."""
    decided = json.loads(NAMES.read_text("utf-8"))["arguments"][package]
    found = {}
    for name in PACKAGES[package].__all__:
        value = getattr(PACKAGES[package], name)
        if callable(value) and not (isinstance(value, type) and issubclass(value, Exception | enum.Enum)):
            with contextlib.suppress(ValueError):  # a class of C, a protocol
                found[name] = list(inspect.signature(value).parameters)
    assert found == decided
