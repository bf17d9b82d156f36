"""Claims about conditions in general: what one does not say changes nothing, and what makes own drives says so."""

from __future__ import annotations

import numpy as np

from softclose import Pulse, Waveform, load_population
from softclose.conditions.protocol import Case, Condition
from softclose.device.drives import Drives
from softclose.evaluate.chain import CONDITIONS
from softclose.population.lot import Lot


class Silent(Condition):
    """One that overrides nothing."""

    section = "silent"


def test_what_a_condition_does_not_say_changes_nothing() -> None:
    silent = Silent()
    lot = Lot.of(load_population("current").sample(3, seed=1))
    drives = Drives(command=Waveform([Pulse(0.0, 4.0, 20.0, 80.0)]))
    assert silent.lot(lot, {}) is lot
    assert silent.drives(drives, lot) is drives
    assert (silent.coordinates, silent.columns, silent.cases()) == ((), (), ())
    assert Silent.assumed(None) == []
    assert not Silent.tailored


def test_reference_designs_go_without_trim_alone() -> None:
    assert [kind.section for kind in CONDITIONS if kind.tailored] == ["trim", "trim"]


def test_a_case_is_the_lot_as_it_changes_it() -> None:
    lot = Lot.of(load_population("current").sample(3, seed=1))
    case = Case(name="twice", at=(("D", 2.0),), change=lambda lot: lot.rows(slice(2)))
    assert len(case.of(lot)) == 2
    np.testing.assert_array_equal(case.of(lot)["D"], lot["D"][:2])
