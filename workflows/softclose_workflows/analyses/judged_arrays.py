"""Owns what is stored of switches that were judged: their results as arrays of a group, and the figures beside them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softclose.evaluate.gathered import put_aside
from softclose.evaluate.quantities import Quantity, Value, quantity
from softclose.metrics.objective import Assessment, Judged
from softclose_store import GroupArray
from softclose_store.schema.fields import RESULTS, PopulationColumn, asked_fields
from softclose_workflows.run import records

ASKED = "switch_"
"""What arrays of further quantities of each switch begin with; those without it are of the lot."""

_COLUMNS: dict[str, tuple[str, str, str]] = {
    "max_contact_speed": ("max_contact_speed", "µm/µs", "V of Eq. 7; NaN: never touched"),
    "closed": ("closed", "1", "held in contact at the horizon"),
    "status": ("status", "1", "outcome of the integration; 0: ok"),
    "settling": ("settling_us", "µs", "instant from which it is held to the horizon; inf: never, NaN: not known"),
    "first_contact": ("first_contact_us", "µs", "instant of the first contact; inf: never"),
    "n_impacts": ("n_impacts", "1", "number of impacts"),
}
"""Array -> what it is of a response, unit, meaning."""
_UNTOLD = ("first_contact", "n_impacts")
"""What a device model may not tell."""


def response_arrays(
    responses: Sequence[Judged], dims: tuple[str, str], further: Sequence[Quantity], prefix: str = ""
) -> dict[str, GroupArray]:
    """What switches did, a row a response.

    Parameters
    ----------
    responses : sequence of Judged
        (n,) switches each.
    dims : tuple of str
        What rows and switches are called.
    further : sequence of Quantity
        What else the campaign asks for, as `Judged.asked` has it.
    prefix : str
        Before every array's name.

    Returns
    -------
    dict of str to GroupArray
        What no response tells has no array, but for `settling`, which is NaN.
    """
    found: dict[str, GroupArray] = {}
    for name, (attribute, unit, meaning) in _COLUMNS.items():
        columns = [getattr(r, attribute) for r in responses]
        if name == "settling":
            columns = [np.full(r.closed.shape, math.nan) if r.settling_us is None else r.settling_us for r in responses]
        if all(values is not None for values in columns):
            found[f"{prefix}{name}"] = GroupArray(dims=dims, values=Stacked(columns), unit=unit, long_name=meaning)
    for k, q in enumerate(further):
        of_each = Stacked([r.asked[:, k] for r in responses if r.asked is not None])
        found[f"{prefix}{ASKED}{q.name}"] = GroupArray(dims=dims, values=of_each, unit=q.unit, long_name=q.long_name)
    return found


class Stacked:
    """Columns of n switches, one above the other where they are read (`softclose_store.groups.Blocks`)."""

    def __init__(self, rows: Sequence[NDArray[Any]]) -> None:
        self._rows = rows
        self.shape = len(rows), len(rows[0])
        self.dtype = np.result_type(*rows)

    def block(self, where: tuple[slice, ...]) -> NDArray[Any]:
        """The values there; what lies in a file is taken out of memory again."""
        which, columns = where
        found = np.stack([row[columns] for row in self._rows[which]])
        put_aside(*self._rows[which])
        return found


def response_of(arrays: Mapping[str, NDArray[Any]], i: int, further: Sequence[Quantity], prefix: str = "") -> Judged:
    """The inverse of `response_arrays` of row i; what no response told is None."""
    columns: dict[str, Any] = {
        attribute: None if name in _UNTOLD and f"{prefix}{name}" not in arrays else arrays[f"{prefix}{name}"][i]
        for name, (attribute, _, _) in _COLUMNS.items()
    }
    of_each = [arrays[f"{prefix}{ASKED}{q.name}"][i] for q in further]
    return Judged(**columns, asked=np.stack(of_each, axis=-1) if further else None)


def figure_arrays(
    judged: Sequence[tuple[Assessment, Mapping[str, Value]]], dim: str, prefix: str = ""
) -> dict[str, GroupArray]:
    """The figures of each row, under the names that the campaign's own records have.

    judged: assessments, each with further quantities by name, the same in all; dim: what rows are called.
    """
    names = judged[0][1]
    wanted = [PopulationColumn(n, quantity(n).unit, quantity(n).long_name) for n in names]
    fields = {field.name: field for field in (*RESULTS, *asked_fields(wanted))}
    rows = [records.assessment_record(a, values) for a, values in judged]
    found = {}
    for name, first in rows[0].items():
        if name not in ("failed", "failure"):
            dims = (dim, "limit") if isinstance(first, np.ndarray) else (dim,)
            field = fields[name]
            found[f"{prefix}{name}"] = GroupArray(
                dims=dims, values=np.array([row[name] for row in rows]), unit=field.unit, long_name=field.long_name
            )
    return found
