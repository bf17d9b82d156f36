"""Owns the small campaigns that tests of everything above the run loop read, run in this process, without Dask."""

from __future__ import annotations

from pathlib import Path

from softclose.config import load_config
from softclose_store import DriverStore
from softclose_workflows.run.campaign import Driver
from softclose_workflows.run.creation import create_store
from softclose_workflows.run.executors.serial import SerialExecutor

FINISHED = (
    "campaign.budget=12",
    "population.n_switches=200",
    "store.n_times=251",
    "store.max_impacts=8",
    "optimiser.n_initial=10",
)
"""Ten points of the design and two of the surrogate: what exports, reports, scripts and documentation show."""

COARSE = (
    "campaign.budget=8",
    "population.n_switches=80",
    "compute.block_switches=50",
    "store.n_times=11",
    "optimiser.engine=sobol",
    "explore.budget=0",
    "finish.budget=0",
)
"""Eight Sobol points, two blocks each, no surrogate to fit: for certification, rescoring and studies."""


def make_campaign(path: Path, *settings: str, run: bool = True) -> str:
    """The path of a campaign that has run to its end, or (run=False) has only been created."""
    create_store(load_config("current", settings), str(path))
    if run:
        with DriverStore(path) as store:
            Driver(store, SerialExecutor()).run()
    return str(path)
