"""Owns a law of one's own: stiffness and mass as formulas of a switch's gap, modulus and thickness."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softclose.population.distributions import PopulationError
from softclose.population.laws import Law
from softclose.tables import finite_number

FloatArray = NDArray[np.float64]

_INPUTS = ("G", "E", "T")
_NAME = re.compile(r"[A-Za-z]\w*")
_MOST_CHARACTERS = 1000


@dataclass(frozen=True, slots=True, kw_only=True)
class Formula:
    """Stiffness and mass of a switch in the place of Eqs. 4 and 6.

    Expressions as numexpr has them: + - * / ** and brackets, sqrt, exp, log, where and the like, of G [µm], E [GPa],
    T [µm], pi and the constants. numexpr refuses all else, so that a file of a stranger's computes and does nothing.
    """

    K: str
    """Stiffness [N/m]."""
    M: str
    """Mass [µg]."""
    constants: tuple[tuple[str, float], ...] = ()
    """Names that the formulas use, such as a length [µm], and their values."""

    def __post_init__(self) -> None:
        for name, value in self.constants:
            if not _NAME.fullmatch(name) or name in (*_INPUTS, "D", "K", "M", "pi"):
                raise PopulationError(
                    f"[law] cannot have a constant called {name!r}; a name is made of letters, digits and _, and D, G, "
                    "E, T, K, M and pi are taken"
                )
            finite_number(f"[law] {name}", value, PopulationError)
        known = {*_INPUTS, "pi", *(name for name, _ in self.constants)}
        for which, text in (("K", self.K), ("M", self.M)):
            unknown = sorted(_names(which, text) - known)
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
            rests_on_gap="G" in _names("K", self.K) | _names("M", self.M),
        )

    def _of(self, which: str, text: str, g: FloatArray, e: FloatArray, t: FloatArray) -> FloatArray:
        import numexpr

        g, e, t = np.broadcast_arrays(g, e, t)
        values: dict[str, Any] = {"G": g, "E": e, "T": t, "pi": math.pi, **dict(self.constants)}
        used = {name: np.asarray(values[name], dtype=np.float64) for name in _names(which, text)}
        try:
            found = numexpr.evaluate(text, local_dict=used, global_dict={}, sanitize=True)
        except Exception as x:  # numexpr lets through whatever a formula stumbles over
            raise PopulationError(f"[law] {which} = {text!r} cannot be computed: {x}") from x
        found = np.broadcast_to(np.asarray(found, dtype=np.float64), g.shape)
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
        for which in ("K", "M"):
            if not isinstance(table.get(which), str):
                raise PopulationError(
                    f"[law] {which} is {table.get(which)!r}; it must be a formula in quotes, such as "
                    '"1e3 * E * W * T**3 / (4 * L**3)"'
                )
        constants = tuple((str(n), v) for n, v in table.items() if n not in ("K", "M"))
        return cls(K=table["K"], M=table["M"], constants=constants)


@lru_cache(maxsize=64)
def _names(which: str, text: str) -> frozenset[str]:
    """Names that a formula uses. Raises PopulationError where it is none."""
    from numexpr.necompiler import getExprNames

    if len(text) > _MOST_CHARACTERS:
        raise PopulationError(f"[law] {which} has {len(text)} characters; at most {_MOST_CHARACTERS}")
    try:
        return frozenset(getExprNames(text, {}, sanitize=True)[0])
    except Exception as x:  # a syntax error, or whatever numexpr refuses
        raise PopulationError(f"[law] {which} = {text!r} is no formula: {x}") from x
