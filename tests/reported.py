"""Owns what the tests of reports, figures and comparisons share: stores, one of a hostile name, and a browser."""

from __future__ import annotations

import functools
import shutil
import tempfile
from pathlib import Path

from small_campaigns import FINISHED, make_campaign

_SCRATCH = tempfile.TemporaryDirectory(prefix="softclose-reported-")

HOSTILE = "<script>alert(1)</script> %{x} & \u2028 {{ 7 * 7 }}"
"""A campaign's name is a stranger's text."""


@functools.cache
def hostile_store() -> str:
    """A finished campaign of eight candidates, three from the surrogate, with a hostile name. Read it only."""
    folder = Path(_SCRATCH.name)
    settings = ("campaign.budget=8", "prior.model=none", "optimiser.n_initial=5", f"campaign.name={HOSTILE}")
    return make_campaign(folder / "hostile.zarr", *FINISHED, *settings)


def empty_store(folder: Path) -> str:
    """A campaign that has just been created: not one candidate."""
    return make_campaign(folder / "empty.zarr", "campaign.budget=8", "population.n_switches=50", run=False)


def chromium() -> str | None:
    """Path of Debian's Chromium, or of a Chrome by another name; None where there is none."""
    names = ("chromium", "chromium-browser", "google-chrome")
    return next((path for name in names if (path := shutil.which(name))), None)
