"""Claims about tables of files: a pydantic model checks them, and all that is wrong is one bounded message of ours."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import pytest
from pydantic import BaseModel, ConfigDict, Field, model_validator
from pydantic.dataclasses import dataclass

from softclose.allowed.refusal import Said
from softclose.allowed.tables import MOST_PROBLEMS, TABLE, Number, checked, refuses_with


class OwnError(ValueError):
    """What the readers of this page raise."""


@dataclass(frozen=True, kw_only=True, config=TABLE)
class Round:
    kind: Literal["round"]
    radius_um: Annotated[Number, Field(gt=0)]


@dataclass(frozen=True, kw_only=True, config=TABLE)
class Square:
    kind: Literal["square"]
    side_um: Number = 1.0
    corner: Annotated[str, Said("sharp or blunt")] | None = None

    @model_validator(mode="after")
    def _check(self) -> Square:
        if self.side_um < 0.0:
            raise ValueError(f"side_um is {self.side_um:g}: turn it round")
        return self


class Open(BaseModel):
    model_config = ConfigDict(extra="allow", allow_inf_nan=False)
    __pydantic_extra__: dict[str, Number]
    name: str


@refuses_with(OwnError)
@dataclass(frozen=True, kw_only=True, config=TABLE)
class Plates:
    n: Annotated[int, Field(ge=1, strict=True)]
    plate: tuple[Annotated[Round | Square, Field(discriminator="kind")], ...] = ()
    best: Round | None = None
    shift: dict[str, Round] = Field(default_factory=dict)
    weights: dict[str, Number] = Field(default_factory=dict)
    values: tuple[Number, ...] = ()
    pair: tuple[str, Number] | None = None
    more: Open | None = None


ROUND = {"kind": "round", "radius_um": 2}


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({}, "n is missing; it must be a whole number of 1 or more"),
        ({"n": True}, "n is True; it must be a whole number of 1 or more"),
        ({"n": 1, "vaules": 2},
         "unknown key 'vaules'; did you mean 'values'? known: n, plate, best, shift, weights, values, pair, more"),
        ({"n": 1, "best": 3}, "best is 3; it must be a table, [best]"),
        ({"n": 1, "best": {"kind": "round"}}, "[best] radius_um is missing; it must be a finite number above 0 µm"),
        ({"n": 1, "plate": [ROUND, {"kind": "round", "radius_um": 0}]},
         "[plate 2] radius_um is 0; it must be a finite number above 0 µm"),
        ({"n": 1, "plate": [{"kind": "sqare"}]},
         "[plate 1] kind is 'sqare'; did you mean 'square'? it must be one of round, square"),
        ({"n": 1, "plate": [{}]}, "[plate 1] kind is None; it must be one of round, square"),
        ({"n": 1, "plate": [4]}, "plate.0 is 4; it must be a table, [plate 1]"),
        ({"n": 1, "plate": [{"kind": "square", "side_um": -1}]}, "[plate 1] side_um is -1: turn it round"),
        ({"n": 1, "plate": [{"kind": "square", "sid_um": 1}]},
         "[plate 1] unknown key 'sid_um'; did you mean 'side_um'? known: kind, side_um, corner"),
        ({"n": 1, "plate": [{"kind": "square", "corner": 3}]}, "[plate 1] corner is 3; it must be sharp or blunt"),
        ({"n": 1, "shift": {"D": {"kind": "round", "radius_um": "2"}}},
         "[shift.D] radius_um is '2'; it must be a finite number above 0 µm"),
        ({"n": 1, "weights": {"D": "a"}}, "[weights] D is 'a'; it must be a finite number"),
        ({"n": 1, "weights": 3}, "weights is 3; it must be a table of keys"),
        ({"n": 1, "values": [1, True]}, "values.1 is True; it must be a finite number"),
        ({"n": 1, "values": "abc"}, "values is 'abc'; it must be a list, each entry a finite number"),
        ({"n": 1, "pair": ["a", "b"]}, "pair.1 is 'b'; it must be a finite number"),
        ({"n": 1, "more": {"name": "a", "x": float("nan")}}, "[more] x is nan; it must be a finite number"),
        ({"n": 1, "more": {}}, "[more] name is missing; it must be a text"),
        (3, "3 is no table; it must have the keys n, plate, best, shift, weights, values, pair, more"),
        ({3: 1}, "3 is no key; it must be a text"),
    ],
)  # fmt: skip
def test_a_message_says_where_what_was_got_and_what_is_allowed(table: Any, said: str) -> None:
    with pytest.raises(OwnError) as e:
        checked(Plates, table, OwnError)
    assert str(e.value) == said
    with pytest.raises(OwnError) as e:
        checked(Plates, table, OwnError, "[file] ")
    assert str(e.value) == "[file] " + said


def test_what_is_right_is_taken_and_whole_numbers_are_numbers() -> None:
    found = checked(Plates, {"n": 2, "plate": [ROUND], "values": [1, 2.5], "weights": {"a": 1}}, OwnError)
    assert found == Plates(n=2, plate=(Round(kind="round", radius_um=2.0),), values=(1.0, 2.5), weights={"a": 1.0})
    assert isinstance(found.values[0], float)


def test_thousands_of_mistakes_are_one_bounded_line() -> None:
    with pytest.raises(OwnError) as e:
        checked(Plates, {"n": 1, "values": ["x" * 5000] * 3000}, OwnError)
    assert "\n" not in str(e.value)
    assert str(e.value).count("; values.") == MOST_PROBLEMS - 1
    assert str(e.value).endswith(f"; and {3000 - MOST_PROBLEMS:,} problems more")
    assert len(str(e.value)) < 250 * MOST_PROBLEMS


def test_every_mistake_is_in_the_message() -> None:
    with pytest.raises(OwnError, match=r"^n is 0; .*; \[best\] radius_um is -1; .*µm$"):
        checked(Plates, {"n": 0, "best": {"kind": "round", "radius_um": -1}}, OwnError)


def test_who_makes_one_in_python_gets_the_same_error() -> None:
    with pytest.raises(OwnError, match=r"^n is 0; it must be a whole number of 1 or more$"):
        Plates(n=0)
