"""Owns the small finished store that tests of the store damage: made once a module, copied for each test."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from small_store import create, run


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """All eight candidates; not to be changed."""
    path = tmp_path_factory.mktemp("whole") / "a.zarr"
    create(path)
    run(path)
    return path


@pytest.fixture
def store(whole: Path, tmp_path: Path) -> Path:
    """A copy of it, to be damaged."""
    return Path(shutil.copytree(whole, tmp_path / "a.zarr"))
