"""Owns the small finished campaign of the certification, rescoring and study tests, run in this process."""

from __future__ import annotations

from pathlib import Path

from softclose.config import load_config
from softclose_store import DriverStore
from softclose_workflows.run.campaign import Driver
from softclose_workflows.run.creation import create_store
from softclose_workflows.run.executors import Placement, open_executor

SETTINGS = (
    "campaign.budget=8",
    "population.n_switches=80",
    "compute.block_switches=50",
    "store.n_times=11",
    "optimiser.engine=sobol",
    "explore.budget=0",
    "finish.budget=0",
)
"""Eight Sobol points, two blocks each: no surrogate to fit."""


def small_campaign(path: Path, *settings: str, run: bool = True) -> str:
    """The path of a campaign that has run to its end, or (run=False) has only been created."""
    create_store(load_config("current", (*SETTINGS, *settings)), str(path))
    if run:
        with DriverStore(str(path)) as store, open_executor(Placement(serial=True)) as executor:
            Driver(store, executor).run()
    return str(path)
