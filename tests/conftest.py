"""Fixtures that several folders of tests share, and what CI demands of tests that need a system package."""

from __future__ import annotations

import os
import shutil
from collections.abc import Generator
from pathlib import Path

import pytest
from hypothesis import settings

# A deadline is a claim about the machine: on a busy one the same example passes the next time.
settings.register_profile("softclose", deadline=None)
settings.load_profile("softclose")


@pytest.fixture(scope="session")
def finished_store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished campaign of twelve candidates on two hundred switches. Read it, don't write to it."""
    from small_campaigns import FINISHED, make_campaign

    return Path(make_campaign(tmp_path_factory.mktemp("finished") / "small.zarr", *FINISHED))


@pytest.fixture(scope="session")
def another_store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A second one, of another seed and shorter."""
    from small_campaigns import FINISHED, make_campaign

    settings = ("campaign.seed=2", "campaign.budget=6", "campaign.name=another seed")
    return Path(make_campaign(tmp_path_factory.mktemp("another") / "other.zarr", *FINISHED, *settings))


def require(program: str) -> str:
    """The path of a system program; without it the test is skipped by name."""
    found = shutil.which(program)
    if found is None:
        pytest.skip(f"{program} is not installed")
    return found


@pytest.fixture
def ngspice() -> str:
    """The circuit simulator."""
    return require("ngspice")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Where SOFTCLOSE_REQUIRE_ALL is set, as in CI, a test skipped because something is not installed has failed."""
    report = yield
    if report.skipped and os.environ.get("SOFTCLOSE_REQUIRE_ALL") and "not installed" in str(report.longrepr):
        report.outcome = "failed"
        report.longrepr = f"{item.nodeid} may not be skipped here (SOFTCLOSE_REQUIRE_ALL): {report.longrepr}"
    return report
