"""Owns what the tests of reports, figures and comparisons share: stores, one of a hostile name, and a browser."""

from __future__ import annotations

import functools
import shutil
import tempfile
from pathlib import Path

from finished import make_finished
from softclose.config import load_config
from softclose_workflows.run.creation import create_store

_SCRATCH = tempfile.TemporaryDirectory(prefix="softclose-reported-")

HOSTILE = "<script>alert(1)</script> %{x} & \u2028 {{ 7 * 7 }}"
"""A campaign's name is a stranger's text."""


@functools.cache
def hostile_store() -> str:
    """A finished campaign of eight candidates, three from the surrogate, with a hostile name. Read it only."""
    folder = Path(_SCRATCH.name)
    return str(
        make_finished(folder / "hostile.zarr", "campaign.budget=8", "optimiser.n_initial=5", f"campaign.name={HOSTILE}")
    )


def empty_store(folder: Path) -> str:
    """A campaign that has just been created: not one candidate."""
    path = str(folder / "empty.zarr")
    create_store(load_config("current", ["campaign.budget=8", "population.n_switches=50"]), path)
    return path


def chromium() -> str | None:
    """Path of Debian's Chromium, or of a Chrome by another name; None where there is none."""
    names = ("chromium", "chromium-browser", "google-chrome")
    return next((path for name in names if (path := shutil.which(name))), None)
