"""Fixtures that several folders of tests share, and what CI demands of tests that need a system package."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def finished_store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished campaign of twelve candidates on two hundred switches. Read it, don't write to it."""
    from finished import make_finished

    return make_finished(tmp_path_factory.mktemp("finished") / "small.zarr")


@pytest.fixture(scope="session")
def another_store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A second one, of another seed and shorter."""
    from finished import make_finished

    return make_finished(
        tmp_path_factory.mktemp("another") / "other.zarr",
        "campaign.seed=2",
        "campaign.budget=6",
        "campaign.name=another seed",
    )


def require(program: str) -> str:
    """The path of a system program. Without it the test is skipped; with SOFTCLOSE_REQUIRE_ALL it fails."""
    found = shutil.which(program)
    if found is not None:
        return found
    if os.environ.get("SOFTCLOSE_REQUIRE_ALL"):
        pytest.fail(f"{program} is not installed, and SOFTCLOSE_REQUIRE_ALL is set")
    pytest.skip(f"{program} is not installed")


@pytest.fixture
def ngspice() -> str:
    """The circuit simulator."""
    return require("ngspice")
