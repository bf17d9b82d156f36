"""Owns rows of a stored array that are read when they are indexed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray

from softclose_store.errors import DamageError


class LazyRows:
    """Rows of one candidate's array, read when indexed: `x[10:20]`, `x[5, ::10]`, `x[...]`.

    i: the candidate in its stage; n: its switches; column: one entry of the last dimension, where that holds columns.
    """

    def __init__(self, array: zarr.Array[Any], i: int, n: int, column: int | None = None) -> None:
        self._array = array
        self._i = i
        self._column = column
        self.shape: tuple[int, ...] = (n, *array.shape[2:]) if column is None else (n, *array.shape[2:-1])
        """(n_switches, …)."""
        self.dtype = array.dtype
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
            return self._read((int(first) % n, *rest))
        if isinstance(first, slice):
            start, stop, step = first.indices(n)
            if step < 0:
                return self._read((slice(0, n), *rest))[first]
            return self._read((slice(start, stop, step), *rest))
        rows = np.asarray(first)
        rows = np.flatnonzero(rows) if rows.dtype == bool else np.where(rows < 0, rows + n, rows)
        if rows.size and (rows.min() < 0 or rows.max() >= n):
            raise IndexError(f"switches {rows.min()} to {rows.max()} are not all among the {n} of this candidate")
        return self._guard(lambda: self._array.oindex[(self._i, rows, *self._rest(rest))])

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return np.asarray(self[...], dtype=dtype)

    def _read(self, selection: tuple[Any, ...]) -> NDArray[Any]:
        first, *rest = selection
        return self._guard(lambda: self._array[(self._i, first, *self._rest(rest))])

    def _rest(self, given: Sequence[Any]) -> list[Any]:
        """What to read behind the switches: whole where nothing was said."""
        rest = [*given, *[slice(None)] * (len(self.shape) - 1 - len(given))]
        return rest if self._column is None else [*rest, self._column]

    def _guard(self, read: Any) -> NDArray[Any]:
        try:
            return np.asarray(read())
        except (ValueError, RuntimeError, OSError) as e:
            raise DamageError(
                f"{self._array.name} of candidate {self._i} cannot be read ({type(e).__name__}: {e}): "
                "run `softclose verify`"
            ) from e

    def __repr__(self) -> str:
        return f"LazyRows({self._array.name}[{self._i}], shape={self.shape}, dtype={self.dtype})"
