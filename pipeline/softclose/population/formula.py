"""Owns a law of one's own: stiffness and mass as formulas of a switch's gap, modulus and thickness."""

from __future__ import annotations

import keyword
import math
import re
from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict
from pydantic.dataclasses import dataclass

from softclose.allowed.refusal import Said
from softclose.allowed.tables import TABLE, Number, checked, refuses_with
from softclose.arrays import FloatArray
from softclose.population.distributions import PopulationError
from softclose.population.expression import FUNCTIONS, Expression, ExpressionError, parsed
from softclose.population.laws import Law

_INPUTS = ("G", "E", "T")
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_TAKEN = frozenset({*_INPUTS, "D", "K", "M", "pi", *FUNCTIONS, *keyword.kwlist})


FormulaText = Annotated[str, Said('a formula in quotes, such as "1e3 * E * W * T**3 / (4 * L**3)"')]


class LawTable(BaseModel):
    """`[law]` of a file: two formulas, and the constants that they use."""

    model_config = ConfigDict(extra="allow", allow_inf_nan=False)
    __pydantic_extra__: dict[str, Number]

    K: FormulaText
    """Stiffness [N/m]."""
    M: FormulaText
    """Mass [µg]."""


@refuses_with(PopulationError)
@dataclass(frozen=True, slots=True, kw_only=True, config=TABLE)
class Formula:
    """Stiffness and mass of a switch in the place of Eqs. 4 and 6.

    Expressions (`softclose.population.expression`) of G [µm], E [GPa], T [µm], pi and the constants: + - * / ** and
    brackets, sqrt, exp, log, where and the like, and nothing else.
    """

    K: FormulaText
    """Stiffness [N/m]."""
    M: FormulaText
    """Mass [µg]."""
    constants: tuple[tuple[str, Number], ...] = ()
    """Names that the formulas use, such as a length [µm], and their values."""

    def __post_init__(self) -> None:
        for name, _ in self.constants:
            if not _NAME.fullmatch(name) or name in _TAKEN:
                raise PopulationError(
                    f"[law] cannot have a constant called {name!r}; a name is made of letters A to z, digits and _, "
                    "and D, G, E, T, K, M, pi, the functions and Python's own words are taken"
                )
        known = {*_INPUTS, "pi", *(name for name, _ in self.constants)}
        for which, text in (("K", self.K), ("M", self.M)):
            unknown = sorted(_parsed(which, text).names - known)
            if unknown:
                raise PopulationError(
                    f"[law] {which} = {text!r} names {', '.join(unknown)}; a formula may use {', '.join(sorted(known))}"
                )

    @property
    def law(self) -> Law:
        """As a population takes it."""
        return Law(
            variables=("E", "T"),
            switch=lambda g, e, t, area: (self._of("K", self.K, g, e, t), self._of("M", self.M, g, e, t)),
            rests_on_gap="G" in _parsed("K", self.K).names | _parsed("M", self.M).names,
        )

    def _of(self, which: str, text: str, g: FloatArray, e: FloatArray, t: FloatArray) -> FloatArray:
        g, e, t = np.broadcast_arrays(g, e, t)
        values: dict[str, Any] = {"G": g, "E": e, "T": t, "pi": math.pi, **dict(self.constants)}
        found = _parsed(which, text)(values)
        found = np.broadcast_to(found, g.shape)
        good = np.isfinite(found) & (found > 0.0)
        if not good.all():
            i = int(np.argmin(good.ravel()))
            raise PopulationError(
                f"[law] {which} = {text!r} is {found.ravel()[i]:g} at G {g.ravel()[i]:g} µm, E {e.ravel()[i]:g} GPa, "
                f"T {t.ravel()[i]:g} µm; it must be above 0"
            )
        return found

    def to_dict(self) -> dict[str, Any]:
        """The table of a file: K, M and the constants."""
        return {"K": self.K, "M": self.M, **dict(self.constants)}

    @classmethod
    def from_dict(cls, table: Mapping[str, Any]) -> Formula:
        """Inverse of `to_dict`, and the reader of a file's [law]. Raises PopulationError."""
        return cls.of(checked(LawTable, table, PopulationError, "[law] "))

    @classmethod
    def of(cls, law: LawTable) -> Formula:
        """The formulas of a table whose types are right."""
        return cls(K=law.K, M=law.M, constants=tuple((law.__pydantic_extra__ or {}).items()))


def _parsed(which: str, text: str) -> Expression:
    """Raises PopulationError where the text is no formula."""
    try:
        return parsed(text)
    except ExpressionError as e:
        shown = repr(text) if len(text) <= 200 else f"{text[:200]!r}…"
        raise PopulationError(f"[law] {which} = {shown} is no formula: {e}") from e
