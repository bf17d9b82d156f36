"""Do workers idle for lack of tasks? A device model that sleeps for 0.1 s a switch, and many workers.

python benchmarks/sleeping.py [--workers 32] [--switches 64] [--candidates 80] [--fresh 640] [--runs sobol:1 skopt:3 …]

It takes no processor time to speak of, so that a laptop may stand for a cluster: workers are threads of this process.
Busy is what the workers slept over workers times wall time, start-up and the search for the prior's basins apart. A run
is an engine and `campaign.lag`: one whose waves are known beforehand (sobol), one of descents (cmaes), the Gaussian
process that starts from a prior (skopt); then a certification.
"""

from __future__ import annotations

import argparse
import tempfile
import threading
import time
from importlib import import_module
from pathlib import Path
from typing import Any

import softclose
from softclose.settings import load_config
from softclose_store import DriverStore
from softclose_workflows.analyses.certify import certify
from softclose_workflows.run.campaign import Driver
from softclose_workflows.run.creation import create_store
from softclose_workflows.run.crew import Crew
from softclose_workflows.run.executors.threads import ThreadExecutor
from softclose_workflows.run.prior import PriorOfStore

SECONDS = 0.1
_slept, _lock = [0.0], threading.Lock()


def asleep(switches: Any, waveform: Any, **settings: Any) -> softclose.Responses:
    """Eqs. 1-2, slowly."""
    found = softclose.simulate(switches, waveform, **settings)
    time.sleep(SECONDS * len(found.status))
    with _lock:
        _slept[0] += SECONDS * len(found.status)
    return found


asleep.seconds_a_trajectory = SECONDS  # type: ignore[attr-defined]


def told(what: str, workers: int, wall: float) -> None:
    """One row of the table."""
    print(f"| {what} | {_slept[0] / SECONDS:,.0f} | {wall:.1f} | {_slept[0] / (workers * wall):.1%} |", flush=True)
    _slept[0] = 0.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--workers", type=int, default=32)
    parser.add_argument("--switches", type=int, default=64)
    parser.add_argument("--candidates", type=int, default=80)
    parser.add_argument("--fresh", type=int, default=640)
    parser.add_argument("--runs", nargs="*", default=["sobol:1", "cmaes:1", "cmaes:2", "skopt:1", "skopt:2", "skopt:3"])
    options = parser.parse_args()
    softclose.allow_code("sleeping:asleep")
    print("| work | trajectories | wall time, s | busy |\n| --- | ---: | ---: | ---: |")
    with tempfile.TemporaryDirectory() as folder:
        executor = ThreadExecutor(options.workers)
        for engine, lag in (run.split(":") for run in options.runs):
            config = load_config(
                "current",
                [
                    "model.name=sleeping:asleep",
                    f"optimiser.engine={engine}",
                    f"campaign.lag={lag}",
                    f"campaign.budget={options.candidates}",
                    f"population.n_switches={options.switches}",
                    "store.n_times=11",
                ],
            )
            path = str(Path(folder) / f"{engine}-{lag}.zarr")
            create_store(config, path)
            if config.has_prior:
                PriorOfStore(path, config, keeps=True).basins()
            _slept[0] = 0.0
            with DriverStore(path) as store:
                driver = Driver(store, executor)
                driver.run()
            told(f"{engine}, lag {lag}, blocks of {config.block_switches}", options.workers, driver.spent.wall)
        began = time.perf_counter()
        certify(path, n_switches=options.fresh, top=2, mapper=Crew(lambda: executor))
        told("certificate", options.workers, time.perf_counter() - began)
        executor.close()


if __name__ == "__main__":
    import_module("sleeping").main()  # by the name that the model has, so that there is one clock
