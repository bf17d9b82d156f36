"""Shared stores of the workflow tests, made once a session."""

from __future__ import annotations

from pathlib import Path

import pytest

from campaigns import run_arguments, softclose


@pytest.fixture(scope="session")
def reference_store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small campaign, run serially and without interruption. Tests read it; none may change it."""
    store = tmp_path_factory.mktemp("reference") / "reference.zarr"
    done = softclose(*run_arguments(store), "--serial")
    assert done.returncode == 0, done.stderr
    return store
