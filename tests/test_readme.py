"""Claims about the README: its table and its picture show the same figures, made by one command."""

from __future__ import annotations

import copy
import json
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "docs"))

import readme

FIGURES = json.loads(readme.FIGURES.read_text("utf-8"))


def test_the_table_is_made_of_the_figures() -> None:
    text = readme.README.read_text("utf-8")
    assert text.count(readme.BEGIN) == text.count(readme.END) == 1
    assert readme.between_marks(text) == readme.table(FIGURES)


def test_the_picture_shows_the_figures() -> None:
    from PIL import Image

    with Image.open(readme.PICTURE) as image:
        assert image.info[readme.STAMP] == readme.digest(FIGURES)


def test_other_figures_are_another_table_and_another_picture() -> None:
    other = copy.deepcopy(FIGURES)
    other["rows"][-1]["p_nc"] += 0.01
    assert readme.table(other) != readme.table(FIGURES)
    assert readme.digest(other) != readme.digest(FIGURES)


def test_nothing_but_what_is_between_the_marks_is_renewed() -> None:
    text = f"x {readme.BEGIN}\nx\n{readme.END} x"
    assert readme.renewed(text, "new") == f"x {readme.BEGIN}\nnew\n{readme.END} x"
    whole = readme.README.read_text("utf-8")
    assert readme.renewed(whole, readme.table(FIGURES)) == whole
    with pytest.raises(SystemExit):
        readme.renewed("no marks", "new")


@pytest.mark.parametrize("name", ["unshaped", "deterministic", "current", "current-three"])
def test_every_row_is_a_design_within_the_limits(name: str) -> None:
    (row,) = [row for row in FIGURES["rows"] if row["name"] == name]
    assert row["v_u_interval"][0] <= row["v_u_cm_s"] <= row["v_u_interval"][1]
    assert 0.0 <= row["p_nc_interval"][0] <= row["p_nc"] <= row["p_nc_interval"][1] <= 1.0
