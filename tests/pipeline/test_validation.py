"""Claims about the page of validation: it is what its command writes, and what has a closed form agrees with it."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def validation() -> Any:
    spec = importlib.util.spec_from_file_location("validation", ROOT / "benchmarks" / "validation.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["validation"] = module
    spec.loader.exec_module(module)
    return module


def test_the_page_is_what_the_command_writes_and_the_figures_hold(validation: Any) -> None:
    found = validation.rows()
    text = (ROOT / "docs" / "explanation" / "validation.md").read_text("utf-8")
    assert validation.page(found) == text
    by_kind: dict[str, list[Any]] = {}
    for row in found:
        by_kind.setdefault(row.kind, []).append(row)
        assert abs(row.off) < 0.05 or row.why or "actuator" in row.what, row.what
    assert max(abs(r.off) for r in by_kind["closed form"]) < 2e-5  # the step rises in a millionth of the horizon
    told = [r for r in by_kind["somebody's model"] if not r.why]
    assert len(told) == 8
    assert max(abs(r.off) for r in told) < 0.002
    slips = [r.off for r in found if "with slip: closing" in r.what and "20 V" not in r.what and "actuator" in r.what]
    assert len(slips) == 7
    assert max(map(abs, slips)) < 0.06


def test_slip_brings_the_measured_actuator_nearer(validation: Any) -> None:
    rows = [r for r in validation.actuator() if "closing time" in r.what]
    without, with_slip = rows[: len(rows) // 2], rows[len(rows) // 2 :]
    assert all(abs(b.off) < abs(a.off) for a, b in zip(without, with_slip, strict=True))
