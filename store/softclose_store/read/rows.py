"""Owns rows of a stored array that are read when they are indexed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Take = Callable[[NDArray[np.intp] | slice], NDArray[Any]]
"""Switches, as indices or as a slice of a positive step, -> their rows, (n, …)."""


class LazyRows:
    """Rows of one candidate's array, read when indexed: `x[10:20]`, `x[5, ::10]`, `x[...]`.

    take: reads rows; name: for people; shape: (n_switches, …); column: one entry of the last dimension, where that
    holds columns.
    """

    def __init__(self, take: Take, name: str, shape: tuple[int, ...], dtype: Any, column: int | None = None) -> None:
        self._take = take
        self._name = name
        self._column = column
        self.shape: tuple[int, ...] = shape if column is None else shape[:-1]
        """(n_switches, …)."""
        self.dtype = np.dtype(dtype)
        """Type of the elements."""

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, selection: Any) -> NDArray[Any]:
        first, *rest = selection if isinstance(selection, tuple) else (selection,)
        n = self.shape[0]
        if first is Ellipsis:
            first = slice(None)
        if isinstance(first, int | np.integer):
            if not -n <= first < n:
                raise IndexError(f"switch {first} is outside the {n} of this candidate")
            at = int(first) % n
            return np.asarray(self._of(slice(at, at + 1, 1), rest)[0])
        if isinstance(first, slice):
            start, stop, step = first.indices(n)
            if step < 0:
                return self._of(slice(0, n, 1), rest)[first]
            return self._of(slice(start, max(start, stop), step), rest)
        rows = np.asarray(first)
        rows = np.flatnonzero(rows) if rows.dtype == bool else np.where(rows < 0, rows + n, rows)
        if rows.size and (rows.min() < 0 or rows.max() >= n):
            raise IndexError(f"switches {rows.min()} to {rows.max()} are not all among the {n} of this candidate")
        return self._of(rows.astype(np.intp), rest)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return np.asarray(self[...], dtype=dtype)

    def _of(self, rows: NDArray[np.intp] | slice, rest: list[Any]) -> NDArray[Any]:
        """Rows, and of each what was asked for behind the switches: whole where nothing was said."""
        found = self._take(rows)
        if self._column is not None:
            found = found[..., self._column]
        return np.asarray(found[(slice(None), *rest)] if rest else found)

    def __repr__(self) -> str:
        return f"LazyRows({self._name}, shape={self.shape}, dtype={self.dtype})"
