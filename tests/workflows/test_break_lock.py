"""Claims about `--break-lock`: it takes a store from a driver that holds it, and only it does."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from click.testing import CliRunner

from small_campaigns import COARSE, make_campaign
from softclose_store import DriverStore, LockedError, open_campaign
from softclose_workflows.cli import main
from softclose_workflows.run.campaign import Driver
from softclose_workflows.run.executors import Placement, open_executor


def test_a_store_that_is_driven_is_refused_unless_its_lock_is_broken(tmp_path: Path) -> None:
    path = make_campaign(tmp_path / "a.zarr", *COARSE, "campaign.budget=3", run=False)
    resume = ["resume", path, "--serial", "--quiet"]
    with DriverStore(path) as held, open_executor(Placement(serial=True)) as executor:
        refused = CliRunner().invoke(main, resume)
        assert refused.exit_code == 2
        told = " ".join(refused.stderr.split())
        assert f"is being driven by process {os.getpid()}" in told
        assert "wait for it, or, if you are sure that it is gone, take the store with --break-lock" in told
        assert "folder" not in told  # another one would hold half of the same campaign
        assert open_campaign(path).committed == 0
        taken = CliRunner().invoke(main, [*resume, "--break-lock"])
        assert taken.exit_code == 0, taken.output
        assert open_campaign(path).committed == 3
        # The old driver finds that the store is no longer its own before it writes anything.
        with pytest.raises(LockedError, match="was broken"):
            Driver(held, executor).run()
    assert open_campaign(path).committed == 3
