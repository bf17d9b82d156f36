"""Claims about values of a group that are put together where they are read: a block at a time, the same files."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from numpy.typing import NDArray

from softclose_store import GroupArray, StoreError, groups, read_group, write_group

GROUP = "certification/9-1"


class Watched:
    """Values that count how often each is asked for, and how many at once."""

    def __init__(self, values: NDArray[Any]) -> None:
        self._values = values
        self.shape, self.dtype = values.shape, values.dtype
        self.asked = np.zeros(values.shape, dtype=int)
        self.most = 0

    def block(self, where: tuple[slice, ...]) -> NDArray[Any]:
        self.asked[where] += 1
        self.most = max(self.most, self.asked[where].size)
        return self._values[where]


def files(store: Path) -> dict[str, bytes]:
    return {str(p.relative_to(store)): p.read_bytes() for p in sorted((store / GROUP).rglob("*")) if p.is_file()}


def written(store: Path, values: Any, **others: Any) -> dict[str, bytes]:
    arrays = {"speed": GroupArray(dims=("design", "fresh_switch"), values=values, unit="µm/µs")}
    arrays |= {name: GroupArray(dims=("k",) * np.ndim(v), values=v) for name, v in others.items()}
    write_group(store, GROUP, arrays, {"n": 9}, replace=True)
    return files(store)


@pytest.mark.parametrize("shape", [(3, 200_000), (1, 65_536), (2, 65_537), (2, 5)])
def test_values_are_read_once_each_and_a_few_chunks_at_a_time(
    store: Path, shape: tuple[int, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    values = np.random.default_rng(1).random(shape)
    others: dict[str, Any] = {"alone": np.float64(3.0), "empty": np.empty(0), "name": np.array(["a", "µ"])}
    whole = written(store, values, **others)
    assert_array_equal(read_group(store, GROUP).arrays["speed"], values)
    monkeypatch.setattr(groups, "MOST_CHUNK", 65_536)
    for together in (1, 2 * 8 * shape[0] * 65_536):
        monkeypatch.setattr(groups, "TOGETHER_BYTES", together)
        watched = Watched(values)
        assert written(store, watched, **others) == whole
        assert (watched.asked == 1).all()
        chunk = shape[0] * min(shape[1], 65_536)
        assert watched.most <= max(together // 8, chunk)
    assert math.prod(read_group(store, GROUP).arrays["empty"].shape) == 0


def test_values_of_no_number_are_refused_before_a_file_is_touched(store: Path) -> None:
    before = written(store, np.ones((2, 3)))
    watched = Watched(np.ones((2, 3), dtype=complex))
    with pytest.raises(StoreError, match="complex128; it must be numbers or text"):
        written(store, watched)
    assert not watched.asked.any()
    assert files(store) == before
