"""Claims about the page of validation: it is what its command writes, and what has a closed form agrees with it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmark_files import benchmark
from softclose.switch.losses import Losses, shape_factor

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def validation() -> Any:
    return benchmark("validation")


def test_the_page_is_what_the_command_writes_and_the_figures_hold(validation: Any) -> None:
    found, under = validation.rows(), validation.films()
    text = (ROOT / "docs" / "explanation" / "validation.md").read_text("utf-8")
    assert validation.page(found, under) == text
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


def test_what_is_left_of_the_beams_is_the_film_and_not_its_integration(validation: Any) -> None:
    """The plate's film by another integrator is ours, but for the rise of our step; a beam's is ∫φ² / β of it."""
    plate, share, bent = validation.films()[1:4]
    ours = {r.what: r.ours for r in validation.cantilever() if "1.2 V_p" in r.what}
    begin = "ohmic cantilever at 1.2 V_p"
    for film, name in ((plate, "film with slip"), (share, "film of a bent beam")):
        assert ours[f"{begin}, {name}: closing time"] == pytest.approx(film.closing_us, rel=2e-5)
        assert ours[f"{begin}, {name}: contact speed"] == pytest.approx(film.speed_cm_s, rel=2e-5)
    assert np.trapezoid(validation.mode_of(False, 4001) ** 2, dx=1 / 4000) == pytest.approx(validation.BENDS, rel=1e-6)
    assert np.trapezoid(validation.mode_of(True, 4001) ** 2, dx=1 / 4000) == pytest.approx(0.3965, rel=1e-4)
    assert share.quality_factor == pytest.approx(bent.quality_factor, rel=1e-3)
    losses = Losses(
        film_viscosity_uPa_s=18.45, film_length_um=75.0, film_width_um=30.0, film_mean_free_path_um=0.15,
        film_count=validation.BENDS / shape_factor(0.4),
    )  # fmt: skip
    at_rest = losses.damping_at_rest(np.array([[0.2, 0.6, 300.4, 0.0864]]), 300.0)
    assert 1.0 / float(at_rest[0]) == pytest.approx(share.quality_factor, rel=1e-9)
    assert share.speed_cm_s < bent.speed_cm_s < 32.8
