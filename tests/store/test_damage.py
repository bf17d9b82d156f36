"""A few of the damages of `make damage`: each kind on both stores."""

from __future__ import annotations

from pathlib import Path

import pytest

from damage import KINDS, Case, make_cases, run_round

SHORT = ("four at once",)
"""Kinds of `make test`; all in `make long`."""


@pytest.fixture(scope="module")
def cases(tmp_path_factory: pytest.TempPathFactory) -> list[Case]:
    return make_cases(tmp_path_factory.mktemp("cases"))


@pytest.mark.slow
@pytest.mark.parametrize("kind", [pytest.param(k, marks=() if k in SHORT else pytest.mark.long) for k in KINDS])
def test_a_damage_is_found_and_repaired_in_one_pass(kind: str, cases: list[Case], tmp_path: Path) -> None:
    at = KINDS.index(kind) * len(cases)
    for number in range(at, at + len(cases)):
        outcome = run_round(number, 2, cases, tmp_path)
        assert outcome.found or outcome.silent, outcome
        assert not outcome.wrong, outcome
