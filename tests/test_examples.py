"""Claims about the examples that tests draw: they depend on the test, and on nothing that happens to be loaded."""

from __future__ import annotations

import ast
import importlib
import sys
from pathlib import Path

import pytest
from hypothesis import given, seed, settings
from hypothesis import strategies as st


def drawn() -> list[int]:
    """Numbers that a test with a seed gets."""
    found: list[int] = []

    @seed(1)
    @settings(max_examples=200, database=None)
    @given(st.integers())
    def draw(number: int) -> None:
        found.append(number)

    draw()
    return found


def test_examples_do_not_depend_on_which_modules_are_loaded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = drawn()
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "loaded_later.py").write_text(f"NUMBERS = {list(range(777_000, 777_400))}\n")
    importlib.import_module("loaded_later")
    try:
        assert drawn() == before
    finally:
        del sys.modules["loaded_later"]


def test_a_test_that_tries_some_of_its_cases_here_is_run_again_on_all() -> None:
    """`make long` runs what is long, and what it makes long: else the other cases would be tried nowhere."""
    asking, unmarked = 0, []
    for file in sorted(Path(__file__).parent.rglob("test_*.py")):
        for node in ast.walk(ast.parse(file.read_text("utf-8"))):
            if not (isinstance(node, ast.FunctionDef) and node.name.startswith("test_")):
                continue
            called = {ast.unparse(n.func) for part in node.body for n in ast.walk(part) if isinstance(n, ast.Call)}
            if called & {"is_whole", "examples"}:
                asking += 1
                marks = " ".join(ast.unparse(mark) for mark in node.decorator_list)
                if not any(word in marks for word in ("mark.sampled", "mark.long", "given(")):
                    unmarked.append(f"{file.name}: {node.name}")
    assert unmarked == []
    assert asking > 5
