"""Claims about the examples that tests draw: they depend on the test, and on nothing that happens to be loaded."""

from __future__ import annotations

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
