"""Claims about origins and labels: every word that an engine writes, and every axis, is one that a person reads."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import softclose.propose
from softclose.propose import origins
from softclose.propose.inputs import SWING
from softclose.propose.origins import ORIGINS, group_of, label_of
from softclose.waveform import coordinates
from softclose.waveform.spaces import SPACES, NaturalScales, build_space
from softclose_workflows.figures.drawing import MARKERS
from softclose_workflows.tell.labels import ORIGIN_GROUPS, PALETTE, coordinate_label

FOLDER = Path(softclose.propose.__file__).parent


def test_every_origin_is_one_of_the_list_and_drawn_with_a_marker_and_a_colour_of_its_own() -> None:
    words = {v for name, v in vars(origins).items() if name.isupper() and isinstance(v, str)}
    assert words == set(ORIGINS)
    assert {o.group for o in ORIGINS.values()} | {"other"} == set(ORIGIN_GROUPS)
    assert len(set(ORIGIN_GROUPS.values())) == len(ORIGIN_GROUPS)
    for marker, role in ORIGIN_GROUPS.values():
        assert marker in MARKERS
        assert role in PALETTE["light"]


def test_no_engine_writes_a_word_of_its_own() -> None:
    written = {
        keyword.value.value
        for path in FOLDER.glob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call)
        for keyword in node.keywords
        if keyword.arg == "origin" and isinstance(keyword.value, ast.Constant)
    }
    assert written <= set(ORIGINS)


def test_an_origin_with_more_said_is_still_known_and_a_stranger_s_is_other() -> None:
    assert group_of("fallback: sobol") == "fallback"
    assert label_of("fallback: sobol") == label_of("fallback")
    assert group_of("my-engine") == "other"
    assert label_of("my-engine") == "my-engine"


@pytest.mark.parametrize("name", sorted(SPACES))
def test_every_axis_of_every_space_has_words_and_a_unit(name: str) -> None:
    problem_space = build_space(name, NaturalScales(period_us=30.0, impulse=1e5, pull_in_volts=60.0, hold_volts=40.0))
    for axis in problem_space.names:
        assert coordinates.label_of(axis) not in (None, axis)
        assert coordinate_label(axis).startswith(f"pulse {axis[-1]} ")
        assert coordinate_label(axis).endswith(")")
        assert not coordinate_label(axis, unit=False).endswith(")")
    assert coordinate_label("delay2") == "pulse 2 delay (periods)"


def test_every_input_of_the_surrogate_has_words_and_a_stranger_s_stays() -> None:
    assert all(coordinate_label(name) == words != name for name, words in SWING.items())
    assert coordinate_label("gap2") == "gap2"
    assert coordinate_label("volts") == "volts"
