"""Fixtures that several folders of tests share, and what CI demands of tests that need a system package."""

from __future__ import annotations

import gc
import logging
import os
import uuid
from collections.abc import Generator
from pathlib import Path

import pytest
from hypothesis import settings
from hypothesis.internal.conjecture import providers

from examples import examples, is_whole
from not_run import (  # noqa: F401 - hooks of pytest
    pytest_deselected,
    pytest_sessionfinish,
    pytest_terminal_summary,
    pytest_testnodedown,
)
from programs import require

# Examples are a function of the test: by default they take constants out of whichever modules of ours are loaded, and
# differ from process to process and with every line of code.
providers._get_local_constants = lambda: providers._local_constants  # type: ignore[attr-defined]
# A deadline is a claim about the machine: on a busy one the same example passes the next time.
settings.register_profile("softclose", deadline=None, max_examples=examples(100))
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


@pytest.fixture
def ngspice() -> str:
    """The circuit simulator."""
    return require("ngspice")


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """What is made while tests are collected stays to the end: nobody looks through it for what could be freed."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Properties, and what says that it is sampled, are tried again in `make long`, on all their cases."""
    for item in items:
        is_property = getattr(getattr(item, "obj", None), "is_hypothesis_test", False)
        if is_whole() and (is_property or item.get_closest_marker("sampled")):
            item.add_marker("long")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Where SOFTCLOSE_REQUIRE_ALL is set, as in CI, a test skipped because something is not installed has failed."""
    report = yield
    if report.skipped and os.environ.get("SOFTCLOSE_REQUIRE_ALL") and "not installed" in str(report.longrepr):
        report.outcome = "failed"
        report.longrepr = f"{item.nodeid} may not be skipped here (SOFTCLOSE_REQUIRE_ALL): {report.longrepr}"
    return report


@pytest.fixture(scope="session")
def s3_endpoint() -> Generator[str, None, None]:
    """The address of an S3 service of the tests' own, empty."""
    from moto.server import ThreadedMotoServer

    logging.getLogger("werkzeug").setLevel(logging.ERROR)  # a line for each request
    server = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    yield f"http://{host}:{port}"
    server.stop()


@pytest.fixture
def s3(s3_endpoint: str, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> str:
    """URL of a folder that no other test uses, in a bucket of that service; the environment names the service."""
    from urllib.request import Request, urlopen

    settings = {"AWS_ENDPOINT_URL": s3_endpoint, "AWS_REGION": "us-east-1"}
    settings |= {"AWS_ACCESS_KEY_ID": "tests", "AWS_SECRET_ACCESS_KEY": "tests"}
    for name, value in settings.items():
        monkeypatch.setenv(name, value)
    urlopen(Request(f"{s3_endpoint}/bucket", method="PUT")).close()
    return f"s3://bucket/{uuid.uuid4().hex[:8]}-{request.node.name[:20]}"
