"""Claims about pieces: they cover a question, answers are those of the whole, their size is by stated cost alone."""

from __future__ import annotations

import itertools
import math
import pickle
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from examples import examples
from softclose.baselines import deterministic_design
from softclose.device import cost
from softclose.evaluate import draw, respond
from softclose.evaluate.pieces import (
    MANY,
    Sent,
    Work,
    here,
    joined_judged,
    light,
    respond_to_all,
    rows_of_pieces,
)
from softclose.settings import load_config

PLAIN, SMALL = load_config("current"), ["population.n_switches=64"]
WAVE = deterministic_design(PLAIN.build_population())
LOSSY = load_config("current", ["model.quality_factor=30.0"])


def sent_off(function: Callable[[Any], Any], pieces: Iterable[Any], /) -> Iterator[Any]:
    """A mapper whose pieces and answers cross from one process to another."""
    return (pickle.loads(pickle.dumps(function(pickle.loads(pickle.dumps(piece))))) for piece in pieces)


@settings(max_examples=examples(40), deadline=None)
@example(30_000, 12, LOSSY)
@given(st.integers(1, 30_000), st.integers(1, 12), st.sampled_from([PLAIN, LOSSY]))
def test_pieces_cover_every_row_once_and_in_order(n: int, n_waveforms: int, config: Any) -> None:
    pieces = rows_of_pieces(config, n, n_waveforms=n_waveforms)
    assert [*itertools.chain(*pieces)] == [*range(n)]
    each = config.seconds_a_switch * n_waveforms
    most, large = (max(s, cost.SLOW_ROWS * each) for s in (cost.PIECE_S, cost.LARGE_PIECE_S))
    for rows in pieces:
        assert len(rows) * each <= most or (len(pieces) >= MANY and len(rows) * each <= large)


@pytest.mark.parametrize(("n", "n_waveforms", "longest"), [(10**6, 12, 0.2), (10**5, 12, 0.05), (10**5, 1, 0.05)])
def test_large_work_has_larger_pieces(n: int, n_waveforms: int, longest: float) -> None:
    rows = rows_of_pieces(PLAIN, n, n_waveforms=n_waveforms)[0]
    assert 0.75 * longest < len(rows) * PLAIN.seconds_a_switch * n_waveforms <= longest


def test_pieces_grow_only_where_there_are_many_all_the_same() -> None:
    """Between ordinary pieces and large ones there are just so many."""
    pieces = rows_of_pieces(PLAIN, 2_000 * MANY, n_waveforms=12)
    assert len(pieces) == MANY
    assert cost.PIECE_S < len(pieces[0]) * PLAIN.seconds_a_switch * 12 < cost.LARGE_PIECE_S


def test_a_question_is_of_one_waveform_where_nothing_else_is_said() -> None:
    assert rows_of_pieces(PLAIN, 50_000) == rows_of_pieces(PLAIN, 50_000, n_waveforms=1)
    assert cost.rows_a_piece(1e-3) == cost.rows_a_piece(1e-3, n_waveforms=1) == 50


def test_what_costs_more_is_cut_finer() -> None:
    """An amplifier, losses, temperatures, modes, waveforms."""
    others = [load_config(f"current-{name}") for name in ("amplifier", "damped", "temperature", "two-modes")]
    sizes = [len(rows_of_pieces(config, 50_000)) for config in (PLAIN, *others)]
    assert sizes == sorted({*sizes})
    assert len(rows_of_pieces(PLAIN, 20_000, n_waveforms=12)) > len(rows_of_pieces(PLAIN, 20_000))


@pytest.mark.parametrize(
    ("stated", "rows"),
    [
        *[(2.0, 1), (0.3, 3), (0.1, 10), (0.01, 16), (0.001, 50), (1e-9, cost.MOST_ROWS)],
        *[("slow", 50), (-0.5, 50), (0.0, 50), (math.inf, 50), (math.nan, 50)],  # as if it stated none
    ],
)
def test_somebody_s_model_states_what_a_trajectory_costs(
    stated: Any, rows: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = type("Model", (), {"seconds_a_trajectory": stated})()
    monkeypatch.setattr(type(cost.MODELS), "load", lambda self, name: model)
    assert cost.rows_a_piece(cost.seconds_a_trajectory("theirs", lossless=True, ideal=True)) == rows


def test_a_model_that_is_not_installed_here_states_nothing() -> None:
    assert cost.seconds_a_trajectory("theirs", lossless=True, ideal=True) == cost.UNSTATED_S


def test_modes_cost_more_than_losses_and_losses_more_than_nothing() -> None:
    plain, lossy = (cost.seconds_a_trajectory(cost.SINGLE_MODE, lossless=yes, ideal=True) for yes in (True, False))
    modal = [cost.seconds_a_trajectory(cost.REDUCED_ORDER, lossless=yes, ideal=True) for yes in (True, False)]
    assert 0.0 < plain < lossy < min(modal)
    assert cost.seconds_a_trajectory(cost.MEASURED, lossless=True, ideal=True) == plain


@pytest.mark.parametrize("mapper", [here, sent_off])
@pytest.mark.parametrize("name", ["current", "current-temperature", "current-trim", "current-amplifier"])
def test_answers_are_those_of_the_whole(mapper: Any, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    config = load_config(name, SMALL)
    lots = [draw(config, n, seed=n) for n in (64, 7)]
    monkeypatch.setattr("softclose.evaluate.pieces.rows_a_piece", lambda *_, **__: 5)
    works = [Work(sent=Sent(config), lot=lot, drive=WAVE) for lot in lots]
    for lot, found in zip(lots, respond_to_all(works, mapper), strict=True):
        whole = light(respond(config, lot, WAVE))
        for name in ("max_contact_speed", "closed", "status", "settling_us"):
            np.testing.assert_array_equal(getattr(found, name), getattr(whole, name))


def test_a_drive_for_everybody_is_tailored_to_nobody_in_its_pieces_either() -> None:
    config = load_config("current-trim", SMALL)
    lot = draw(config, 20, seed=1)
    own, everybody = (
        next(respond_to_all([Work(sent=Sent(config), lot=lot, drive=WAVE, for_everybody=yes)])).max_contact_speed
        for yes in (False, True)
    )
    np.testing.assert_array_equal(everybody, respond(config, lot, WAVE, for_everybody=True).max_contact_speed)
    assert (own != everybody).any()


def test_what_is_judged_is_of_one_type_whatever_type_a_device_model_answers_in() -> None:
    """Lists, or whole numbers for speeds; pieces of several models are put into arrays of one type."""
    answer = SimpleNamespace(
        max_contact_speed=[1, 2],
        closed=[1, 0],
        status=[0, 0],
        settling_us=[50, 60],
        first_contact_us=[40, 41],
        n_impacts=[1.0, 2.0],
        asked=None,
    )
    judged = light(answer)
    types = {name: getattr(judged, name).dtype for name in vars(answer) if name != "asked"}
    speeds = dict.fromkeys(("max_contact_speed", "settling_us", "first_contact_us"), np.dtype(np.float64))
    whole = {"closed": np.dtype(np.bool_), "status": np.dtype(np.int8), "n_impacts": np.dtype(np.int32)}
    assert types == speeds | whole


def test_what_one_part_does_not_tell_is_not_told_of_them_together() -> None:
    told = light(respond(PLAIN, draw(PLAIN, 3, seed=1), WAVE))
    joined = joined_judged([told, replace(told, settling_us=None), told])
    assert joined.settling_us is None
    np.testing.assert_array_equal(joined.max_contact_speed, np.tile(told.max_contact_speed, 3))


def test_a_configuration_is_one_object_however_many_pieces_bring_it() -> None:
    sent = Sent(PLAIN)
    first, second = (pickle.loads(pickle.dumps((sent, k)))[0] for k in range(2))
    assert first.config is second.config
    assert first.config == PLAIN
