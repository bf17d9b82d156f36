"""Owns one small finished campaign that the tests of exports, scripts and documentation read."""

from __future__ import annotations

from pathlib import Path

from softclose.config import load_config
from softclose_store import DriverStore
from softclose_workflows.run.campaign import Driver
from softclose_workflows.run.creation import create_store
from softclose_workflows.run.executors.serial import SerialExecutor

SETTINGS = (
    "campaign.budget=12",
    "population.n_switches=200",
    "store.n_times=251",
    "store.max_impacts=8",
    "optimiser.n_initial=10",
)


def make_finished(path: Path, *settings: str) -> Path:
    """Run the small campaign in this process, without Dask; returns path."""
    create_store(load_config("current", (*SETTINGS, *settings)), str(path))
    with DriverStore(path) as store:
        Driver(store, SerialExecutor()).run()
    return path
