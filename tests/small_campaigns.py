"""Owns the small campaigns that tests of everything above the run loop read, run in this process, without Dask."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

from softclose.settings import load_config
from softclose_store import DriverStore
from softclose_workflows.analyses.certify import certify
from softclose_workflows.errors import Stopped
from softclose_workflows.run.campaign import Driver
from softclose_workflows.run.creation import create_store
from softclose_workflows.run.executors.protocol import Event
from softclose_workflows.run.executors.serial import SerialExecutor
from softclose_workflows.run.tasks import BlockTask

FINISHED = (
    "campaign.budget=12",
    "prior.model=none",
    "population.n_switches=200",
    "store.n_times=251",
    "store.max_impacts=8",
    "optimiser.n_initial=10",
)
"""Ten points of the design and two of the surrogate: what exports, reports, scripts and documentation show."""

COARSE = (
    "campaign.budget=8",
    "prior.model=none",
    "population.n_switches=80",
    "compute.block_switches=50",
    "store.n_times=11",
    "optimiser.engine=sobol",
    "explore.budget=0",
    "finish.budget=0",
)
"""Eight Sobol points, two blocks each, no surrogate to fit: for certification, rescoring and studies."""

COMPLETE = (
    "campaign.budget=6",
    "prior.model=none",
    "population.n_switches=40",
    "compute.block_switches=80",
    "store.n_times=11",
    "store.max_impacts=3",
    "optimiser.n_initial=4",
    "optimiser.batch=2",
    "optimiser.n_candidates=64",
    "explore.budget=16",
    "explore.n_descents=2",
    "explore.generation=4",
    "explore.n_scouts=4",
    "finish.budget=6",
    "finish.n_switches=100",
    "finish.n_basins=2",
)
"""Everything that a store can hold, as small as it gets: three stages in eight waves, a surrogate, blocks of one, two
and half a candidate. A third of a second."""


class Halting(SerialExecutor):
    """Computes so many blocks; then the run ends, with whatever is in flight."""

    def __init__(self, blocks: int | None = None) -> None:
        super().__init__()
        self.left = blocks

    def next_event(self, timeout_s: float) -> Event | None:
        """The next block, or the end."""
        if self.left == 0:
            raise Stopped("as many blocks as were asked for")
        self.left = None if self.left is None else self.left - 1
        return super().next_event(timeout_s)


def make_complete(path: Path, *settings: str, blocks: int | None = None) -> str:
    """A campaign with two certifications and an entry of who ran it; blocks: how many are computed, all by default."""
    create_store(load_config("current", (*COMPLETE, *settings)), str(path))
    finish(path, blocks)
    certify(str(path), n_switches=100, top=2)
    certify(str(path), n_switches=120, top=1, seed=5)
    return str(path)


def finish(path: Path, blocks: int | None = None) -> None:
    """Go on with a campaign to its end, or for so many blocks."""
    with DriverStore(path) as store:
        store.note_run({"host": "here"})
        with contextlib.suppress(Stopped):
            Driver(store, Halting(blocks)).run()


def make_campaign(path: Path, *settings: str, run: bool = True, preset: str = "current") -> str:
    """The path of a campaign that has run to its end, or (run=False) has only been created."""
    create_store(load_config(preset, settings), str(path))
    if run:
        with DriverStore(path) as store:
            Driver(store, SerialExecutor()).run()
    return str(path)


def block_task(**given: Any) -> BlockTask:
    """A task of one block, of no waveform and one switch but for what is given."""
    least: dict[str, Any] = {"store": "", "fingerprint": "", "stage": "search", "row": 0, "column": 0, "first": 0}
    least |= {"start": 0, "stop": 1, "waveforms": (), "proposals_digest": 0}
    return BlockTask(**(least | given))
