"""Claims about lots: named columns, their units, and one clear error for a table that is none."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from softclose.population.lot import COLUMNS, DEVICE_COLUMNS, Lot, LotError

TABLE = np.array([[2.4, 3.7, 65.0, 3.4], [2.5, 3.8, 66.0, 3.5], [2.6, 3.9, 67.0, 3.6]])


def test_a_lot_is_read_by_name() -> None:
    lot = Lot.of(TABLE)
    assert (len(lot), list(lot)) == (3, ["D", "G", "K", "M"])
    for name, column in zip(DEVICE_COLUMNS, TABLE.T, strict=True):
        np.testing.assert_array_equal(lot[name], column)
    np.testing.assert_array_equal(lot.switches, TABLE)
    assert lot.switches.flags.c_contiguous
    assert Lot.of(lot) is lot


def test_what_adds_to_a_lot_makes_another_one() -> None:
    lot = Lot.of(TABLE)
    more = lot.with_columns(gain=[1.0, 1.1, 0.9], K=[1.0, 2.0, 3.0])
    assert "gain" not in lot
    assert lot["K"][0] == 65.0
    assert more["K"].tolist() == [1.0, 2.0, 3.0]
    np.testing.assert_array_equal(more.switches[:, [0, 1, 3]], TABLE[:, [0, 1, 3]])
    assert list(more.without(["gain"])) == list(lot)
    np.testing.assert_array_equal(more.get("gain", 7.0), [1.0, 1.1, 0.9])
    np.testing.assert_array_equal(lot.get("gain", 7.0), [7.0] * 3)


@pytest.mark.parametrize("which", [slice(1, 3), np.array([False, True, True]), np.array([1, 2])])
def test_rows_keep_every_column(which: Any) -> None:
    lot = Lot.of(TABLE).with_columns(celsius=[10.0, 20.0, 30.0])
    part = lot.rows(which)
    assert list(part) == list(lot)
    np.testing.assert_array_equal(part.switches, TABLE[1:])
    assert part["celsius"].tolist() == [20.0, 30.0]
    whole = Lot.joined([lot.rows(slice(1)), part])
    for name in lot:
        np.testing.assert_array_equal(whole[name], lot[name])


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        ({"D": [1.0], "G": [2.0], "K": [3.0]}, "no column M; it needs D, G, K, M"),
        ({"D": [1.0], "G": [2.0], "K": [3.0], "M": [4.0, 5.0]}, "differ in length .*M: 2"),
        ({"D": [[1.0]], "G": [2.0], "K": [3.0], "M": [4.0]}, r"column D has shape \(1, 1\)"),
        ({"D": [1.0], "G": [2.0], "K": [3.0], "M": [4.0], "weight": [1.0]}, "'weight' is no column of a lot"),
    ],
)
def test_what_is_no_lot_is_said(columns: dict[str, Any], said: str) -> None:
    with pytest.raises(LotError, match=said):
        Lot(columns)


def test_a_column_that_is_missing_says_what_it_is_and_where_it_comes_from() -> None:
    with pytest.raises(LotError, match=r"no column gain \(gain of its drive over the nominal one\).*softclose.draw"):
        Lot.of(TABLE)["gain"]
    with pytest.raises(LotError, match=r"give a Lot, or \(n, 4\)"):
        Lot.of(np.zeros((3, 6)))


def test_every_column_has_a_unit_and_a_meaning() -> None:
    assert all(c.name == name and c.unit and c.long_name for name, c in COLUMNS.items())
    assert {*DEVICE_COLUMNS} <= {*COLUMNS}


class Told(np.ndarray[Any, Any]):
    """Switches whose population was told with a plate area."""

    plate_area_um2 = 123.0


def test_a_lot_keeps_the_plate_area_of_its_population() -> None:
    lot = Lot.of(TABLE.view(Told))
    assert lot.plate_area_um2 == 123.0
    assert Lot.of(TABLE).plate_area_um2 is None
    for same in (lot.rows(slice(2)), lot.with_columns(gain=[1.0, 1.0, 1.0]), lot.without(["gain"])):
        assert same.plate_area_um2 == 123.0
    assert Lot.joined([lot, Lot.of(TABLE)]).plate_area_um2 == 123.0
    assert Lot.joined([lot]).plate_area_um2 == 123.0


def test_numbers_of_any_type_and_lists_are_columns_of_float64() -> None:
    whole = Lot.of([[2, 4, 65, 3]])
    assert {whole[name].dtype for name in whole} == {np.dtype(np.float64)}
    assert Lot({"D": [2], "G": [4], "K": [65], "M": [3]})["K"].dtype == np.float64
    assert Lot.of(TABLE.astype(np.float32)).switches.dtype == np.float64
