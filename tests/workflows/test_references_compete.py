"""Claims about reference designs: of the campaign's model, and competing; what has no difference is said."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from small_campaigns import finish
from softclose.evaluate import draw, evaluate, judge, respond
from softclose.metrics.paired import compare
from softclose.metrics.ranking import rank_cm_s
from softclose.settings import load_config
from softclose.waveform import Pulse, Waveform
from softclose_workflows.analyses.certified_tables import comparison_line, print_certification
from softclose_workflows.analyses.certify import certify
from softclose_workflows.analyses.references import beaten_lines, reference_designs
from softclose_workflows.analyses.result import print_result
from softclose_workflows.run.creation import create_store

HARD = [[[0.0, 4.0, "hold", 149.0]]]
"""A drive that slams: every reference is better."""


def test_a_best_that_a_reference_beats_is_said_by_run_and_certify(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = load_config({
        "campaign": {"budget": 2}, "population": {"n_switches": 60}, "optimiser": {"engine": "sobol"},
        "waveform": {"initial": HARD * 2}, "store": {"n_times": 3},
    })  # fmt: skip
    path = tmp_path / "a.zarr"
    create_store(config, str(path))
    finish(path)
    print_result(str(path))
    said = capsys.readouterr().out
    assert "the unshaped design is better than the best candidate (g" in said
    assert "give the search more candidates" in said
    print_certification(certify(str(path), n_switches=100, top=1))
    assert "the deterministic design is better than the best candidate" in " ".join(capsys.readouterr().out.split())


def test_a_best_that_is_better_or_a_reference_without_an_objective_says_nothing() -> None:
    def of(g: float, p_nc: float = 0.0) -> Any:
        ranked = rank_cm_s(g, p_nc, 0.1)
        return SimpleNamespace(g_cm_s=g, p_nc=p_nc, rank_cm_s=ranked, closed_by_us=0.0, closing_us=math.nan)

    assert beaten_lines(of(10.0), {"unshaped": of(40.0), "deterministic": of(math.nan)}) == []
    assert len(beaten_lines(of(41.0), {"unshaped": of(40.0), "deterministic": of(50.0)})) == 1
    (line,) = beaten_lines(of(10.0, 0.71), {"unshaped": of(40.0), "deterministic": of(5.0, 0.8)})
    assert "the unshaped design is better" in line
    assert "0.0 % of the switches open against 71.0 %" in line


def test_a_slow_ramp_is_told_what_to_ask_for_and_a_quick_drive_is_not() -> None:
    def of(closing_us: float, closed_by_us: float = 0.0) -> Any:
        return SimpleNamespace(rank_cm_s=1.0, closing_us=closing_us, closed_by_us=closed_by_us)

    (line,) = beaten_lines(of(18.0), {"unshaped": of(2.3)})
    assert "takes 18 µs to close, a step 2.3" in line
    assert "objective.closed_by_us=10" in line
    assert beaten_lines(of(18.0, closed_by_us=20.0), {"unshaped": of(2.3)}) == []
    assert beaten_lines(of(9.0), {"unshaped": of(2.3)}) == []
    assert beaten_lines(of(18.0), {"unshaped": of(math.nan), "deterministic": of(2.3)}) == []


@pytest.mark.parametrize("preset", ["current-damped", "current-two-modes", "current"])
def test_the_deterministic_design_closes_most_of_the_lot_in_the_model_that_it_is_for(preset: str) -> None:
    """That of an ideal plate left 84 to 100 % of damped lots open."""
    config = load_config(preset)
    found = reference_designs(config)
    assert found.missing == {}
    lot = draw(config, 200, seed=3)
    assert evaluate(config, lot, found.designs["deterministic"]).p_nc < 0.1


def test_a_difference_that_does_not_exist_is_words_and_no_nan() -> None:
    config = load_config({})
    lot = draw(config, 60, seed=1)
    pair = [
        (r := respond(config, lot, Waveform([Pulse(0.0, 4.0, np.inf, volts)])), judge(config, r))
        for volts in (100.0, 20.0)
    ]
    line = comparison_line(compare(pair[0], pair[1]))
    assert "nan" not in line
    assert "no difference of v_u, since too few switches touch" in line
    assert "no switch touches under both" in line


def test_a_table_of_capacitance_that_ends_at_the_contact_has_a_deterministic_design_too() -> None:
    """The design's motion is looked for with the contact out of the way, no farther than the table is known."""
    assert "deterministic" in reference_designs(load_config("actuator")).designs
