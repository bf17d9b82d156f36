"""Claims about how open switches split: every open switch is of one kind, and the kinds are those of its motion."""

from __future__ import annotations

import numpy as np
import pytest

from softclose import load_population, simulate
from softclose.metrics.objective import MISSING, Judged, in_time
from softclose.metrics.open_kinds import open_kinds
from softclose.waveform import Pulse, Waveform

NAN = float("nan")


def judged(closed_by_us: float = 0.0) -> Judged:
    """Held early, held late, touched and lost (twice), never touched (three), not integrated, not read."""
    rows = [(0.1, True, 0, 30.0), (0.1, True, 0, 90.0), *[(0.2, False, 0, np.inf)] * 2, *[(NAN, False, 0, np.inf)] * 3]
    rows += [(NAN, False, 1, np.inf), (NAN, False, MISSING, np.inf)]
    speed, closed, status, settling = zip(*rows, strict=True)
    return Judged(
        max_contact_speed=np.array(speed),
        closed=np.array(closed),
        status=np.array(status, dtype=np.int8),
        settling_us=np.array(settling),
    )


@pytest.mark.parametrize(("by", "late"), [(0.0, 0), (50.0, 1), (100.0, 0)])
def test_every_open_switch_is_of_one_kind(by: float, late: int) -> None:
    found = open_kinds(judged(), by)
    assert (found.n, found.n_open) == (8, 6 + late)
    assert (found.never_touch, found.not_held, found.too_late, found.not_integrated) == (3, 2, late, 1)


def test_the_sentence_names_the_kinds_that_there_are() -> None:
    assert open_kinds(judged(), 50.0).sentence == (
        "7 of 8 switches stay open: 3 never touch, 2 touch and are not held at the end, 1 are held later than 50 µs, "
        "1 could not be integrated"
    )
    closed = judged().first(2)
    assert open_kinds(closed).sentence == "none of the 2 switches stays open"


def test_kinds_are_those_of_the_motion() -> None:
    """A drive that is too low for the stiff, and is taken away from the others after they have touched."""
    lot = load_population("current").sample(200, seed=3)
    drive = Waveform([Pulse(0.0, 4.0, 60.0, 90.0), Pulse(70.0, 4.0, np.inf, 60.0)])
    r = simulate(lot, drive, horizon_us=250.0)
    found = open_kinds(r)
    touched = np.asarray(r.n_impacts) > 0
    assert found.never_touch == int((~touched & ~r.closed).sum())
    assert found.not_held == int((touched & ~r.closed).sum())
    assert found.n_open == int((~in_time(r, 0.0)).sum())
    assert found.not_held > 0
